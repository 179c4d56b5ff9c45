"""hippomat-logs metrics: what a fleet achieved, or many trials side by side, as a paper wants it."""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from hippomat_core.errors import HippomatError, LogError
from hippomat_logs.commands.select import words
from hippomat_logs.each_file import each_item
from hippomat_logs.metrics.as_json import fleet_as_json, truth_as_json
from hippomat_logs.metrics.beside_paper import CAVEAT, beside_paper, printed_text
from hippomat_logs.metrics.comparison import Group, Trial, compare
from hippomat_logs.metrics.figures import FIGURES, PAPER, Figure, chosen, figures_of
from hippomat_logs.metrics.fleet import Clocks, FleetMetrics, clocks_of, fleet_metrics, robot_metrics
from hippomat_logs.metrics.fleet_tables import (
    fleet_lines,
    link_tables,
    metrics_table,
    truth_lines,
    truth_table,
)
from hippomat_logs.metrics.grouping import LoggedRun
from hippomat_logs.metrics.robot import RobotMetrics
from hippomat_logs.metrics.trial_tables import (
    as_csv,
    as_latex,
    as_markdown,
    as_values,
    grids,
    terminal_tables,
)
from hippomat_logs.metrics.trials import BY_DIRECTORY, BY_TIME, TrialFiles, find_trials
from hippomat_logs.metrics.truth import against_truth
from hippomat_logs.metrics.truth_files import read_truth
from hippomat_logs.paragraphs import say
from hippomat_logs.reader import Run
from hippomat_logs.report import DAMAGED, REPRODUCED

ALL = "all"
OWN_FRAME, MAP_FRAME = "own", "map"
_TRIALS = (
    "what one trial is: time (default): runs of one fleet id that overlap by half of the shorter one, those "
    "in one directory first, and whatever their clocks say where each robot is there once; dir: all runs "
    "below each directory directly in PATH. A fused file is one trial"
)
_BY = (
    "group trials by what their manifests say: method (allocator), robots, tasks, seed, policy, map, dir "
    "(first directory below PATH), trial, any setting (fleet.round_s), any key of the manifest"
)


def add_options(parser: argparse.ArgumentParser) -> None:
    parser.epilog = (
        "docs/metrics.md defines every figure. Tables over trials: mean ± 95 % interval (Student's t)."
    )
    add = parser.add_argument
    add(
        "paths",
        nargs="+",
        type=Path,
        metavar="PATH",
        help="logs, or directories of logs: of one trial or many",
    )
    add("--by", type=words, default=(), metavar="KEY,...", help=_BY)
    add(
        "--baseline",
        default="",
        metavar="NAME",
        help="paired differences to this value of the first --by KEY",
    )
    keys = ", ".join(figure.key for figure in FIGURES)
    add("--figures", type=words, default=(), metavar="NAME,...", help=f"only these, in this order: {keys}")
    add("--trials", choices=(BY_TIME, BY_DIRECTORY), default=BY_TIME, help=_TRIALS)
    form = parser.add_mutually_exclusive_group()
    form.add_argument("--json", action="store_true", help="print JSON, unrounded")
    form.add_argument("--csv", action="store_true", help="print CSV, unrounded, a line per group and figure")
    form.add_argument("--markdown", action="store_true", help="print Markdown tables")
    form.add_argument("--latex", action="store_true", help="print LaTeX tables (booktabs)")
    add("--links", action="store_true", help="one trial: also the matrices of all links")
    truth = "one trial: motion capture (CSV: time_s,robot,x_m,y_m,yaw_rad) or the simulator's truth.npz"
    add("--truth", type=Path, metavar="FILE", help=truth)
    frame = "own (default): the rigid transform to the map is found by the motion; map: it is the map's frame"
    add("--truth-frame", choices=(OWN_FRAME, MAP_FRAME), default=OWN_FRAME, help=frame)
    add("--trust-clocks", action="store_true", help="the robots' wall clocks are one: do not align them")


