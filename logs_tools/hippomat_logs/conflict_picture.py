"""A picture of a fleet's conflicts: who had them with whom, and all claims over time. Extra `viz`.

The axis of time is allocation rounds, which all robots count alike; no clock is needed.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from hippomat_logs.fleet_story.causes import CAUSES
from hippomat_logs.fleet_story.conflicts import DOUBLY_CONFIRMED, Conflict
from hippomat_logs.fleet_story.story import FleetStory
from hippomat_logs.fleet_story.values import Claim
from hippomat_logs.pictures import new_figure

# Okabe and Ito's colours, told apart by everybody
COLOURS = dict(zip(CAUSES, ("#D55E00", "#E69F00", "#56B4E9", "#0072B2", "#CC79A7", "#999999"), strict=True))
REQUESTED_GREY, CONFIRMED_GREY = "#d9d9d9", "#9e9e9e"
INCHES, DPI = (12.0, 5.0), 120


def draw(story: FleetStory, conflicts: list[Conflict], path: Path) -> None:
    """Write the file; its suffix says of which kind."""
    figure = new_figure(INCHES, dpi=DPI, facecolor="white", layout="constrained")
    matrix, lines = figure.subplots(1, 2, width_ratios=(1.0, 2.6))
    robots = sorted(story.robots)
    _draw_matrix(matrix, robots, conflicts)
    _draw_claims(lines, story, robots, conflicts)
    figure.savefig(path)


def _draw_matrix(axes: Any, robots: list[int], conflicts: list[Conflict]) -> None:
    place = {robot: k for k, robot in enumerate(robots)}
    counts = np.zeros((len(robots), len(robots)), np.int64)
    for one in conflicts:
        i, j = (place[robot] for robot in one.robots)
        counts[i, j] += 1
        counts[j, i] += 1
    axes.imshow(counts, cmap="Oranges", vmin=0, vmax=max(1, int(counts.max()) * 1.3))
    for i in range(len(robots)):
        for j in range(len(robots)):
            text = "" if i == j else str(counts[i, j])
            axes.text(j, i, text, ha="center", va="center")
    axes.set_xticks(range(len(robots)), [str(robot) for robot in robots])
    axes.set_yticks(range(len(robots)), [str(robot) for robot in robots])
    axes.set_xlabel("robot")
    axes.set_ylabel("robot")
    axes.set_title(f"who with whom ({len(conflicts)} in all)")


def _draw_claims(axes: Any, story: FleetStory, robots: list[int], conflicts: list[Conflict]) -> None:
    place = {robot: k for k, robot in enumerate(robots)}
    for claim in story.claims:
        last = story.robots[claim.robot].rounds[1] + 1
        _draw_claim(axes, claim, place[claim.robot], last)
    for one in conflicts:
        at, (i, j) = max(one.requested), sorted(place[robot] for robot in one.robots)
        broken = one.kind == DOUBLY_CONFIRMED
        axes.plot([at, at], [i, j], color=COLOURS[one.cause], linewidth=3.0 if broken else 1.2, zorder=3)
        axes.plot([at, at], [i, j], "o", color=COLOURS[one.cause], markersize=4, zorder=3)
    axes.set_yticks(range(len(robots)), [str(robot) for robot in robots])
    axes.set_ylim(len(robots) - 0.4, -0.6)
    first = min((claim.requested.round for claim in story.claims), default=0)
    last = max(told.rounds[1] + 1 for told in story.robots.values())
    axes.set_xlim(first - 0.02 * (last - first) - 1, last + 0.02 * (last - first) + 1)
    axes.set_xlabel("allocation round")
    axes.set_ylabel("robot")
    axes.set_title("claims (light: requested, dark: confirmed) and conflicts")
    seen = [cause for cause in CAUSES if any(one.cause == cause for one in conflicts)]
    from matplotlib.lines import Line2D  # matplotlib loads slowly

    handles = [Line2D([], [], color=COLOURS[cause], marker="o", label=cause) for cause in seen]
    if handles:
        axes.legend(handles=handles, loc="upper center", bbox_to_anchor=(0.5, -0.14), ncols=len(handles))


def _draw_claim(axes: Any, claim: Claim, row: int, last: int) -> None:
    begun = claim.requested.round
    end = last if claim.ended is None else claim.ended.round
    axes.barh(row, max(end - begun, 1), left=begun, height=0.5, color=REQUESTED_GREY, edgecolor="white")
    for since, until in claim.confirmed_rounds():
        stop = last if until is None else until
        axes.barh(row, max(stop - since, 1), left=since, height=0.5, color=CONFIRMED_GREY)
