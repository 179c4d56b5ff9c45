"""The explained life of a task on a terminal. Knows rich."""

from __future__ import annotations

from rich.console import Console
from rich.table import Table

from hippomat_logs.definitions import TICKS_PER_S
from hippomat_logs.fleet_story.decision_view import cost_text
from hippomat_logs.fleet_story.story import FleetStory
from hippomat_logs.fleet_story.task_life import Learnt, RequestView, TaskLife
from hippomat_logs.paragraphs import say

MOST_ROBOTS = 8  # columns of costs


def show_task(story: FleetStory, life: TaskLife, console: Console, with_costs: bool) -> None:
    """with_costs: the story holds every decision made while the task was open."""
    place = "" if life.place_m is None else f", at ({life.place_m[0]:.2f}, {life.place_m[1]:.2f}) m"
    say(console, f"slot {life.slot} generation {life.generation}{place}", style="bold")
    say(console, _learnt(life.learnt, life.replaced), 2)
    if life.costs and with_costs:
        console.print(_costs(story, life))
        say(
            console,
            "* asked for it; whoever holds a claim counts from where and when it is done with that",
            2,
        )
    for request in life.requests:
        _show_request(story, request, console)
    if not life.requests:
        say(console, "no robot with a log requested it", 2)
    for robot, first, last in life.bound:
        when = f"in round {first}" if first == last else f"in rounds {first} to {last}"
        say(console, f"robot {robot} would have asked for it {when}, but had endorsed another's claim", 2)
    for robot, what, number in life.heard_of:
        say(console, f"robot {robot} has no log; others heard its claim: {what} in round {number}", 2)
    for one in life.conflicts:
        console.print()
        say(console, f"conflict of robots {one.robots[0]} and {one.robots[1]} ({one.kind}): {one.cause}")
        for text in one.evidence:
            say(console, text, 2)
        say(console, one.ending, 2)
    console.print()


def _learnt(learnt: tuple[Learnt, ...], replaced: int | None) -> str:
    if not learnt:
        return "no log says when it was opened"
    rounds = sorted({one.round for one in learnt})
    texts = []
    for number in rounds:
        those = [one for one in learnt if one.round == number]
        causes = sorted({one.cause for one in those})
        robots = ", ".join(str(one.robot) for one in those)
        texts.append(f"robot{'s' if len(those) > 1 else ''} {robots} in round {number} ({'/'.join(causes)})")
    until = "" if replaced is None else f"; its slot had a newer task from round {replaced} on"
    return f"known to {'; '.join(texts)}{until}"


def _costs(story: FleetStory, life: TaskLife) -> Table:
    """What it cost each robot, as the robot told the others."""
    robots = sorted(story.robots)[:MOST_ROBOTS]
    table = Table(box=None, padding=(0, 2, 0, 0), header_style="bold", title_justify="left")
    table.add_column("  cost in round", justify="right", no_wrap=True)
    for robot in robots:
        table.add_column(f"robot {robot}", justify="right", no_wrap=True)
    asked = {request.round: request.robot for request in life.requests}
    for row in life.costs:
        cells = []
        for robot in robots:
            code = row.codes[robot]
            text = "-" if code is None else cost_text(story, code)
            cells.append(f"{text} *" if asked.get(row.round) == robot else text)
        table.add_row(str(row.round), *cells)
    return table


def _show_request(story: FleetStory, request: RequestView, console: Console) -> None:
    console.print()
    say(console, f"robot {request.robot} asked for it in round {request.round}: {_choice(story, request)}")
    if request.inputs:
        say(console, f"decided on: {request.inputs}", 2)
    for text in request.stale:
        say(console, f"stale: {text}", 4)
    if request.on_air is None:
        say(console, "the claim was never on the air", 2)
    elif request.on_air > request.round + 1:
        say(console, f"the claim was on the air only in round {request.on_air}: deadline missed", 2)
    _show_votes(request, console)
    _show_drive(request, console)
    if request.ended is None:
        say(console, "the claim is alive where the log ends", 2)
    else:
        say(
            console,
            f"{request.end} in round {request.ended}, after {request.held_s:.1f} s ({request.why})",
            2,
        )


def _choice(story: FleetStory, request: RequestView) -> str:
    text = f"cost {cost_text(story, request.code)}"
    if request.logit is None or request.margin is None:
        return f"{text}; {request.allocator or 'its allocator'} gives no logits"
    rest = "no request" if request.runner_up == -1 else f"slot {request.runner_up}"
    return f"{text}; {request.allocator}, logit {request.logit:.3f}, {request.margin:.3f} above {rest}"


def _show_votes(request: RequestView, console: Console) -> None:
    votes = ", ".join(f"robot {robot} (round {number})" for robot, number in request.votes)
    say(console, f"endorsed by {votes or 'nobody else, as far as it heard'}", 2)
    if not request.confirmed:
        say(console, "never confirmed", 2)
        return
    _, why, number = request.confirmed[0]
    say(
        console, f"confirmed in round {number}: {why}, {request.confirmed_after_s:.2f} s after the request", 2
    )
    if ran_out := [one for one in request.confirmed if one[0] == "unconfirmed"]:
        often = f"{len(ran_out)} times, the last" if len(ran_out) > 1 else "once,"
        again = "" if request.confirmed[-1][0] == "unconfirmed" else ", and confirmed again"
        say(console, f"its votes ran out {often} in round {ran_out[-1][2]}{again}", 2)


def _show_drive(request: RequestView, console: Console) -> None:
    planned = "" if request.planned_m is None else f" (planned at first: {request.planned_m:.2f} m)"
    say(console, f"drove {request.driven_m:.2f} m for it{planned}", 2)
    parts = [f"{count} new path{'s' if count > 1 else ''}: {cause}" for cause, count in request.replanned]
    if request.guarded:
        parts.append(f"its scan guard slowed or stopped it for {request.guarded / TICKS_PER_S:.1f} s")
    parts += [f"stuck, tried {text}" for text in request.recoveries]
    for part in parts:
        say(console, part, 4)
