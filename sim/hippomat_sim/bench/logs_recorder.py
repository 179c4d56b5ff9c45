"""What recording costs beside a control loop: share of a core, longest call, longest pause of its work.

The loop does a fixed piece of work between records, once without a recorder and once with: what the work
takes longer at worst is what the recorder's thread costs it.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from hippomat_sim.bench.logs_stream import START_NS, Call, Stream, call_of, new_recorder

WORK = 3000  # additions, about 0.15 ms


@dataclass(frozen=True, slots=True)
class RecorderFigures:
    """Shares of one core in percent; times in milliseconds. without: the same loop, nothing recorded."""

    seconds: float
    messages_per_s: float
    writer_percent: float  # the recorder's own thread
    calls_percent: float  # what the loop spends in calls to the recorder
    longest_call_ms: float
    work_ms: float  # median of the piece of work
    longest_work_ms: float
    longest_work_without_ms: float
    lost: int

    @property
    def percent(self) -> float:
        return self.writer_percent + self.calls_percent

    @property
    def stall_ms(self) -> float:
        """How much longer the loop was held up at worst than without a recorder."""
        return max(self.longest_call_ms, self.longest_work_ms - self.longest_work_without_ms)


@dataclass(frozen=True, slots=True)
class _Loop:
    cpu_s: float  # of other threads than the loop's
    calls_s: float
    longest_call_s: float
    work_s: list[float]


def measure_recorder(
    seconds: int, messages_per_s: float, progress: Callable[[float], None]
) -> RecorderFigures:
    """Real time: takes twice `seconds`."""
    steps = [step for second in range(seconds) for step in Stream().steps(second)]
    idle = [(step[0], _nothing, (step,)) for step in steps]
    without = _loop(idle, progress, 0.0)
    with tempfile.TemporaryDirectory(prefix="hippomat-bench-") as directory:
        recorder = new_recorder(Path(directory))
        calls = [call_of(recorder, step) for step in steps]
        with_recorder = _loop(calls, progress, float(seconds))
        status = recorder.close()
    return RecorderFigures(
        seconds=float(seconds),
        messages_per_s=messages_per_s,
        writer_percent=100 * (with_recorder.cpu_s - without.cpu_s) / seconds,
        calls_percent=100 * (with_recorder.calls_s - without.calls_s) / seconds,
        longest_call_ms=1e3 * with_recorder.longest_call_s,
        work_ms=1e3 * float(np.median(with_recorder.work_s)),
        longest_work_ms=1e3 * max(with_recorder.work_s),
        longest_work_without_ms=1e3 * max(without.work_s),
        lost=status.lost,
    )


def _nothing(_: object) -> None: ...


def _loop(calls: Sequence[Call], progress: Callable[[float], None], done_s: float) -> _Loop:
    work_s: list[float] = []
    calls_s = longest_s = 0.0
    process_s, thread_s = time.process_time(), time.thread_time()
    begun_s = time.perf_counter()
    for index, (at_ns, call, arguments) in enumerate(calls):
        due_s = begun_s + (at_ns - START_NS) / 1e9
        pause_s = due_s - time.perf_counter()
        if pause_s > 0:
            time.sleep(pause_s)
        before_s = time.perf_counter()
        call(*arguments)
        call_s = time.perf_counter() - before_s
        calls_s, longest_s = calls_s + call_s, max(longest_s, call_s)
        before_s = time.perf_counter()
        _work()
        work_s.append(time.perf_counter() - before_s)
        if index % 500 == 0:
            progress(done_s + (at_ns - START_NS) / 1e9)
    cpu_s = (time.process_time() - process_s) - (time.thread_time() - thread_s)
    return _Loop(cpu_s, calls_s, longest_s, work_s)


def _work() -> int:
    total = 0
    for number in range(WORK):
        total += number
    return total
