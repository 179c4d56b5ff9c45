"""The stories of all robots of one fleet, side by side.

Decides which logs belong to one fleet run, and says whose log is missing. Rounds count fleet time, so that
nothing here needs a clock; times to show are the alignment's (hippomat_logs/alignment.py).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import pairwise

from hippomat_core import messages as m
from hippomat_core.config import Config
from hippomat_core.errors import HippomatError, MapError
from hippomat_logs.definitions import c_max_s
from hippomat_logs.each_file import progress_bar
from hippomat_logs.fleet_story.reading import KINDS, Keep, RobotReading, requests_only
from hippomat_logs.fleet_story.values import NO_ROUND, Claim, RobotStory
from hippomat_logs.reader import Run
from hippomat_logs.shortfalls import not_whole, shortfalls, whose_log

_STEP = 2000  # records between two moves of the progress bar
Progress = Callable[[int], None]


@dataclass(slots=True, eq=False)
class FleetStory:
    """Robots by id. A robot that was restarted has several runs, and one story."""

    robots: dict[int, RobotStory]
    runs: dict[int, list[Run]]
    size: int
    slots: int
    observers: list[str] = field(default_factory=list)  # logs of those who only listened
    c_max_s: float = 0.0  # of all costs; 0: unknown

    @property
    def missing(self) -> list[int]:
        """Robots of the roster without a log."""
        return [robot for robot in range(self.size) if robot not in self.robots]

    @property
    def claims(self) -> list[Claim]:
        """Of all robots, in the order of their requests."""
        claims = [claim for story in self.robots.values() for claim in story.claims]
        return sorted(claims, key=lambda claim: (claim.requested.round, claim.robot))

    @property
    def not_whole(self) -> list[str]:
        """What the logs themselves say that they lack."""
        return [
            line
            for story in self.robots.values()
            for line in not_whole(whose_log(story.robot), shortfalls(story))
        ]

    def config(self, robot: int) -> Config:
        return self.runs[robot][0].config

    def policy(self, robot: int) -> bytes:
        return self.runs[robot][0].policy


def fleet_story(
    runs: Sequence[Run],
    keep: Keep = requests_only,
    said_in: Sequence[int] = (),
) -> FleetStory:
    """Reads every log once. Raises HippomatError where they are not of one fleet run.

    keep: which decisions to keep whole; said_in: rounds of which to keep what was on the air.
    """
    by_robot: dict[int, list[Run]] = {}
    observers = []
    for run in runs:
        if run.robot < 0:
            observers.append(run.name)
        else:
            by_robot.setdefault(run.robot, []).append(run)
    if not by_robot:
        raise HippomatError("these logs are of observers, which decide nothing: give a robot's log too")
    size, slots = _one_fleet([run for several in by_robot.values() for run in several])
    stories = {}
    with _progress(runs) as advance:
        for robot, several in sorted(by_robot.items()):
            parts = [_read(run, keep, said_in, advance) for run in several]
            stories[robot] = _joined(parts, several)
    story = FleetStory(stories, by_robot, size, slots, observers)
    story.c_max_s = _c_max_s(story)
    return story


def _one_fleet(runs: Sequence[Run]) -> tuple[int, int]:
    """Roster size and task slots of them all."""
    first = runs[0].config.fleet
    for run in runs[1:]:
        other = run.config.fleet
        for what in ("id", "size", "task_slots"):
            ours, theirs = getattr(first, what), getattr(other, what)
            if ours != theirs:
                raise HippomatError(
                    f"{runs[0].name} has [fleet] {what} = {ours}, {run.name} has {theirs}: "
                    "give the logs of one fleet"
                )
    return first.size, first.task_slots


def _read(run: Run, keep: Keep, said_in: Sequence[int], advance: Progress) -> RobotStory:
    reading = RobotReading(run.robot, run.config, keep, said_in)
    done = 0
    for record in run.records_in_order(KINDS):
        reading.feed(record)
        if record.number - done >= _STEP:
            advance(record.number - done)
            done = record.number
    story = reading.result()
    story.lost, story.recovered = list(run.lost), run.recovered
    return story


def _joined(parts: Sequence[RobotStory], runs: Sequence[Run]) -> RobotStory:
    """One story of a robot that was restarted: rounds go on, as fleet time does."""
    if len(parts) == 1:
        return parts[0]
    order = sorted(range(len(parts)), key=lambda k: parts[k].rounds)
    whole = parts[order[0]]
    for before, k in pairwise(order):
        part = parts[k]
        if NO_ROUND in part.rounds:
            continue
        if part.rounds[0] <= whole.rounds[1]:
            raise HippomatError(
                f"{runs[before].name} and {runs[k].name} are both of robot {whole.robot}, and both of round "
                f"{part.rounds[0]}: give the logs of one fleet run"
            )
        whole.rounds = whole.rounds[0], part.rounds[1]
        for name in ("claims", "conflicts", "turned", "peers", "lost"):
            getattr(whole, name).extend(getattr(part, name))
        for name in ("decisions", "sent", "said"):
            getattr(whole, name).update(getattr(part, name))
        whole.map, whole.recovered = whole.map or part.map, whole.recovered or part.recovered
    return whole


def _c_max_s(story: FleetStory) -> float:
    """From the settings, or from the map as every robot computes it; 0 where no log holds a map."""
    for robot, told in story.robots.items():
        config = story.config(robot)
        if config.fleet.c_max_s:
            return config.fleet.c_max_s
        if told.map is not None:
            return _of_map(told.map, config)
    return 0.0


def _of_map(event: m.MapReceived, config: Config) -> float:
    try:
        return c_max_s(config, event)
    except MapError:
        return 0.0


@contextmanager
def _progress(runs: Sequence[Run]) -> Iterator[Progress]:
    total = sum(run.records for run in runs)
    with progress_bar() as bar:
        task = bar.add_task("reading", total=total)
        yield lambda steps: bar.advance(task, steps)
