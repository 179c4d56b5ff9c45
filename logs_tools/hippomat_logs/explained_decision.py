"""One explained decision on a terminal: the rows, the choices, and the answer with fresh rows. Knows rich."""

from __future__ import annotations

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from hippomat_logs.definitions import Task
from hippomat_logs.fleet_story.decision_view import Choice, DecisionView, RowView, cost_text
from hippomat_logs.fleet_story.story import FleetStory
from hippomat_logs.fleet_story.values import Claim
from hippomat_logs.paragraphs import say

CHOICES = 6


def show_decision(story: FleetStory, view: DecisionView, claim: Claim | None, console: Console) -> None:
    what = f"asked for {task_text(view.request)}" if view.request is not None else "asked for nothing"
    reason = "" if view.request is not None else f": {view.reason}"
    say(console, f"robot {view.robot}, round {view.round}: {what}{reason}", style="bold")
    alone = "" if view.common else "; the robot counted this round alone: it may be no other robot's"
    say(console, f"{view.time_s:.2f} s after its log begins, record {view.record}{alone}", 2)
    console.print()
    console.print(_rows_table(story, view.rows))
    for row in view.rows:
        if row.fate:
            say(console, f"stale: {row.fate}", 2)
    _show_differences(view, console)
    console.print()
    _show_choices(story, view, console)
    _show_fresh(view, console)
    if claim is not None:
        say(console, _fate(claim))


def task_text(task: Task) -> str:
    return f"slot {task[0]} generation {task[1]}"


def _rows_table(story: FleetStory, rows: tuple[RowView, ...]) -> Table:
    """At most 78 characters wide."""
    table = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0), header_style="bold")
    for name in ("row", "came", "round", "age", "RSSI", "state", "cheapest open tasks [s]"):
        left = name in ("came", "state", "cheapest open tasks [s]")
        table.add_column(escape(name), justify="left" if left else "right", no_wrap=True)
    for row in rows:
        table.add_row(
            str(row.robot),
            row.came,
            "-" if row.round < 0 else str(row.round),
            "-" if row.came == "never" else f"{row.age_ms} ms",
            "-" if row.rssi_dbm is None else str(row.rssi_dbm),
            "-" if row.came == "never" else row.state,
            "  ".join(f"{slot}: {cost_text(story, code).removesuffix(' s')}" for slot, code in row.best),
            style="yellow" if row.stale else None,
        )
    return table


def _show_differences(view: DecisionView, console: Console) -> None:
    differing = [row for row in view.rows if row.differs]
    for row in differing:
        say(console, f"robot {row.robot} said in this round: {'; '.join(row.differs)}", 2)
    if not differing and any(row.compared for row in view.rows if row.robot != view.robot):
        say(console, "every row says what its owner had on the air in this round, as far as logs tell", 2)
    if view.newer:
        slots = ", ".join(map(str, view.newer))
        say(console, f"others knew of a newer task in slot {slots}", 2)


def _show_choices(story: FleetStory, view: DecisionView, console: Console) -> None:
    open_ones = [one for one in view.choices if one.slot is None or one.state == "waiting"]
    table = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0), header_style="bold")
    table.add_column(escape(view.allocator), no_wrap=True)
    table.add_column("cost", justify="right", no_wrap=True)
    table.add_column("logit", justify="right", no_wrap=True)
    for one in open_ones[:CHOICES]:
        taken = (None if view.request is None else view.request[0]) == one.slot
        asked = taken and (view.request is not None or one.logit is not None)
        table.add_row(*_choice_row(story, one), style="bold" if asked else None)
    if open_ones:
        console.print(table)
    if len(open_ones) > CHOICES:
        say(console, f"and {len(open_ones) - CHOICES} more", 2)
    if closed := [one for one in view.choices if one.slot is not None and one.state != "waiting"]:
        say(console, "not open: " + ", ".join(f"{o.slot}@{o.generation} {o.state}" for o in closed), 2)
    if view.margin is not None:
        say(console, f"margin of the logit over the next best: {view.margin:.3f}", 2)


def _choice_row(story: FleetStory, one: Choice) -> tuple[str, str, str]:
    name = "no request" if one.slot is None else task_text((one.slot, one.generation))
    cost = "" if one.slot is None else cost_text(story, one.code)
    return name, cost, "-" if one.logit is None else f"{one.logit:.3f}"


def _show_fresh(view: DecisionView, console: Console) -> None:
    if view.same is None:
        say(console, f"with fresh rows: not known; {view.refusal}", 2)
        return
    would = "nothing" if view.fresh is None else task_text(view.fresh)
    answer = f"the same, {would}" if view.same else f"it would have asked for {would} INSTEAD"
    but = ""
    if view.unknown:
        robots = ", ".join(map(str, view.unknown))
        but = f" (robot {robots}: not known what it had on the air; taken as held)"
    say(console, f"with every row fresh: {answer}{but}", 2, "" if view.same else "bold yellow")


def _fate(claim: Claim) -> str:
    if claim.ended is None:
        return "the claim is alive where the log ends"
    confirmed = [at.round for what, _, at in claim.changes if what == "confirmed"]
    then = f"confirmed in round {confirmed[0]}, " if confirmed else ""
    return f"the claim was {then}{claim.end} in round {claim.ended.round} ({claim.why})"
