"""Which path to be on: to the destination, around what is taken, or out of somebody's way.

The rules for waiting, planning again and giving way. Decides paths, never velocities.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from hippomat_core.control.nav_state import NEVER, STANDING_MPS, Navigator, NewPath, Stretch, View
from hippomat_core.planning.astar import Path, path_length_m, shortest_path
from hippomat_core.planning.costmap import nearest_free
from hippomat_core.planning.give_way import way_aside
from hippomat_core.planning.reservations import PeerMotion, keep_out_m
from hippomat_core.replaced import replace

DETOUR_M = 2.0  # accepted at once; a longer one only after waiting three times as long
RETRY_S = 0.5
STEP_BACK_S = 3.0
SERVED_PATIENCE_S = 2.0  # longer than the dwell: whoever is at its destination finishes there first

Planned = tuple[Navigator, NewPath | None]


def choose_errand(nav: Navigator, view: View) -> Planned:
    """Give way where we stand in it, else be on a path to the destination."""
    if nav.aside:
        there = nav.path is None or nav.cursor >= len(nav.path) - 1
        if not there or view.now_ns < nav.aside_until_ns:
            return nav, None
        nav = nav.without_path()
    nav, new = _give_way(nav, view)
    if new is not None or nav.destination is None or nav.arrived:
        return nav, new
    if nav.path is None and view.now_ns >= nav.retry_ns:
        return plan(nav, view)
    return nav, None


def plan(nav: Navigator, view: View) -> Planned:
    """A path to the destination, around peers that stand still if that is not far."""
    standing = [p.robot for p in view.peers if p.speed_mps < STANDING_MPS]
    physical = view.taken.physical()
    around = view.taken_mask(physical.only(np.isin(physical.robot, [*standing, -1])))
    path = _route(nav, view, None)
    if path is None:
        nav = replace(nav.without_path(), retry_ns=view.now_ns + int(RETRY_S * 1e9))
        return nav, NewPath(np.zeros((0, 2), np.int32), math.inf, "gone")
    if around[path[:, 1], path[:, 0]].any():
        detour = _route(nav, view, around)
        if detour is not None and _longer_m(detour, path, view) <= DETOUR_M:
            path = detour
    return nav.on_path(path, "new", view.resolution_m)


def when_blocked(nav: Navigator, view: View, stretch: Stretch) -> Planned:
    """After enough blockages: another way; failing that, let the one who is in our way pass."""
    if nav.blocked_since_ns == NEVER:
        return replace(nav, blocked_since_ns=view.now_ns), None
    patience = view.config.planning.replan_after_blockages
    count = view.blockages(nav.blocked_since_ns)
    if count < nav.tried + patience:
        return nav, None
    nav = replace(nav, tried=count)
    if nav.aside or nav.path is None:
        return nav.without_path(), None
    path = _route(nav, view, view.taken_mask(view.taken))
    if path is not None:
        if count >= 3 * patience or _longer_m(path, nav.path[nav.cursor :], view) <= DETOUR_M:
            return nav.on_path(path, "blocked", view.resolution_m)
    elif count >= 2 * patience:
        wanting = {p.robot for p in view.peers if p.robot == stretch.owner and _under_way(p, view)}
        hold_s = STEP_BACK_S + 0.5 * ((view.config.robot.id + count) % 4)
        if wanting:
            return _step_aside(nav, view, wanting, hold_s)
    return nav, None


def _under_way(peer: PeerMotion, view: View) -> bool:
    """True where the peer wants to be elsewhere; one that is at its destination will stay for its dwell."""
    if peer.destination is None:
        return False
    away_m = math.dist((peer.x_m, peer.y_m), peer.destination)
    return away_m > view.config.fleet.goal_tolerance_m


def _route(nav: Navigator, view: View, blocked: NDArray[np.bool_] | None) -> Path | None:
    if nav.destination is None:
        return None
    goal = nearest_free(view.costmap, *nav.destination)
    if goal is None:
        return None
    # The field leads to the destination's own cell; where that one is not free it cannot guide us.
    field = view.field if view.field is not None and view.field.goal == goal else None
    return shortest_path(view.costmap, view.cell, goal, blocked, field)


def _longer_m(path: Path, than: Path, view: View) -> float:
    return path_length_m(path, view.resolution_m) - path_length_m(than, view.resolution_m)


def _give_way(nav: Navigator, view: View) -> Planned:
    """Step aside after standing in the way of a peer with priority for a while."""
    waiting = view.stands and (nav.path is None or nav.blocked_since_ns != NEVER)
    if not (waiting and (view.taken.intended & view.taken.inside).any()):
        return replace(nav, in_way_since_ns=NEVER), None
    if nav.in_way_since_ns == NEVER:
        return replace(nav, in_way_since_ns=view.now_ns), None
    patience_s = view.config.planning.blockage_s
    if nav.arrived:
        patience_s = max(SERVED_PATIENCE_S, view.config.fleet.dwell_s + 1.0)
    if view.now_ns - nav.in_way_since_ns < patience_s * 1e9:
        return nav, None
    nav = replace(nav, in_way_since_ns=view.now_ns)
    return _step_aside(nav, view, set(view.taken.robot[view.taken.intended].tolist()), 0.0)


def _step_aside(nav: Navigator, view: View, robots: set[int], hold_s: float) -> Planned:
    passing = [peer for peer in view.peers if peer.robot in robots]
    blocked = view.taken_mask(view.taken.physical())
    path = way_aside(view.costmap, view.cell, blocked, passing, keep_out_m(view.config))
    if path is None or (len(path) < 2 and not hold_s):
        return nav, None
    nav, new = nav.on_path(path, "aside", view.resolution_m)
    return replace(nav, aside_until_ns=view.now_ns + int(hold_s * 1e9)), new
