"""ReadLogs -> ReportData: all robots on one time base, tasks merged, poses at common instants.

Decides what the fleet's second 0 is, which view of a peer without a log is taken, and what the head says.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from datetime import datetime, timezone

import numpy as np
from numpy.typing import NDArray

from hippomat_core.fleet.robot_names import named
from hippomat_logs.fleet_story.conflicts import Conflict
from hippomat_logs.manifest import core_hash
from hippomat_logs.metrics.fleet import CommonNs, on_one_clock
from hippomat_logs.report_html.data import (
    Clock,
    Fact,
    Frames,
    ReportData,
    RobotView,
    TaskConflict,
    TaskLife,
    TaskSeen,
    Track,
    on_clock,
)
from hippomat_logs.report_html.logs import ReadLog
from hippomat_logs.shortfalls import not_whole

STEPS_S = (0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 30.0, 60.0)
MOST_POSES = 300_000  # of all robots together: some 2 MB of the file
HELD_S = 1.0  # a pose older than this says nothing
SHORTEST_S = 0.1


def assemble(
    read: Sequence[ReadLog],
    common: Sequence[CommonNs],
    conflicts: Sequence[Conflict] | None = None,
    clocks: str = "",
    doubt: str = "",
) -> ReportData:
    """read: the logs of one run, by robot; common: the clock of each.

    conflicts: of the fleet; None: not known, each robot's own word is taken.
    clocks: how times of different robots compare. doubt: why they may not, "" = they do.
    """
    spans_ns = [clock(_span_ns(one)) for one, clock in zip(read, common, strict=True)]
    begun_ns, ended_ns = (int(pick(spans_ns)) for pick in (np.min, np.max))
    times = [_since(clock, one, begun_ns) for one, clock in zip(read, common, strict=True)]
    robots, span_s = _robots(read, times), max((ended_ns - begun_ns) / 1e9, SHORTEST_S)
    return ReportData(
        title=_title(read),
        begun_ns=begun_ns,
        span_s=span_s,
        robots=robots,
        frames=frames_of(robots, span_s),
        grid=next((one.reading.grid for one in read if one.reading.grid is not None), None),
        tasks=_tasks(read, times, robots),
        conflicts=_noticed(robots) if conflicts is None else conflicts_shown(conflicts, read, times),
        explained=conflicts is not None,
        metrics=on_one_clock([one.metrics for one in read], common, read[0].log.run.config, clocks),
        age_counts=np.sum([one.reading.age_counts for one in read], axis=0),
        facts=_facts(read, begun_ns, span_s, clocks),
        warnings=[
            *(line for one in read for line in not_whole(one.log.who, one.faults)),
            *([doubt] if doubt else []),
        ],
    )


def _span_ns(one: ReadLog) -> NDArray[np.int64]:
    first_ns = one.reading.first_ns
    return np.array([first_ns, first_ns + round(one.reading.last_s * 1e9)])


def _since(common: CommonNs, one: ReadLog, begun_ns: int) -> Clock:
    """Seconds of a log -> seconds of the fleet."""
    first_ns = one.reading.first_ns

    def clock(at_s: NDArray[np.float64]) -> NDArray[np.float64]:
        own_ns = first_ns + np.rint(at_s * 1e9).astype(np.int64)
        return np.asarray((common(own_ns) - begun_ns) / 1e9)

    return clock


def _robots(read: Sequence[ReadLog], clocks: Sequence[Clock]) -> list[RobotView]:
    """Each robot by its own log; one without a log as whoever heard most of it saw it."""
    views = {
        one.reading.own.robot: one.reading.own.moved(clock)
        for one, clock in zip(read, clocks, strict=True)
        if one.reading.own is not None
    }
    best: dict[int, tuple[int, RobotView, Clock]] = {}
    for one, clock in zip(read, clocks, strict=True):
        for view in one.reading.heard:
            heard = len(view.track.at_s) + len(view.spans)
            if view.robot not in views and heard > best.get(view.robot, (-1,))[0]:
                best[view.robot] = heard, view, clock
    views |= {robot: view.moved(clock) for robot, (_, view, clock) in best.items()}
    return [views[robot] for robot in sorted(views)]


def frames_of(robots: Sequence[RobotView], span_s: float) -> Frames:
    """Poses at common instants, fine enough to be looked at and few enough to be mailed."""
    step_s = next((s for s in STEPS_S if len(robots) * span_s / s <= MOST_POSES), STEPS_S[-1])
    at_s = np.arange(math.ceil(span_s / step_s) + 1, dtype=np.float64) * step_s
    table = (
        np.stack([_sampled(one.track, at_s) for one in robots], axis=1)
        if robots
        else np.zeros((3, 0, len(at_s)))
    )
    x_m, y_m, yaw_rad = table.round(2).astype(np.float32)  # centimetres: rounded numbers compress well
    return Frames(step_s, x_m, y_m, yaw_rad)


def _sampled(track: Track, at_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """(3, T) x, y, yaw: the last pose at each instant, nan where there is none that is fresh."""
    if not len(track.at_s):
        return np.full((3, len(at_s)), np.nan)
    last = np.searchsorted(track.at_s, at_s, side="right") - 1
    fresh = (last >= 0) & (at_s - track.at_s[last] <= HELD_S)
    return np.where(fresh, np.stack([track.x_m[last], track.y_m[last], track.yaw_rad[last]]), np.nan)


# ---- tasks ----


def _tasks(read: Sequence[ReadLog], clocks: Sequence[Clock], robots: Sequence[RobotView]) -> list[TaskLife]:
    seen = [
        task
        for one, clock in zip(read, clocks, strict=True)
        for task in on_clock(clock, one.reading.tasks, "at_s")
    ]
    return task_lives(seen, robots)


def task_lives(seen: Sequence[TaskSeen], robots: Sequence[RobotView]) -> list[TaskLife]:
    """Whoever knew first, for the fleet; a task is closed by a newer one in its slot too."""
    lives: dict[tuple[int, int], TaskLife] = {}
    for one in sorted(seen, key=lambda task: task.at_s):
        key = one.slot, one.generation
        if one.closed:
            if key in lives and math.isinf(lives[key].closed_s):
                lives[key] = replace(lives[key], closed_s=one.at_s)
        elif key not in lives:
            lives[key] = TaskLife(one.slot, one.generation, one.x_m, one.y_m, one.at_s)
    newer_s: dict[int, float] = {}  # slot -> when any newer generation than the one at hand was known
    for key in sorted(lives, reverse=True):
        life = lives[key]
        over_s = newer_s.get(life.slot, math.inf)
        lives[key] = replace(life, closed_s=min(life.closed_s, max(over_s, life.seen_s)))
        newer_s[life.slot] = min(over_s, life.seen_s)
    for robot in robots:
        for end in robot.ends:
            key = end.slot, end.generation
            if end.what == "completed" and key in lives:
                lives[key] = replace(lives[key], completed_s=end.at_s, completed_by=robot.robot)
    return [lives[key] for key in sorted(lives)]


# ---- between robots ----


def conflicts_shown(
    conflicts: Sequence[Conflict], read: Sequence[ReadLog], clocks: Sequence[Clock]
) -> list[TaskConflict]:
    """The fleet's conflicts, on its time."""
    by_robot = {one.log.robot: (one.reading.first_ns, clock) for one, clock in zip(read, clocks, strict=True)}
    shown = []
    for one in conflicts:
        first_ns, clock = by_robot[one.robots[1]]
        at_s = float(clock(np.array([(one.begun.log_time_ns - first_ns) / 1e9]))[0])
        text = "; ".join((*one.evidence, one.ending))
        shown.append(TaskConflict(at_s, one.robots, *one.task, one.kind, one.cause, text))
    return sorted(shown, key=lambda one: one.at_s)


