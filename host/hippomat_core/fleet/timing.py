"""The intervals of rule F, derived once from the length of an allocation round. Knows no clock.

The reasons are with rule F in votes.py. The delay is the longest time from the moment a host hands its STATE
to its radio to the moment another host reads it, and has two parts:

- SLOT_ROUNDS in the sender's radio. A STATE decided at the end of a round leaves in the next round's slot, or
  in one of the two slots behind it; a newer STATE replaces it. What the host computes before it hands a STATE
  over delays no change of its mind, for it hands over every vote before it decides anew. (Not covered: a host
  that stalls just there, at the very round end at which it quotes a claim for the last time in T_dead.)
- HOLD_ROUNDS between the receiving radio and its host. A robot that notices that it was held up for longer,
  or that it is told things by its radio that are older, trusts nothing for a round (FleetState.awake).

Common rounds shorten no interval: a robot without a radio's count is in the same fleet.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from hippomat_core.config import FleetConfig

LEASE_ROUNDS = 3  # not less than SLOT_ROUNDS + HOLD_ROUNDS, see votes.py, "Why tags"
SLOT_ROUNDS = 1
HOLD_ROUNDS = 2
SETTLE_ROUNDS = 1.9  # rows with costs of a new generation need this long to reach everyone (see settle_ns)
HANDOVER_ROUNDS = 10  # long enough to hear of it and to claim, with some frames lost on the way
TURN_ROUNDS = 2  # on_claim: a confirmed claim waits this long for late votes before its slot turns
DEAD_S = 3.0


@dataclass(frozen=True)  # without slots: what is derived is kept
class Timing:
    """All in nanoseconds of the robot's monotonic clock."""

    round_ns: int

    @staticmethod
    def of(config: FleetConfig) -> Timing:
        return Timing(round(config.round_s * 1e9))

    @cached_property
    def lease_ns(self) -> int:
        """A vote counts this long after it was heard."""
        return LEASE_ROUNDS * self.round_ns

    @cached_property
    def round_us(self) -> int:
        """As the radios count it: whole milliseconds."""
        return round(self.round_ns / 1e6) * 1000

    @cached_property
    def hold_ns(self) -> int:
        """A hold-up of this robot that may go unnoticed."""
        return HOLD_ROUNDS * self.round_ns

    @cached_property
    def delay_ns(self) -> int:
        return SLOT_ROUNDS * self.round_ns + self.hold_ns

    @cached_property
    def dead_ns(self) -> int:
        """T_dead: a robot unheard for so long is taken for dead; never less than ten rounds."""
        return max(round(DEAD_S * 1e9), 10 * self.round_ns)

    @cached_property
    def fallow_ns(self) -> int:
        """After a vote was released because its owner was unheard, until the next vote on that task."""
        return self.lease_ns + self.delay_ns

    @cached_property
    def tag_reuse_ns(self) -> int:
        """From the end of a claim until its tag may name another; also the silence of claims after a boot."""
        return self.dead_ns + self.lease_ns + self.delay_ns

    @cached_property
    def refused_ns(self) -> int:
        """A claim unconfirmed for so long, though a majority is heard, is given up."""
        return 2 * self.dead_ns

    @cached_property
    def settle_ns(self) -> int:
        """From a task's new generation until it is allocated.

        Where rounds are common, all who learn of it in one round begin at the end of the same later round. At
        two rounds, and not just under, the jitter of the round ends would decide for each of them.
        """
        return round(SETTLE_ROUNDS * self.round_ns)

    @cached_property
    def handover_ns(self) -> int:
        """Whoever handed a task over leaves it alone for so long."""
        return HANDOVER_ROUNDS * self.round_ns

    @cached_property
    def turn_ns(self) -> int:
        return TURN_ROUNDS * self.round_ns
