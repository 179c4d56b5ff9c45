"""What a radio keeps over a reboot, as a value: rc_memory of radio_core.h, both ways. Stores nothing."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

from hippomat_core.config import MAX_ROBOTS
from hippomat_core.wire.link import NO_ROBOT

NEVER_HEARD = (0,) * MAX_ROBOTS


@dataclass(frozen=True, slots=True)
class Memory:
    """The default is an empty flash: listens only, OPEN. key: b"" or 16 bytes, never shown."""

    robot: int = NO_ROBOT
    fleet: int = 1
    channel: int = 1
    round_ms: int = 100
    slots: int = 5
    rate_mbps: int = 6
    provisioned: bool = False
    key: bytes = field(default=b"", repr=False)
    boot_counter: int = 0
    peer_boots: tuple[int, ...] = field(default=NEVER_HEARD, repr=False)
    operators: tuple[tuple[bytes, int], ...] = ()  # MAC, highest boot
    stop_counter: int = 0
    stop_resumed: int = 0

    def counted(self) -> Memory:
        """As at the next boot."""
        return replace(self, boot_counter=self.boot_counter + 1)

    def as_struct(self) -> dict[str, Any]:
        """What cffi takes for an rc_memory."""
        return {
            "identity": {"robot": self.robot, "fleet": self.fleet, "channel": self.channel},
            "schedule": {"round_ms": self.round_ms, "slots": self.slots},
            "rate_mbps": self.rate_mbps,
            "provisioned": self.provisioned,
            "keyed": bool(self.key),
            "key": tuple(self.key),
            "boot_counter": self.boot_counter,
            "peer_boots": self.peer_boots,
            "operators": [{"mac": tuple(mac), "boot": boot} for mac, boot in self.operators],
            "stop_counter": self.stop_counter,
            "stop_resumed": self.stop_resumed,
        }


def memory_of(struct: Any) -> Memory:
    """The inverse of as_struct, from an rc_memory."""
    return Memory(
        struct.identity.robot,
        struct.identity.fleet,
        struct.identity.channel,
        struct.schedule.round_ms,
        struct.schedule.slots,
        struct.rate_mbps,
        bool(struct.provisioned),
        bytes(struct.key) if struct.keyed else b"",
        struct.boot_counter,
        tuple(struct.peer_boots),
        tuple((bytes(place.mac), place.boot) for place in struct.operators if place.boot),
        struct.stop_counter,
        struct.stop_resumed,
    )
