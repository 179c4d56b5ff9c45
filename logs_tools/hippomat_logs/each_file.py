"""The same work on many files: one process per file, a progress bar, results in the order of the files."""

from __future__ import annotations

import multiprocessing
import os
import sys
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import TypeVar

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from hippomat_logs.interrupts import interrupts_held

Result = TypeVar("Result")
WORTH_A_PROCESS_BYTES = 4 << 20  # starting one costs a second


def progress_bar() -> Progress:
    """On the terminal's error output, gone when done; invisible where that is no terminal."""
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    return Progress(*columns, console=Console(stderr=True), transient=True, disable=not sys.stderr.isatty())


def each_file(
    paths: Sequence[Path], work: Callable[[Path], Result], label: str
) -> Iterator[tuple[Path, Result]]:
    """work(path) for every path; `work` must be importable, and raise nothing but what ends everything."""
    workers = min(len(paths), os.cpu_count() or 1)
    size = sum(path.stat().st_size for path in paths if path.is_file())
    with progress_bar() as bar:
        task = bar.add_task(label, total=len(paths))
        if workers < 2 or size < WORTH_A_PROCESS_BYTES:
            for path in paths:
                yield path, work(path)
                bar.advance(task)
            return
        context = multiprocessing.get_context("spawn")
        with ProcessPoolExecutor(workers, context) as pool:
            try:
                with interrupts_held():  # workers inherit it: Ctrl-C is this process's affair
                    futures = [pool.submit(work, path) for path in paths]
                for path, future in zip(paths, futures, strict=True):
                    yield path, future.result()
                    bar.advance(task)
            except KeyboardInterrupt:
                for worker in multiprocessing.active_children():
                    worker.terminate()
                raise
