"""The same work on many files or groups of them: a process for each, a progress bar, results in order."""

from __future__ import annotations

import multiprocessing
import os
import sys
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from pathlib import Path
from typing import TypeVar

from rich.console import Console
from rich.markup import escape
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TaskProgressColumn,
    TextColumn,
    TimeRemainingColumn,
)

from hippomat_logs.interrupts import interrupts_held

Item = TypeVar("Item")
Result = TypeVar("Result")
WORTH_A_PROCESS_BYTES = 4 << 20  # starting one costs a second


def progress_bar() -> Progress:
    """On the terminal's error output, gone when done; invisible where that is no terminal."""
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    return Progress(*columns, console=Console(stderr=True), transient=True, disable=not sys.stderr.isatty())


@contextmanager
def share_bar(label: str) -> Iterator[Callable[[float], None]]:
    """The same for one long piece of work: call it with the share that is done, 0 .. 1."""
    columns = (TextColumn("{task.description}"), BarColumn(), TaskProgressColumn(), TimeRemainingColumn())
    bar = Progress(*columns, console=Console(stderr=True), transient=True, disable=not sys.stderr.isatty())
    with bar:
        task = bar.add_task(escape(label), total=1.0)
        yield lambda share: bar.update(task, completed=share)


def each_file(
    paths: Sequence[Path], work: Callable[[Path], Result], label: str
) -> Iterator[tuple[Path, Result]]:
    """work(path) for every path; `work` must be importable, and raise nothing but what ends everything."""
    size = sum(path.stat().st_size for path in paths if path.is_file())
    yield from zip(paths, each_item(paths, work, label, size), strict=True)


def each_item(
    items: Sequence[Item], work: Callable[[Item], Result], label: str, size: int
) -> Iterator[Result]:
    """work(item) for every item, in order. size: bytes of all files in them."""
    workers = min(len(items), os.cpu_count() or 1)
    with progress_bar() as bar:
        task = bar.add_task(label, total=len(items))
        if workers < 2 or size < WORTH_A_PROCESS_BYTES:
            for item in items:
                yield work(item)
                bar.advance(task)
            return
        context = multiprocessing.get_context("spawn")
        with ProcessPoolExecutor(workers, context) as pool:
            try:
                with interrupts_held():  # workers inherit it: Ctrl-C is this process's affair
                    futures = [pool.submit(work, item) for item in items]
                for future in futures:
                    yield future.result()
                    bar.advance(task)
            except KeyboardInterrupt:
                for worker in multiprocessing.active_children():
                    worker.terminate()
                raise
