"""The records of several runs in one order: by common time, each run's own kept, no effect before its cause.

Decides when a reception is held back: until the record of its sending has come. Daemons read their radios
late, some later than others, so a frame is often noted by who heard it before it is by who sent it. Knows
numbers and times, not records; what it gives out never goes back in time.
"""

from __future__ import annotations

import heapq
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Generic, NamedTuple, TypeVar

import numpy as np

from hippomat_logs.clock_map import Times
from hippomat_logs.radio_links import Link

LONG_AGO_NS = -(1 << 62)
T = TypeVar("T")


class Stamped(NamedTuple, Generic[T]):
    """A record of one run: its number, its time in common time, itself."""

    number: int
    common_ns: int
    record: T


class Placed(NamedTuple, Generic[T]):
    """A record at its place among those of all runs; at_ns: common time, or a little later."""

    run: int
    at_ns: int
    stamped: Stamped[T]


@dataclass(frozen=True, slots=True)
class Causes:
    """Which records of one run wait for which of others, by ascending number."""

    numbers: Times  # (n,)
    by_run: Times  # (n,)
    by_number: Times  # (n,)


@dataclass(slots=True)
class Held:
    """Receptions that stand later than their own common time."""

    count: int = 0
    longest_ns: int = 0
    broken: int = 0  # placed without their cause: it is lost, or each waits for the other


def causes_of(links: Sequence[Link], runs: int) -> list[Causes]:
    """For each run: its receptions, and the sendings in other runs."""
    found: list[list[tuple[Times, int, Times]]] = [[] for _ in range(runs)]
    for link in links:
        found[link.second].append((link.there.heard_numbers, link.first, link.there.sent_numbers))
        found[link.first].append((link.back.heard_numbers, link.second, link.back.sent_numbers))
    return [_sorted(one) for one in found]


def _sorted(parts: Sequence[tuple[Times, int, Times]]) -> Causes:
    none = [np.empty(0, np.int64)]
    numbers = np.concatenate([*none, *(heard for heard, _, _ in parts)])
    by_run = np.concatenate([*none, *(np.full(len(heard), run) for heard, run, _ in parts)])
    by_number = np.concatenate([*none, *(sent for _, _, sent in parts)])
    order = np.argsort(numbers, kind="stable")
    return Causes(numbers[order], by_run[order], by_number[order])


def in_causal_order(
    runs: Sequence[Iterator[Stamped[T]]], causes: Sequence[Causes], held: Held
) -> Iterator[Placed[T]]:
    """All records of all runs, once each. `held` is complete at the end."""
    return _Merge([_Feed(records, cause) for records, cause in zip(runs, causes, strict=True)], held).placed()


@dataclass(slots=True)
class _Feed(Generic[T]):
    """One run's records; `head` is the next one, `done` the number of the last that was placed."""

    records: Iterator[Stamped[T]]
    causes: Causes
    head: Stamped[T] | None = None
    done: int = 0
    last_ns: int = LONG_AGO_NS
    at: int = 0  # in causes
    waiting: list[tuple[int, int]] = field(default_factory=list)  # (number awaited, run), a heap

    def advance(self) -> tuple[int, int] | None:
        """Take the next record; (run, number) of its cause."""
        self.head = next(self.records, None)
        numbers = self.causes.numbers
        while self.head and self.at < len(numbers) and numbers[self.at] < self.head.number:
            self.at += 1
        if self.head and self.at < len(numbers) and numbers[self.at] == self.head.number:
            return int(self.causes.by_run[self.at]), int(self.causes.by_number[self.at])
        return None


class _Merge(Generic[T]):
    """Heads whose cause has been placed are ready; the others wait with the run that their cause is in."""

    def __init__(self, feeds: Sequence[_Feed[T]], held: Held) -> None:
        self._feeds, self._held = feeds, held
        self._ready: list[tuple[int, int]] = []  # (time, run), a heap

    def placed(self) -> Iterator[Placed[T]]:
        for run in range(len(self._feeds)):
            self._advance(run, LONG_AGO_NS)
        while self._ready or self._break_a_ring():
            at_ns, run = heapq.heappop(self._ready)
            feed = self._feeds[run]
            assert feed.head is not None
            self._note(at_ns - max(feed.head.common_ns, feed.last_ns))
            yield Placed(run, at_ns, feed.head)
            feed.last_ns, feed.done = at_ns, feed.head.number
            self._advance(run, at_ns)

    def _advance(self, run: int, now_ns: int) -> None:
        feed = self._feeds[run]
        cause = feed.advance()
        if cause is not None and self._comes(*cause):
            heapq.heappush(self._feeds[cause[0]].waiting, (cause[1], run))
        else:
            self._offer(run, now_ns)
        while feed.waiting and (feed.waiting[0][0] <= feed.done or feed.head is None):
            number, other = heapq.heappop(feed.waiting)
            self._held.broken += number > feed.done
            self._offer(other, now_ns)

    def _comes(self, run: int, number: int) -> bool:
        feed = self._feeds[run]
        return feed.done < number and (feed.head is not None or feed.last_ns == LONG_AGO_NS)

    def _offer(self, run: int, now_ns: int) -> None:
        feed = self._feeds[run]
        if feed.head is not None:
            heapq.heappush(self._ready, (max(feed.head.common_ns, feed.last_ns, now_ns), run))

    def _break_a_ring(self) -> bool:
        """All that is left waits for each other: let the earliest go."""
        stuck = [(feed.head.common_ns, run) for run, feed in enumerate(self._feeds) if feed.head is not None]
        if not stuck:
            return False
        _, free = min(stuck)
        for feed in self._feeds:
            feed.waiting = [(number, run) for number, run in feed.waiting if run != free]
            heapq.heapify(feed.waiting)
        self._held.broken += 1
        self._offer(free, max(feed.last_ns for feed in self._feeds))
        return True

    def _note(self, late_ns: int) -> None:
        if late_ns > 0:
            self._held.count += 1
            self._held.longest_ns = max(self._held.longest_ns, late_ns)
