"""C and Python side by side on mutated bytes: the same verdict, the same values, or it stops with the input.

    python tests/firmware/fuzz_agree.py INPUTS [SEED] [CORPUS_DIRECTORY ...]

Three parsers in turn: air frames, messages of the host, and streams of framed messages. Deterministic given
the seed and the corpus.
"""

from __future__ import annotations

import random
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

from c_values import c_decode, exactly, ffi, lib
from fuzz_corpus import seeds
from rich.progress import track
from wire_values import plain

from hippomat_core.errors import WireError
from hippomat_core.wire import cobs, codec, link

LONGEST = 300  # bytes: longer than any frame
FROM_HOST = (link.Hello, link.SendBody, link.Provision, link.Command, link.AskPeers)
_INTERESTING = (0, 1, 2, 0x7F, 0x80, 0xFE, 0xFF)


class Disagreement(AssertionError):
    """C and Python differ; the message has parser and input."""


def mutated(data: bytes, others: Sequence[bytes], draw: random.Random) -> bytes:
    """`data` with up to four changes: bits, bytes, cuts, insertions, repetitions, pieces of another input."""
    out = bytearray(data)
    for _ in range(draw.randrange(5)):
        at = draw.randrange(len(out) + 1)
        kind = draw.randrange(6)
        if kind == 0 and at < len(out):
            out[at] ^= 1 << draw.randrange(8)
        elif kind == 1 and at < len(out):
            out[at] = draw.choice(_INTERESTING) if draw.random() < 0.5 else draw.randrange(256)
        elif kind == 2:
            del out[at : at + draw.randrange(1, 9)]
        elif kind == 3:
            out[at:at] = draw.randbytes(draw.randrange(1, 9))
        elif kind == 4:
            out[at:at] = out[at : at + draw.randrange(1, 20)]
        else:
            other = draw.choice(others)
            cut = draw.randrange(len(other) + 1)
            out[at:] = other[cut:]
    return bytes(out[:LONGEST])


def frames_agree(data: bytes) -> bool:
    """An air frame: header and plain body. True: it is one."""
    try:
        expected = codec.decode_frame(data)
    except WireError:
        expected = None
    found = c_decode(data)
    same = found is None if expected is None else plain(found) == plain(expected)
    valid = lib.rc_frame_valid(exactly(data), len(data))
    if not same or valid != (expected is not None):
        raise Disagreement(f"air frame {data.hex()}: C {found}, Python {expected}")
    if expected is not None and codec.encode_frame(*expected) != data:
        raise Disagreement(f"air frame {data.hex()} encodes to other bytes")
    return expected is not None


def c_host_message(data: bytes) -> link.LinkMessage | None:
    """A message of a host as link.c reads it."""
    raw, n = exactly(data), len(data)
    hello, send = ffi.new("rc_hello *"), ffi.new("rc_send *")
    provision, command = ffi.new("rc_provision *"), ffi.new("rc_command *")
    if lib.rc_hello_decode(raw, n, hello):
        who, rounds = hello.identity, hello.schedule
        return link.Hello(
            *(hello.link_version, who.robot, who.fleet, who.channel, rounds.round_ms, rounds.slots)
        )
    if lib.rc_send_decode(raw, n, send):
        return link.SendBody(send.kind, bytes(ffi.buffer(send.body, send.length)))
    if lib.rc_provision_decode(raw, n, provision):
        who, key = provision.identity, bytes(provision.key) if provision.keyed else b""
        rate = provision.rate_mbps
        return link.Provision(
            *(provision.link_version, who.robot, who.fleet, who.channel, rate, key, provision.unix_s)
        )
    if lib.rc_command_decode(raw, n, command):
        return link.Command(command.kind, command.counter, command.reason)
    return link.AskPeers() if lib.rc_ask_peers_decode(raw, n) else None


def messages_agree(data: bytes) -> bool:
    """A message of the host, as radio and Python read it; a radio's own messages only have to survive."""
    try:
        expected = link.decode_message(data)
    except WireError:
        expected = None
    if expected is not None and link.encode_payload(expected) != data:
        raise Disagreement(f"message {data.hex()} encodes to other bytes")
    found = c_host_message(data)
    if found != (expected if isinstance(expected, FROM_HOST) else None):
        raise Disagreement(f"message {data.hex()}: C {found}, Python {expected}")
    return expected is not None


def streams_agree(data: bytes) -> bool:
    """A stream of framed payloads."""
    python = cobs.FrameDecoder()
    expected = list(python.feed(data))
    decoder, found = ffi.new("rc_cobs_decoder *"), []
    for byte in data:
        size = lib.rc_cobs_push(decoder, byte)
        if size >= 0:
            found.append(bytes(ffi.buffer(decoder.buffer, size)))
    counts = (decoder.skipped_bytes, decoder.bad_checksums)
    if found != expected or counts != (python.skipped_bytes, python.bad_checksums):
        raise Disagreement(f"stream {data.hex()}: C {found} {counts}, Python {expected}")
    return bool(expected)


def corpora(directories: Sequence[Path]) -> list[tuple[Callable[[bytes], bool], list[bytes]]]:
    """Each parser with its seeds, and what a fuzzer left in directories of the targets' names."""
    own = seeds()
    payloads = [payload for data in own["fuzz_usb"] for payload in cobs.FrameDecoder().feed(data)]
    streams = list(own["fuzz_usb"])
    frames = list(own["fuzz_frame"])
    for directory in directories:
        frames += _files(directory / "fuzz_frame")
        streams += _files(directory / "fuzz_usb")
    return [(frames_agree, frames), (messages_agree, payloads), (streams_agree, streams)]


def _files(folder: Path) -> list[bytes]:
    paths = sorted(folder.iterdir()) if folder.is_dir() else []
    return [path.read_bytes()[:LONGEST] for path in paths]


def run(inputs: int, seed: int, directories: Sequence[Path] = (), *, quiet: bool = False) -> int:
    """How many of the inputs were valid; raises Disagreement."""
    draw = random.Random(f"agree {seed}")
    parsers = corpora(directories)
    valid = 0
    for number in track(range(inputs), "C beside Python", disable=quiet):
        agree, corpus = parsers[number % len(parsers)]
        valid += agree(mutated(draw.choice(corpus), corpus, draw))
    return valid


def main() -> int:
    inputs = int(sys.argv[1]) if len(sys.argv) > 1 else 1_000_000
    seed = int(sys.argv[2]) if len(sys.argv) > 2 else 1
    valid = run(inputs, seed, [Path(name) for name in sys.argv[3:]])
    print(f"{inputs} inputs, {valid} of them valid: C and Python agree on every one")
    return 0


if __name__ == "__main__":
    sys.exit(main())
