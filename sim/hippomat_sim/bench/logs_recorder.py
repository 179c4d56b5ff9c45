"""What recording costs beside a control loop: share of a core, and how long it holds the loop up at worst.

The loop does a fixed piece of work between records, once without a recorder and once with. It is held up
where it waits for the recorder: for a lock, the disk or the interpreter. Where it was only pushed aside, that
counts as far as the recorder's thread was at work meanwhile: a machine that others use makes longer pauses.
"""

from __future__ import annotations

import contextlib
import os
import resource
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from itertools import chain, count
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import numpy as np

from hippomat_logs.recorder import PLUG_S, bound_interpreter_wait
from hippomat_sim.bench.core_speed import additions
from hippomat_sim.bench.logs_peer import calls_of_peer
from hippomat_sim.bench.logs_stream import START_NS, Call, Step, Stream, call_of, new_recorder

Figures = TypeVar("Figures")
WORK = 3000  # additions, about 0.15 ms


@dataclass(frozen=True, slots=True)
class RecorderFigures:
    """Shares of one core in percent; times in milliseconds. without: the same loop, nothing recorded."""

    seconds: float
    messages_per_s: float
    writer_percent: float  # the recorder's own thread
    calls_percent: float  # what the loop spends in calls to the recorder
    stall_ms: float  # longest that the loop was held up by the recorder, from a call to the end of its work
    work_ms: float  # median of the piece of work, WORK additions
    longest_ms: float  # of call and work, whoever held it up
    longest_without_ms: float
    lost: int
    is_alone: bool  # in real time: the system let other processes wait
    mcap_writer_percent: float  # of its peer, given the bytes

    @property
    def percent(self) -> float:
        return self.writer_percent + self.calls_percent

    @property
    def over_mcap_writer(self) -> float:
        return self.percent / self.mcap_writer_percent


class _Clocks(NamedTuple):
    """Real time; processor time of the loop's thread and of all others; how often the loop's gave way."""

    real_s: float
    own_s: float
    others_s: float
    gave_way: int

    @classmethod
    def now(cls) -> _Clocks:
        own_s = time.thread_time()
        gave_way = resource.getrusage(resource.RUSAGE_THREAD).ru_nvcsw
        return cls(time.perf_counter(), own_s, time.process_time() - own_s, gave_way)


def measure_recorder(
    seconds: int, messages_per_s: float, progress: Callable[[float], None]
) -> RecorderFigures:
    """Takes five times `seconds`. progress() is called between two steps of the loop.

    No other thread of the process may work meanwhile.
    """
    stream, done_s = Stream(), count()

    def steps() -> Iterator[Step]:
        """Made as they are needed: a real loop's records are in the caches too."""
        for second in range(seconds):
            progress(float(next(done_s)))
            yield from stream.steps(second)

    def idle() -> Iterator[Call]:
        return ((step[0], _nothing, (step,)) for step in steps())

    with _undisturbed() as is_alone, tempfile.TemporaryDirectory(prefix="hippomat-bench-") as directory:
        without = _costs(idle())
        peer = _costs(calls_of_peer(Path(directory) / "peer.mcap", steps()))
        costs, lost_then = _recorded(Path(directory), steps(), _costs)
        alone = _pauses(idle())
        pauses, lost = _recorded(Path(directory), steps(), _pauses)
    return RecorderFigures(
        seconds=float(seconds),
        messages_per_s=messages_per_s,
        writer_percent=100 * (costs.others_s - without.others_s) / seconds,
        calls_percent=100 * (costs.calls_s - without.calls_s) / seconds,
        stall_ms=1e3 * pauses.stall_s,
        work_ms=1e3 * costs.work_s,
        longest_ms=1e3 * pauses.longest_s,
        longest_without_ms=1e3 * alone.longest_s,
        lost=lost_then + lost,
        is_alone=is_alone,
        mcap_writer_percent=100 * (peer.calls_s - without.calls_s) / seconds,
    )


def _recorded(
    directory: Path, steps: Iterable[Step], loop: Callable[[Iterable[Call]], Figures]
) -> tuple[Figures, int]:
    """What the loop finds, and the records that were lost."""
    recorder = new_recorder(directory)
    try:
        figures = loop(call_of(recorder, step) for step in steps)
    finally:
        status = recorder.close()
    return figures, status.lost


@contextlib.contextmanager
def _undisturbed() -> Iterator[bool]:
    """Where the system allows it (True), other processes wait: what they take is not the recorder's. The
    interpreter is shared as in the daemon."""
    before = os.sched_getscheduler(0), os.sched_getparam(0)
    switch_s = sys.getswitchinterval()
    try:
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(1))
        is_alone = True
    except OSError:
        is_alone = False
    try:
        bound_interpreter_wait()
        yield is_alone
    finally:
        sys.setswitchinterval(switch_s)
        if is_alone:
            os.sched_setscheduler(0, *before)


def _nothing(_: object) -> None: ...


class _Costs(NamedTuple):
    calls_s: float
    others_s: float  # processor time of all other threads
    work_s: float  # median


def _costs(calls: Iterable[Call]) -> _Costs:
    """Of a loop that looks at no clock but real time's: every other one takes what it measures."""
    work_s: list[float] = []
    calls_s = 0.0
    begun = _Clocks.now()
    for _, _, call, arguments in _paced(calls):
        called_s = time.perf_counter()
        call(*arguments)
        ended_s = time.perf_counter()
        additions(WORK)
        work_s.append(time.perf_counter() - ended_s)
        calls_s += ended_s - called_s
    time.sleep(PLUG_S)  # then all is written
    return _Costs(calls_s, _Clocks.now().others_s - begun.others_s, float(np.median(work_s)))


class _Pauses(NamedTuple):
    longest_s: float
    stall_s: float


def _pauses(calls: Iterable[Call]) -> _Pauses:
    """Of a loop that finds out what held it up."""
    longest_s = stall_s = 0.0
    before = _Clocks.now()
    for due_s, slept, call, arguments in _paced(calls):
        own_s = time.thread_time()
        call(*arguments)
        own_ended_s = time.thread_time()
        additions(WORK)
        after = _Clocks.now()
        took_s = after.real_s - max(due_s, before.real_s)
        waited_s = max(0.0, took_s - (after.own_s - before.own_s))
        if after.gave_way - before.gave_way <= slept:  # its own pause, no more: it was pushed aside
            waited_s = min(waited_s, after.others_s - before.others_s)
        longest_s = max(longest_s, took_s)
        stall_s = max(stall_s, own_ended_s - own_s + waited_s)
        before = _Clocks.now()
    return _Pauses(longest_s, stall_s)


def _paced(calls: Iterable[Call]) -> Iterator[tuple[float, bool, Callable[..., None], tuple[Any, ...]]]:
    """(when it was due, whether that had to be waited for, what to call, with what), each when it is due."""
    remaining = iter(calls)
    first = next(remaining)  # making it may take long
    begun_s = time.perf_counter()
    for at_ns, call, arguments in chain([first], remaining):
        due_s = begun_s + (at_ns - START_NS) / 1e9
        pause_s = due_s - time.perf_counter()
        if pause_s > 0:
            time.sleep(pause_s)
        yield due_s, pause_s > 0, call, arguments
