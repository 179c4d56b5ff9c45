"""hippomat-logs conflicts: every double request and double claim of a fleet, and why it came about."""

from __future__ import annotations

import argparse
import json
import math
from collections import Counter
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

from hippomat_core.fleet.robot_names import named
from hippomat_logs.fleet_story.causes import CAUSES
from hippomat_logs.fleet_story.conflicts import (
    DOUBLY_CONFIRMED,
    KINDS,
    Conflict,
    OneSided,
    conflict_free_rate,
    conflicts_in,
    one_sided,
    price,
    promise_holds,
)
from hippomat_logs.fleet_story.story import FleetStory, fleet_story
from hippomat_logs.metrics.as_json import plain
from hippomat_logs.paragraphs import say
from hippomat_logs.pictures import refuse_no_picture
from hippomat_logs.reader import open_runs
from hippomat_logs.report import DAMAGED, DIVERGED, REPRODUCED

SHOWN = 20


def add_options(parser: argparse.ArgumentParser) -> None:
    parser.description = (
        "Every double request and double claim in the logs of a fleet, with its cause: loss, staleness, tie, "
        "policy, clock. Exit code 2 where two robots held one task confirmed at once."
    )
    parser.add_argument(
        "paths", nargs="+", type=Path, metavar="LOG", help="logs of one fleet run, or directories"
    )
    parser.add_argument("--json", action="store_true", help="print JSON")
    parser.add_argument("--all", action="store_true", help=f"explain more than the first {SHOWN}")
    parser.add_argument(
        "-o", "--out", type=Path, metavar="PNG", help="a picture: who with whom, and the claims over time"
    )


def run(options: argparse.Namespace, console: Console) -> int:
    if options.out is not None:
        refuse_no_picture(options.out)
    story = fleet_story(open_runs(options.paths))
    conflicts = conflicts_in(story)
    if options.json:
        print(json.dumps(as_json(story, conflicts), indent=2))
    else:
        show(story, conflicts, None if options.all else SHOWN, console)
    if options.out is not None:
        from hippomat_logs.conflict_picture import draw  # matplotlib loads slowly

        draw(story, conflicts, options.out)
        if not options.json:
            console.print(f"{options.out}: who with whom, and the claims over time", markup=False)
    if broken(story, conflicts):
        return DIVERGED
    return DAMAGED if story.not_whole else REPRODUCED


def broken(story: FleetStory, conflicts: list[Conflict]) -> list[Conflict]:
    """Two confirmed at once, in a fleet that was promised one."""
    return [one for one in conflicts if one.kind == DOUBLY_CONFIRMED] if promise_holds(story) else []


def as_json(story: FleetStory, conflicts: list[Conflict]) -> dict[str, Any]:
    """nan and infinity are null."""
    return {
        "robots": sorted(story.robots),
        "without_log": story.missing,
        "requests": len(story.claims),
        "requested_tasks": len({claim.task for claim in story.claims}),
        "conflict_free_rate": plain(conflict_free_rate(story.claims)),
        "by_cause": {cause: count for cause, count in _by_cause(conflicts).items() if count},
        "by_kind": {kind: sum(one.kind == kind for one in conflicts) for kind in KINDS},
        "price_s": price(conflicts)[0],
        "price_m": price(conflicts)[1],
        "misjudged": sum(one.misjudged for one in conflicts),
        "promise_broken": bool(broken(story, conflicts)),
        "conflicts": plain(conflicts),
        "one_sided": plain(one_sided(story)),
        "not_whole": story.not_whole,
    }


def _by_cause(conflicts: list[Conflict]) -> dict[str, int]:
    counts = Counter(one.cause for one in conflicts)
    return {cause: counts[cause] for cause in CAUSES}


def show(story: FleetStory, conflicts: list[Conflict], most: int | None, console: Console) -> None:
    for line in _head(story, conflicts):
        console.print(line, markup=False)
    for one in broken(story, conflicts):
        text = (
            f"BROKEN PROMISE: robots {_both(one)} held slot {one.slot} generation {one.generation} confirmed"
        )
        console.print(f"{text} at once", style="bold red", markup=False)
    if conflicts:
        console.print(_table(conflicts if most is None else conflicts[:most]))
        console.print(_causes_line(conflicts), markup=False)
    for one in conflicts[:most]:
        _explain(one, console)
    if most is not None and len(conflicts) > most:
        console.print(f"and {len(conflicts) - most} more: --all", markup=False)
    for seen in one_sided(story):
        say(console, _one_sided_text(seen), 2)
    say_what_is_missing(story, console)


