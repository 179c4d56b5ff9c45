"""What the daemon's loop is told, one value per thing that happened. Knows no port and no clock."""

from __future__ import annotations

from dataclasses import dataclass

from hippomat_core.messages import Event

START, MAP, TICK, READ, EVENT, OPENED, LOST, NOTE, END = (
    "start",
    "map",
    "tick",
    "read",
    "event",
    "opened",
    "lost",
    "note",
    "end",
)


@dataclass(frozen=True, slots=True)
class Exchanged:
    """Bytes of an identification; direction as in hippomat_logs.records."""

    stamp_ns: int
    direction: int
    data: bytes


@dataclass(frozen=True, slots=True)
class Happening:
    """One thing that happened at `stamp_ns`; `port` is one of messages.RADIO .. ROS where there is one.

    data: the bytes of a READ. event: of an EVENT, to be stamped yet.
    text: what an OPENED device said of itself, why it was LOST, or a NOTE.
    exchanged: how an OPENED device was identified. lag_ns: how late a TICK is.
    """

    stamp_ns: int
    what: str
    port: int = -1
    data: bytes = b""
    text: str = ""
    exchanged: tuple[Exchanged, ...] = ()
    lag_ns: int = 0
    event: Event | None = None
