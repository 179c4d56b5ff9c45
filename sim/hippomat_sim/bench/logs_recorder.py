"""What recording costs beside a control loop: share of a core, and how long it holds the loop up at worst.

The loop does a fixed piece of work between records, once without a recorder and once with. A pause counts as
the recorder's as far as the recorder was at work in it, in its call or in its thread: a machine that others
use, too, makes longer ones.
"""

from __future__ import annotations

import contextlib
import os
import tempfile
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from hippomat_logs.recorder import bound_interpreter_wait
from hippomat_sim.bench.core_speed import additions
from hippomat_sim.bench.logs_stream import START_NS, Call, Step, Stream, call_of, new_recorder

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

    @property
    def percent(self) -> float:
        return self.writer_percent + self.calls_percent


@dataclass(frozen=True, slots=True)
class _Loop:
    cpu_s: float  # of other threads than the loop's
    calls_s: float
    work_s: list[float]
    longest_s: float
    stall_s: float


def measure_recorder(
    seconds: int, messages_per_s: float, progress: Callable[[float], None]
) -> RecorderFigures:
    """Takes twice `seconds`. progress() is called between two steps of the loop; no other thread may work."""
    bound_interpreter_wait()  # as the daemon does
    with _undisturbed(), tempfile.TemporaryDirectory(prefix="hippomat-bench-") as directory:
        without = _loop(((step[0], _nothing, (step,)) for step in _steps(seconds)), progress, 0.0)
        recorder = new_recorder(Path(directory))
        calls = (call_of(recorder, step) for step in _steps(seconds))
        with_recorder = _loop(calls, progress, float(seconds))
        status = recorder.close()
    return RecorderFigures(
        seconds=float(seconds),
        messages_per_s=messages_per_s,
        writer_percent=100 * (with_recorder.cpu_s - without.cpu_s) / seconds,
        calls_percent=100 * (with_recorder.calls_s - without.calls_s) / seconds,
        stall_ms=1e3 * with_recorder.stall_s,
        work_ms=1e3 * float(np.median(with_recorder.work_s)),
        longest_ms=1e3 * with_recorder.longest_s,
        longest_without_ms=1e3 * without.longest_s,
        lost=status.lost,
    )


@contextlib.contextmanager
def _undisturbed() -> Iterator[None]:
    """Where the system allows it, other processes have to wait: what they take is not the recorder's."""
    before = os.sched_getscheduler(0), os.sched_getparam(0)
    with contextlib.suppress(PermissionError):
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(1))
    try:
        yield
    finally:
        os.sched_setscheduler(0, *before)


def _steps(seconds: int) -> Iterator[Step]:
    """Made as they are needed: a real loop's records are in the caches too."""
    stream = Stream()
    for second in range(seconds):
        yield from stream.steps(second)


def _nothing(_: object) -> None: ...


def _loop(calls: Iterable[Call], progress: Callable[[float], None], done_s: float) -> _Loop:
    work_s: list[float] = []
    calls_s = longest_s = stall_s = 0.0
    process_s, thread_s = time.process_time(), time.thread_time()
    begun_s = time.perf_counter()
    for index, (at_ns, call, arguments) in enumerate(calls):
        due_s = begun_s + (at_ns - START_NS) / 1e9
        others_s = _others_s()
        pause_s = due_s - time.perf_counter()
        if pause_s > 0:
            time.sleep(pause_s)
        own_s, before_s = time.thread_time(), time.perf_counter()
        call(*arguments)
        called_s, own_called_s = time.perf_counter(), time.thread_time()
        additions(WORK)
        ended_s, own_ended_s = time.perf_counter(), time.thread_time()
        calls_s += called_s - before_s
        work_s.append(ended_s - called_s)
        late_s = before_s - due_s if pause_s > 0 else 0.0
        longest_s = max(longest_s, late_s + ended_s - before_s)
        waited_s = late_s + (ended_s - before_s) - (own_ended_s - own_s)
        stall_s = max(stall_s, own_called_s - own_s + min(waited_s, _others_s() - others_s))
        if index % 500 == 0:
            progress(done_s + (at_ns - START_NS) / 1e9)
    cpu_s = (time.process_time() - process_s) - (time.thread_time() - thread_s)
    return _Loop(cpu_s, calls_s, work_s, longest_s, stall_s)


def _others_s() -> float:
    """Processor time of the process's other threads."""
    return time.process_time() - time.thread_time()
