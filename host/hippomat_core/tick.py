"""What happens when time passes: notice faults, end the round if the radio does not, drive.

Twenty times a second. Knows the state only; lengths are configured, ages are differences of stamps.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from hippomat_core.allocation_round import Stepped, round_without_radio
from hippomat_core.control.follower import Motion
from hippomat_core.control.guard import Lateness, carried_along, carrying, guard
from hippomat_core.control.nav_state import STANDING, NavOutcome
from hippomat_core.control.navigator import forget_path, navigate
from hippomat_core.control.recovery import DRIVE
from hippomat_core.control.together import Together
from hippomat_core.faults import with_faults
from hippomat_core.fleet.peers import Peer, Placed
from hippomat_core.localization import on_tick
from hippomat_core.messages import BASE, Drive, Effect, GuardLimited, PathPlanned, PoseEstimated, Tick
from hippomat_core.motion.commitment import may_start
from hippomat_core.planning.reservations import PeerMotion, body_only, peer_motion
from hippomat_core.reactions import BY_CODE, Permissions, permissions
from hippomat_core.replaced import replace
from hippomat_core.state import NO_POINTS, State, elsewhere
from hippomat_core.unsticking import unstuck, unworried

ALONE_S = 3.0  # of silence since the start: there is nobody who has to hear of us first
HEARD_ROUNDS = 3  # as long may what a peer says it heard of us be a STATE from before we were placed
LOST_NS = 60_000_000_000  # a peer that is lost for longer may have been carried anywhere


def tick(state: State, event: Tick) -> Stepped:
    """One control step: at most one round end, exactly one drive command while there is a base."""
    now_ns = event.stamp_ns
    effects: list[Effect] = []
    state = on_tick(state, now_ns, effects)
    state = with_faults(state, now_ns, effects)
    allowed = permissions(dict(state.faults), now_ns)
    state = round_without_radio(state, now_ns, allowed, effects)
    if not state.observes and state.ports[BASE]:
        state = _drive(state, now_ns, allowed, effects)
        effects.append(PoseEstimated(*state.pose, *state.velocity, state.pose_source))
    if any(code == "not_localized" for code, _ in state.faults):
        state = elsewhere(state, now_ns)
    return state, tuple(effects)


# ---- motion -------------------------------------------------------------------------------------


def _drive(state: State, now_ns: int, allowed: Permissions, effects: list[Effect]) -> State:
    if not allowed.may_move or state.ground is None:
        standing = replace(state.navigator, drive=STANDING, stamp_ns=now_ns)
        code = next((code for code, _ in state.faults if BY_CODE[code].stops), "no_map")
        effects.append(Drive(0.0, 0.0, f"stop:{code}"))
        state = unworried(state, now_ns, effects)
        return replace(state, navigator=standing, outcome=None, held=False)
    claim = state.fleet.own_claim
    motion = Motion(*state.pose, *state.velocity)
    peers = peers_in_the_way(state, now_ns)
    together = _together(state, now_ns)
    navigator = state.navigator
    if together is not None and state.outcome is None:  # nothing of it was broadcast: nothing is committed
        navigator = forget_path(navigator)
    navigator, outcome = navigate(
        navigator,
        now_ns,
        motion,
        None if claim is None else claim.destination_m[:2],
        peers,
        state.ground.costmap,
        None if claim is None else state.fields.by_task.get(claim.id.task),
        state.config,
        state.held and state.recovery.step == DRIVE,
        together,
    )
    if outcome.path is not None:
        ix, iy = (np.ascontiguousarray(axis) for axis in outcome.path.cells.astype(np.uint16).T)
        epoch, path = state.ground.epoch, outcome.path
        effects.append(PathPlanned(epoch, ix, iy, path.length_m, path.cause))
    state, navigator, outcome = unstuck(state, now_ns, motion, peers, navigator, outcome, effects)
    return _guarded(replace(state, navigator=navigator, outcome=outcome), now_ns, peers, outcome, effects)


def _guarded(
    state: State, now_ns: int, peers: list[PeerMotion], outcome: NavOutcome, effects: list[Effect]
) -> State:
    """Command what the guard lets through; the next command starts from that."""
    scan, navigator = state.scan, state.navigator
    late = Lateness(
        scan_s=0.0 if scan is None else max(now_ns - scan.stamp_ns, 0) / 1e9,
        odometry_s=max(now_ns - state.moved_ns, 0) / 1e9,
        v_mps=state.velocity[0],
    )
    wanted_v, wanted_wz = outcome.v_mps, outcome.wz_radps
    whole = scan is not None and scan.whole
    safe = guard(_seen(state), wanted_v, wanted_wz, _discs(state, peers), state.config, late, whole)
    effects.append(Drive(safe.v_mps, safe.wz_radps, "guard" if safe.limited else outcome.reason))
    if safe.limited:
        seen = (safe.nearest_m, safe.free_m, safe.stop_m, late.scan_s)
        effects.append(GuardLimited(wanted_v, wanted_wz, *seen))
        drive = replace(navigator.drive, v_mps=safe.v_mps, wz_radps=safe.wz_radps)
        navigator = replace(navigator, drive=drive)
    return replace(state, navigator=navigator, held=safe.limited)


def _together(state: State, now_ns: int) -> Together | None:
    """Where the fleet plans its moves together: what round it is, and whether the others know of us."""
    if state.ground is None or state.ground.lattice is None:
        return None
    claim = state.fleet.own_claim
    claim_round = 0 if claim is None else claim.on_air(0.0).round
    return Together(state.ground.lattice, state.fleet.clock.round, claim_round, heard_of_us(state, now_ns))


def heard_of_us(state: State, now_ns: int) -> bool:
    """Whether all peers that we hear have heard of us where we are now; after a silence, we are alone."""
    me, fresh_ns = state.config.robot.id, int(state.config.planning.peer_stale_s * 1e9)
    known_ns = state.placed_ns + HEARD_ROUNDS * state.fleet.timing.round_ns
    heard_by = [
        bool(peer.frame.heard >> me & 1) and peer.stamp_ns > known_ns
        for peer in state.fleet.peers
        if peer is not None and now_ns - peer.stamp_ns <= fresh_ns
    ]
    alone_s = (now_ns - max(state.started_ns, state.placed_ns)) / 1e9
    return may_start(heard_by, alone_s, ALONE_S)


def peers_in_the_way(state: State, now_ns: int) -> list[PeerMotion]:
    """Every peer that knows, or lately knew, where it is; the others are left to the scan.

    One that is lost stands where it was: it counts as one that has been silent since.
    """
    return [
        _motion(state, peer, placed, now_ns)
        for peer in state.fleet.peers
        if peer is not None
        and (placed := peer.placed) is not None
        and (placed.frame is peer.frame or now_ns - placed.stamp_ns <= LOST_NS)
    ]


def _motion(state: State, peer: Peer, placed: Placed, now_ns: int) -> PeerMotion:
    """Of a robot with another map or other settings nothing counts but its body."""
    agreed = peer.agrees and placed.frame.fleet_digest == state.fleet.digest
    motion = replace(_told(peer.robot, placed), age_s=(now_ns - placed.stamp_ns) / 1e9)
    return motion if agreed or state.ground is None else body_only(motion, state.ground.costmap.grid)


@lru_cache(maxsize=4096)  # of 64 robots in one process; asked for at every tick, new at every second one
def _told(robot: int, placed: Placed) -> PeerMotion:
    """What a STATE said of its robot's motion when it was heard."""
    return peer_motion(robot, placed.frame, 0.0, placed.round)


def _seen(state: State) -> NDArray[np.float64]:
    """The latest scan, moved along with the robot by its wheels: where in the map it is plays no part."""
    scan = state.scan
    return NO_POINTS if scan is None else carried_along(scan.points, scan.pose, state.steady_pose)


def _discs(state: State, peers: list[PeerMotion]) -> NDArray[np.float64]:
    """(k, 3) fresh peers in the base frame: x, y, radius [m], which grows by what they drove since they told.

    Older ones are left to the scan.
    """
    radius_m, stale_s = state.config.robot.radius_m, state.config.planning.peer_stale_s
    c, s, dx, dy = carrying((0.0, 0.0, 0.0), state.pose)
    discs: list[float] = []
    for p in peers:
        if p.age_s <= stale_s:
            discs += c * p.x_m - s * p.y_m + dx, s * p.x_m + c * p.y_m + dy, radius_m + p.speed_mps * p.age_s
    return np.array(discs, np.float64).reshape(-1, 3)
