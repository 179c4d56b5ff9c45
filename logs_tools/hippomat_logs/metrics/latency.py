"""How long a STATE takes from core to core, matched by its sender, boot and sequence number.

Three measures, for no two clocks are one:
- whole: the sender's SendState -> the receiver's StateHeard, both on the fleet's common time (alignment.py);
- air: header's fleet time -> fleet time of arrival, radio to radio, each by its own estimate of fleet time;
- radio to host: how much later than the fastest frame of the same two seconds the host read it. What every
  frame takes cannot be told from the offset of the two clocks.
Both sides keep only sequence numbers that are multiples of a power of two, which grows with the run.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from hippomat_core import messages as m
from hippomat_core.wire import frames
from hippomat_logs.metrics.samples import Samples

Times = NDArray[np.int64]
Frame = tuple[int, int]  # boot, sequence
MAX_KEPT = 8192  # frames of one sender
WINDOW_NS = 2_000_000_000  # two crystals that differ by 50 ppm move 0.1 ms apart meanwhile


class _Stamps:
    """Frame -> time [ns], of every `stride`-th sequence number."""

    def __init__(self) -> None:
        self.stride = 1
        self.times: dict[Frame, int] = {}

    def add(self, frame: Frame, time_ns: int) -> None:
        if frame[1] % self.stride:
            return
        self.times.setdefault(frame, time_ns)
        if len(self.times) > MAX_KEPT:
            self.stride *= 2
            self.times = {key: at for key, at in self.times.items() if key[1] % self.stride == 0}


@dataclass(slots=True)
class Passages:
    """One robot's half: when its STATEs left its core, when it heard those of others; its log's time."""

    sent: _Stamps = field(default_factory=_Stamps)
    heard: dict[int, _Stamps] = field(default_factory=lambda: defaultdict(_Stamps))


class LatencyReading:
    """Collects one robot's passages, and what needs no other robot's log."""

    def __init__(self) -> None:
        self.passages = Passages()
        self.air_ms = Samples()
        self.radio_to_host_ms = Samples()
        self._boot = -1  # of our radio; a frame sent before it said so is left out
        self._waiting_ns = -1  # log time of the SendState that the radio has not yet reported
        self._window: list[int] = []  # host minus radio clock [ns]
        self._window_end_ns = 0

    def heard(self, message: m.StateHeard, log_time_ns: int, agreed: bool) -> None:
        """agreed: fleet time is."""
        header = message.header
        self.passages.heard[header.sender].add((header.boot, header.sequence), log_time_ns)
        if agreed:
            self.air_ms.add((message.fleet_time_us - header.fleet_time_us) / 1e3)
        if message.stamp_ns > self._window_end_ns:
            self._close_window()
            self._window_end_ns = message.stamp_ns + WINDOW_NS
        self._window.append(message.stamp_ns - 1000 * message.radio_time_us)

    def status(self, message: m.RadioStatus) -> None:
        self._boot = message.boot_counter

    def decided_state(self, log_time_ns: int) -> None:
        """A SendState left the core; it replaces one that waits."""
        self._waiting_ns = log_time_ns

    def sent(self, message: m.FrameSent) -> None:
        if message.kind != frames.STATE or self._waiting_ns < 0:
            return
        if message.sent and self._boot >= 0:
            self.passages.sent.add((self._boot, message.sequence), self._waiting_ns)
        self._waiting_ns = -1

    def _close_window(self) -> None:
        if len(self._window) > 1:
            fastest = min(self._window)
            self.radio_to_host_ms.extend((one - fastest) / 1e6 for one in self._window)
        self._window.clear()

    def close(self) -> None:
        self._close_window()


@dataclass(frozen=True, slots=True)
class LatencyMetrics:
    """Core to core of one direction; nan where no frame is in both logs. Negative: the clocks are not one."""

    sender: int
    receiver: int
    frames: int
    median_ms: float
    high_ms: float  # 95th percentile


def whole_latencies(
    halves: Iterable[tuple[int, Passages]], common_ns: Callable[[int, Times], Times]
) -> list[LatencyMetrics]:
    """Every direction of which both logs are there. common_ns(place in halves, log times) -> common time."""
    known = list(halves)
    places = {robot: place for place, (robot, _) in enumerate(known)}
    found = []
    for to, (receiver, passages) in enumerate(known):
        for sender, stamps in passages.heard.items():
            if sender in places:
                of = places[sender]
                matched = _matched(known[of][1].sent, stamps)
                begun, ended = common_ns(of, matched[0]), common_ns(to, matched[1])
                found.append(_metrics(sender, receiver, (ended - begun) / 1e6))
    return sorted(found, key=lambda one: (one.sender, one.receiver))


def _matched(sent: _Stamps, heard: _Stamps) -> tuple[Times, Times]:
    """Log times of the frames that both have: (n,) when they left, (n,) when they arrived."""
    pairs = [(at, heard.times[frame]) for frame, at in sent.times.items() if frame in heard.times]
    table = np.array(pairs, np.int64).reshape(-1, 2)
    return table[:, 0], table[:, 1]


def _metrics(sender: int, receiver: int, taken_ms: NDArray[np.float64]) -> LatencyMetrics:
    if not taken_ms.size:
        return LatencyMetrics(sender, receiver, 0, math.nan, math.nan)
    median, high = np.percentile(taken_ms, (50, 95)).tolist()
    return LatencyMetrics(sender, receiver, len(taken_ms), median, high)