def _head(story: FleetStory, conflicts: list[Conflict]) -> list[str]:
    spans = [told.rounds for told in story.robots.values()]
    first, last = min(span[0] for span in spans), max(span[1] for span in spans)
    tasks = {claim.task for claim in story.claims}
    rate = conflict_free_rate(story.claims)
    share = "-" if math.isnan(rate) else f"{100 * rate:.1f} %"
    who = f"robots {', '.join(map(str, sorted(story.robots)))}" if len(story.robots) > 1 else "one robot"
    return [
        f"{who}, rounds {first} to {last}: {len(story.claims)} requests for {len(tasks)} tasks",
        f"{len(conflicts) or 'no'} conflict{'' if len(conflicts) == 1 else 's'}; "
        f"tasks that exactly one robot requested (CF1): {share}",
    ]


def _causes_line(conflicts: list[Conflict]) -> str:
    causes = ", ".join(f"{count} {cause}" for cause, count in _by_cause(conflicts).items() if count)
    lost_s, lost_m = price(conflicts)
    lines = [f"by cause: {causes}; price: {lost_s:.1f} s and {lost_m:.2f} m for claims that were given up"]
    if wrong := sum(one.misjudged for one in conflicts):
        lines.append(
            f"in {wrong} of them a robot itself recorded another cause: from one side, less is known"
        )
    return "\n".join(lines)


def _table(conflicts: list[Conflict]) -> Table:
    """72 characters wide at most."""
    table = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0), header_style="bold")
    names = ("round", "task", "robots", "kind", "cause", "kept by", "rounds", "lost")
    for name in names:
        right = name in ("round", "rounds", "lost", "kept by")
        table.add_column(name, justify="right" if right else "left", no_wrap=True)
    for one in conflicts:
        table.add_row(
            str(max(one.requested)),
            f"{one.slot}@{one.generation}",
            _both(one),
            one.kind,
            one.cause,
            "-" if one.kept_by is None else str(one.kept_by),
            str(one.rounds),
            f"{price([one])[0]:.1f} s",
            style="bold red" if one.kind == DOUBLY_CONFIRMED else None,
        )
    return table


def _both(one: Conflict) -> str:
    return f"{one.robots[0]}, {one.robots[1]}"


def _explain(one: Conflict, console: Console) -> None:
    first, second = one.requested
    when = f"both in round {first}" if first == second else f"in rounds {first} and {second}"
    asked = f"robots {_both(one)} asked for slot {one.slot} generation {one.generation} {when}"
    console.print()
    say(console, f"{asked} ({_costs(one)})")
    for index, text in enumerate(one.evidence):
        say(console, f"{one.cause + ': ' if index == 0 else ''}{text}", 2)
    for robot, guess in one.guesses:
        if guess != one.cause:
            say(console, f"robot {robot} itself recorded: {guess}", 2, "yellow")
    say(console, one.ending, 2)


def _costs(one: Conflict) -> str:
    if math.isnan(one.costs_s[0]):
        return f"cost codes {one.codes[0]} and {one.codes[1]}"
    return f"costs {one.costs_s[0]:.1f} s and {one.costs_s[1]:.1f} s"


def say_what_is_missing(story: FleetStory, console: Console) -> None:
    """What these logs cannot tell."""
    if story.missing:
        whom = "it" if len(story.missing) == 1 else "they"
        text = f"no log of {named(story.missing)}: what {whom} did is known only as far as others heard"
        say(console, text, 0, "yellow")
    for name in story.observers:
        say(console, f"{name} is an observer's log: it decides nothing and is left out", 0, "yellow")
    for line in story.not_whole:
        say(console, line, 0, "yellow")
    for told in story.robots.values():
        if told.recovered:
            say(console, f"robot {told.robot}'s log ends with round {told.rounds[1]}", 0, "yellow")


def _one_sided_text(one: OneSided) -> str:
    kept = "kept it" if one.kept else "gave it up"
    return (
        f"robot {one.robot} saw a conflict with robot {one.other} in round {one.at.round} about slot "
        f"{one.slot} generation {one.generation} and {kept}; its guess: {one.guess}"
    )
