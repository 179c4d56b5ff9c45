"""How a run of `hippomat-bench slam` is shown: tables for people, one JSON object for programs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from rich.console import Console
from rich.text import Text

from hippomat_sim.bench.radio_report import plain_table, target_table, verdict, without_nan
from hippomat_sim.bench.radio_targets import Target
from hippomat_sim.bench.slam_relations import RelationErrors
from hippomat_sim.bench.slam_run import SlamRun
from hippomat_sim.bench.slam_targets import Errors

NOTES = (
    "final: after the final pass; online: when the log ended; as in the log: its own poses. At scans: "
    "relations with both ends within 1 ms of a scan. Between scans poses are interpolated in time, or follow "
    "the odometry of --between. Times are processor time of one core; no robot waits for the worker or the "
    "final pass."
)


@dataclass(frozen=True, slots=True, eq=False)
class SlamReport:
    """All that is shown. errors: by trajectory, none without relations; run: None if nothing was mapped."""

    log: str
    scans: int
    errors: dict[str, Errors]
    run: SlamRun | None
    targets: Sequence[Target]

    @property
    def met(self) -> bool:
        return not any(target.missed for target in self.targets)


def show(report: SlamReport, console: Console) -> None:
    """Tables, targets, verdict."""
    if report.errors:
        _show_errors(report, console)
    if report.run is not None:
        _show_run(report.run, report.scans, console)
        console.print(target_table(report.targets))
    console.print(Text(NOTES, style="dim"))
    if report.targets:
        console.print(Text(verdict(report.targets), style="bold green" if report.met else "bold red"))


def as_json(report: SlamReport) -> dict[str, Any]:
    """What --json prints; NaN becomes null, and so does `met` of a target that is not judged."""
    errors = {name: asdict(one) for name, one in report.errors.items()}
    targets = [
        asdict(target) | {"met": None if target.not_judged else target.met} for target in report.targets
    ]
    whole = {"log": report.log, "scans": report.scans, "errors": errors, "targets": targets}
    if report.run is not None:
        whole |= {"run": _figures(report.run)}
    return without_nan(whole | {"met": report.met})  # type: ignore[no-any-return]


def _show_errors(report: SlamReport, console: Console) -> None:
    table = plain_table(f"{report.log}: error over relations, mean +- deviation", "poses", "of", "m", "deg")
    for name, errors in report.errors.items():
        table.add_row(f"{name}, at scans", *_row(errors.at_scans))
        table.add_row(f"{name}, all, interpolated", *_row(errors.interpolated))
        if errors.all is not None:
            table.add_row(f"{name}, all, odometry between", *_row(errors.all))
    console.print(table)


def _row(errors: RelationErrors) -> tuple[str, str, str]:
    return (
        f"{errors.count}",
        f"{errors.translation_m:.4f} +- {errors.translation_deviation_m:.4f}",
        f"{errors.rotation_deg:.3f} +- {errors.rotation_deviation_deg:.3f}",
    )


def _show_run(run: SlamRun, scans: int, console: Console) -> None:
    figures = _figures(run)
    table = plain_table(
        f"{scans} scans, {figures['keyframes']} keyframes, {figures['loops']} links in the final map, "
        f"{run.map.unmatched} scans without a match",
        "step",
        "times",
        "median ms",
        "95 % ms",
        "longest ms",
    )
    for name, key in (
        ("front end, a scan", "scan_ms"),
        ("taking over closed loops", "solution_ms"),
        ("worker: closing loops", "worker_ms"),
    ):
        one = figures[key]
        cells = (f"{one[what]:.1f}" for what in ("median", "p95", "max"))
        table.add_row(name, f"{one['count']}", *cells)
    console.print(table)


def _figures(run: SlamRun) -> dict[str, Any]:
    costs = run.costs
    return {
        "keyframes": len(run.map.graph),
        "loops": len(run.map.graph.loops),
        "unmatched": run.map.unmatched,
        "scan_ms": _times(costs.scan_ms),
        "solution_ms": _times(costs.solution_ms),
        "worker_ms": _times(costs.worker_ms),
        "longest_step_ms": costs.longest_ms,
    }


def _times(times_ms: Sequence[float]) -> dict[str, float]:
    if not times_ms:
        nan = float("nan")
        return {"count": 0, "median": nan, "p95": nan, "max": nan}
    median, p95, longest = np.percentile(times_ms, [50, 95, 100])
    return {"count": len(times_ms), "median": float(median), "p95": float(p95), "max": float(longest)}
