"""From a fleet's logs to the plan of its re-runs. Decides what can be re-run and what is said of the rest.

Times of several logs are compared as their Alignment has them.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hippomat_core import messages as m
from hippomat_core.config import Config, RosConfig
from hippomat_core.errors import HippomatError, LogError
from hippomat_core.fleet.claims import serves_alone
from hippomat_core.maps.map_event import grid_in
from hippomat_core.maps.occupancy_grid import OccupancyGrid
from hippomat_logs.alignment import Alignment, align_runs
from hippomat_logs.closed_loop.plan import RECORDED, Air, FleetPlan, Pose, RobotPlan, SenderDeliveries
from hippomat_logs.radio_traffic import Traffic, traffic_of
from hippomat_logs.reader import Run
from hippomat_logs.shortfalls import not_whole, shortfalls, whose_log

PAUSE_NS = 500_000_000  # between ticks, which come every 50 ms: worth a note

Keys = NDArray[np.uint64]


@dataclass(frozen=True, slots=True)
class Recording:
    """A fleet's logs, ready to be run again. notes: what the re-runs cannot have as it was."""

    runs: tuple[Run, ...]
    alignment: Alignment
    plan: FleetPlan
    notes: tuple[str, ...]


@dataclass(slots=True)
class _Seen:
    """What one pass over a log says."""

    run: Run
    config: Config
    grid: OccupancyGrid | None = None
    start: Pose | None = None
    first_ns: int = 0
    tick_ns: int = 0  # its first
    ticked_ns: int = 0  # and the last so far
    pause_ns: int = 0  # the longest time from one tick to the next
    last_ns: int = 0
    stopped: bool = False

    def ticked(self, at_ns: int) -> None:
        if self.tick_ns:
            self.pause_ns = max(self.pause_ns, at_ns - self.ticked_ns)
        else:
            self.tick_ns = at_ns
        self.ticked_ns = at_ns


def read_recording(runs: Sequence[Run], air: Air) -> Recording:
    """Raises HippomatError for logs that are no fleet that can be run again, LogError for damaged ones."""
    notes: list[str] = []
    robots = _robots(runs, notes)
    seen = [_look(run) for run in robots]
    first = seen[0]
    grid, fleet = first.grid, first.config.fleet
    if grid is None:
        raise HippomatError(f"{first.run.name}: holds no map, so there is no world to run it again in")
    for one in seen[1:]:
        if one.grid != grid or (one.config.fleet.id, one.config.fleet.size) != (fleet.id, fleet.size):
            raise HippomatError(
                f"{one.run.name} has another map or fleet than {first.run.name}: give the logs of one fleet"
            )
    alignment = _aligned(robots, air, notes)
    begins_ns = [alignment.common_ns(one.run, one.first_ns) for one in seen]
    origin_ns = min(begins_ns)
    plans = tuple(
        _plan(
            one, (begin_ns - origin_ns) / 1e9, (alignment.common_ns(one.run, one.last_ns) - origin_ns) / 1e9
        )
        for one, begin_ns in zip(seen, begins_ns, strict=True)
    )
    if air.kind == RECORDED:
        air = replace(air, deliveries=_deliveries(robots, alignment, origin_ns, fleet.size))
    plan = FleetPlan(grid, fleet.size, plans, air)
    _note_who_is_missing(plan, notes)
    _note_what_differs(seen, notes)
    return Recording(tuple(robots), alignment, plan, tuple(notes))


def _robots(runs: Sequence[Run], notes: list[str]) -> list[Run]:
    """One run per robot; observers decide nothing and are left out."""
    robots = [run for run in runs if run.robot >= 0]
    if len(robots) < len(runs):
        notes.append("an observer's log takes no part")
    if not robots:
        raise HippomatError("these are logs of observers: there is no robot to run again")
    robot, count = Counter(run.robot for run in robots).most_common(1)[0]
    if count > 1:
        names = ", ".join(run.name for run in robots if run.robot == robot)
        raise HippomatError(f"robot {robot} has {count} runs ({names}): give one run of each robot")
    for run in robots:
        config = run.config
        if run.weights_lost:
            raise LogError(
                f"{run.name}: the weights that decided are lost: give another part of this run too"
            )
        if config.slam.mode == "map":
            raise HippomatError(f"{run.name}: made a map, and decided nothing that could be run again")
        if config.fleet.task_source != "continuous":
            raise HippomatError(
                f"{run.name}: its tasks came from an operator ([fleet] task_source = "
                f"{config.fleet.task_source!r}), who is not in the re-runs"
            )
    return robots


