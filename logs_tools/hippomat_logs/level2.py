"""Level L2: the recorded events, fed to the core, give the recorded effects.

Bit for bit where the fingerprints are equal; otherwise logits within 1e-5, other floats within 1e-6, and the
same action wherever the top two logits are more than 1e-4 apart. Knows events and effects, no bytes.
"""

from __future__ import annotations

import dataclasses
import math
import struct
from collections.abc import Iterator
from itertools import chain
from typing import Any

import numpy as np

from hippomat_core import messages as m
from hippomat_core.step import State, step
from hippomat_logs.reader import Record, Run
from hippomat_logs.report import FAILED, OK, Divergence, LevelResult
from hippomat_logs.schema import EFFECTS, EVENTS, TOPICS, MessageStore, differences
from hippomat_logs.walk import RawMessage

LOGITS_TOLERANCE = 1e-5
FLOAT_TOLERANCE = 1e-6
TIE_MARGIN = 1e-4
_EVENTS, _EFFECTS = frozenset(EVENTS), frozenset(EFFECTS)
NO_SUCH_EFFECT = "no such effect"  # recorded, where one was replayed; found at the next event


def is_near_tie(decided: m.RoundDecided) -> bool:
    """Whether another machine's last bits may decide otherwise."""
    top = np.sort(np.asarray(decided.logits))[-2:]
    return len(top) == 2 and float(top[1] - top[0]) <= TIE_MARGIN


def tied(decided: m.RoundDecided, action: int) -> bool:
    """Whether another machine's last bits may decide for `action` instead."""
    best = float(np.max(decided.logits)) if len(decided.logits) else math.inf
    within = 0 <= action < len(decided.logits) and best - float(decided.logits[action]) <= TIE_MARGIN
    return within and action != decided.action and is_near_tie(decided)


class EffectComparison:
    """Compare effects with recorded ones, one after the other."""

    def __init__(self, store: MessageStore, exact: bool) -> None:
        self.store = store
        self.exact = exact
        self.near_ties = 0

    def bytes_of(self, replayed: Any) -> bytes:
        """Empty where it does not fit its definition: then it is not what was recorded."""
        try:
            return self.store.encode(replayed)
        except (struct.error, ValueError, OverflowError):
            return b""

    def first_difference(self, recorded: Any, replayed: Any) -> tuple[str, Any, Any] | None:
        """(field, recorded, replayed) of the first difference that counts."""
        if type(recorded) is not type(replayed):
            return "effect", type(recorded).__name__, type(replayed).__name__
        if self.store.encode(recorded) == self.bytes_of(replayed):
            return None
        name = type(recorded).__name__
        for path, a, b in differences(recorded, replayed):
            if self.exact or not self._tolerated(recorded, replayed, path, a, b):
                return f"{name}.{path}", a, b
        return (name, recorded, replayed) if self.exact else None

    def _tolerated(self, recorded: Any, replayed: Any, path: str, a: Any, b: Any) -> bool:
        decided = isinstance(recorded, m.RoundDecided)
        if decided and path in ("action", "reason") and tied(recorded, replayed.action):
            self.near_ties += path == "action"
            return True
        if isinstance(a, float) and isinstance(b, float):
            limit = LOGITS_TOLERANCE if path.startswith("logits") else FLOAT_TOLERANCE
            return math.isclose(a, b, rel_tol=limit, abs_tol=limit)
        return False


class DecisionReplay:
    """Feed every record of one run in order, then ask for the result. Stops at the first divergence."""

    def __init__(self, run: Run, state: State, exact: bool) -> None:
        """state: from which the core goes on. Of a clip, effects of earlier events were not kept."""
        config = run.config
        self._state, self._compared_from = state, run.compared_from
        self._robot = config.robot.id
        self._decides = config.robot.id >= 0 and config.slam.mode != "map" and not run.compared_from
        self._started_ns = int(run.manifest.get("started_ns", "0"))
        self._offset_ns = run.wall_offset_ns
        self._compare = EffectComparison(run.store, exact)
        self._pending: Iterator[m.Effect] = iter(())
        self._tick = self._events = self._effects = self._decisions = 0
        self._last: Record | None = None
        self._notes: list[str] = []
        self._stopped = False  # behind a near-tie the two runs are different runs
        self.divergence: Divergence | None = None

    def feed(self, record: Record) -> None:
        if self.divergence is not None or self._stopped:
            return
        if type(record.message) in _EVENTS:
            self._no_more(record)
            if self.divergence is None:
                self._event(record)
        elif type(record.message) in _EFFECTS:
            self._effect(record)

    def takes(self, raw: RawMessage) -> bool:
        """Whether these are the very bytes of the effect that comes next: nobody needs to decode them."""
        if self.divergence is not None or self._stopped:
            return False
        replayed = next(self._pending, None)
        if replayed is None:
            return False
        kind = type(replayed)
        if TOPICS[kind] != raw.topic or self._compare.bytes_of(replayed) != raw.data:
            self._pending = chain((replayed,), self._pending)
            return False
        self._effects += 1
        self._decisions += kind is m.RoundDecided
        return True

    def result(self, may_be_cut: bool) -> LevelResult:
        """may_be_cut: the log's end was lost, so effects of its last event may be missing."""
        if self._last is not None and not may_be_cut and not self._stopped:
            self._no_more(self._last)
        how = "bit-equal" if self._compare.exact else "within tolerances: another machine or library"
        detail = f"{self._effects:,} effects of {self._events:,} events, {how}"
        detail += ", up to a near-tie" if self._stopped else ""
        status = OK if self.divergence is None and self._decisions else FAILED
        if self.divergence is None and not self._decisions:
            if self._effects and not self._decides:
                status = OK  # an observer, who makes a map, or a clip: its effects were compared
            else:
                detail += ": nothing was compared, which is a failure"
        return LevelResult("L2", status, self._decisions, "decisions", detail, self._notes, self.divergence)

    def _event(self, record: Record) -> None:
        self._last = record
        self._events += 1
        self._tick += isinstance(record.message, m.Tick)
        try:
            self._state, effects = step(self._state, record.message)
        except Exception as error:  # whatever the core raises is a finding about this record
            effects = ()
            found = f"{type(error).__name__}: {error}"
            self._diverge(record, type(record.message).__name__, "an event", found)
        self._pending = iter(effects if record.number >= self._compared_from else ())

    def _effect(self, record: Record) -> None:
        replayed = next(self._pending, None)
        if replayed is None:
            self._diverge(record, type(record.message).__name__, record.message, "no further effect")
            return
        ties = self._compare.near_ties
        found = self._compare.first_difference(record.message, replayed)
        if found is not None:
            self._diverge(record, *found)
            return
        self._effects += 1
        self._decisions += isinstance(record.message, m.RoundDecided)
        if self._compare.near_ties > ties:
            self._stopped = True
            self._notes.append(
                f"near-tie at tick {self._tick} (record {record.number}): the two best logits are within "
                f"{TIE_MARGIN}, the other action was taken; nothing behind it can be compared"
            )

    def _no_more(self, record: Record) -> None:
        """The next event came: the one before must have no effect left."""
        left = next(self._pending, None)
        if left is not None:
            self._diverge(record, type(left).__name__, NO_SUCH_EFFECT, dataclasses.asdict(left))

    def _diverge(self, record: Record, field: str, recorded: Any, replayed: Any) -> None:
        time_s = (record.log_time_ns - self._offset_ns - self._started_ns) / 1e9
        self.divergence = self.divergence or Divergence(
            "L2", self._robot, self._tick, record.number, time_s, field, recorded, replayed
        )
