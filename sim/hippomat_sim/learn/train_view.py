"""What a training run shows: a bar with the newest figures, the frozen set, and the last lines."""

from __future__ import annotations

import time
from types import TracebackType
from typing import Any, TypeVar

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.progress import (
    BarColumn,
    Progress,
    ProgressColumn,
    TaskProgressColumn,
    TextColumn,
    TimeRemainingColumn,
)
from rich.table import Table

Row = dict[str, Any]
_Bar = TypeVar("_Bar", bound="StepsBar")


class StepsBar:
    """A context: a bar over agent steps is there inside, `front` before it and `figures` behind it."""

    def __init__(self, console: Console, total: int, *front: ProgressColumn) -> None:
        columns = (
            *front,
            BarColumn(bar_width=24),
            TaskProgressColumn(),
            TextColumn("{task.fields[figures]}"),
            TimeRemainingColumn(),
        )
        self._progress = Progress(*columns, console=console, transient=True)
        self._task = self._progress.add_task("", total=total, figures="")

    def __enter__(self: _Bar) -> _Bar:
        self._progress.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._progress.stop()

    def _say(self, line: str) -> None:
        """A line that stays."""
        self._progress.console.print(line, markup=False, highlight=False, soft_wrap=True)


class TrainView(StepsBar):
    """Of one run. total: its agent steps; done: those of before."""

    def __init__(self, console: Console, total: int, done: int) -> None:
        super().__init__(console, total)
        self._done, self._began_s = done, time.monotonic()
        self._progress.update(self._task, completed=done)

    def show(self, row: Row) -> None:
        """row: of metrics.jsonl."""
        steps = row["agent_steps"]
        rate = (steps - self._done) / max(time.monotonic() - self._began_s, 1e-9)
        parts = [f"{steps:,} agent steps", f"{rate:,.0f}/s"]
        parts += [f"reward {row['reward']:.3f}"] if "reward" in row else []
        parts += [f"entropy {row['entropy']:.2f}"] if "entropy" in row else []
        self._progress.update(self._task, completed=steps, figures="  ".join(parts))
        if "evaluation" in row:
            self._say(f"{steps:>12,}  {evaluation_text(row['evaluation'])}")


def evaluation_text(evaluation: dict[str, dict[str, float]]) -> str:
    """An evaluation of the frozen set, in one line."""
    return "CF1/gap %: " + "; ".join(f"N={size} {_shown(figures)}" for size, figures in evaluation.items())


def _shown(figures: dict[str, float]) -> str:
    text = f"{figures['cf1']:.1f}/{figures['gap']:.2f}"
    if "alone_cf1" in figures:
        text += f" (alone {figures['alone_cf1']:.1f}/{figures['alone_gap']:.1f})"
    return text


def summary(console: Console, row: Row, epochs: int, threads: int) -> None:
    """The run's figures and its throughput. row: the last one."""
    table = Table(box=SIMPLE_HEAD, title="frozen set, in the worlds of training", title_justify="left")
    for name in ("N", "CF1 %", "gap %", "alone: CF1 %", "gap %"):
        table.add_column(name, justify="right")
    for size, figures in row.get("evaluation", {}).items():
        keys = ("cf1", "gap", "alone_cf1", "alone_gap")
        table.add_row(size, *(f"{figures[key]:.2f}" if key in figures else "" for key in keys))
    if table.row_count:
        console.print(table)
    steps, learn_s, collect_s = row["agent_steps"], max(row["learn_s"], 1e-9), max(row["collect_s"], 1e-9)
    spent_s = learn_s + collect_s
    console.print(
        f"{steps:,} agent steps in {spent_s:.1f} s: {steps / spent_s:,.0f}/s in all; "
        f"environment and acting {steps / collect_s:,.0f}/s; learner {steps / learn_s:,.0f}/s, "
        f"{epochs * steps / learn_s:,.0f}/s counting each of {epochs} passes ({threads} threads)",
        highlight=False,
        markup=False,
        soft_wrap=True,
    )
