"""Which velocity the base may be given now. Pure: stamps in, frames out; the motor guard is its shell.

Law: a frame that is given out was commanded less than TIMEOUT_NS ago, or it is zero.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from hippomat_core.wire.jetbot_base import VELOCITY, BaseFrame, encode_velocity

TIMEOUT_NS = 200_000_000  # silence after which the base is stopped
PERIOD_NS = 20_000_000  # the vendor's own node sends a velocity this often

ZERO = encode_velocity(0.0, 0.0)


@dataclass(frozen=True, slots=True)
class Deadman:
    """The last command and when it came."""

    frame: bytes = ZERO
    commanded_ns: int | None = None
    next_ns: int = 0
    period_ns: int = PERIOD_NS

    def commanded(self, stamp_ns: int, frame: BaseFrame) -> Deadman:
        """A frame from the daemon; only velocities are commands, and a new one is due at once."""
        if frame.type != VELOCITY:
            return self
        return replace(self, frame=frame.encode(), commanded_ns=stamp_ns, next_ns=stamp_ns)

    def silent(self, stamp_ns: int) -> bool:
        """Nobody commanded for too long, or ever."""
        return self.commanded_ns is None or stamp_ns - self.commanded_ns >= TIMEOUT_NS

    def output(self, stamp_ns: int) -> tuple[Deadman, bytes]:
        """What to write now: a velocity frame when one is due, else nothing."""
        if stamp_ns < self.next_ns:
            return self, b""
        frame = ZERO if self.silent(stamp_ns) else self.frame
        return replace(self, next_ns=stamp_ns + self.period_ns), frame
