"""What happens when time passes: notice faults, end the round when it is due, drive.

Twenty times a second. Knows the state only; lengths are configured, ages are differences of stamps.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from hippomat_core.allocation.quantise import quantise, saturated
from hippomat_core.control.follower import Motion
from hippomat_core.control.guard import carried_along, guard
from hippomat_core.control.nav_state import STANDING
from hippomat_core.control.navigator import navigate
from hippomat_core.fleet.inputs import Intent, OwnInputs
from hippomat_core.fleet.rounds import end_round
from hippomat_core.messages import (
    BASE,
    LIDAR,
    RADIO,
    WARNING,
    AlarmCleared,
    AlarmRaised,
    Drive,
    Effect,
    PathPlanned,
    PoseEstimated,
    SendState,
    SendTasks,
    Tick,
)
from hippomat_core.planning.distance_field import distance_at
from hippomat_core.planning.ground import Ground
from hippomat_core.planning.reservations import PeerMotion, encode_intent, peer_motion
from hippomat_core.reactions import BY_CODE, Permissions, permissions
from hippomat_core.state import NO_POINTS, State
from hippomat_core.wire.frames import (
    FLAG_GUARD,
    FLAG_LOCALIZED,
    FLAG_SATURATED,
    FLAG_STOPPED,
    IDLE,
    INACTIVE,
    LOST,
)

STARTUP_NS = 4_000_000_000  # devices come up one after the other: no alarm before
RADIO_SILENT_NS = 3_000_000_000  # its status comes once a second
BASE_SILENT_NS = 1_000_000_000  # its feedback comes every 40 ms; without it the pose stands still

Stepped = tuple[State, tuple[Effect, ...]]


def tick(state: State, event: Tick) -> Stepped:
    """One control step: at most one round end, exactly one drive command while there is a base."""
    now_ns = event.stamp_ns
    effects: list[Effect] = []
    state = _with_faults(state, now_ns, effects)
    allowed = permissions(dict(state.faults), now_ns)
    if not state.observes and state.ground is not None and state.fleet.round_due(now_ns):
        state = _round(state, state.ground, now_ns, allowed, effects)
    if not state.observes and state.ports[BASE]:
        state = _drive(state, now_ns, allowed, effects)
        odometry = state.odometry
        effects.append(PoseEstimated(*state.pose, odometry.v_mps, odometry.wz_radps, "odometry"))
    return state, tuple(effects)


# ---- faults -------------------------------------------------------------------------------------


def _with_faults(state: State, now_ns: int, effects: list[Effect]) -> State:
    """Faults keep the stamp they began at; alarms are raised and cleared as faults come and go."""
    if state.observes:
        return state
    since = dict(state.faults)
    faults = tuple((code, since.get(code, now_ns)) for code in _faults(state, now_ns))
    quiet = now_ns - state.started_ns < STARTUP_NS
    codes = frozenset(code for code, _ in faults)
    raised = frozenset() if quiet else codes - state.alarms
    cleared = frozenset(BY_CODE) & state.alarms - codes
    effects += [AlarmRaised(BY_CODE[code].level, code, BY_CODE[code].text) for code in sorted(raised)]
    effects += [AlarmCleared(code) for code in sorted(cleared)]
    return replace(state, faults=faults, alarms=(state.alarms | raised) - cleared)


def _faults(state: State, now_ns: int) -> list[str]:
    config, odometry = state.config, state.odometry
    base_silent = odometry.last is None or now_ns - odometry.stamp_ns > BASE_SILENT_NS
    scan_ns = None if state.scan is None else now_ns - state.scan.stamp_ns
    holds = {
        "no_map": state.ground is None,
        "base_lost": not state.ports[BASE] or base_silent,
        "lidar_lost": not state.ports[LIDAR] or scan_ns is None or scan_ns > config.lidar.timeout_s * 1e9,
        "not_localized": not config.robot.start_known,
        "radio_lost": not state.ports[RADIO] or now_ns - state.radio_heard_ns > RADIO_SILENT_NS,
        "stop": state.stop.latched,
    }
    return [code for code, held in holds.items() if held]


# ---- the allocation round -----------------------------------------------------------------------


def _round(state: State, ground: Ground, now_ns: int, allowed: Permissions, effects: list[Effect]) -> State:
    state = _with_fields(state, ground)
    costs_s = _travel_costs_s(state, ground)
    over = bool(saturated(costs_s, ground.c_max_s).any())
    state = _saturation_alarm(state, over, ground.c_max_s, effects)
    own = _own_inputs(state, quantise(costs_s, ground.c_max_s), over, allowed)
    fleet, outcome = end_round(state.fleet, now_ns, own)
    effects += outcome.effects
    if outcome.state_frame is not None:
        effects.append(SendState(outcome.state_frame))
    effects += [SendTasks(frame) for frame in outcome.tasks_frames]
    return replace(state, fleet=fleet)


def _with_fields(state: State, ground: Ground) -> State:
    """A distance field for every open task and for the destination of our claim."""
    tasks, claim = state.fleet.tasks, state.fleet.own_claim
    positions_m = tasks.positions_m()
    wanted = {
        (slot, int(tasks.generations[slot])): (float(positions_m[slot, 0]), float(positions_m[slot, 1]))
        for slot in np.flatnonzero(tasks.states != INACTIVE).tolist()
    }
    if claim is not None:
        wanted[claim.id.task] = claim.destination_m[:2]
    return replace(state, fields=state.fields.with_tasks(ground, wanted))


def _travel_costs_s(state: State, ground: Ground) -> NDArray[np.float64]:
    """(M,) [s] from here to every open task at our speed; inf where unreachable or not open."""
    tasks, odometry = state.fleet.tasks, state.odometry
    costs_s = np.full(len(tasks.generations), math.inf)
    for slot, generation in enumerate(tasks.generations.tolist()):
        field = state.fields.by_task.get((slot, generation))
        if field is not None:
            way_m = distance_at(ground.costmap, field, odometry.x_m, odometry.y_m)
            costs_s[slot] = way_m / state.config.limits.speed_mps
    return costs_s


def _saturation_alarm(state: State, over: bool, c_max_s: float, effects: list[Effect]) -> State:
    if over == ("saturated" in state.alarms):
        return state
    if not over:
        effects.append(AlarmCleared("saturated"))
        return replace(state, alarms=state.alarms - {"saturated"})
    text = f"a travel cost exceeds c_max = {c_max_s:.1f} s and is sent as c_max: raise [fleet] c_max_s"
    effects.append(AlarmRaised(WARNING, "saturated", text))
    return replace(state, alarms=state.alarms | {"saturated"})


def _own_inputs(state: State, costs_q: NDArray[np.uint8], over: bool, allowed: Permissions) -> OwnInputs:
    x_m, y_m, yaw_rad = state.pose
    codes = {code for code, _ in state.faults}
    localized = "not_localized" not in codes
    flags = (
        FLAG_STOPPED * state.stop.latched
        | FLAG_LOCALIZED * localized
        | FLAG_GUARD * state.held
        | FLAG_SATURATED * over
    )
    outcome = state.outcome
    way_m = 0.0 if outcome is None else outcome.remaining_m
    return OwnInputs(
        costs_q=costs_q,
        can_request=allowed.may_request,
        why_not=allowed.why_not,
        arrived=outcome is not None and outcome.arrived,
        may_serve=allowed.may_serve,
        drop_claim=allowed.drop_claim,
        x_cm=_centimetres(x_m),
        y_cm=_centimetres(y_m),
        yaw_256=round(yaw_rad / math.tau * 256) % 256,
        speed_2cmps=min(round(abs(state.odometry.v_mps) * 50), 255),
        eta_s=min(way_m / state.config.limits.speed_mps, 6553.5),
        status=IDLE if localized else LOST,
        flags=flags,
        intent=_intent(state),
        stop_counter=state.stop.counter,
    )


def _centimetres(length_m: float) -> int:
    return min(max(round(length_m * 100), -32768), 32767)


def _intent(state: State) -> Intent:
    if state.outcome is not None:
        ix, iy, steps = encode_intent(state.outcome.intent)
        return Intent(ix, iy, 0, steps)
    if state.ground is None:
        return Intent()
    grid = state.ground.costmap.grid
    ix, iy = grid.cell_of(state.odometry.x_m, state.odometry.y_m)
    return Intent(min(max(ix, 0), grid.width - 1), min(max(iy, 0), grid.height - 1))


# ---- motion -------------------------------------------------------------------------------------


def _drive(state: State, now_ns: int, allowed: Permissions, effects: list[Effect]) -> State:
    if not allowed.may_move or state.ground is None:
        standing = replace(state.navigator, drive=STANDING, stamp_ns=now_ns)
        code = next((code for code, _ in state.faults if BY_CODE[code].stops), "no_map")
        effects.append(Drive(0.0, 0.0, f"stop:{code}"))
        return replace(state, navigator=standing, outcome=None, held=False)
    odometry, claim = state.odometry, state.fleet.own_claim
    motion = Motion(*state.pose, odometry.v_mps, odometry.wz_radps)
    peers = peers_in_the_way(state, now_ns)
    navigator, outcome = navigate(
        state.navigator,
        now_ns,
        motion,
        None if claim is None else claim.destination_m[:2],
        peers,
        state.ground.costmap,
        None if claim is None else state.fields.by_task.get(claim.id.task),
        state.config,
        state.held,
    )
    if outcome.path is not None:
        ix, iy = (np.ascontiguousarray(axis) for axis in outcome.path.cells.astype(np.uint16).T)
        epoch, path = state.ground.epoch, outcome.path
        effects.append(PathPlanned(epoch, ix, iy, path.length_m, path.cause))
    safe = guard(_seen(state), outcome.v_mps, outcome.wz_radps, _discs(state, peers), state.config)
    effects.append(Drive(safe.v_mps, safe.wz_radps, "guard" if safe.limited else outcome.reason))
    return replace(state, navigator=navigator, outcome=outcome, held=safe.limited)


def peers_in_the_way(state: State, now_ns: int) -> list[PeerMotion]:
    """Every peer that knows where it is, of whatever digest; the others are left to the scan."""
    return [
        peer_motion(peer.robot, peer.frame, (now_ns - peer.stamp_ns) / 1e9)
        for peer in state.fleet.peers
        if peer is not None and peer.frame.flags & FLAG_LOCALIZED
    ]


def _seen(state: State) -> NDArray[np.float64]:
    """The latest scan, moved along with the robot."""
    scan = state.scan
    return NO_POINTS if scan is None else carried_along(scan.points, scan.pose, state.pose)


def _discs(state: State, peers: list[PeerMotion]) -> NDArray[np.float64]:
    """(k, 3) fresh peers in the base frame: x, y, radius [m]. Older ones are left to the scan."""
    fresh = [peer for peer in peers if peer.age_s <= state.config.planning.peer_stale_s]
    at = np.array([[peer.x_m, peer.y_m] for peer in fresh]).reshape(-1, 2)
    xy = carried_along(at, (0.0, 0.0, 0.0), state.pose)
    return np.column_stack([xy, np.full(len(xy), state.config.robot.radius_m)])
