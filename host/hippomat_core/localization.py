"""Localization as the robot's events drive it: sweeps move the localizer on, ticks let it search.

Decides what a sweep shows of the map (peers are left out) and what is recorded and said of it. Where the
robot is, is slam/localizer.py's affair.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hippomat_core.config import Config
from hippomat_core.mapping import with_answer
from hippomat_core.mapping import with_sweep as charted
from hippomat_core.messages import (
    WARNING,
    AlarmCleared,
    AlarmRaised,
    Effect,
    Localized,
    LoopsClosed,
    ScanReceived,
)
from hippomat_core.planning.ground import Ground
from hippomat_core.reactions import BY_CODE
from hippomat_core.replaced import replace
from hippomat_core.slam.localizer import (
    Localizer,
    Seen,
    first_localizer,
    on_new_map,
    saved_map,
    with_sweep,
    with_work,
)
from hippomat_core.slam.masking import masked
from hippomat_core.slam.pose2 import compose
from hippomat_core.slam.sweep import deskewed
from hippomat_core.state import State, elsewhere
from hippomat_core.wire.frames import FLAG_LOCALIZED

LOOPS_OPEN = "loops_open"


def localizes(config: Config) -> bool:
    """Whether the robot finds itself in a map, once it has one, with a lidar of its own."""
    ros = config.ros
    return config.robot.id >= 0 and config.slam.mode == "auto" and not (ros.localizes or ros.scans)


def on_map(state: State, ground: Ground, now_ns: int) -> State:
    """With a map that is new, or changed: the pose in it is what it was before, and has to be checked."""
    config = state.config
    if not localizes(config):
        return replace(state, place=None)
    saved = saved_map(ground.costmap, config.robot.radius_m)
    if state.place is not None:
        return replace(state, place=on_new_map(state.place, saved, now_ns))
    known = config.robot.start_known
    place = first_localizer(saved, config.lidar, config.slam, state.odometry.pose, known, now_ns)
    return replace(state, place=place)


def on_sweep(state: State, event: ScanReceived, effects: list[Effect]) -> State:
    """After a whole sweep."""
    before = state.place
    if before is None and state.charting is None:
        return state
    points, odom, at_ns = deskewed(event, state.sweeps, state.odometry, state.config.lidar)
    if state.charting is not None:
        # Peers are not left out: their poses are told in a map that we do not have.
        return replace(state, charting=charted(state.charting, event, (points, odom, at_ns), effects))
    assert before is not None
    shown = points
    if before.localized:
        pose = compose(before.map_from_odom, odom)
        shown = masked(points, pose, _peers_m(state, event.stamp_ns), state.config.robot.radius_m)
    after = with_sweep(before, Seen(shown, odom), event.stamp_ns)
    effects.append(_record(after, at_ns, len(points) - len(shown)))
    return _told(state, before, after, event.stamp_ns, effects)


def on_loops_closed(state: State, event: LoopsClosed) -> tuple[State, tuple[Effect, ...]]:
    """The answer of the solver outside; one that nobody asked for changes nothing."""
    if state.charting is None:
        return state, ()
    effects: list[Effect] = []
    alarms, raised = state.alarms, LOOPS_OPEN in state.alarms
    if event.text and not raised:
        effects.append(AlarmRaised(WARNING, LOOPS_OPEN, f"loops of the map are not closed: {event.text}"))
        alarms |= {LOOPS_OPEN}
    if raised and not event.text:
        effects.append(AlarmCleared(LOOPS_OPEN))
        alarms -= {LOOPS_OPEN}
    charting = with_answer(state.charting, event, effects)
    return replace(state, charting=charting, alarms=alarms), tuple(effects)


def on_tick(state: State, now_ns: int, effects: list[Effect]) -> State:
    """A search of the whole map goes on, where there is one."""
    before = state.place
    return state if before is None else _told(state, before, with_work(before, now_ns), now_ns, effects)


def _told(state: State, before: Localizer, after: Localizer, now_ns: int, effects: list[Effect]) -> State:
    """What changed is said; a robot that finds itself somewhere plans anew."""
    news = (after.phase, after.searched) != (before.phase, before.searched)  # not after every search
    if after.why and news and "not_localized" in state.alarms:
        effects.append(AlarmRaised(BY_CODE["not_localized"].level, "not_localized", after.why))
    if after.localized and not before.localized:
        return elsewhere(replace(state, place=after), now_ns)
    return replace(state, place=after)


def _peers_m(state: State, now_ns: int) -> NDArray[np.float64]:
    """(k, 2) [m]: where peers of our fleet, and so in our map, say that they are."""
    fresh_ns = state.config.planning.peer_stale_s * 1e9
    at = [
        (peer.frame.x_cm / 100, peer.frame.y_cm / 100)
        for peer in state.fleet.peers
        if peer is not None
        and peer.agrees
        and peer.frame.flags & FLAG_LOCALIZED
        and now_ns - peer.stamp_ns <= fresh_ns
    ]
    return np.array(at).reshape(-1, 2)


def _record(place: Localizer, at_ns: int, masked_count: int) -> Localized:
    x_m, y_m, yaw_rad = compose(place.map_from_odom, place.odom)
    unknown = place.estimate is None
    covariance = np.zeros(9) if place.estimate is None else place.estimate.stated.ravel()
    fit = place.fit
    return Localized(
        at_ns,
        place.phase,
        *((0.0, 0.0, 0.0) if unknown else (x_m, y_m, yaw_rad)),
        fit.score,
        covariance,
        fit.on_walls,
        fit.through_walls,
        fit.unexplained,
        masked_count,
    )
