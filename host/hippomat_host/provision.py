"""`hippomat-host provision`: write identity, channel, rate and fleet key into a radio, at a desk, once.

The radio stores them, answers, and restarts; what counts is what it says of itself afterwards. The key goes
to the radio and nowhere else.
"""

from __future__ import annotations

import sys
import time
from dataclasses import dataclass

from hippomat_core.errors import HippomatError, PortError
from hippomat_core.wire.link import (
    FLAG_OPEN,
    FLAG_PASSIVE,
    FLAG_PROVISIONED,
    FLAG_UNSAFE,
    LINK_VERSION,
    NO_ROBOT,
    PEER_DUPLICATE,
    AskPeers,
    HelloReply,
    LinkMessage,
    PeerReport,
    Provision,
    Provisioned,
    Status,
)
from hippomat_host.conversation import Conversation, Vanished
from hippomat_host.identify import ASK
from hippomat_host.key_file import FleetKey
from hippomat_host.radio_words import firmware, who

STORE_S = 3.0  # a flash page is erased and written
RESTART_S = 20.0
_ASK_EVERY_S = 0.5
TWIN_S = 1.0  # to hear another radio under the same id: ten rounds
_CHANNELS = 11
_YEAR_2025_S = 1_735_689_600


@dataclass(frozen=True, slots=True)
class Wanted:
    """What a radio shall be; key None: OPEN. robot 255: an operator's radio."""

    robot: int
    fleet: int
    channel: int
    rate_mbps: int
    key: FleetKey | None


def provision(path: str, wanted: Wanted, now_s: float) -> int:
    """Exit code 0; raises HippomatError in one line with the remedy. now_s: Unix time."""
    if not _YEAR_2025_S <= now_s < 2**32:
        year = time.strftime("%Y-%m-%d", time.gmtime(max(0.0, min(now_s, 2.0**32))))
        raise HippomatError(
            f"this machine's clock says {year}, but boot counters are seeded from it and must never repeat: "
            "set it (`sudo timedatectl set-ntp true`) and repeat"
        )
    if wanted.key is not None and wanted.key.warning:
        _warn(wanted.key.warning)
    if wanted.channel > _CHANNELS:
        _warn(f"channel {wanted.channel}: ESP-IDF's default region allows 1 .. {_CHANNELS}")
    with Conversation(path) as radio:
        radio.forget_stale()
        before = radio.reply
        print(f"{path}: {firmware(before)}, MAC {before.mac.hex(':')}", flush=True)
        print(f"it was: {who(before)}", flush=True)
        answered = _write(radio, wanted, int(now_s))
        print(f"{'written' if answered else 'sent, and the port went away'}: {_what(wanted)}", flush=True)
        after = _restarted(radio, before.boot_id)
        _verify(path, wanted, after)
        doubled = wanted.robot != NO_ROBOT and _has_twin(radio, wanted.robot)
    print(f"restarted, and says: {who(after)}; boot counter {after.boot_counter}")
    if doubled:
        _warn(f"another radio sends as robot {wanted.robot}: give every robot its own id")
    if wanted.key is None:
        _warn(
            f"fleet {wanted.fleet} is OPEN: anyone in range may send, stop and resume; "
            "`hippomat-host make-key FILE` and --key-file FILE seal it"
        )
    return 0


def _warn(text: str) -> None:
    print(f"warning: {text}", file=sys.stderr, flush=True)


def _write(radio: Conversation, wanted: Wanted, unix_s: int) -> bool:
    """True: the radio says that it is stored. False: its port went away with the answer."""
    key = b"" if wanted.key is None else wanted.key.key
    identity = (wanted.robot, wanted.fleet, wanted.channel, wanted.rate_mbps)
    radio.say(Provision(LINK_VERSION, *identity, key, unix_s))
    try:
        answer = radio.await_kind(Provisioned, STORE_S)
    except Vanished:
        return False
    if answer is None:
        raise PortError(
            f"the radio on {radio.path} did not say within {STORE_S:.0f} s that it stored anything: "
            "repeat, and see `hippomat-host radio-info` for what it is"
        )
    if not answer.stored:
        raise PortError(
            f"the radio on {radio.path} could not store it (its flash is full or damaged): repeat; if that "
            "does not help, `pio run -t erase -t upload` in esp32_firmware and provision again"
        )
    return True


def _restarted(radio: Conversation, boot_id: int) -> HelloReply:
    """What the radio says after its restart; its port may go away meanwhile."""
    until_s = time.monotonic() + RESTART_S
    late = (
        f"{radio.path}: the radio did not come back within {RESTART_S:.0f} s of being written: "
        "unplug it, plug it in, and see `hippomat-host radio-info`"
    )
    while time.monotonic() < until_s:
        try:
            radio.say(ASK)
            reply = radio.await_kind(HelloReply, _ASK_EVERY_S)
            if reply is not None and reply.boot_id != boot_id:
                return reply
        except Vanished:
            try:
                radio.reopen(until_s)
            except PortError as error:
                raise PortError(f"{late} ({error})") from None
    raise PortError(late)


def _has_twin(radio: Conversation, robot: int) -> bool:
    """Whether the radio hears another one under its own id, in the first second after its restart."""
    until_s = time.monotonic() + TWIN_S
    try:
        while time.monotonic() < until_s:
            radio.say(AskPeers())
            for message in radio.listen(_ASK_EVERY_S):
                if _tells_of_twin(message, robot):
                    return True
    except Vanished:  # what was written is stored and was verified
        _warn(f"{radio.path} went away again: whether another radio sends as robot {robot} is not known")
    return False


def _tells_of_twin(message: LinkMessage, robot: int) -> bool:
    if isinstance(message, Status):
        return bool(message.flags & FLAG_PASSIVE or message.duplicate >> robot & 1)
    return isinstance(message, PeerReport) and message.robot == robot and bool(message.flags & PEER_DUPLICATE)


def _verify(path: str, wanted: Wanted, reply: HelloReply) -> None:
    is_open = bool(reply.flags & FLAG_OPEN)
    found = (reply.robot, reply.fleet, reply.channel, reply.rate_mbps, is_open)
    asked = (wanted.robot, wanted.fleet, wanted.channel, wanted.rate_mbps, wanted.key is None)
    if found != asked or not reply.flags & FLAG_PROVISIONED:
        raise PortError(
            f"the radio on {path} restarted as {who(reply)}, not as written (channels differ by region): "
            "repeat, and if that does not help flash it anew with `pio run -t upload` in esp32_firmware"
        )
    if reply.flags & FLAG_UNSAFE:
        raise PortError(
            f"the radio on {path} cannot store its boot counter and stays silent: "
            "`pio run -t erase -t upload` in esp32_firmware, then provision again"
        )


def _what(wanted: Wanted) -> str:
    name = f"robot {wanted.robot}" if wanted.robot < 255 else "an operator's radio"
    key = "OPEN" if wanted.key is None else f"sealed with the key of fingerprint {wanted.key.fingerprint}"
    return f"{name} of fleet {wanted.fleet}, channel {wanted.channel}, {wanted.rate_mbps} Mbit/s, {key}"
