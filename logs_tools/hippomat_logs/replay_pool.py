"""Replay several runs at once, each in a process of its own, with a progress bar.

Decides how many processes there are, and that each computes with as many threads as its daemon did.
"""

from __future__ import annotations

import multiprocessing
import os
import sys
from collections.abc import Callable
from concurrent.futures import Future, ProcessPoolExecutor, wait
from pathlib import Path
from queue import Empty
from typing import Any, TypeVar

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from hippomat_logs.interrupts import interrupts_held
from hippomat_logs.manifest import recorded_threads
from hippomat_logs.reader import Run, open_again
from hippomat_logs.replay import ReplayOptions, replay_run
from hippomat_logs.report import RunReport

T = TypeVar("T")
_progress: Any = None  # in a worker: the queue to its parent


def _start_worker(queue: Any) -> None:
    global _progress
    _progress = queue


def _replay_in_worker(
    number: int, run_paths: tuple[Path, ...], inside: str, options: ReplayOptions
) -> RunReport:
    run = open_again(run_paths, inside)
    return replay_run(run, options, lambda level, done: _progress.put((number, level, done)))


def in_a_process(run: Run, work: Callable[..., T], *arguments: Any) -> T:
    """work(*arguments) where numbers are computed as the daemon of `run` computed them."""
    os.environ.update(recorded_threads(run.manifest))
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as pool:
        try:
            with interrupts_held():
                future = pool.submit(work, *arguments)
            return future.result()
        except KeyboardInterrupt:
            for worker in multiprocessing.active_children():
                worker.terminate()
            raise


def replay_all(runs: list[Run], options: ReplayOptions) -> list[RunReport]:
    """Each run in a process of its own, which computes with as many threads as the daemon did."""
    os.environ.update(recorded_threads(runs[0].manifest))
    context = multiprocessing.get_context("spawn")
    queue: Any = context.Queue()
    workers = max(1, min(len(runs), os.cpu_count() or 1))
    bar = Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        console=Console(stderr=True),
        transient=True,
        disable=not sys.stderr.isatty(),
    )
    with bar, ProcessPoolExecutor(workers, context, _start_worker, (queue,)) as pool:
        try:
            with interrupts_held():  # workers inherit it: Ctrl-C is this process's affair
                futures = [
                    pool.submit(_replay_in_worker, number, run.paths, run.inside, options)
                    for number, run in enumerate(runs)
                ]
            _watch(futures, runs, queue, bar)
        except KeyboardInterrupt:
            for worker in multiprocessing.active_children():
                worker.terminate()
            raise
        return [future.result() for future in futures]


def _watch(futures: list[Future[RunReport]], runs: list[Run], queue: Any, bar: Progress) -> None:
    rows = [bar.add_task(f"{run.name[:7]} start ", total=run.records or None) for run in runs]
    pending: set[Future[RunReport]] = set(futures)
    while pending:
        _, pending = wait(pending, timeout=0.1)
        try:
            while True:
                number, level, done = queue.get_nowait()
                bar.update(rows[number], description=f"{runs[number].name[:7]} {level:6}", completed=done)
        except Empty:
            pass
