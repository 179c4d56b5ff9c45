"""Who sends when: carrier sense of 802.11 broadcasts, each station by its own ears.

DCF (IEEE 802.11-2020, 10.3.4): DIFS, a random back-off of 0..15 slots that is frozen while the channel is
busy, no acknowledgement, no second try. A station senses only those it can hear, and not what began less than
SENSE_US ago: equal back-offs collide, and so do stations hidden from each other. Not modelled: the back-off
after one's own frame where none follows. Knows stations and times, not who receives what.
"""

from __future__ import annotations

import heapq
import random
from collections import deque
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from hippomat_sim.air import airtime_us

SLOT_US, DIFS_US, CONTENTION_SLOTS = 9, 28, 16
SENSE_US = 4  # CCA time: what began later than this ago is not noticed yet


@dataclass(slots=True, eq=False)
class Transmission:
    """A frame on the air, and those that were on the air with it."""

    sender: int
    frame: bytes
    start_us: int
    end_us: int
    overlaps: list[Transmission] = field(default_factory=list)


@dataclass(slots=True)
class _Contender:
    """A station that waits for the channel; its frame starts at start_us unless somebody is sensed before."""

    station: int
    frame: bytes
    start_us: int
    busy_until_us: int
    slots: int

    def defer(self, now_us: int, until_us: int) -> None:
        """Freeze the back-off: the channel is busy from now on."""
        counted = max(0, now_us - self.busy_until_us - DIFS_US) // SLOT_US
        self.slots -= min(self.slots, counted)
        self.busy_until_us = max(self.busy_until_us, until_us)
        self.start_us = self.busy_until_us + DIFS_US + SLOT_US * self.slots


class Carrier:
    """Stations ask for the channel; `step` goes from one event to the next. Deterministic, given the asks."""

    def __init__(self, senses: NDArray[np.bool_], rate_mbps: int, rng: random.Random) -> None:
        """senses: (S, S) [sender, listener]; may be changed at any time."""
        self.senses = senses
        self._rate_mbps = rate_mbps
        self._random = rng
        self._asks: list[tuple[int, int, int, bytes]] = []  # heap: time, order, station, frame
        self._asked = 0
        self._queues: list[deque[bytes]] = [deque() for _ in range(len(senses))]
        self._occupied = [False] * len(senses)  # contending or on the air
        self._contenders: list[_Contender] = []
        self._on_air: list[Transmission] = []
        self._recent: list[Transmission] = []  # on the air, or ended less than DIFS ago

    def ask(self, at_us: int, station: int, frame: bytes) -> None:
        """The station wants to send, from at_us on; frames of one station go in order."""
        self._asked += 1
        heapq.heappush(self._asks, (at_us, self._asked, station, frame))

    def next_us(self) -> int | None:
        """When step() has work again; None: nobody wants anything."""
        earliest_us = self._asks[0][0] if self._asks else None
        for contender in self._contenders:
            if earliest_us is None or contender.start_us < earliest_us:
                earliest_us = contender.start_us
        for transmission in self._on_air:
            if earliest_us is None or transmission.end_us < earliest_us:
                earliest_us = transmission.end_us
        return earliest_us

    def step(self, now_us: int) -> Transmission | None:
        """Do the one thing that is next, at now_us = next_us(); a transmission if it ended one."""
        for transmission in self._on_air:
            if transmission.end_us == now_us:
                self._end(transmission)
                return transmission
        if self._asks and self._asks[0][0] == now_us:
            _, _, station, frame = heapq.heappop(self._asks)
            self._queues[station].append(frame)
            self._contend(now_us, station)
            return None
        self._start(next(c for c in self._contenders if c.start_us == now_us))
        return None

    def _contend(self, now_us: int, station: int) -> None:
        if self._occupied[station] or not self._queues[station]:
            return
        self._occupied[station] = True
        busy_until_us = self._sensed_until_us(now_us, station)
        contender = _Contender(station, self._queues[station].popleft(), now_us, busy_until_us, 0)
        if now_us < busy_until_us + DIFS_US:
            contender.slots = self._random.randrange(CONTENTION_SLOTS)
            contender.defer(now_us, busy_until_us)
        self._contenders.append(contender)

    def _sensed_until_us(self, now_us: int, station: int) -> int:
        """Until when the channel is busy to this station, as far as it can know; at least a DIFS ago."""
        until_us = now_us - DIFS_US
        for other in self._recent:
            noticed = other.start_us <= now_us - SENSE_US and self.senses[other.sender, station]
            if (noticed or other.sender == station) and other.end_us > until_us:
                until_us = other.end_us
        return until_us

    def _start(self, contender: _Contender) -> None:
        start_us, sender = contender.start_us, contender.station
        end_us = start_us + airtime_us(len(contender.frame), self._rate_mbps)
        transmission = Transmission(sender, contender.frame, start_us, end_us, list(self._on_air))
        for other in self._on_air:
            other.overlaps.append(transmission)
        self._recent = [one for one in self._recent if one.end_us + DIFS_US > start_us]
        self._recent.append(transmission)
        self._on_air.append(transmission)
        self._contenders.remove(contender)
        for waiting in self._contenders:
            if self.senses[sender, waiting.station] and waiting.start_us >= start_us + SENSE_US:
                waiting.defer(start_us, end_us)

    def _end(self, transmission: Transmission) -> None:
        self._on_air.remove(transmission)
        self._occupied[transmission.sender] = False
        self._contend(transmission.end_us, transmission.sender)
