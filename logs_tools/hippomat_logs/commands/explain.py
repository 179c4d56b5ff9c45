"""hippomat-logs explain: why a fleet did what it did with a task, or one robot in one round."""

from __future__ import annotations

import argparse
import dataclasses
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rich.console import Console

from hippomat_core import messages as m
from hippomat_core.errors import HippomatError
from hippomat_logs.commands.conflicts import say_what_is_missing
from hippomat_logs.definitions import Task
from hippomat_logs.explained_decision import show_decision
from hippomat_logs.explained_task import show_task
from hippomat_logs.fleet_story.decision_view import decision_view
from hippomat_logs.fleet_story.reading import Keep
from hippomat_logs.fleet_story.story import FleetStory, fleet_story
from hippomat_logs.fleet_story.task_life import task_lives
from hippomat_logs.fleet_story.values import Decision
from hippomat_logs.metrics.as_json import plain
from hippomat_logs.paragraphs import say
from hippomat_logs.reader import Run, open_runs
from hippomat_logs.report import DAMAGED, REPRODUCED

LAST, ALL = "last", "all"
_TASK = re.compile(r"(\d+)(?:[:@](\d+|last|all))?")


def add_options(parser: argparse.ArgumentParser) -> None:
    parser.description = (
        "Why did the fleet do what it did? --task: the whole life of a task. --robot with --round or --time: "
        "one decision, the rows it was made from, and what it would have been with all rows fresh."
    )
    add = parser.add_argument
    add("paths", nargs="+", type=Path, metavar="LOG", help="logs of one fleet run, or directories")
    what = "a task slot; with a generation (3:7), :last (default: the last that was requested) or :all"
    add("--task", metavar="SLOT[:GEN]", help=what)
    add("--robot", type=int, metavar="ID", help="the robot whose decision to explain")
    add("--round", type=int, metavar="K", help="the allocation round at whose end it decided")
    add("--time", type=float, metavar="S", help="instead of --round: seconds since that robot's log begins")
    add("--json", action="store_true", help="print JSON")


def run(options: argparse.Namespace, console: Console) -> int:
    by_task = options.task is not None
    if by_task == (options.robot is not None):
        raise HippomatError("say what to explain: --task SLOT[:GENERATION], or --robot ID with --round K")
    if by_task and (options.round is not None or options.time is not None):
        raise HippomatError("--round and --time belong to --robot: leave them out with --task")
    if not by_task and (options.round is None) == (options.time is None):
        raise HippomatError("--robot needs --round K, or --time S in seconds since its log begins")
    runs = open_runs(options.paths)
    story = _explain_task(options, runs, console) if by_task else _explain_decision(options, runs, console)
    if not options.json:
        say_what_is_missing(story, console)
    return DAMAGED if story.lost else REPRODUCED


# ---- a task ----


def _explain_task(options: argparse.Namespace, runs: list[Run], console: Console) -> FleetStory:
    found = _TASK.fullmatch(options.task)
    if found is None:
        raise HippomatError(f"--task {options.task}: give a slot, as in 3, 3:7, 3:last or 3:all")
    slot, which = int(found[1]), found[2] or LAST
    known, asked = _tasks_in(runs)
    tasks = _of_slot(known, slot)
    if which == LAST:
        tasks = [max(asked & set(tasks), default=tasks[-1])]
    elif which != ALL:
        tasks = [_named(tasks, int(which))]
    story = fleet_story(runs) if which == ALL else fleet_story(runs, keep=_of_task(*tasks[0]))
    lives = task_lives(story, tasks)
    if options.json:
        _print_json(story, {"tasks": [dataclasses.asdict(life) for life in lives]})
        return story
    for life in lives:
        show_task(story, life, console, with_costs=which != ALL)
    if found[2] is None and len(of_slot := _of_slot(known, slot)) > 1:
        first, last = of_slot[0][1], of_slot[-1][1]
        say(console, f"slot {slot} had generations {first} to {last}: --task {slot}:{first}, or {slot}:all")
    return story


def _print_json(story: FleetStory, facts: dict[str, Any]) -> None:
    print(json.dumps(plain({**facts, "without_log": story.missing, "lost": story.lost}), indent=2))


