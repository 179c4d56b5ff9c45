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
from typing import Protocol

from hippomat_core import messages as m
from hippomat_logs.reader import Run
from hippomat_logs.report import FAILED, MISSED, NOT_RUN, OK, LevelResult

GROUP = "hippomat.replay_worlds"
WINDOW_S = 5.0
BOUND_M = 0.15
MAX_SHARE_BEYOND = 0.05
RPE_STEP_S = 1.0

Pose = tuple[float, float, float]  # x [m], y [m], yaw [rad], map frame
Command = tuple[float, float, float]  # time [s], v [m/s], wz [rad/s]


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


def check_motion(run: Run, strict: bool) -> LevelResult:
    """L3 on one run; misses are reported and fail the level only when strict."""
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
        return _judge(motion, world, strict)
    finally:
        world.close()


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


def _judge(motion: Motion, world: ReplayWorld, strict: bool) -> LevelResult:
    errors: list[float] = []
    steps: list[float] = []
    beyond = 0
    begin = 0
    while begin < len(motion.poses) - 1:
        end = begin + 1
        while end < len(motion.poses) and motion.poses[end][0] <= motion.poses[begin][0] + WINDOW_S:
            end += 1
        recorded = motion.poses[begin:end]
        driven = _window(motion, world, recorded)
        window_errors = [
            _distance(pose, other) for (_, pose), other in zip(recorded[1:], driven, strict=True)
        ]
        errors += window_errors
        beyond += sum(error > BOUND_M for error in window_errors)
        steps += _relative_errors(recorded[1:], driven)
        begin = max(end - 1, begin + 1)
    drift = _distance(motion.poses[-1][1], _window(motion, world, motion.poses)[-1])
    share = beyond / len(errors)
    detail = (
        f"{100 * (1 - share):.1f} % of samples within {BOUND_M} m, ATE {_rms(errors):.3f} m, "
        f"RPE {_rms(steps):.3f} m per s, drift over the run {drift:.2f} m"
    )
    missed = share > MAX_SHARE_BEYOND
    if missed:
        detail += f" - misses the bar of {100 * (1 - MAX_SHARE_BEYOND):.0f} %"
    status = OK if not missed else FAILED if strict else MISSED
    return LevelResult("L3", status, len(errors), "samples", detail)


def _window(motion: Motion, world: ReplayWorld, recorded: Sequence[tuple[float, Pose]]) -> list[Pose]:
    start_s = recorded[0][0]
    first = max(0, bisect_right(motion.commands, start_s, key=lambda command: command[0]) - 1)
    last = bisect_right(motion.commands, recorded[-1][0], key=lambda command: command[0])
    commands = [(time_s - start_s, v, wz) for time_s, v, wz in motion.commands[first:last]]
    times = [time_s - start_s for time_s, _ in recorded[1:]]
    return world.drive(recorded[0][1], commands, times)


def _relative_errors(recorded: Sequence[tuple[float, Pose]], driven: Sequence[Pose]) -> list[float]:
    """Difference of the distances covered in one second, inside one window."""
    found: list[float] = []
    behind = 0
    for k in range(len(recorded)):
        while recorded[k][0] - recorded[behind][0] > RPE_STEP_S:
            behind += 1
        if recorded[k][0] - recorded[behind][0] > 0.9 * RPE_STEP_S:
            a, b = recorded[k][1], recorded[behind][1]
            c, d = driven[k], driven[behind]
            found.append(math.hypot((a[0] - b[0]) - (c[0] - d[0]), (a[1] - b[1]) - (c[1] - d[1])))
    return found


def _distance(a: Pose, b: Pose) -> float:
    return math.hypot(a[0] - b[0], a[1] - b[1])


def _rms(values: Sequence[float]) -> float:
    return math.sqrt(sum(v * v for v in values) / len(values)) if values else 0.0
