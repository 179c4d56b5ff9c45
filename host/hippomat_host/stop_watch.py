"""Who of a fleet shows that it is stopped, from what one radio tells. Pure: messages and seconds in.

A robot shows it in its STATE, with the STOP's counter; rows that others relay show it for robots that are not
heard themselves, without the counter. Knows no port and says nothing.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from hippomat_core.errors import WireError
from hippomat_core.fleet.robot_names import robots_of
from hippomat_core.wire.codec import decode_frame
from hippomat_core.wire.frames import FLAG_STOPPED, RelayFrame, StateFrame
from hippomat_core.wire.link import FLAG_PASSIVE, NO_ROBOT, Heard, LinkMessage, Status
from hippomat_host.radio_words import latched

UNTOLD = -1  # a relayed row has no counter


@dataclass(frozen=True, slots=True)
class Shown:
    """What a robot said last, and when it said it at the latest."""

    at_s: float
    stopped: bool
    counter: int


@dataclass(slots=True)
class StopWatch:
    """Fed with all messages of a radio, in order. own: its robot id, whose daemon cannot run meanwhile."""

    own: int
    robots: dict[int, Shown] = field(default_factory=dict)
    radios: set[int] = field(default_factory=set)  # robots whose radio is alive, STATE or not
    first: Status | None = None  # since our radio restarted
    status: Status | None = None  # the last

    def hear(self, now_s: float, message: LinkMessage) -> None:
        if isinstance(message, Status):
            if self.first is None or self.first.boot_id != message.boot_id:
                self.first = message  # its counters begin at 0
            self.status = message
            self.radios.update(robots_of(message.alive & ~(1 << self.own)))
        elif isinstance(message, Heard):
            self._frame(now_s, message.frame)

    def _frame(self, now_s: float, data: bytes) -> None:
        try:
            header, frame = decode_frame(data)
        except WireError:
            return
        if isinstance(frame, StateFrame) and header.sender != self.own:
            shown = Shown(now_s, bool(frame.flags & FLAG_STOPPED), frame.stop_counter)
            self.robots[header.sender] = shown
        elif isinstance(frame, RelayFrame):
            for row in frame.rows:
                at_s = now_s - (row.age + 1) * self._round_s
                before = self.robots.get(row.robot)
                if row.robot != self.own and (before is None or before.at_s < at_s):
                    self.robots[row.robot] = Shown(at_s, row.stopped, UNTOLD)

    @property
    def _round_s(self) -> float:
        return 0.1 if self.status is None else self.status.round_ms / 1e3

    @property
    def heard(self) -> list[int]:
        """Robots of which anything was heard."""
        return sorted(self.robots.keys() | self.radios)

    @property
    def radios_now(self) -> list[int]:
        """Robots whose radio was heard within 3 s, as our radio said last."""
        return robots_of(self.status.alive) if self.status is not None else []

    @property
    def doubled(self) -> list[int]:
        """Robots under whose id two radios send; their STATE may be either's."""
        return robots_of(self.status.duplicate) if self.status is not None else []

    @property
    def twin(self) -> str:
        """Names another radio under the id of ours, which does not hear it out; "" where there is none."""
        own_bit = 1 << self.own if self.own != NO_ROBOT else 0
        if self.status is None or not (self.status.flags & FLAG_PASSIVE or self.status.duplicate & own_bit):
            return ""
        return f"another radio sends as robot {self.own}"

    @property
    def latched(self) -> bool:
        """Our own radio is."""
        return self.status is not None and latched(self.status)

    @property
    def counter(self) -> int:
        """The highest STOP that holds, in our radio or in a robot that shows it; 0: none."""
        held = [self.status.stop_counter] if self.status is not None and latched(self.status) else []
        return max([*held, *(shown.counter for shown in self.robots.values() if shown.stopped)], default=0)

    @property
    def stopped(self) -> list[int]:
        return sorted(robot for robot, shown in self.robots.items() if shown.stopped)

    def shows_stop(self, since_s: float) -> list[int]:
        """Robots that have shown since then that they are stopped, by our radio's STOP or a later one."""
        own = self.status.stop_counter if self.status is not None else 0
        return [
            robot
            for robot, shown in sorted(self.robots.items())
            if shown.at_s > since_s and shown.stopped and (shown.counter >= own or shown.counter == UNTOLD)
        ]

    def shows_go(self, since_s: float) -> list[int]:
        """Robots that have shown since then that they are not stopped."""
        return [
            robot
            for robot, shown in sorted(self.robots.items())
            if shown.at_s > since_s and not shown.stopped
        ]

    def grown(self, counter: str) -> int:
        """How much a counter of our radio has grown while we listened, or since it restarted."""
        if self.first is None or self.status is None:
            return 0
        grown: int = getattr(self.status, counter) - getattr(self.first, counter)
        return grown
