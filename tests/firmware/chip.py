"""The shell on a chip that is played by fake_chip/: builds it, tells it what happens, reads what it does."""

from __future__ import annotations

import functools
import os
import shutil
import subprocess
import tempfile
from pathlib import Path
from typing import Any

import pytest
from radio_desk import a_state

from hippomat_core.wire import cobs, codec, link
from hippomat_core.wire import frames as air

HERE = Path(__file__).parent
FIRMWARE = HERE.parent.parent / "esp32_firmware"
CORE = FIRMWARE / "lib/radio_core"
SHELL = FIRMWARE / "src"
STRICT = ("-std=gnu17", "-Wall", "-Wextra", "-Werror", "-Werror=incompatible-pointer-types")
INCLUDES = ("-I", HERE / "idf_stubs", "-I", CORE, "-I", SHELL)
SANITIZE = ("-g", "-O1", "-fsanitize=address,undefined", "-fno-sanitize-recover=all")
UNIX_S = 1_760_000_000
NO_KEY = bytes(16)
KEY = bytes(range(16))


def compile_c(compiler: str, *arguments: str | Path) -> subprocess.CompletedProcess[str]:
    if shutil.which(compiler) is None:
        pytest.skip(f"{compiler} is not installed")
    command = [compiler, *(str(argument) for argument in arguments)]
    return subprocess.run(command, capture_output=True, text=True, check=False)


@functools.cache
def links_sanitized(compiler: str) -> bool:
    """Whether the compiler has its sanitizers' run time: Debian keeps clang's in a package of its own."""
    with tempfile.TemporaryDirectory() as folder:
        empty = Path(folder, "empty.c")
        empty.write_text("int main(void) { return 0; }")
        return compile_c(compiler, *SANITIZE, empty, "-o", empty.with_suffix("")).returncode == 0


def build_chip(output: Path, compiler: str, *flags: str) -> Path:
    """Shell, core and fakes as one program, under the address and undefined-behaviour sanitizers."""
    sources = [path for folder in (SHELL, CORE, HERE / "fake_chip") for path in sorted(folder.glob("*.c"))]
    wrapped = "-Wl,--wrap=malloc,--wrap=calloc"
    if not links_sanitized(compiler):
        pytest.skip(f"{compiler} cannot link its sanitizers: install libclang-rt-dev")
    built = compile_c(compiler, *STRICT, *SANITIZE, *flags, *INCLUDES, *sources, wrapped, "-o", output)
    assert built.returncode == 0, built.stderr
    return output


class Chip:
    """One life of the chip, from power on to restart or power off. flash: what NVS holds, followed on."""

    def __init__(self, program: Path, flash: dict[str, bytes] | None = None) -> None:
        self.flash = dict(flash or {})
        self.lines: list[str] = []
        self.now_us = 0
        self.alive = True
        self._told = 0
        self._decoder = cobs.FrameDecoder()
        environment = os.environ | {"ASAN_OPTIONS": "detect_leaks=0"}  # drivers keep what they take
        self._process = subprocess.Popen(
            [str(program)], stdin=-1, stdout=-1, stderr=-1, text=True, env=environment
        )
        self._listen()
        for key, value in self.flash.items():
            self.tell(f"nvs {key} {value.hex()}")

    def tell(self, line: str) -> None:
        assert self._process.stdin is not None
        self._process.stdin.write(line + "\n")
        self._process.stdin.flush()
        self._listen()

    def _listen(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            match line.split():
                case ["ready", now_us]:
                    self.now_us = int(now_us)
                    return
                case ["stored", _, key, value]:
                    self.flash[key] = bytes.fromhex(value)
            self.lines.append(line.rstrip())
        self.alive = False
        assert self._process.wait() == 0, self._process.stderr and self._process.stderr.read()

    def off(self) -> None:
        if self.alive:
            assert self._process.stdin is not None
            self._process.stdin.close()
            self._listen()
        for pipe in (self._process.stdin, self._process.stdout, self._process.stderr):
            assert pipe is not None
            pipe.close()

    def boot(self, run_ms: float = 10) -> Chip:
        self.tell("boot")
        self.run_ms(run_ms)
        return self

    def run_ms(self, ms: float) -> None:
        if self.alive:
            self.tell(f"run {round(1000 * ms)}")

    def host(self, message: Any) -> None:
        self.tell(f"host {link.encode_message(message).hex()}")

    def hear(self, mac: bytes, frame: bytes, rssi_dbm: int = -50) -> None:
        self.tell(f"air {mac.hex()} {rssi_dbm} {frame.hex()}")

    def messages(self, *kinds: type) -> list[Any]:
        """What the host has been sent since the last call, or those of some types."""
        new, self._told = self.lines[self._told :], len(self.lines)
        stream = b"".join(bytes.fromhex(line.split()[1]) for line in new if line.startswith("host "))
        found = [link.decode_message(payload) for payload in self._decoder.feed(stream)]
        assert self._decoder.skipped_bytes == 0
        return [message for message in found if not kinds or isinstance(message, kinds)]

    def said(self, first_word: str) -> list[list[str]]:
        """Lines of one kind, without that word."""
        return [line.split()[1:] for line in self.lines if line.split()[:1] == [first_word]]

    def sent(self) -> list[tuple[int, bytes]]:
        """Frames that ESP-NOW took: when, and which."""
        return [(int(at), bytes.fromhex(frame)) for at, frame in self.said("sent")]

    def index(self, start: str) -> int:
        """Of the first line that begins so."""
        return next(i for i, line in enumerate(self.lines) if line.startswith(start))


def identity_in_flash(
    robot: int = 3, *, channel: int = 1, rate_mbps: int = 6, key: bytes = NO_KEY, provisioned: bool = False
) -> bytes:
    """The part `identity` as keep.c writes it: fleet 1, 100 ms, 5 slots."""
    schedule = (100).to_bytes(2, "little") + bytes([5])
    keyed = key != NO_KEY
    return bytes([1, robot, 1, channel]) + schedule + bytes([rate_mbps, provisioned or keyed, keyed]) + key


def keyed_flash(boot_counter: int = 1_700_000_000) -> dict[str, bytes]:
    return {"identity": identity_in_flash(key=KEY), "boot": boot_counter.to_bytes(4, "little")}


@functools.cache
def hello(
    robot: int = 3, fleet: int = 1, channel: int = 1, round_ms: int = 100, slots: int = 5
) -> link.Hello:
    return link.Hello(link.LINK_VERSION, robot, fleet, channel, round_ms, slots)


def status_of(on: Chip) -> link.Status:
    on.run_ms(1000)
    status: link.Status = on.messages(link.Status)[-1]
    return status


def send_state(on: Chip, run_ms: float = 120) -> None:
    on.host(link.SendBody(air.STATE, codec.encode_body(a_state())))
    on.run_ms(run_ms)


def sealed(plain: bytes) -> bytes:
    """As fake_chip/cipher.c seals."""
    return bytes([plain[0] | 8]) + plain[1:16] + bytes(b ^ 0xA5 for b in plain[16:]) + b"\xa5" * 8
