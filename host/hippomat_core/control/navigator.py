"""Bring one robot to its destination among peers: the paper's wait-and-replan, with rules for giving way.

A robot drives along its path only as far as planning/reservations.py leaves it free, and waits there. After
`replan_after_blockages` blockages it plans around what is taken. A robot that stands in the way of one with
priority steps aside; one with priority that finds no way around steps back in turn (control/errands.py).
Equal calls, equal outcome.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from hippomat_core.config import Config
from hippomat_core.control.errands import choose_errand, plan, when_blocked
from hippomat_core.control.follower import BRAKE_SHARE, REACTION_S, Motion, follow, limited
from hippomat_core.control.nav_state import (
    NEVER,
    NO_STRETCH,
    STANDING,
    STANDING_MPS,
    Navigator,
    NavOutcome,
    NewPath,
    Stretch,
    View,
)
from hippomat_core.control.path_kernels import nearest_point, ways_m
from hippomat_core.control.together import Together, choose_together
from hippomat_core.planning.astar import path_length_m
from hippomat_core.planning.costmap import Costmap, nearest_free
from hippomat_core.planning.distance_field import DistanceField
from hippomat_core.planning.reservations import Cells, PeerMotion, free_stretch, keep_out_m, reserve
from hippomat_core.replaced import replace
from hippomat_core.wire.frames import MAX_INTENT_STEPS

AHEAD_CELLS = 24  # of our own path are checked, about twice an intent
STOP_AT_M = 0.03  # from the destination
OFF_PATH_M = 0.15
CRAWL_MPS = 0.01
SLACK_MOVING_S, SLACK_STANDING_S = 0.6, 1.0  # two values, so that a robot does not dither at a crossing
MARK_S, MARKS = 4.0, 3  # how long and how many places the scan guard stopped us at are remembered


def navigate(
    nav: Navigator,
    stamp_ns: int,
    motion: Motion,
    destination: tuple[float, float] | None,
    peers: Sequence[PeerMotion],
    costmap: Costmap,
    field: DistanceField | None,
    config: Config,
    held: bool = False,
    together: Together | None = None,
) -> tuple[Navigator, NavOutcome]:
    """One control step, about 20 times a second.

    destination: (x, y) [m, map frame], None: nothing to drive to   field: distance_field to it, if at hand
    held: the scan guard slowed or stopped the previous command
    together: given where the fleet plans its moves together; without, robots wait, plan again and give way
    """
    dt_s = 0.05 if nav.stamp_ns == NEVER else min(max((stamp_ns - nav.stamp_ns) / 1e9, 0.0), 0.2)
    marks_left = tuple(m for m in nav.marks if m[2] > stamp_ns)
    nav = replace(nav, stamp_ns=stamp_ns, marks=marks_left, together=together is not None)
    if destination != nav.destination:
        nav = _given_back(nav, motion, costmap, config) if nav.together else nav.without_path()
        nav = replace(nav, destination=destination, arrived=False)
    cell = nearest_free(costmap, motion.x_m, motion.y_m)
    if cell is None:
        return _lost(nav, motion, costmap, config, dt_s)
    nav = _held(nav, motion, held, config)
    marks = [(x, y) for x, y, _ in nav.marks]
    taken = reserve(peers, costmap.grid, (motion.x_m, motion.y_m), destination is not None, config, marks)
    view = View(stamp_ns, dt_s, motion, cell, peers, taken, costmap, field, config, marks)
    nav = _arrival(nav, view)
    if together is not None:
        nav, chosen = choose_together(nav, view, together)
        nav, stretch = _along_commitment(nav, view)
        return _outcome(nav, view, chosen, stretch)
    nav, chosen = choose_errand(nav, view)
    nav, changed, stretch = _progress(nav, view)
    return _outcome(nav, view, changed or chosen, stretch)


def forget_path(nav: Navigator) -> Navigator:
    """For a new map: the next call plans anew."""
    return nav.without_path()


def _given_back(nav: Navigator, motion: Motion, costmap: Costmap, config: Config) -> Navigator:
    """Of what is committed keep what we can no longer stop before; a shorter commitment is always safe."""
    if nav.path is None:
        return nav
    stop_m = REACTION_S * motion.v_mps + motion.v_mps**2 / (2.0 * BRAKE_SHARE * config.limits.accel_mps2)
    kept = math.ceil(stop_m / costmap.grid.resolution_m) + 1 if motion.v_mps > CRAWL_MPS else 0
    return replace(nav, path=nav.path[: nav.cursor + 1 + kept]) if kept else nav.without_path()


def _held(nav: Navigator, motion: Motion, held: bool, config: Config) -> Navigator:
    """Where the guard kept us standing for a while, there is something that neither map nor radio told of."""
    passed = not held and nav.drive.v_mps >= STANDING_MPS
    if passed or abs(motion.v_mps) > STANDING_MPS:
        return replace(nav, held_since_ns=NEVER)
    if not held:  # nothing to hold was commanded: no news of the obstacle
        return nav
    nav = replace(nav, drive=replace(nav.drive, v_mps=min(nav.drive.v_mps, STANDING_MPS)))
    if nav.held_since_ns == NEVER:
        return replace(nav, held_since_ns=nav.stamp_ns)
    patience_ns = int(config.planning.replan_after_blockages * config.planning.blockage_s * 1e9)
    if nav.stamp_ns - nav.held_since_ns < patience_ns:
        return nav
    ahead_m = keep_out_m(config) / 2 + 0.01  # so near that the very next cell of the path is taken
    x = motion.x_m + ahead_m * math.cos(motion.yaw_rad)
    y = motion.y_m + ahead_m * math.sin(motion.yaw_rad)
    marks = (*nav.marks, (x, y, nav.stamp_ns + int(MARK_S * 1e9)))[-MARKS:]
    # Blocked for long enough already: look for another way at once.
    return replace(
        nav, held_since_ns=NEVER, marks=marks, blocked_since_ns=nav.stamp_ns - patience_ns, tried=0
    )


def _arrival(nav: Navigator, view: View) -> Navigator:
    """Arrived robots stand until they are pushed out of the goal tolerance or step aside."""
    if nav.destination is None or nav.aside:
        return replace(nav, arrived=False)
    tolerance_m = view.config.fleet.goal_tolerance_m
    limit_m = tolerance_m if nav.arrived else min(STOP_AT_M, tolerance_m / 2)
    arrived = _away_m(nav.destination, view.motion) <= limit_m
    if arrived and not nav.arrived:
        nav = nav.without_path()
    return replace(nav, arrived=arrived)


def _progress(nav: Navigator, view: View) -> tuple[Navigator, NewPath | None, Stretch]:
    """Move the cursor, see how far the path is free, and look for another way when blocked for long."""
    if nav.path is None:
        return nav, None, NO_STRETCH
    nav, off_m = _tracked(nav, view)
    if off_m > OFF_PATH_M:
        nav, new = (nav.without_path(), None) if nav.aside else plan(nav, view)
        return nav, new, NO_STRETCH
    stretch = _stretch(nav, view)
    if not stretch.blocked:
        return replace(nav, blocked_since_ns=NEVER, tried=0), None, stretch
    nav, new = when_blocked(nav, view, stretch)
    return nav, new, _stretch(nav, view) if new is not None else stretch


def _along_commitment(nav: Navigator, view: View) -> tuple[Navigator, Stretch]:
    """Move the cursor along what is committed, and see how far the peers' bodies leave it free."""
    if nav.path is None:
        return nav, NO_STRETCH
    nav, off_m = _tracked(nav, view)
    if off_m > OFF_PATH_M:
        return nav.without_path(), NO_STRETCH
    stretch = _stretch(nav, replace(view, taken=view.taken.physical()))
    if not (stretch.blocked and view.stands):
        return replace(nav, blocked_since_ns=NEVER), stretch
    if nav.blocked_since_ns == NEVER:
        return replace(nav, blocked_since_ns=view.now_ns), stretch
    if view.blockages(nav.blocked_since_ns) < view.config.planning.replan_after_blockages:
        return nav, stretch
    # Somebody stands where nobody should: give back what is left of the commitment and decide anew.
    return nav.without_path(), NO_STRETCH


