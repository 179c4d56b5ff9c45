"""What `hippomat-bench plan` says: tables and targets, or one JSON object."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

from rich.console import Console
from rich.table import Table
from rich.text import Text

from hippomat_sim.bench.plan_matrix import AGENTS, TASKS, MatrixResult
from hippomat_sim.bench.plan_run import PLAIN, Answers, FileResult
from hippomat_sim.bench.radio_report import target_table, verdict
from hippomat_sim.bench.radio_targets import Target

LEAST_MEAN_RATIO, LEAST_RATIO, LEAST_MATRIX_RATIO = 70.0, 30.0, 5000.0
JUDGED_FILES = 5  # those of the benchmark data: small maps have small ratios, large ones large
JUDGED_FILES = 5  # those of the benchmark data: small maps have small ratios
NOTES = (
    "ratio: median time of the peer / ours, both asked the same queries in turn; > 1: ours is faster. "
    "Ours answers all queries of a file, the peers an evenly spread sample. wrong: no path, or a length off "
    "by more than 1e-3 and the last printed digit. infeasible: through an occupied cell or around a corner "
    "that a robot with width touches. Times are processor time."
)


@dataclass(frozen=True, slots=True)
class PlanReport:
    """Files in the order asked for; the matrix where it was asked for."""

    files: Sequence[FileResult]
    matrix: MatrixResult | None

    @property
    def targets(self) -> list[Target]:
        """Of what was run."""
        return [*_file_targets(self.files), *_matrix_targets(self.matrix)]

    @property
    def met(self) -> bool:
        """Every one of them."""
        return all(target.met for target in self.targets)


def show(report: PlanReport, console: Console) -> None:
    """Tables, targets, verdict."""
    if report.files:
        console.print(_files_table(report.files))
        console.print(Text(NOTES, style="dim"))
    for name in sorted({name for result in report.files for name in result.missing}):
        console.print(f"not compared: {name} is not installed (pip install 'hippomat[bench]')")
    if report.matrix is not None:
        console.print(_matrix_table(report.matrix))
    console.print(target_table(report.targets))
    console.print(Text(verdict(report.targets), style="bold green" if report.met else "bold red"))


def as_json(report: PlanReport) -> dict[str, Any]:
    """What --json prints."""
    files = [
        asdict(result) | {"others": [asdict(answers) | {"ratio": answers.ratio} for answers in result.others]}
        for result in report.files
    ]
    matrix = None if report.matrix is None else asdict(report.matrix) | {"ratio": report.matrix.ratio}
    targets = [asdict(target) | {"met": target.met} for target in report.targets]
    return {"files": files, "matrix": matrix, "targets": targets, "met": report.met}


def _plain_ratios(files: Sequence[FileResult]) -> list[float]:
    return [answers.ratio for result in files for answers in result.others if answers.planner == PLAIN]


def _file_targets(files: Sequence[FileResult]) -> list[Target]:
    if not files:
        return []
    ratios = _plain_ratios(files)
    not_judged = "" if len(files) >= JUDGED_FILES else f"set for {JUDGED_FILES} files together"
    mean = math.exp(sum(map(math.log, ratios)) / len(ratios))
    return [
        Target("wrong lengths", sum(result.ours.wrong for result in files), 0, False, ""),
        Target("infeasible paths", sum(result.ours.infeasible for result in files), 0, False, ""),
        Target("heapq A* / ours, geometric mean", mean, LEAST_MEAN_RATIO, True, "x", not_judged),
        Target("heapq A* / ours, worst file", min(ratios), LEAST_RATIO, True, "x"),
    ]


def _matrix_targets(matrix: MatrixResult | None) -> list[Target]:
    if matrix is None:
        return []
    return [
        Target("cost matrix, differing values", matrix.wrong, 0, False, ""),
        Target("infeasible paths in the air", matrix.infeasible, 0, False, ""),
        Target("cost matrix, heapq A* / ours", matrix.ratio, LEAST_MATRIX_RATIO, True, "x"),
    ]


def _files_table(files: Sequence[FileResult]) -> Table:
    table = Table(title="shortest paths")
    for column in ("scenario", "planner", "queries", "wrong", "infeasible", "median ms", "ratio"):
        table.add_column(column, justify="left" if column in ("scenario", "planner") else "right")
    for result in files:
        for answers in (result.ours, *result.others):
            table.add_row(*_row(result, answers), style="bold" if answers is result.ours else "")
        table.add_section()
    return table


def _row(result: FileResult, answers: Answers) -> tuple[str, ...]:
    own = answers is result.ours
    infeasible = "-" if answers.infeasible < 0 else f"{answers.infeasible:,}"
    return (
        f"{result.name} ({result.cells:,} cells)" if own else "",
        answers.planner,
        f"{answers.queries:,}",
        f"{answers.wrong:,}",
        infeasible,
        f"{answers.median_ms:.4f}",
        "" if own else f"{answers.ratio:,.1f}",
    )


def _matrix_table(matrix: MatrixResult) -> Table:
    title = f"travel costs of a decision: {AGENTS} agents x {TASKS} tasks, 50 x 50 x 30 cells, 30 % obstacles"
    table = Table(title=title)
    for column in ("what", "time"):
        table.add_column(column, justify="left" if column == "what" else "right")
    pairs = AGENTS * TASKS
    asked = f"{pairs} calls" + (f", from {matrix.pairs} asked" if matrix.sampled else "")
    table.add_row("ours, one task replaced", f"{matrix.decision_ms:.3f} ms")
    table.add_row("  its distance field", f"{matrix.field_ms:.3f} ms")
    table.add_row("  the matrix", f"{matrix.lookup_us:.1f} us")
    table.add_row(f"heapq A* ({asked})", f"{matrix.plain_ms:,.0f} ms")
    table.add_row("ratio", f"{matrix.ratio:,.0f}")
    table.add_row("one path, heapq A* / our A*", f"{matrix.path_ratio:,.0f}")
    return table