def _look(run: Run) -> _Seen:
    seen = _Seen(run, run.config)
    robot = seen.config.robot
    if robot.start_known:
        seen.start = robot.start_x_m, robot.start_y_m, robot.start_yaw_rad
    from_ros = seen.config.ros.localizes
    for record in run.records_in_order(
        (m.Started, m.Tick, m.MapReceived, m.Localized, m.PoseEstimated, m.StopHeard)
    ):
        message = record.message
        if isinstance(message, m.Started):
            seen.first_ns = record.log_time_ns
        elif isinstance(message, m.Tick):
            seen.ticked(record.log_time_ns)
        elif isinstance(message, m.MapReceived):
            seen.grid = grid_in(message)
        elif isinstance(message, m.StopHeard):
            seen.stopped = True
        elif seen.start is None and (
            (isinstance(message, m.Localized) and message.phase == "localized")
            or (isinstance(message, m.PoseEstimated) and from_ros)
        ):
            seen.start = message.x_m, message.y_m, message.yaw_rad
        seen.last_ns = record.log_time_ns
    return seen


def _plan(seen: _Seen, begins_s: float, ends_s: float) -> RobotPlan:
    if seen.start is None:
        raise HippomatError(
            f"{seen.run.name}: never knew where it was, so it cannot be put there: leave its log out"
        )
    config = replace(seen.config, ros=RosConfig())
    if seen.config.ros.localizes:  # ROS told it where it was; again its first place does
        config = replace(config, robot=config.robot.starting_at(seen.start))
    first_tick_s = max(0, seen.tick_ns - seen.first_ns) / 1e9
    return RobotPlan(config, seen.run.policy or None, seen.start, begins_s, ends_s, first_tick_s)


def _note_who_is_missing(plan: FleetPlan, notes: list[str]) -> None:
    if not plan.missing:
        return
    names = ", ".join(map(str, plan.missing))
    whose, their = ("robot", "its") if len(plan.missing) == 1 else ("robots", "their")
    notes.append(
        f"no log of {whose} {names}: the re-runs have neither {their} work nor frames nor votes, so they do "
        "not say whether the recorded values are usual"
    )
    partition = plan.robots[0].config.fleet.partition
    if len(plan.robots) <= plan.size // 2 and not serves_alone(partition, plan.size):
        notes.append(f"{len(plan.robots)} of {plan.size} robots are no majority: they confirm no claim")


def _note_what_differs(seen: Sequence[_Seen], notes: list[str]) -> None:
    for one in seen:
        if one.stopped:
            notes.append(f"robot {one.run.robot} heard a STOP or RESUME; nobody stops the re-runs")
        if one.pause_ns > PAUSE_NS:
            pause_s = one.pause_ns / 1e9
            notes.append(
                f"robot {one.run.robot}'s computer once stood still for {pause_s:.1f} s; again it is punctual"
            )
        if one.config.ros.url:
            notes.append(f"robot {one.run.robot} ran behind ROS; again it has a simulated base and lidar")
        notes += not_whole(whose_log(one.run.robot), shortfalls(one.run))


def _aligned(runs: Sequence[Run], air: Air, notes: list[str]) -> Alignment:
    try:
        return align_runs(runs)
    except LogError:
        raise
    except HippomatError as error:
        if air.kind == RECORDED:
            raise HippomatError(f"--radio recorded: {error}; or give --radio loss=P or ideal") from None
        notes.append("the robots did not hear each other: their logs' own clocks are trusted")
        return Alignment.trusting(runs)


# ---- the air as it was --------------------------------------------------------------------------


def _deliveries(
    runs: Sequence[Run], alignment: Alignment, origin_ns: int, size: int
) -> dict[int, SenderDeliveries]:
    """By sender. A frame counts as sent if its sender's log says so, or anybody heard it."""
    if alignment.traffic:
        clocks = zip(alignment.clocks, alignment.traffic, strict=True)
        traffic = {clock.robot: of_run for clock, of_run in clocks}
    else:
        traffic = {run.robot: traffic_of(run) for run in runs}
    heard = {run.robot: np.unique(traffic[run.robot].heard.keys) for run in runs}
    return {run.robot: _of_sender(run, runs, traffic, heard, alignment, origin_ns, size) for run in runs}


def _of_sender(
    run: Run,
    runs: Sequence[Run],
    traffic: dict[int, Traffic],
    heard: dict[int, Keys],
    alignment: Alignment,
    origin_ns: int,
    size: int,
) -> SenderDeliveries:
    sent = traffic[run.robot].sent
    keys, times_ns = sent.keys, alignment.common_ns_array(run, sent.air_ns)
    kinds = sent.kinds
    for other in runs:  # what the sender's own log does not have
        frames = traffic[other.robot].heard
        new = ((frames.keys >> np.uint64(56)) == run.robot) & ~np.isin(frames.keys, keys)
        if new.any():
            keys = np.concatenate([keys, frames.keys[new]])
            times_ns = np.concatenate([times_ns, alignment.common_ns_array(other, frames.air_ns[new])])
            kinds = np.concatenate([kinds, frames.kinds[new]])
    keys, first = np.unique(keys, return_index=True)
    order = np.argsort(times_ns[first], kind="stable")
    keys, first = keys[order], first[order]
    table = np.zeros((len(keys), size), np.bool_)
    for receiver, known in heard.items():
        table[:, receiver] = np.isin(keys, known)
    return SenderDeliveries((times_ns[first] - origin_ns) // 1000, kinds[first], table)