def _tracked(nav: Navigator, view: View) -> tuple[Navigator, float]:
    """The cursor at the nearest path cell, and how far from it we are [m]."""
    assert nav.path is not None
    low = max(nav.cursor - 2, 0)
    xy = view.costmap.centres(nav.path[low : nav.cursor + 8])
    nearest, off_m = nearest_point(xy, view.motion.x_m, view.motion.y_m)
    return nav if nav.cursor == low + nearest else replace(nav, cursor=low + nearest), off_m


def _stretch(nav: Navigator, view: View) -> Stretch:
    """The next points of the path, and how far along them we may go."""
    points = _ahead(nav, view)
    along_m = ways_m(points, view.motion.x_m, view.motion.y_m)
    limits = view.config.limits
    x, y = points[0].tolist()
    heading_rad = math.atan2(y - view.motion.y_m, x - view.motion.x_m)
    turn_s = abs(math.remainder(heading_rad - view.motion.yaw_rad, math.tau)) / limits.turn_radps
    at_s = turn_s + along_m / limits.speed_mps
    # Who gives way leaves an intent it stands in, and so may cross it.
    taken = view.taken.physical() if nav.aside else view.taken
    slack_s = SLACK_STANDING_S if view.stands else SLACK_MOVING_S
    count, owner = free_stretch(taken, points, at_s, slack_s)
    return Stretch(points, float(along_m[count - 1]) if count else 0.0, owner, count == 0)