def run(options: argparse.Namespace, console: Console) -> int:
    if options.baseline and not options.by:
        raise HippomatError(f"--baseline {options.baseline} needs --by KEY: a value of the first KEY")
    found = find_trials(options.paths, options.trials)
    errors = Console(stderr=True, highlight=False)
    for line in found.twice:
        errors.print(f"counted once: {line}", style="yellow", markup=False, soft_wrap=True)
    if not found.trials and not found.damaged and found.foreign:
        more = f"; and so for {len(found.foreign) - 1} more" if len(found.foreign) > 1 else ""
        raise HippomatError(found.foreign[0] + more)
    for line in found.foreign:
        errors.print(f"left out: {line}", style="yellow", markup=False, soft_wrap=True)
    as_table = options.by or options.csv or options.markdown or options.latex
    if options.truth and (as_table or len(found.trials) != 1):
        raise HippomatError(f"--truth {options.truth} goes with one trial, found {len(found.trials)}")
    if len(found.trials) == 1 and not as_table:
        if found.damaged:
            raise LogError("; ".join(found.damaged))
        return _one_trial(found.trials[0], options, console)
    for line in found.damaged:
        errors.print(f"damaged: {line}", style="red", markup=False, soft_wrap=True)
    if not found.trials:
        if found.damaged:
            return DAMAGED
        raise HippomatError(f"{', '.join(map(str, options.paths))}: holds no robot's log of ours")
    return max(_many_trials(found.trials, options, console, errors), DAMAGED if found.damaged else REPRODUCED)


# ---- one trial ----


def _one_trial(trial: TrialFiles, options: argparse.Namespace, console: Console) -> int:
    truth = read_truth(options.truth) if options.truth else None  # before the work
    runs, clocks, metrics = read_fleet(trial, options.trust_clocks)
    errors = None
    if truth is not None:
        errors = against_truth(runs, clocks.alignment, truth, map_frame=options.truth_frame == MAP_FRAME)
    code = DAMAGED if metrics.not_whole else REPRODUCED
    guess = trial.doubt(clocks.linked)
    if options.json:
        facts = {**fleet_as_json(metrics), "grouping": guess or None}
        print(json.dumps(facts if errors is None else {**facts, "truth": truth_as_json(errors)}, indent=2))
        return code
    console.print(metrics_table(metrics))
    for line in fleet_lines(metrics):
        console.print(line, markup=False)
    if errors is not None:
        console.print()
        console.print(truth_table(errors))
        for line in truth_lines(errors):
            console.print(line, markup=False)
    _show_paper(metrics, console)
    if options.links:
        for title, table in link_tables(metrics):
            console.print(f"\n{title}", style="bold", markup=False)
            console.print(table)
    for line in [*metrics.not_whole, *([guess] if guess else [])]:
        say(console, line, 0, "yellow")
    return code


def read_fleet(trial: TrialFiles, trust_clocks: bool) -> tuple[list[Run], Clocks, FleetMetrics]:
    """A process for each robot, and a progress bar; raises LogError where a log is damaged."""
    read = list(each_item(trial.runs, _read_robot, "reading", trial.size))
    for one in read:
        if isinstance(one, HippomatError):
            raise one
    whole = [one for one in read if not isinstance(one, HippomatError)]
    runs = [Run(logged.paths, logged.manifest, inside=logged.inside) for logged in trial.runs]
    clocks = clocks_of(runs, trusted=trust_clocks)
    return runs, clocks, fleet_metrics(runs, whole, clocks)


def _read_robot(logged: LoggedRun) -> RobotMetrics | HippomatError:
    """In a process of its own; an error comes back as a value, so that it ends the others cleanly."""
    try:
        return robot_metrics(logged.open())
    except HippomatError as error:
        return error