def _tasks_in(runs: list[Run]) -> tuple[set[Task], set[Task]]:
    """All that were known to anybody; those that were requested."""
    known, asked = set[Task](), set[Task]()
    for run in runs:
        for record in run.records_in_order((m.TaskTurned, m.ClaimChanged)):
            change = record.message
            known.add((change.slot, change.generation))
            if isinstance(change, m.ClaimChanged):
                asked.add((change.slot, change.generation))
    return known, asked


def _of_task(slot: int, generation: int) -> Keep:
    """Decisions made while this was the slot's task."""

    def keep(_: int, decided: m.RoundDecided) -> bool:
        ours = slot < len(decided.generations) and int(decided.generations[slot]) == generation
        return decided.action > 0 or ours

    return keep


def _of_slot(known: set[Task], slot: int) -> list[Task]:
    if tasks := sorted(task for task in known if task[0] == slot):
        return tasks
    slots = sorted({task[0] for task in known})
    has = f"slots {slots[0]} to {slots[-1]} have" if slots else "no slot has"
    raise HippomatError(f"--task {slot}: no log knows a task in slot {slot}; {has} one")


def _named(tasks: list[Task], generation: int) -> Task:
    slot = tasks[0][0]
    if (slot, generation) not in tasks:
        raise HippomatError(
            f"--task {slot}:{generation}: no log knows it; slot {slot} had generations {tasks[0][1]} to "
            f"{tasks[-1][1]}"
        )
    return slot, generation


# ---- a decision ----


def _explain_decision(options: argparse.Namespace, runs: list[Run], console: Console) -> FleetStory:
    robot = options.robot
    own = [run for run in runs if run.robot == robot]
    if not own:
        ids = [str(run.robot) for run in runs if run.robot >= 0]
        whose = {0: "no robot", 1: f"robot {ids[0]}" if ids else ""}.get(len(ids), f"robots {', '.join(ids)}")
        raise HippomatError(f"--robot {robot}: its log is not among these, which are of {whose}")
    number = options.round if options.time is None else _round_at(own[0], options.time)

    def keep(whose: int, decided: m.RoundDecided) -> bool:
        return whose == robot and decided.round == number

    story = fleet_story(runs, keep=keep, said_in=range(number, number + 1))
    seen = story.robots[robot].decisions.get(number) or _no_decision(story, own, robot, number)
    view = decision_view(story, seen)
    claim = next((c for c in story.robots[robot].claims if c.requested.round == number), None)
    if options.json:
        _print_json(story, dataclasses.asdict(view))
    else:
        show_decision(story, view, claim, console)
    return story


def _round_at(run: Run, time_s: float) -> int:
    """The round that had ended last at that time; the first one before any."""
    rounds, times_s = _round_ends(run)
    if not 0.0 <= time_s <= (times_s[-1] if len(times_s) else 0.0):
        lasts = f"{times_s[-1]:.1f}" if len(times_s) else "0"
        raise HippomatError(f"--time {time_s:g}: robot {run.robot} ended rounds until {lasts} s of its log")
    return int(rounds[max(0, int(np.searchsorted(times_s, time_s, side="right")) - 1)])


def _round_ends(run: Run) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Round numbers, and seconds since the log begins."""
    begun_ns, rounds, times_s = 0, list[int](), list[float]()
    for record in run.records_in_order((m.Started, m.RoundDecided)):
        begun_ns = begun_ns or record.log_time_ns
        if isinstance(record.message, m.RoundDecided):
            rounds.append(record.message.round)
            times_s.append((record.log_time_ns - begun_ns) / 1e9)
    return np.array(rounds, np.int64), np.array(times_s)


def _no_decision(story: FleetStory, runs: list[Run], robot: int, number: int) -> Decision:
    first, last = story.robots[robot].rounds
    if first < 0:
        raise HippomatError(f"--robot {robot}: its log holds no allocation round: had it no map?")
    if not first <= number <= last:
        raise HippomatError(f"--round {number}: robot {robot} ended rounds {first} to {last}")
    rounds = np.concatenate([_round_ends(run)[0] for run in runs])
    before, after = rounds[rounds < number].max(), rounds[rounds > number].min()
    raise HippomatError(
        f"--round {number}: robot {robot} ended no such round (it was held up, or fleet time leapt); around "
        f"it are {before} and {after}"
    )
