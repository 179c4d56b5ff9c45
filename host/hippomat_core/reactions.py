"""What a robot does when it loses something: the reaction table of the design, one row per fault.

Decides from conditions and their age only; which condition holds is observed elsewhere (tick.py). Two rows
of the design's table are not here: a low battery, which nothing on this robot measures, and a full log
disk, which the recorder answers by itself.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from hippomat_core.messages import ERROR, WARNING


@dataclass(frozen=True, slots=True)
class Reaction:
    """One row: what a fault forbids while it lasts, and when it costs the robot its claim."""

    code: str
    level: int
    text: str
    stops: bool  # the robot stands still
    blocks_requests: bool  # it asks for nothing new
    blocks_service: bool  # it does not complete a task
    releases_after_s: float  # its claim returns to the pool after this long; inf: never


NEVER = math.inf

REACTIONS: tuple[Reaction, ...] = (
    Reaction("no_map", ERROR, "no map was loaded: give --map map.yaml", True, True, True, 0.0),
    Reaction("base_lost", ERROR, "the base does not answer: no commands are sent", True, True, True, 0.0),
    Reaction(
        "lidar_lost", ERROR, "no whole scan for lidar.timeout_s: standing still", True, True, True, 10.0
    ),
    Reaction("not_localized", ERROR, "the pose is not known: give --start x,y,yaw", True, True, True, 10.0),
    Reaction(
        "radio_lost", ERROR, "the radio does not answer: nothing new is requested", False, True, False, NEVER
    ),
    Reaction("stop", WARNING, "STOP was heard: latched until RESUME", True, True, True, NEVER),
)
BY_CODE = {reaction.code: reaction for reaction in REACTIONS}


@dataclass(frozen=True, slots=True)
class Permissions:
    """What the active faults leave allowed; `drop_claim` and `why_not` name the first fault that decides."""

    may_move: bool
    may_request: bool
    may_serve: bool
    drop_claim: str
    why_not: str


ALL_ALLOWED = Permissions(True, True, True, "", "")


def permissions(active: dict[str, int], now_ns: int) -> Permissions:
    """From active faults (code -> stamp_ns since when) to what the robot may do now."""
    if not active:
        return ALL_ALLOWED
    rows = [(BY_CODE[code], now_ns - since_ns) for code, since_ns in active.items()]
    overdue = [row.code for row, age_ns in rows if age_ns >= row.releases_after_s * 1e9]
    return Permissions(
        may_move=not any(row.stops for row, _ in rows),
        may_request=not any(row.blocks_requests for row, _ in rows),
        may_serve=not any(row.blocks_service for row, _ in rows),
        drop_claim=overdue[0] if overdue else "",
        why_not=next((row.code for row, _ in rows if row.blocks_requests), ""),
    )
