"""The air between the radios: airtime, carrier sense, loss, latency, duplicates and signal strength.

One channel, everybody within everybody's carrier: one transmission at a time, random back-off (802.11 DCF,
6 Mbit/s OFDM; facts/firmware.md). Collisions of hidden nodes are not modelled; loss stands for them. Knows
stations and bytes, not what the bytes mean. A pure function of seed, set-up and the calls made.
"""

from __future__ import annotations

import heapq
import math
import random
from dataclasses import dataclass, field
from typing import TypeAlias

SLOT_US, DIFS_US, CONTENTION_SLOTS = 9, 28, 16
_OVERHEAD_BYTES = 43  # 24 MAC + 8 + 7 (vendor action frame) + 4 FCS
_REFERENCE_DBM, _PATH_EXPONENT, _SHADOWING_DB = -40.0, 2.2, 2.0


def airtime_us(payload_bytes: int) -> int:
    """Airtime of a broadcast of at most 250 B at 6 Mbit/s OFDM: 61 B 170 us, 124 B 254 us, 250 B 422 us."""
    bits = 16 + 8 * (_OVERHEAD_BYTES + payload_bytes) + 6  # service, frame, tail
    return 20 + 4 * math.ceil(bits / 24) + 6  # preamble, symbols of 24 bits, 2.4 GHz signal extension


@dataclass(frozen=True, slots=True)
class AirSettings:
    """What the air does to frames, the same on every link unless `link_loss` says otherwise."""

    loss: float = 0.0  # probability that one receiver misses one frame
    duplicate: float = 0.001  # probability that a received frame is received twice
    latency_us: int = 60  # end of the frame to the receiving radio's callback
    jitter_us: int = 40  # uniform, on top
    link_loss: dict[tuple[int, int], float] = field(default_factory=dict)  # (sender, receiver)


@dataclass(frozen=True, slots=True)
class Heard:
    """A frame reaches a receiver."""

    at_us: int
    receiver: int
    rssi_dbm: int
    frame: bytes


@dataclass(frozen=True, slots=True)
class Left:
    """A frame's transmission ended; its sender may send the next."""

    at_us: int
    sender: int
    frame: bytes


Happening: TypeAlias = Heard | Left


@dataclass(slots=True)
class StationCounts:
    """Frames of one station: sent by it; received, lost and received twice by it."""

    sent: int = 0
    received: int = 0
    lost: int = 0
    duplicates: int = 0
    air_us: int = 0


@dataclass(frozen=True, slots=True)
class _Waiting:
    """A frame that wants the channel."""

    asked_us: int
    sender: int
    frame: bytes
    back_off_us: int


class Medium:
    """`send` frames, then `pop` what happens, one by one in time order, sending the answers in between.

    The calls' times never go back. Stations are numbered from 0; positions set the signal strength.
    """

    def __init__(self, stations: int, settings: AirSettings, seed: int) -> None:
        self.positions_m: list[tuple[float, float]] = [(0.0, 0.0)] * stations
        self.counts = [StationCounts() for _ in range(stations)]
        self._settings = settings
        self._random = random.Random(f"medium {seed}")
        self._waiting: list[_Waiting] = []
        self._free_us = -DIFS_US  # end of the last transmission
        self._ahead: list[tuple[int, int, Happening]] = []  # heap by time, then order of creation
        self._created = 0

    def send(self, now_us: int, sender: int, frame: bytes) -> None:
        """Ask for the channel. The Left that follows says when the frame was out."""
        back_off_us = SLOT_US * self._random.randrange(CONTENTION_SLOTS)
        self._waiting.append(_Waiting(now_us, sender, frame, back_off_us))

    def next_us(self) -> int | None:
        """When pop() has work again if nothing more is sent; None: the air is quiet."""
        times = [self._start_us(waiting) for waiting in self._waiting]
        if self._ahead:
            times.append(self._ahead[0][0])
        return min(times, default=None)

    def pop(self, now_us: int) -> Happening | None:
        """The next thing that happens up to now_us, else None."""
        while True:
            starts = [self._start_us(waiting) for waiting in self._waiting]
            start_us = min(starts, default=now_us + 1)
            if self._ahead and self._ahead[0][0] <= min(start_us, now_us):
                return heapq.heappop(self._ahead)[2]
            if start_us > now_us:
                return None
            self._transmit(start_us, self._waiting.pop(starts.index(start_us)))

    def rssi_dbm(self, sender: int, receiver: int) -> int:
        """Signal strength of one frame: log-distance path loss and a random part."""
        distance_m = math.dist(self.positions_m[sender], self.positions_m[receiver])
        mean = _REFERENCE_DBM - 10 * _PATH_EXPONENT * math.log10(max(distance_m, 0.1))
        return round(min(-10.0, max(-100.0, self._random.gauss(mean, _SHADOWING_DB))))

    def _start_us(self, waiting: _Waiting) -> int:
        """When this frame starts, if nobody else does before it."""
        idle_us = self._free_us + DIFS_US
        return waiting.asked_us if waiting.asked_us >= idle_us else idle_us + waiting.back_off_us

    def _transmit(self, start_us: int, waiting: _Waiting) -> None:
        sender, frame, air = waiting.sender, waiting.frame, self._settings
        end_us = start_us + airtime_us(len(frame))
        self._free_us = end_us
        self.counts[sender].sent += 1
        self.counts[sender].air_us += end_us - start_us
        self._add(Left(end_us, sender, frame))
        for receiver in range(len(self.counts)):
            if receiver == sender:
                continue
            if self._random.random() < air.link_loss.get((sender, receiver), air.loss):
                self.counts[receiver].lost += 1
                continue
            again = self._random.random() < air.duplicate
            self.counts[receiver].received += 1
            self.counts[receiver].duplicates += again
            for _ in range(1 + again):
                arrival_us = end_us + air.latency_us + self._random.randint(0, air.jitter_us)
                self._add(Heard(arrival_us, receiver, self.rssi_dbm(sender, receiver), frame))

    def _add(self, happening: Happening) -> None:
        self._created += 1
        heapq.heappush(self._ahead, (happening.at_us, self._created, happening))
