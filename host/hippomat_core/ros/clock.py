"""How old is a message? ROS's stamps are of a clock that need not agree with ours.

The offset between the two is what the promptest message of the last minute shows. So an age counts from the
least delay that occurs: a delay that all messages share cannot be seen, and is [guard] latency_s's affair.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from hippomat_core.replaced import replace

WINDOW_NS = 30_000_000_000  # the offset is the least of two windows: clocks drift by milliseconds a minute
BACK_NS = (
    1_000_000_000  # a source went back by more: simulation started anew, ROS's clock was set, or disorder
)
BACK = 10  # messages in a row of sources that went back: the clock did
UNKNOWN = 2**62


@dataclass(frozen=True, slots=True)
class RosClock:
    """Our monotonic clock minus ROS's, from below."""

    begun_ns: int = 0
    least_ns: int = UNKNOWN  # of this window
    before_ns: int = UNKNOWN  # and of the one before
    latest: Mapping[str, int] = field(default_factory=dict)  # source: its latest stamp [ns]
    back: int = 0  # messages in a row of sources that went back
    back_least_ns: int = UNKNOWN  # the offset since then

    def heard(self, stamp_ns: int, ros_ns: int, source: str = "") -> RosClock:
        """After a message with ROS's stamp came in at `stamp_ns`; a stamp of 0 was never set.

        A source that is late falls behind the others, and not behind itself: it shows no other clock. To take
        it for one would make its messages look new, and the guard would drive by what was there seconds ago.
        """
        if ros_ns == 0:
            return self
        offset_ns = stamp_ns - ros_ns
        latest_ns = self.latest.get(source, ros_ns)
        if ros_ns < latest_ns - BACK_NS:
            return self._went_back(stamp_ns, ros_ns, source)
        latest = {**self.latest, source: max(latest_ns, ros_ns)}
        clock = replace(self, latest=latest)
        if source in self.latest:  # one that is new says nothing of before
            clock = replace(clock, back=0, back_least_ns=UNKNOWN)
        if self.least_ns == UNKNOWN:
            return replace(clock, begun_ns=stamp_ns, least_ns=offset_ns)
        if stamp_ns - self.begun_ns > WINDOW_NS:
            return replace(clock, begun_ns=stamp_ns, least_ns=offset_ns, before_ns=self.least_ns)
        return replace(clock, least_ns=min(self.least_ns, offset_ns))

    def _went_back(self, stamp_ns: int, ros_ns: int, source: str) -> RosClock:
        """Its stamps are believed once everything that is heard went back."""
        back, least_ns = self.back + 1, min(self.back_least_ns, stamp_ns - ros_ns)
        if back < BACK:
            return replace(self, back=back, back_least_ns=least_ns)
        return RosClock(stamp_ns, least_ns, latest={source: ros_ns})

    def taken_ns(self, stamp_ns: int, ros_ns: int) -> int:
        """When a message that came in at `stamp_ns` was stamped, on our clock."""
        if ros_ns == 0 or self.least_ns == UNKNOWN:
            return stamp_ns
        return min(stamp_ns, ros_ns + min(self.least_ns, self.before_ns))
