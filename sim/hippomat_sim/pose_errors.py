"""How far the robots were from where they believed to be: their logs against the world's truth.

Compares at the robot's ticks; its clock is the world's, but for an error that is known.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from rich.box import SIMPLE_HEAD
from rich.table import Table

from hippomat_core.messages import Localized, PoseEstimated, Tick
from hippomat_logs.reader import Run, open_runs
from hippomat_sim.clock_errors import ClockError

GOAL_M = 0.10  # 95 of 100 errors shall be below


@dataclass(frozen=True, slots=True)
class PoseErrors:
    """Of one robot, while it knew where it was."""

    robot: int
    errors_m: NDArray[np.float64]  # (n,)
    known: float  # share of the ticks since it first knew its place

    def quantile_m(self, share: float) -> float:
        return float(np.quantile(self.errors_m, share)) if len(self.errors_m) else float("nan")


def pose_errors(
    logs: Sequence[Path],
    stamps_ns: NDArray[np.int64],
    truth: NDArray[np.float64],
    clock_errors: Sequence[ClockError],
) -> list[PoseErrors]:
    """One per log. truth: (T, N, 3) poses at stamps_ns (T,) of the world's clock."""
    return [_of_run(run, clock_errors[run.robot].own_ns(stamps_ns), truth) for run in open_runs(logs)]


def _of_run(run: Run, stamps_ns: NDArray[np.int64], truth: NDArray[np.float64]) -> PoseErrors:
    at_ns, poses, known, sure, first = [], [], [], True, False
    stamp_ns = 0
    for record in run.records_in_order((Tick, PoseEstimated, Localized)):
        message = record.message
        if isinstance(message, Tick):
            stamp_ns = message.stamp_ns
        elif isinstance(message, Localized):
            sure = message.phase == "localized"
            first = first or sure
        elif isinstance(message, PoseEstimated) and stamps_ns[0] <= stamp_ns <= stamps_ns[-1]:
            at_ns.append(stamp_ns)
            poses.append((message.x_m, message.y_m))
            known.append(sure and (first or message.source == "odometry"))
    at, told = np.array(at_ns, np.int64), np.array(poses).reshape(-1, 2)
    true = [np.interp(at - stamps_ns[0], stamps_ns - stamps_ns[0], truth[:, run.robot, k]) for k in (0, 1)]
    mask = np.array(known, bool)
    errors_m = np.hypot(told[:, 0] - true[0], told[:, 1] - true[1])[mask]
    began = int(mask.argmax()) if mask.any() else 0
    return PoseErrors(run.robot, errors_m, float(mask[began:].mean()) if mask.any() else 0.0)


def pose_table(errors: Sequence[PoseErrors]) -> Table:
    """One row per robot, one for all."""
    table = Table(title="error of the pose, metres", title_justify="left", title_style="bold")
    table.box, table.padding = SIMPLE_HEAD, (0, 1)
    for name in ("robot", "median", "95 %", "max", "place known"):
        table.add_column(name, justify="right", no_wrap=True)
    for one in errors:
        table.add_row(str(one.robot), *_figures(one))
    if errors:
        every = np.concatenate([one.errors_m for one in errors])
        known = float(np.mean([one.known for one in errors]))
        fleet = PoseErrors(-1, every, known)
        met = fleet.quantile_m(0.95) < GOAL_M
        table.add_section()
        table.add_row("fleet", *_figures(fleet), style="bold")
        table.caption = f"goal: 95 % below {GOAL_M:.2f} m, {'met' if met else 'missed'}"
    return table


def _figures(errors: PoseErrors) -> list[str]:
    figures = [f"{errors.quantile_m(share):.3f}" for share in (0.5, 0.95, 1.0)]
    return [*figures, f"{100 * errors.known:.1f} %"]