def _noticed(robots: Sequence[RobotView]) -> list[TaskConflict]:
    """Every robot's own word: both sides of one conflict, where both noticed it."""
    shown = [
        TaskConflict(
            one.at_s,
            (robot.robot, one.other),
            one.slot,
            one.generation,
            "noticed",
            one.cause,
            "kept its claim" if one.kept else "gave its claim up",
        )
        for robot in robots
        for one in robot.conflicts
    ]
    return sorted(shown, key=lambda one: one.at_s)


# ---- the head ----


def _title(read: Sequence[ReadLog]) -> str:
    robots = [one.log.robot for one in read if one.log.robot >= 0]
    fleet = read[0].log.manifest.get("fleet", "?")
    if not robots:
        return f"Fleet {fleet}, as an observer heard it"
    return (
        f"Fleet {fleet}, {len(robots)} robots" if len(robots) > 1 else f"Robot {robots[0]} of fleet {fleet}"
    )


def _facts(read: Sequence[ReadLog], begun_ns: int, span_s: float, clocks: str) -> list[Fact]:
    begun = datetime.fromtimestamp(begun_ns / 1e9, timezone.utc).strftime("%Y-%m-%d %H:%M:%S UTC")
    configs = [one.log.run.config for one in read]
    return [
        Fact("Begun", f"{begun}, {span_s:.1f} s long"),
        _logs(read),
        _same("Allocator", [config.fleet.allocator for config in configs]),
        _same("Turnover", [config.fleet.turnover for config in configs]),
        _same("Task slots", [str(config.fleet.task_slots) for config in configs]),
        _same("Policy", [_short(one.log.manifest.get("policy_hash", "")) for one in read]),
        _same("Map", [_short(one.log.manifest.get("map_hash", "")) for one in read]),
        _same("hippomat", [one.log.manifest.get("hippomat", "?") for one in read]),
        _replayable(read),
        *([Fact("Clocks", clocks)] if clocks else []),
    ]


