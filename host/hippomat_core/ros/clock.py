"""How old is a message? ROS's stamps are of a clock that need not agree with ours.

The offset between the two is what the promptest message of the last minute shows. So an age counts from the
least delay that occurs: a delay that all messages share cannot be seen, and is [guard] latency_s's affair.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

WINDOW_NS = 30_000_000_000  # the offset is the least of two windows: clocks drift by milliseconds a minute
BACK_NS = 1_000_000_000  # ROS's clock went back: simulation started anew, or was set
UNKNOWN = 2**62


@dataclass(frozen=True, slots=True)
class RosClock:
    """Our monotonic clock minus ROS's, from below."""

    begun_ns: int = 0
    least_ns: int = UNKNOWN  # of this window
    before_ns: int = UNKNOWN  # and of the one before
    last_ros_ns: int = -UNKNOWN

    def heard(self, stamp_ns: int, ros_ns: int) -> RosClock:
        """After a message with ROS's stamp came in at `stamp_ns`; a stamp of 0 was never set."""
        if ros_ns == 0:
            return self
        offset_ns = stamp_ns - ros_ns
        if self.least_ns == UNKNOWN or ros_ns < self.last_ros_ns - BACK_NS:
            return RosClock(stamp_ns, offset_ns, UNKNOWN, ros_ns)
        last_ros_ns = max(self.last_ros_ns, ros_ns)
        if stamp_ns - self.begun_ns > WINDOW_NS:
            return RosClock(stamp_ns, offset_ns, self.least_ns, last_ros_ns)
        return replace(self, least_ns=min(self.least_ns, offset_ns), last_ros_ns=last_ros_ns)

    def taken_ns(self, stamp_ns: int, ros_ns: int) -> int:
        """When a message that came in at `stamp_ns` was stamped, on our clock."""
        if ros_ns == 0 or self.least_ns == UNKNOWN:
            return stamp_ns
        return min(stamp_ns, ros_ns + min(self.least_ns, self.before_ns))