def _show_paper(metrics: FleetMetrics, console: Console) -> None:
    beside = beside_paper(metrics)
    if not beside.rows:
        console.print(f"beside the paper: {beside.why}", markup=False)
        return
    table = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0), header_style="bold")
    for name in ("", "this run", "paper"):
        table.add_column(name, no_wrap=True, justify="right" if name else "left")
    for row in beside.rows:
        table.add_row(escape(row.metric), row.ours, printed_text(row.printed))
    console.print(f"\nbeside the paper's {beside.title}", style="bold", markup=False)
    console.print(table)
    console.print(CAVEAT, style="dim")


# ---- many ----


def _many_trials(
    trials: Sequence[TrialFiles], options: argparse.Namespace, console: Console, errors: Console
) -> int:
    keys = options.by or ("trial",)
    facts = [
        tuple(trial.fact(key) for key in keys) for trial in trials
    ]  # an unknown key ends it before the work
    figures = chosen(
        options.figures or (PAPER if options.latex or options.markdown else [f.key for f in FIGURES])
    )
    size = sum(trial.size for trial in trials)
    work = partial(_read_trial, options.trust_clocks)
    read = [
        Trial(trial.name, fact, trial.pairing, one.figures, one.error, one.notes, one.whole)
        for trial, fact, one in zip(trials, facts, each_item(trials, work, "trials", size), strict=True)
    ]
    for trial in read:
        if trial.error:
            line = f"left out: trial {trial.name}: {trial.error}"
            errors.print(line, style="red", markup=False, soft_wrap=True)
        for note in trial.notes:
            errors.print(f"trial {trial.name}: {note}", style="yellow", markup=False, soft_wrap=True)
    good = sorted(
        (trial for trial in read if not trial.error), key=lambda trial: tuple(map(_rank, trial.facts))
    )
    if not good:
        return DAMAGED
    groups = compare(good, options.baseline)
    if not options.by and len(good) > 1:
        groups.append(Group((ALL,), tuple(good)))
    _print_groups(groups, keys, figures, options, console)
    return REPRODUCED if all(trial.whole for trial in read) else DAMAGED


@dataclass(frozen=True, slots=True)
class _Read:
    """What a trial gave. error: why it gave no figures; notes: what to mind of them."""

    figures: dict[str, float] = field(default_factory=dict)
    error: str = ""
    notes: tuple[str, ...] = ()
    whole: bool = False


def _read_trial(trust_clocks: bool, trial: TrialFiles) -> _Read:
    """In a process of its own."""
    try:
        runs = [logged.open() for logged in trial.runs]
        robots = [robot_metrics(run) for run in runs]
        clocks = clocks_of(runs, trusted=trust_clocks)
        fleet = fleet_metrics(runs, robots, clocks)
    except HippomatError as error:
        return _Read(error=str(error))
    of_fleet = f"{fleet.coverage} of the fleet: totals lack what the other robots did"
    notes = (*fleet.not_whole, of_fleet if fleet.coverage else "", trial.doubt(clocks.linked))
    return _Read(figures_of(fleet), "", tuple(note for note in notes if note), not fleet.not_whole)


def _print_groups(
    groups: Sequence[Group],
    keys: Sequence[str],
    figures: Sequence[Figure],
    options: argparse.Namespace,
    console: Console,
) -> None:
    if options.json:
        print(json.dumps({"by": list(keys), "groups": as_values(groups, keys, figures)}, indent=2))
    elif options.csv:
        print(as_csv(groups, keys, figures), end="")
    else:
        made = grids(groups, keys, figures, options.baseline)
        if options.latex:
            print(as_latex(made, len(keys)), end="")
        elif options.markdown:
            print(as_markdown(made), end="")
        else:
            for grid in made:
                console.print(grid.caption, style="dim", markup=False)
                for table in terminal_tables(grid, len(keys), max(80, console.width)):
                    console.print(table)
                    console.print()


def _rank(fact: str) -> tuple[float, str]:
    """Numbers by size, names by alphabet behind them."""
    try:
        return float(fact), ""
    except ValueError:
        return float("inf"), fact
