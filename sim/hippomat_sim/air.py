"""What the air is: airtime, its settings, who cannot hear whom, and what is told about a frame. Values only.

Airtime and timing: 802.11 OFDM in 2.4 GHz (IEEE 802.11-2020, 17.3 and 18.4.5), frames as ESP-NOW sends them
(facts/firmware.md).
"""

from __future__ import annotations

import itertools
import math
import random
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

_OVERHEAD_BYTES = 43  # 24 MAC + 8 + 7 (vendor action frame) + 4 FCS


def airtime_us(payload_bytes: int, rate_mbps: int = 6) -> int:
    """Airtime of a broadcast of at most 250 B; at 6 Mbit/s 61 B take 170 us, 124 B 254 us, 250 B 422 us."""
    bits = 16 + 8 * (_OVERHEAD_BYTES + payload_bytes) + 6  # service, frame, tail
    return (
        20 + 4 * math.ceil(bits / (4 * rate_mbps)) + 6
    )  # preamble, symbols of 4 us, 2.4 GHz signal extension


def hidden_pairs(stations: int, share: float, seed: int) -> frozenset[tuple[int, int]]:
    """That share of all pairs, drawn from the seed; the smaller number first."""
    pairs = list(itertools.combinations(range(stations), 2))
    return frozenset(random.Random(f"hidden {seed}").sample(pairs, round(share * len(pairs))))


@dataclass(frozen=True, slots=True)
class AirSettings:
    """What the air does to frames, the same on every link unless `link_loss` or `hidden` says otherwise.

    From send() to the receiver's callback an uncontended frame takes its airtime and on average 110 us.
    """

    loss: float = 0.0  # probability that one receiver misses one frame
    bursts: Literal["none", "link", "receiver"] = "none"  # Gilbert-Elliott: losses of a link, or fades
    burst_s: float = 0.3  # mean length of a burst
    duplicate: float = 0.001  # probability that a received frame is received twice
    driver_us: int = 20  # from send() to asking for the channel
    driver_jitter_us: int = 20  # uniform, on top
    latency_us: int = 60  # end of the frame to the receiving radio's callback
    jitter_us: int = 40  # uniform, on top
    late: float = 0.0  # probability that one receiver gets one frame late
    late_us: int = 5000  # by up to this, uniform
    shadowing_db: float = 2.0  # standard deviation of the signal strength around its mean
    capture_db: float = math.inf  # a frame so much stronger than all that overlap it is received
    rate_mbps: int = 6
    link_loss: Mapping[tuple[int, int], float] = field(default_factory=dict)  # (sender, receiver)
    hidden: frozenset[tuple[int, int]] = frozenset()  # pairs that neither hear nor sense each other


@dataclass(frozen=True, slots=True)
class Heard:
    """A frame reaches a receiver."""

    at_us: int
    receiver: int
    rssi_dbm: int
    frame: bytes
    sender: int


@dataclass(frozen=True, slots=True)
class Left:
    """A frame's transmission ended; its sender may send the next."""

    at_us: int
    sender: int
    frame: bytes


Happening: TypeAlias = Heard | Left


@dataclass(frozen=True, slots=True)
class Ended:
    """The same for a whole transmission: its end, and whom it reaches when. A duplicate is listed twice."""

    at_us: int
    sender: int
    frame: bytes
    receivers: NDArray[np.int64]  # (R,)
    arrivals_us: NDArray[np.int64]  # (R,) after at_us
    rssi_dbm: NDArray[np.int8]  # (R,)


@dataclass(frozen=True, slots=True)
class StationCounts:
    """Frames of one station; of all that others sent: received + lost + collided + deaf + unreached."""

    sent: int = 0
    received: int = 0
    lost: int = 0
    duplicates: int = 0  # received twice
    air_us: int = 0  # airtime of those sent
    collided: int = 0  # overlapped by another at this station
    deaf: int = 0  # it was sending itself
    unreached: int = 0  # hidden, or in another part of a partition
