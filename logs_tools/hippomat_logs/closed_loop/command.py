"""hippomat-replay --closed-loop, --allocator, --policy: what is asked, what is done, and the exit code.

Exit codes: 0 done; 1 tool or usage error; 2 (only --strict) a recorded value lies beyond all re-runs; 3 a
damaged log.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

from rich.console import Console

from hippomat_core.errors import ConfigError
from hippomat_logs.closed_loop import show
from hippomat_logs.closed_loop.choice import Choice, other_choice
from hippomat_logs.closed_loop.figures import (
    FEWEST_RERUNS,
    Distribution,
    PairedDifference,
    Values,
    distributions,
    paired_differences,
    values_of,
)
from hippomat_logs.closed_loop.open_loop import OpenLoop, open_loop
from hippomat_logs.closed_loop.plan import RECORDED, parse_air
from hippomat_logs.closed_loop.recorded import Recording, read_recording
from hippomat_logs.closed_loop.rerun import fleet_world, rerun_all
from hippomat_logs.metrics import FleetMetrics, fleet_metrics, robot_metrics
from hippomat_logs.metrics.as_json import plain
from hippomat_logs.metrics.figures import Figure
from hippomat_logs.metrics.fleet import Clocks
from hippomat_logs.reader import Run
from hippomat_logs.report import DIVERGED, REPRODUCED

MAX_SEEDS = 10_000


@dataclass(frozen=True, slots=True)
class ClosedLoop:
    """What the re-runs gave. others, differences: of the other allocator, where one was asked for."""

    seeds: list[int]
    radio: str
    allocator: str
    recorded: Values
    reruns: list[Values]
    distributions: list[Distribution]
    whole: bool = True  # no robot's log is missing: else the recorded values are no re-run's
    other: Choice | None = None
    others: list[Values] = field(default_factory=list)
    differences: list[PairedDifference] = field(default_factory=list)

    def as_json(self) -> dict[str, Any]:
        found: dict[str, Any] = {
            "radio": self.radio,
            "seeds": self.seeds,
            "allocator": self.allocator,
            "recorded": plain(self.recorded),
            "reruns": plain(self.reruns),
            "percentiles": plain({one.figure.key: one.percentile for one in self.distributions}),
            "whole_fleet": self.whole,
            "beyond_all_reruns": [figure.key for figure in self.beyond],
        }
        if self.other is not None:
            found["other"] = {
                "allocator": self.other.text,
                "reruns": plain(self.others),
                "differences": {one.figure.key: _difference(one) for one in self.differences},
            }
        return found

    @property
    def beyond(self) -> list[Figure]:
        """Figures whose recorded value lies beyond all of enough re-runs of the whole fleet."""
        judged = self.whole and len(self.seeds) >= FEWEST_RERUNS
        return [one.figure for one in self.distributions if one.outside] if judged else []


def _difference(one: PairedDifference) -> dict[str, Any]:
    numbers = {key: value for key, value in asdict(one).items() if isinstance(value, float)}
    return {"pairs": one.pairs, **plain(numbers), "distinguishable": one.distinguishable}


def add_options(parser: argparse.ArgumentParser) -> None:
    group = parser.add_argument_group("level L4 and counterfactuals, of the logs of a whole fleet")
    add = group.add_argument
    add(
        "--closed-loop",
        action="store_true",
        help="level L4: the fleet again in simulation, with the recorded tasks, map, starts and radio",
    )
    add(
        "--seeds",
        type=int,
        metavar="N",
        help=f"how many re-runs, for what was not recorded ({FEWEST_RERUNS})",
    )
    add("--radio", metavar="HOW", help="of the re-runs: recorded (default), ideal, or loss=P")
    add("--allocator", metavar="NAME", help="and what if the robots decided by this one?")
    add("--policy", type=Path, metavar="FILE", help="the same with these weights (safetensors)")


def asked(options: argparse.Namespace) -> list[str]:
    """Which of these modes, if any; they go together. Raises ConfigError for options that lack theirs."""
    given = [
        name for name in ("closed_loop", "allocator", "policy") if getattr(options, name) not in (None, False)
    ]
    if not options.closed_loop:
        for name in ("seeds", "radio", "plots") if given else ("seeds", "radio"):
            if getattr(options, name) is not None:
                raise ConfigError(f"--{name} is of re-runs: give --closed-loop too")
    return given


def run(runs: list[Run], options: argparse.Namespace, console: Console) -> int:
    """The exit code."""
    seeds = _seeds(options.seeds)
    if options.strict and options.closed_loop and len(seeds) < FEWEST_RERUNS:
        raise ConfigError(f"--strict judges by {FEWEST_RERUNS} re-runs or more, not by --seeds {len(seeds)}")
    air = parse_air(options.radio or RECORDED)
    if options.closed_loop:
        fleet_world()  # before minutes of reading
    recording = read_recording(runs, air)
    other = None
    if options.allocator is not None or options.policy is not None:
        other = other_choice(recording.plan.robots[0].config, options.allocator, options.policy)
    opened = open_loop(recording.runs, other) if other is not None else None
    closed = _closed_loop(recording, seeds, other) if options.closed_loop else None
    if options.json:
        print(json.dumps(_report(recording, opened, closed), indent=2))
    else:
        show.notes(recording.notes, console)
        if opened is not None and other is not None:
            show.opened(opened, _allocator(recording), other.text, console)
        if closed is not None:
            show.closed(closed, console)
    if closed is not None and options.plots is not None:
        from hippomat_logs.closed_loop.picture import draw

        for path in draw(closed, options.plots):
            if not options.json:
                console.print(f"picture: {path}", markup=False)
    return DIVERGED if options.strict and closed is not None and closed.beyond else REPRODUCED


def _seeds(count: int | None) -> list[int]:
    count = FEWEST_RERUNS if count is None else count
    if not 1 <= count <= MAX_SEEDS:
        raise ConfigError(f"--seeds {count} is outside 1 .. {MAX_SEEDS}")
    return list(range(1, count + 1))


def _closed_loop(recording: Recording, seeds: list[int], other: Choice | None) -> ClosedLoop:
    plan = recording.plan
    plans = [plan] if other is None else [plan, other.plan(plan)]
    found = rerun_all(plans, seeds, f"{len(seeds)} re-runs of {plan.seconds:.0f} s")
    recorded = values_of(recorded_metrics(recording))
    closed = ClosedLoop(
        seeds,
        plan.air.text,
        _allocator(recording),
        recorded,
        found[0],
        distributions(found[0], recorded),
        not plan.missing,
    )
    if other is None:
        return closed
    return replace(closed, other=other, others=found[1], differences=paired_differences(*found))


def recorded_metrics(recording: Recording) -> FleetMetrics:
    """Of the logs, all times on the fleet's common clock."""
    robots = [robot_metrics(run_) for run_ in recording.runs]
    return fleet_metrics(recording.runs, robots, Clocks(recording.alignment, ""))


def _allocator(recording: Recording) -> str:
    return recording.plan.robots[0].config.fleet.allocator


def _report(recording: Recording, opened: OpenLoop | None, closed: ClosedLoop | None) -> dict[str, Any]:
    found: dict[str, Any] = {
        "robots": [run_.robot for run_ in recording.runs],
        "notes": list(recording.notes),
    }
    if opened is not None:
        found["open_loop"] = plain(opened)
    if closed is not None:
        found["closed_loop"] = closed.as_json()
    return found
