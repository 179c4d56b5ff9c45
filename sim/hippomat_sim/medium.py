"""The air between the radios: carrier sense, collisions, losses, latency, duplicates and signal strength.

One channel. Who sends when is decided in carrier.py; a receiver gets a frame if it can hear the sender, sends
nothing itself meanwhile, nothing that it can hear overlaps the frame, and the link does not lose it. Knows
stations and bytes, not what the bytes mean. A pure function of seed, set-up and the calls made.
"""

from __future__ import annotations

import heapq
import random
from collections.abc import Iterable, Sequence

import numpy as np
from numpy.typing import NDArray

from hippomat_sim.air import (
    AirSettings,
    Ended,
    Happening,
    Heard,
    Left,
    StationCounts,
    airtime_us,
    hidden_pairs,
)
from hippomat_sim.carrier import Carrier, Transmission
from hippomat_sim.losses import Fates, Losses, LossModel

__all__ = [
    "AirSettings",
    "Ended",
    "Happening",
    "Heard",
    "Left",
    "Medium",
    "StationCounts",
    "airtime_us",
    "hidden_pairs",
]

_REFERENCE_DBM, _PATH_EXPONENT = -40.0, 2.2
_WEAKEST_DBM, _STRONGEST_DBM = -100, -10


class Medium:
    """`send` frames, then `pop` what happens, one by one in time order, sending the answers in between.

    The calls' times never go back. Stations are numbered from 0; positions set the signal strength. pop()
    tells each reception at its time; pop_ended() a whole transmission at its end: use one of both.
    """

    def __init__(
        self, stations: int, settings: AirSettings, seed: int, losses: LossModel | None = None
    ) -> None:
        """losses: instead of those that the settings describe."""
        self._settings = settings
        self._driver_random = random.Random(f"driver {seed}")
        drawn, fates = np.random.SeedSequence(seed).spawn(2)
        self._losses = losses or Losses(stations, settings, np.random.default_rng(drawn))
        self._fates = Fates(stations, settings, np.random.default_rng(fates))
        self._in_range = ~np.eye(stations, dtype=bool)
        for a, b in settings.hidden:
            self._in_range[a, b] = self._in_range[b, a] = False
        self._hears = self._in_range  # (S, S) [sender, receiver]
        self._carrier = Carrier(self._hears, settings.rate_mbps, random.Random(f"back-off {seed}"))
        self.positions_m = [(0.0, 0.0)] * stations
        self._ahead: list[tuple[int, int, Happening]] = []  # heap by time, then order of creation
        self._created = 0
        self._sent, self._air_us = [0] * stations, [0] * stations
        self._tally = np.zeros((6, stations), np.int64)  # in the order of counts below

    @property
    def positions_m(self) -> Sequence[tuple[float, float]]:
        """(S, 2) where the stations are."""
        return self._positions_m

    @positions_m.setter
    def positions_m(self, positions_m: Sequence[tuple[float, float]]) -> None:
        self._positions_m = positions_m
        at_m = np.asarray(positions_m, float)
        distance_m = np.hypot(*(at_m[:, None] - at_m).transpose(2, 0, 1))
        self._mean_dbm = _REFERENCE_DBM - 10 * _PATH_EXPONENT * np.log10(np.maximum(distance_m, 0.1))

    @property
    def counts(self) -> list[StationCounts]:
        """Per station, until now; a frame counts when it has left the air."""
        tallies = zip(self._sent, self._air_us, self._tally.T.tolist(), strict=True)
        return [
            StationCounts(sent, received, lost, duplicates, air_us, collided, deaf, unreached)
            for sent, air_us, (received, lost, duplicates, collided, deaf, unreached) in tallies
        ]

    def partition(self, parts: Iterable[Iterable[int]]) -> None:
        """Stations hear and sense only those of their own part from now on; one in no part hears nobody."""
        together = np.zeros_like(self._in_range)
        for part in parts:
            members = list(part)
            together[np.ix_(members, members)] = True
        self._hears = self._carrier.senses = self._in_range & together

    def heal(self) -> None:
        """The end of a partition."""
        self._hears = self._carrier.senses = self._in_range

    def send(self, now_us: int, sender: int, frame: bytes) -> None:
        """Ask for the channel. The Left that follows says when the frame was out."""
        delay_us = self._settings.driver_us + self._driver_random.randint(0, self._settings.driver_jitter_us)
        self._carrier.ask(now_us + delay_us, sender, frame)

    def next_us(self) -> int | None:
        """When pop() or pop_ended() has work again if nothing more is sent; None: the air is quiet."""
        carrier_us = self._carrier.next_us()
        if not self._ahead:
            return carrier_us
        return self._ahead[0][0] if carrier_us is None else min(carrier_us, self._ahead[0][0])

    def pop(self, now_us: int) -> Happening | None:
        """The next thing that happens up to now_us, else None."""
        while True:
            next_us = self.next_us()
            if next_us is None or next_us > now_us:
                return None
            if self._ahead and self._ahead[0][0] == next_us:
                return heapq.heappop(self._ahead)[2]
            if (transmission := self._carrier.step(next_us)) is not None:
                self._tell(self._ended(transmission))

    def pop_ended(self, now_us: int) -> Ended | None:
        """The next transmission that ends up to now_us, else None."""
        while (next_us := self._carrier.next_us()) is not None and next_us <= now_us:
            if (transmission := self._carrier.step(next_us)) is not None:
                return self._ended(transmission)
        return None

    def _ended(self, transmission: Transmission) -> Ended:
        """Decides who receives it."""
        sender, at_us = transmission.sender, transmission.end_us
        self._sent[sender] += 1
        self._air_us[sender] += at_us - transmission.start_us
        received = self._reaches(transmission)
        delays_us, twice, noise_db = self._fates.draw()
        (receivers,) = received.nonzero()
        (again,) = (received & twice).nonzero()
        if len(again):
            self._tally[2, again] += 1
            receivers = np.concatenate((receivers, again))
        arrivals_us = at_us + delays_us[receivers]
        rssi_dbm = _as_rssi((self._mean_dbm[sender] + noise_db)[receivers])
        return Ended(at_us, sender, transmission.frame, receivers, arrivals_us, rssi_dbm)

    def _reaches(self, transmission: Transmission) -> NDArray[np.bool_]:
        """(S,) who receives it; counts why the others do not."""
        sender, tally = transmission.sender, self._tally
        open_to = self._hears[sender]
        tally[5] += ~open_to
        tally[5, sender] -= 1
        if transmission.overlaps:
            deaf, drowned = self._disturbed(transmission)
            tally[4] += open_to & deaf
            tally[3] += open_to & drowned & ~deaf
            open_to = open_to & ~(deaf | drowned)
        lost = self._losses.lost(transmission.end_us, sender, transmission.frame)
        received: NDArray[np.bool_] = open_to & ~lost
        tally[0] += received
        tally[1] += open_to & lost
        return received

    def _disturbed(self, transmission: Transmission) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """(S,) who sends itself meanwhile, and where another frame overlaps this one."""
        deaf = np.zeros(len(self._mean_dbm), bool)
        drowned = deaf.copy()
        for other in transmission.overlaps:
            deaf[other.sender] = True
            ahead_db = self._mean_dbm[transmission.sender] - self._mean_dbm[other.sender]
            drowned |= self._hears[other.sender] & (ahead_db < self._settings.capture_db)
        return deaf, drowned

    def _tell(self, ended: Ended) -> None:
        self._add(Left(ended.at_us, ended.sender, ended.frame))
        arrivals = zip(
            ended.arrivals_us.tolist(), ended.receivers.tolist(), ended.rssi_dbm.tolist(), strict=True
        )
        for at_us, receiver, rssi_dbm in arrivals:
            self._add(Heard(at_us, receiver, rssi_dbm, ended.frame, ended.sender))

    def _add(self, happening: Happening) -> None:
        self._created += 1
        heapq.heappush(self._ahead, (happening.at_us, self._created, happening))


def _as_rssi(dbm: NDArray[np.float64]) -> NDArray[np.int8]:
    rssi: NDArray[np.int8] = np.minimum(np.maximum(np.rint(dbm), _WEAKEST_DBM), _STRONGEST_DBM).astype(
        np.int8
    )
    return rssi