def _logs(read: Sequence[ReadLog]) -> Fact:
    """Whose logs they are, by the computer that recorded them, and how many of the fleet's."""
    by_host: dict[str, list[int]] = {}
    for one in read:
        by_host.setdefault(one.log.manifest.get("host", "?"), []).append(one.log.robot)
    told = []
    for host, logs in by_host.items():
        robots = [robot for robot in logs if robot >= 0]
        who = [named(robots)] * bool(robots) + ["the observer"] * (len(robots) < len(logs))
        told.append(f"{' and '.join(who)} ({host})")
    have = len({one.log.robot for one in read if one.log.robot >= 0})
    size = max(one.log.run.config.fleet.size for one in read)
    if have < size:
        told.append(f"{have} of the fleet's {size}: totals lack what the others did")
    return Fact("Logs", "; ".join(told), bad=have < size)


def _short(hash_: str) -> str:
    return hash_[:12] or "none"


def _same(name: str, values: Sequence[str]) -> Fact:
    """One value where all logs agree; else every one, as something to mind."""
    distinct = list(dict.fromkeys(values))
    return Fact(name, ", ".join(distinct), bad=len(distinct) > 1)


def _replayable(read: Sequence[ReadLog]) -> Fact:
    """Whether hippomat-replay can hold the decisions to these logs."""
    if broken := [one.log.who for one in read if not one.whole]:
        return Fact("Replay", f"not of damaged logs: {', '.join(broken)}", bad=True)
    if lost := [one.log.who for one in read if one.weights_lost]:
        return Fact("Replay", f"the weights that decided are lost: {', '.join(lost)}", bad=True)
    if any(one.faults for one in read):
        return Fact("Replay", "as far as the logs go: not all are whole", bad=True)
    if all(one.log.robot < 0 for one in read):
        return Fact("Replay", "an observer decides nothing")
    if any(one.log.manifest.get("core_hash") != core_hash() for one in read):
        told = (
            "whole, with its weights: hippomat-replay tells whether the core, changed since, decides the same"
        )
        return Fact("Replay", told)
    return Fact("Replay", "whole, with its weights, recorded by this version: hippomat-replay reproduces it")