def _ahead(nav: Navigator, view: View) -> NDArray[np.float64]:
    """(n >= 1, 2) [m]: the path's next cells; the destination itself where that lies in the last one."""
    assert nav.path is not None
    begin = min(nav.cursor + 1, len(nav.path) - 1)
    points = view.costmap.centres(nav.path[begin : begin + AHEAD_CELLS])
    whole = begin + AHEAD_CELLS >= len(nav.path)
    if nav.destination is None or nav.aside or not whole:
        return points
    if math.dist(nav.destination, points[-1]) < view.resolution_m:
        points[-1] = nav.destination
    return points


def _outcome(
    nav: Navigator, view: View, new: NewPath | None, stretch: Stretch
) -> tuple[Navigator, NavOutcome]:
    limits, motion = view.config.limits, view.motion
    if len(stretch.points) and not _at_end(nav, motion, stretch):
        drive = follow(
            stretch.points, stretch.free_m, motion, nav.drive, view.dt_s, view.config, view.costmap
        )
        reason = "rotate" if drive.turning else "hold" if stretch.blocked else "follow"
    else:
        drive, reason = limited(STANDING, nav.drive, view.dt_s, limits), "hold"
    arrived = (
        nav.destination is not None
        and not nav.aside
        and _away_m(nav.destination, motion) <= view.config.fleet.goal_tolerance_m
    )
    outcome = NavOutcome(
        v_mps=drive.v_mps,
        wz_radps=drive.wz_radps,
        reason=reason,
        path=new,
        intent=_intent(nav, view),
        arrived=arrived,
        blocked=stretch.blocked,
        blocked_by=stretch.owner,
        remaining_m=_remaining_m(nav, view),
    )
    return replace(nav, drive=drive), outcome


def _at_end(nav: Navigator, motion: Motion, stretch: Stretch) -> bool:
    """The path is driven; its end may be short of a destination that stands too near a wall."""
    last = nav.path is None or nav.cursor >= len(nav.path) - 1
    return last and (nav.aside or _away_m((stretch.points[-1, 0], stretch.points[-1, 1]), motion) < STOP_AT_M)


def _intent(nav: Navigator, view: View) -> Cells:
    """What we mean to drive next, also while others keep us from it: that is how they learn to let us by."""
    if nav.path is None or nav.arrived:
        return np.array([view.cell], np.int32)
    if nav.together:
        return nav.path[nav.cursor :]
    steps = min(round(view.config.planning.intent_horizon_m / view.resolution_m), MAX_INTENT_STEPS)
    return nav.path[nav.cursor : nav.cursor + 1 + steps]


def _remaining_m(nav: Navigator, view: View) -> float:
    if nav.destination is None or nav.arrived:
        return 0.0
    if nav.path is not None and not nav.aside and not nav.together:
        return path_length_m(nav.path[nav.cursor :], view.resolution_m)
    return math.inf if view.field is None else float(view.field[view.cell[1], view.cell[0]])


def _lost(
    nav: Navigator, motion: Motion, costmap: Costmap, config: Config, dt_s: float
) -> tuple[Navigator, NavOutcome]:
    """Nowhere near a free cell: the pose or the map is wrong; stand."""
    drive = limited(STANDING, nav.drive, dt_s, config.limits)
    ix, iy = costmap.grid.cell_of(motion.x_m, motion.y_m)
    here = (min(max(ix, 0), costmap.grid.width - 1), min(max(iy, 0), costmap.grid.height - 1))
    intent = np.array([here], np.int32)
    outcome = NavOutcome(drive.v_mps, drive.wz_radps, "stop:off_map", None, intent, False, True, -1, math.inf)
    return replace(nav.without_path(), drive=drive), outcome


def _away_m(destination: tuple[float, float], motion: Motion) -> float:
    return math.hypot(destination[0] - motion.x_m, destination[1] - motion.y_m)
