"""What a radio says of itself, in words for people: identity, air, reset reason, counters, STOP. Pure."""

from __future__ import annotations

from typing import Protocol

from hippomat_core.wire import link

# esp_reset_reason_t of ESP-IDF 5.5
RESET_REASONS = (
    "unknown",
    "power on",
    "reset pin",
    "restart by software",
    "panic",
    "interrupt watchdog",
    "task watchdog",
    "another watchdog",
    "deep sleep",
    "brownout: check the supply",
    "SDIO",
    "USB",
    "JTAG",
    "eFuse error",
    "power glitch: check the supply",
    "CPU lock-up",
)

# A reason travels as one byte; 0 and 1 are the radio's own (stop.h).
STOP_REASONS = {"command": 0, "button": 1, "person": 2, "collision": 3, "fault": 4, "test": 5, "end": 6}

# Status fields that count dropped messages, and what each means.
DROPS = {
    "dropped_foreign": "another fleet, or another protocol version",
    "dropped_malformed": "damaged or made wrongly",
    "dropped_seal": "sealed without our having the key, or open although we have one",
    "dropped_forged": "the tag is wrong: another key, or forged",
    "dropped_replayed": "heard before, or of an older boot",
    "dropped_impostor": "another radio under the id of one that is alive",
    "dropped_babble": "a sender with too many frames",
    "dropped_usb": "messages lost between radio and host",
}


class Identified(Protocol):
    """What HelloReply, Status and RadioStatus have in common."""

    @property
    def robot(self) -> int: ...
    @property
    def fleet(self) -> int: ...
    @property
    def channel(self) -> int: ...
    @property
    def rate_mbps(self) -> int: ...
    @property
    def flags(self) -> int: ...


class Latch(Protocol):
    """The STOP part of Status and RadioStatus."""

    @property
    def stop_counter(self) -> int: ...
    @property
    def stop_resumed(self) -> int: ...


def owner(radio: Identified) -> str:
    """Whose radio it is."""
    if radio.robot != link.NO_ROBOT:
        return f"robot {radio.robot}"
    provisioned = radio.flags & link.FLAG_PROVISIONED
    return "an operator's radio" if provisioned else "a new radio (not provisioned)"


def who(radio: Identified) -> str:
    """robot 3 of fleet 7, channel 6, 6 Mbit/s, sealed"""
    seal = "OPEN" if radio.flags & link.FLAG_OPEN else "sealed"
    return f"{owner(radio)} of fleet {radio.fleet}, channel {radio.channel}, {radio.rate_mbps} Mbit/s, {seal}"


def firmware(reply: link.HelloReply) -> str:
    """hippomat 0.2.0 abcdef01"""
    return f"{reply.firmware} {reply.git_hash}".strip()


def seal(flags: int) -> str:
    if flags & link.FLAG_OPEN:
        return "OPEN: anyone in range may send, stop and resume"
    return "sealed: what it sends is encrypted and authenticated"


def conditions(flags: int) -> list[str]:
    """What holds at the moment, beside the key."""
    words = {
        link.FLAG_AGREED: "fleet time agreed",
        link.FLAG_STOPPED: "STOP latched: `hippomat-host resume`",
        link.FLAG_PASSIVE: "silent: another radio sends under its id",
        link.FLAG_UNSAFE: "cannot store its boot counter: flash it anew",
    }
    return [text for flag, text in words.items() if flags & flag]


def reset_reason(code: int) -> str:
    return RESET_REASONS[code] if code < len(RESET_REASONS) else f"reason {code}"


def stop_reason(code: int) -> str:
    return next((name for name, known in STOP_REASONS.items() if known == code), f"reason {code}")


def latched(radio: Latch) -> bool:
    return radio.stop_counter > radio.stop_resumed


def duration(seconds: float) -> str:
    """12 s, 3 min 20 s, 2 h 3 min, 4 d 1 h"""
    whole = int(seconds)
    for size, name, part, part_name in ((86400, "d", 3600, "h"), (3600, "h", 60, "min"), (60, "min", 1, "s")):
        if whole >= size:
            return f"{whole // size} {name} {whole % size // part} {part_name}"
    return f"{seconds:.1f} s"
