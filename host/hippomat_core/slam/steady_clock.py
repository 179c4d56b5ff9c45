"""When did a device measure what we read late? It measures evenly; its bytes are read after a varying while.

So the moments are tracked, as a clock with a rate, rather than believed: an early reading is believed whole,
a late one a little. A process that slept for a third of a second still knows when each sweep ended.
"""

from __future__ import annotations

from dataclasses import dataclass

from hippomat_core.replaced import quickly_made

NO_STAMP = -1
LATE_NS = 60_000_000  # later than this: the reader slept, or something was missed
PATIENCE = 3  # readings in a row that late: it was missed
SETTLE = 1 / 16  # share of a late reading that is believed
DRIFT = 1 / 64  # share of it that goes into the rate, once that is known


@quickly_made
@dataclass(frozen=True, slots=True)
class SteadyClock:
    """When the last item (lidar sample, odometry frame) was measured, and the time from one to the next."""

    period_ns: float  # at first what is usual, then what is seen
    end_ns: int = NO_STAMP
    seen: int = 0  # readings in a row
    late: int = 0  # of them, at the end

    def after(self, stamp_ns: int, count: int = 1) -> SteadyClock:
        """After `count` more items, of which the last was read at stamp_ns."""
        expected_ns = self.end_ns + round(count * self.period_ns)
        late_ns = stamp_ns - expected_ns
        if self.seen == 1 and 0.1 < (stamp_ns - self.end_ns) / count / self.period_ns < 3.0:
            return SteadyClock((stamp_ns - self.end_ns) / count, stamp_ns, 2)
        if self.seen < 2 or (late_ns > LATE_NS and self.late >= PATIENCE):
            return SteadyClock(self.period_ns, stamp_ns, 1)
        if late_ns > LATE_NS:
            return SteadyClock(self.period_ns, expected_ns, self.seen, self.late + 1)
        period_ns = self.period_ns + max(1 / self.seen, DRIFT) * late_ns / count
        end_ns = expected_ns + (late_ns if late_ns < 0 else round(SETTLE * late_ns))
        return SteadyClock(period_ns, end_ns, self.seen + 1)
