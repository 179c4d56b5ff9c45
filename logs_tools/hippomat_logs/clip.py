"""A small log that still shows where a run first diverges: its clip, kept as a test of the bug that it shows.

Decides which events can go. What the core remembers it has from its events, so a clip begins where the run
began; events are left out as long as the core, fed the rest, differs from the log in the same field with the
same two values (delta debugging: Zeller, Hildebrandt 2002, ddmin). Only the last event's effects are kept.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import Any

from hippomat_core import messages as m
from hippomat_core.errors import HippomatError
from hippomat_core.state import State
from hippomat_core.step import initial_state, step
from hippomat_logs.level2 import NO_SUCH_EFFECT, DecisionReplay
from hippomat_logs.new_log import NewRecord, write_log
from hippomat_logs.reader import CLIP_KEY, COMPARED_FROM_KEY, Record, Run
from hippomat_logs.redecide import attachments_of
from hippomat_logs.report import Divergence
from hippomat_logs.schema import EFFECT_TOPICS, EVENT_TOPICS, EVENTS

BUDGET_STEPS = 300_000  # of the core: half a minute or so
FIRST_WINDOW_S = 0.5  # before the divergence; doubled until it shows
_FOUNDATIONS = (m.Started, m.MapReceived, m.PortOpened, m.PortLost)

Progress = Callable[[int, int], None]  # (steps done, budget)


@dataclass(frozen=True, slots=True)
class Found:
    """A run's first divergence: all events up to where it happened, and the effects recorded there."""

    run: Run
    divergence: Divergence
    events: tuple[Record, ...]
    effects: tuple[Record, ...]


def find_divergence(run: Run, exact: bool) -> Found | None:
    """Where `run` first diverges; None where it does not."""
    replay = DecisionReplay(run, initial_state(run.config, run.policy or None), exact)
    events: list[Record] = []
    effects: list[Record] = []
    for path, raw in run.raw_in_order():
        if run.lost:
            break  # what follows depends on what is missing
        if raw.topic in EVENT_TOPICS:
            if replay.divergence is not None:
                break
            record = run.decoded(path, raw)
            replay.feed(record)
            if replay.divergence is not None and replay.divergence.recorded == NO_SUCH_EFFECT:
                break  # it happened at the event before
            events.append(record)
            effects = []
        elif raw.topic in EFFECT_TOPICS:
            effects.append(run.decoded(path, raw))
            replay.feed(effects[-1])
    replay.result(run.recovered or bool(run.lost))
    if replay.divergence is None:
        return None
    return Found(run, replay.divergence, tuple(events), tuple(effects))


def write_clip(found: Found, path: Path, exact: bool, progress: Progress = lambda *_: None) -> int:
    """The smallest log that the budget gives; how many events it keeps."""
    events = _Thinning(found, exact, progress).smallest()
    told = f"{found.run.name}: {found.divergence}; {len(events)} of {len(found.events)} events are kept"
    manifest = {**found.run.manifest, CLIP_KEY: told, COMPARED_FROM_KEY: str(len(events))}
    store = found.run.store
    records = (
        NewRecord(record.log_time_ns, record.topic, store.encode(record.message))
        for record in chain(events, found.effects)
    )
    write_log(path, manifest, attachments_of(found.run), records, store)
    return len(events)


class _Thinning:
    """Leaves events out of `found` while the divergence stays, until there is nothing to leave out."""

    def __init__(self, found: Found, exact: bool, progress: Progress) -> None:
        self._found, self._exact, self._progress = found, exact, progress
        self._begun = initial_state(found.run.config, found.run.policy or None)
        self._steps = 0

    def smallest(self) -> list[Record]:
        """The events to keep; HippomatError where even all of them do not show it again."""
        last = self._found.events[-1]
        kept = self._without_the_past(list(self._found.events[:-1]))
        kept = self._without_kinds(kept)
        return [*self._without_chunks(kept), last]

    def _without_the_past(self, events: list[Record]) -> list[Record]:
        """What everything rests on, and the last seconds."""
        end_ns = self._found.events[-1].log_time_ns
        window_ns = int(FIRST_WINDOW_S * 1e9)
        while events and end_ns - window_ns > events[0].log_time_ns:
            recent = [
                one
                for one in events
                if isinstance(one.message, _FOUNDATIONS) or one.log_time_ns > end_ns - window_ns
            ]
            if self._shows(recent):
                return recent
            window_ns *= 2
        if not self._shows(events, always=True):
            raise HippomatError(f"{self._found.run.name}: diverges differently when it is replayed again")
        return events

    def _without_kinds(self, events: list[Record]) -> list[Record]:
        for kind in EVENTS:
            rest = [one for one in events if not isinstance(one.message, kind)]
            if len(rest) < len(events) and self._shows(rest):
                events = rest
        return events

    def _without_chunks(self, events: list[Record]) -> list[Record]:
        """ddmin: chunks of half, a quarter ... are left out, down to single events."""
        chunks = 2
        while events and self._steps < BUDGET_STEPS:
            size = -(-len(events) // chunks)
            for begin in range(0, len(events), size):
                rest = events[:begin] + events[begin + size :]
                if self._shows(rest):
                    events, chunks = rest, max(chunks - 1, 2)
                    break
            else:
                if size == 1:
                    break
                chunks = min(2 * chunks, len(events))
        return events

    def _shows(self, events: Sequence[Record], always: bool = False) -> bool:
        """Whether the core, fed these, differs at the last event as it did in the run."""
        if self._steps >= BUDGET_STEPS and not always:
            return False
        self._steps += len(events) + 1
        self._progress(min(self._steps, BUDGET_STEPS), BUDGET_STEPS)
        try:
            state = _after(self._begun, (record.message for record in events))
        except Exception:  # whatever the core raises without these events is not what we look for
            return False
        replay = DecisionReplay(self._found.run, state, self._exact)
        for record in (self._found.events[-1], *self._found.effects):
            replay.feed(record)
        replay.result(False)
        return _meaning(replay.divergence) == _meaning(self._found.divergence)


def _after(state: State, events: Iterable[Any]) -> State:
    for event in events:
        state, _ = step(state, event)
    return state


def _meaning(divergence: Divergence | None) -> tuple[str, str, str] | None:
    """Field and values; record and tick depend on what was left out."""
    if divergence is None:
        return None
    return divergence.field, repr(divergence.recorded), repr(divergence.replayed)
