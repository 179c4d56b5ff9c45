"""The intervals of rule F, derived once from the length of an allocation round. Knows no clock.

The reasons are with rule F in votes.py. The delay is the longest time that a frame may spend between the
sender's decision and the receiver's, queues of both radios included; a robot that notices that it was held
up for longer trusts nothing for a round (FleetState.trusted_from_ns).
"""

from __future__ import annotations

from dataclasses import dataclass

from hippomat_core.config import FleetConfig

LEASE_ROUNDS = 3
DELAY_ROUNDS = 2
SETTLE_ROUNDS = 2  # rows with costs of a new generation need this long to reach everyone
TURN_ROUNDS = 2  # on_claim: a confirmed claim waits this long for late votes before its slot turns
DEAD_S = 3.0


@dataclass(frozen=True, slots=True)
class Timing:
    """All in nanoseconds of the robot's monotonic clock."""

    round_ns: int

    @staticmethod
    def of(config: FleetConfig) -> Timing:
        return Timing(round(config.round_s * 1e9))

    @property
    def lease_ns(self) -> int:
        """A vote counts this long after it was heard."""
        return LEASE_ROUNDS * self.round_ns

    @property
    def delay_ns(self) -> int:
        return DELAY_ROUNDS * self.round_ns

    @property
    def dead_ns(self) -> int:
        """T_dead: a robot unheard for so long is taken for dead; never less than ten rounds."""
        return max(round(DEAD_S * 1e9), 10 * self.round_ns)

    @property
    def fallow_ns(self) -> int:
        """After a vote was released because its owner was unheard, until the next vote on that task."""
        return self.lease_ns + self.delay_ns

    @property
    def tag_reuse_ns(self) -> int:
        """From the end of a claim until its tag may name another; also the silence of claims after a boot."""
        return self.dead_ns + self.lease_ns + self.delay_ns

    @property
    def refused_ns(self) -> int:
        """A claim unconfirmed for so long, though a majority is heard, is given up."""
        return 2 * self.dead_ns

    @property
    def settle_ns(self) -> int:
        return SETTLE_ROUNDS * self.round_ns

    @property
    def turn_ns(self) -> int:
        return TURN_ROUNDS * self.round_ns
