"""Which allocation round it is: the radio's count of fleet time, and our own where the radio is silent.

Radios that agree on fleet time end a round at one instant, so that robots decide on the same rows. Where no
radio tells rounds we count on from its last one, half a round behind, and from 0 where there never was one.
Knows no rows and no frames; decides what of the radio's count is news.

Late: a radio's own clock runs evenly, so the least difference between our stamp and its time, ever seen, is
the one without a hold-up, and whatever exceeds it was held up on its way. Clocks drift apart: the least
difference is allowed to grow by CREEP. A step between the clocks that lasts (one was set, or a machine slept)
looks like a hold-up that never ends: when all of STEADY rounds are late by the same it is followed, and who
relies on lateness has to begin anew (`steps`).
"""

from __future__ import annotations

from dataclasses import dataclass

from hippomat_core.messages import RoundEnded
from hippomat_core.replaced import replace

NEVER = -(10**18)
CREEP = 2000  # 1/CREEP of the time: 500 ppm, more than two crystals differ
STEADY = 20  # rounds; a backlog that drains, or grows, does not stay the same for so long


@dataclass(frozen=True, slots=True)
class RoundClock:
    """A value. Round numbers are 0 .. 2**32 - 1."""

    round_ns: int
    round: int = -1  # of the last round end; -1: none yet
    ended_ns: int = NEVER  # when that was
    common: bool = False  # the radio ended it, for the whole fleet
    start_ns: int | None = None  # our own count: the round `start_round` ends here, a next one after round_ns
    start_round: int = 0
    radio_time_us: int = -1  # of the last RoundEnded; -1: none of this radio yet
    read_ns: int = NEVER  # when that was read
    offset_ns: int = 0  # the least difference, stamp less radio time
    late: int = 0  # rounds in a row that were late by about the same
    late_least_ns: int = 0  # differences, as offset_ns, of these
    late_most_ns: int = 0
    steps: int = 0  # lasting steps that were followed

    def started(self, stamp_ns: int) -> RoundClock:
        """Our own count begins."""
        return replace(self, start_ns=stamp_ns)

    def number(self, stamp_ns: int) -> int:
        """The round that ends at `stamp_ns` by our own count; a round of the radio's count stays the last."""
        start_ns = stamp_ns if self.start_ns is None else self.start_ns
        return max(self.start_round + (stamp_ns - start_ns) // self.round_ns, self.round)

    def due(self, stamp_ns: int) -> bool:
        """True when a round ended by our own count: the radio's is silent for one and a half."""
        begun = self.start_ns is None or stamp_ns >= self.start_ns
        return begun and self.number(stamp_ns) > self.round

    def ended(self, stamp_ns: int) -> RoundClock:
        """After everything about the round was done."""
        return replace(self, ended_ns=stamp_ns)

    def late_ns(self, stamp_ns: int, radio_time_us: int) -> int:
        """How long something that the radio dates at `radio_time_us` was on its way; 0 if unknown."""
        if self.radio_time_us < 0:
            return 0
        return max(0, stamp_ns - 1000 * radio_time_us - self.offset_ns)

    def new_radio(self) -> RoundClock:
        """The radio was opened or restarted: its clock and its count begin anew."""
        return replace(self, radio_time_us=-1)

    def heard(self, event: RoundEnded) -> tuple[RoundClock, bool]:
        """The radio observed a round; True: it ends for us now.

        Not where its number repeats or goes back (fleet time never does, so our own count was ahead), and not
        where it was held up for a round or more: a newer one is on its way behind it.
        """
        anew = self.radio_time_us < 0 or event.radio_time_us < self.radio_time_us
        offset_ns = event.stamp_ns - 1000 * event.radio_time_us
        crept_ns = self.offset_ns + (event.stamp_ns - self.read_ns) // CREEP
        least_ns = offset_ns if anew else min(offset_ns, crept_ns)
        clock = replace(self, radio_time_us=event.radio_time_us, read_ns=event.stamp_ns, offset_ns=least_ns)
        if offset_ns - least_ns >= self.round_ns:
            return clock._with_late(offset_ns), False
        next_ns = event.stamp_ns + self.round_ns + self.round_ns // 2
        clock = replace(clock, late=0, start_ns=next_ns, start_round=event.round + 1)
        if not anew and event.round <= self.round:
            return clock, False
        return replace(clock, round=event.round, common=True), True

    def _with_late(self, offset_ns: int) -> RoundClock:
        """After one more late round: a hold-up, or, if it lasts, a step."""
        least_ns = min(self.late_least_ns, offset_ns) if self.late else offset_ns
        most_ns = max(self.late_most_ns, offset_ns) if self.late else offset_ns
        if most_ns - least_ns > self.round_ns // 4:
            return replace(self, late=1, late_least_ns=offset_ns, late_most_ns=offset_ns)
        if self.late + 1 < STEADY:
            return replace(self, late=self.late + 1, late_least_ns=least_ns, late_most_ns=most_ns)
        return replace(self, late=0, offset_ns=least_ns, steps=self.steps + 1)

    def ends_alone(self, stamp_ns: int) -> RoundClock:
        """A round ends by our own count."""
        return replace(self, round=self.number(stamp_ns), common=False)
