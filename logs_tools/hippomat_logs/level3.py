"""Level L3: the recorded drive commands, applied in a simulated world, move the robot as recorded.

Windows of 5 s, each begun at the recorded pose. Worlds come through the entry-point group
`hippomat.replay_worlds`; this file knows poses and commands, not physics.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass, field
from importlib.metadata import entry_points
from pathlib import Path
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from hippomat_core import messages as m
from hippomat_core.slam.poses import seen_from, wrapped
from hippomat_logs.reader import Run
from hippomat_logs.report import FAILED, MISSED, NOT_RUN, OK, LevelResult

GROUP = "hippomat.replay_worlds"
WINDOW_S = 5.0
BOUND_M = 0.15
MAX_SHARE_BEYOND = 0.05
RPE_STEP_S = 1.0

Pose = tuple[float, float, float]  # x [m], y [m], yaw [rad], map frame
Command = tuple[float, float, float]  # time [s], v [m/s], wz [rad/s]
Poses = NDArray[np.float64]  # (n, 3)
Index = NDArray[np.intp]


class ReplayWorld(Protocol):
    """Built as kind(config, map_received). Opened once per run, closed at its end."""

    def drive(self, start: Pose, commands: Sequence[Command], sample_times_s: Sequence[float]) -> list[Pose]:
        """Poses at sample_times_s (ascending) of a robot that stands at `start` at time 0.

        commands: ascending; each holds until the next; one before 0 is what the base already did at 0.
        """
        ...

    def close(self) -> None: ...


@dataclass(slots=True)
class Motion:
    """What a run says of its motion. Times in seconds since its first pose."""

    poses: list[tuple[float, Pose]] = field(default_factory=list)
    commands: list[Command] = field(default_factory=list)
    map: m.MapReceived | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Driven:
    """What was recorded and what the simulated robot did, n samples; (n, 3) are x, y [m] and yaw [rad]."""

    times_s: NDArray[np.float64]  # (n,)
    recorded: Poses  # (n, 3)
    windows: Poses  # (n, 3) begun anew at the recorded pose in every window
    whole: Poses  # (n, 3) begun once
    begins: tuple[int, ...]  # the samples at which windows begin: there the error is none by definition

    @property
    def errors_m(self) -> NDArray[np.float64]:
        """(n - 1,) of all samples but the first."""
        apart = self.windows[1:, :2] - self.recorded[1:, :2]
        return np.hypot(apart[:, 0], apart[:, 1])

    @property
    def errors_rad(self) -> NDArray[np.float64]:
        return np.abs(wrapped(self.windows[1:, 2] - self.recorded[1:, 2]))

    @property
    def drift_m(self) -> NDArray[np.float64]:
        """(n,) of the run that was begun once."""
        apart = self.whole[:, :2] - self.recorded[:, :2]
        return np.hypot(apart[:, 0], apart[:, 1])

    @property
    def length_m(self) -> float:
        """Of the recorded way."""
        steps = np.diff(self.recorded[:, :2], axis=0)
        return float(np.hypot(steps[:, 0], steps[:, 1]).sum())

    def relative_errors(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """([m], [rad]) by which motions of RPE_STEP_S differ, each in the frame of where it began.

        Relative pose error as Sturm et al. 2012 define it; a motion lies within one window.
        """
        until = np.searchsorted(self.times_s, self.times_s + RPE_STEP_S, side="right") - 1
        window = np.searchsorted(self.begins, np.arange(len(until)), side="right")
        begins = np.arange(len(until))
        enough = self.times_s[until] - self.times_s > 0.9 * RPE_STEP_S
        kept = enough & (window == window[until]) & ~np.isin(begins, self.begins[1:])
        first, last = begins[kept], until[kept]
        apart = seen_from(self.windows[first], self.windows[last])
        apart -= seen_from(self.recorded[first], self.recorded[last])
        return np.hypot(apart[:, 0], apart[:, 1]), np.abs(wrapped(apart[:, 2]))


def check_motion(run: Run, strict: bool, plots: Path | None = None) -> LevelResult:
    """L3 on one run; misses are reported and fail the level only when strict. plots: a directory."""
    kinds = list(entry_points(group=GROUP))
    if not kinds:
        return LevelResult("L3", NOT_RUN, detail="no simulator is installed: pip install 'hippomat[sim]'")
    motion = motion_of(run)
    if motion.map is None or len(motion.poses) < 2:
        return LevelResult("L3", NOT_RUN, detail="the run holds no map or no poses")
    try:
        world: ReplayWorld = kinds[0].load()(run.config, motion.map)
    except (ImportError, AttributeError) as error:
        return LevelResult("L3", NOT_RUN, detail=f"{kinds[0].value} cannot be loaded: {error}")
    try:
        driven = drive_again(motion, world)
    finally:
        world.close()
    result = judge(driven, strict)
    if plots is not None:
        from hippomat_logs.level3_picture import draw  # matplotlib loads slowly

        path = draw(run, motion, driven, plots)
        result.notes.append(f"picture: {path}")
    return result


def motion_of(run: Run) -> Motion:
    motion, start_ns = Motion(), 0
    for record in run.records_in_order((m.MapReceived, m.PoseEstimated, m.Drive)):
        message = record.message
        if isinstance(message, m.MapReceived):
            motion.map = message
        elif isinstance(message, m.PoseEstimated):
            start_ns = start_ns or record.log_time_ns
            pose = (message.x_m, message.y_m, message.yaw_rad)
            motion.poses.append(((record.log_time_ns - start_ns) / 1e9, pose))
        elif isinstance(message, m.Drive) and start_ns:
            time_s = (record.log_time_ns - start_ns) / 1e9
            motion.commands.append((time_s, message.v_mps, message.wz_radps))
    return motion


def drive_again(motion: Motion, world: ReplayWorld) -> Driven:
    """All windows, and the whole run in one go."""
    begins, begin = [0], 0
    times_s = [time_s for time_s, _ in motion.poses]
    while (end := bisect_right(times_s, times_s[begin] + WINDOW_S) - 1) < len(times_s) - 1:
        begin = max(end, begin + 1)
        if begin < len(times_s) - 1:
            begins.append(begin)
        else:
            break
    poses: list[Pose] = [motion.poses[0][1]]
    for first, last in zip(begins, [*begins[1:], len(times_s) - 1], strict=True):
        poses += _window(motion, world, motion.poses[first : last + 1])
    whole = [motion.poses[0][1], *_window(motion, world, motion.poses)]
    recorded = np.array([pose for _, pose in motion.poses])
    return Driven(np.array(times_s), recorded, np.array(poses), np.array(whole), tuple(begins))


def judge(driven: Driven, strict: bool) -> LevelResult:
    """The bar is set on the share of samples; the other figures are reported."""
    beyond = float(np.mean(driven.errors_m > BOUND_M))
    (step_m, step_rad), drift_m = driven.relative_errors(), float(driven.drift_m[-1])
    figures = {
        "share_within": 1.0 - beyond,
        "ate_m": _rms(driven.errors_m),
        "ate_deg": math.degrees(_rms(driven.errors_rad)),
        "rpe_m_per_s": _rms(step_m) / RPE_STEP_S,
        "rpe_deg_per_s": math.degrees(_rms(step_rad)) / RPE_STEP_S,
        "drift_m": drift_m,
        "driven_m": driven.length_m,
    }
    detail = (
        f"{100 * (1 - beyond):.1f} % within {BOUND_M} m; "
        f"ATE {figures['ate_m']:.3f} m {figures['ate_deg']:.1f} deg; "
        f"RPE {figures['rpe_m_per_s']:.3f} m {figures['rpe_deg_per_s']:.1f} deg per s; "
        f"drift {drift_m:.2f} m in {driven.length_m:.1f} m"
    )
    missed = beyond > MAX_SHARE_BEYOND
    if missed:
        detail += f" - misses the bar of {100 * (1 - MAX_SHARE_BEYOND):.0f} %"
    status = OK if not missed else FAILED if strict else MISSED
    return LevelResult("L3", status, len(driven.errors_m), "samples", detail, figures=figures)


def _window(motion: Motion, world: ReplayWorld, recorded: Sequence[tuple[float, Pose]]) -> list[Pose]:
    start_s = recorded[0][0]
    first = max(0, bisect_right(motion.commands, start_s, key=lambda command: command[0]) - 1)
    last = bisect_right(motion.commands, recorded[-1][0], key=lambda command: command[0])
    commands = [(time_s - start_s, v, wz) for time_s, v, wz in motion.commands[first:last]]
    times = [time_s - start_s for time_s, _ in recorded[1:]]
    return world.drive(recorded[0][1], commands, times)


def _rms(values: NDArray[np.float64]) -> float:
    return float(np.sqrt(np.mean(values**2))) if len(values) else 0.0
