"""A robot that is stuck frees itself or gives its task back: the sequence of control/recovery.py, attached.

Translates between the robot's state and that sequence, and tells of it. What is commanded still passes the
guard.
"""

from __future__ import annotations

from collections.abc import Sequence

from hippomat_core.control.follower import Drive, Motion, limited
from hippomat_core.control.nav_state import Navigator, NavOutcome
from hippomat_core.control.navigator import forget_path
from hippomat_core.control.recovery import (
    BACK_UP,
    BLOCKED,
    CLEAR,
    DRIVE,
    FREE,
    GIVE_UP,
    GUARD,
    NO_NEARER,
    SLIPS,
    WAITING,
    WHEELS,
    Order,
    Recovery,
    Symptoms,
    recover,
)
from hippomat_core.messages import WARNING, AlarmCleared, AlarmRaised, Effect, RecoveryChanged
from hippomat_core.planning.reservations import PeerMotion
from hippomat_core.replaced import replace
from hippomat_core.state import State

STUCK = "stuck"
TEXTS = {
    GUARD: "something in sight leaves no way on",
    WAITING: "the robot it waits for does not let it by",
    BLOCKED: "its way is taken, or there is none",
    WHEELS: "commanded to drive, the wheels do not turn",
    SLIPS: "the wheels turn and the robot stays where it is",
    NO_NEARER: "it moves, but comes no nearer to its goal",
}


def unworried(state: State, now_ns: int, effects: list[Effect]) -> State:
    """For a robot that stands on purpose: no time counts."""
    motion = Motion(*state.pose)
    nothing = Symptoms(None, waits=False, held=False, commanded_mps=0.0, remaining_m=0.0)
    recovery, _ = recover(state.recovery, now_ns, motion, nothing, state.config)
    return _told(replace(state, recovery=recovery), state.recovery, motion, effects)


def unstuck(
    state: State,
    now_ns: int,
    motion: Motion,
    peers: Sequence[PeerMotion],
    navigator: Navigator,
    outcome: NavOutcome,
    effects: list[Effect],
) -> tuple[State, Navigator, NavOutcome]:
    """What the robot does if it is stuck; navigator and outcome as they were where it is not.

    state: before this tick's command
    """
    before = state.navigator.drive
    heard = {peer.robot for peer in peers if peer.age_s <= state.config.planning.peer_stale_s}
    seen = Symptoms(
        goal=None if outcome.arrived else navigator.destination,
        waits=navigator.aside or outcome.blocked_by in heard,
        held=state.held,
        commanded_mps=before.v_mps,
        remaining_m=outcome.remaining_m,
        behind=state.scan is not None and state.scan.whole,
    )
    recovery, order = recover(state.recovery, now_ns, motion, seen, state.config)
    state = _told(replace(state, recovery=recovery), state.recovery, motion, effects)
    if not order.step:
        return state, navigator, outcome
    together = state.ground is not None and state.ground.lattice is not None
    if order.began and order.step == CLEAR:  # together, what is committed stays so
        navigator = replace(navigator if together else forget_path(navigator), marks=())
    if together and order.step == BACK_UP:  # the cells behind may have been granted to others
        order = replace(order, v_mps=0.0, wz_radps=0.0)
    if order.began and order.step == GIVE_UP:
        state = replace(state, gives_up=True)
    drive = _commanded(order, before, (now_ns - state.navigator.stamp_ns) / 1e9, state)
    outcome = replace(outcome, v_mps=drive.v_mps, wz_radps=drive.wz_radps, reason=f"recover:{order.step}")
    return state, replace(navigator, drive=drive), outcome


def _commanded(order: Order, before: Drive, dt_s: float, state: State) -> Drive:
    return limited(Drive(order.v_mps, order.wz_radps), before, min(max(dt_s, 0.0), 0.2), state.config.limits)


def _told(state: State, before: Recovery, motion: Motion, effects: list[Effect]) -> State:
    """Every change is recorded; the alarm stands from the first attempt until it is free."""
    now = state.recovery
    place = (motion.x_m, motion.y_m, motion.yaw_rad)
    freed = before.stuck and now.tried == DRIVE
    if now.step != before.step or freed:
        step = FREE if freed else now.step
        effects.append(RecoveryChanged(step, now.cause or before.cause, before.still.stalled_s, *place))
    raised = STUCK in state.alarms
    if now.stuck and not raised:
        effects.append(AlarmRaised(WARNING, STUCK, f"stuck: {TEXTS[now.cause]}; trying to get free"))
        return replace(state, alarms=state.alarms | {STUCK})
    if now.tried == GIVE_UP and before.tried != GIVE_UP:
        text = f"gave the task back: {TEXTS[now.cause]}, and nothing that was tried helped"
        effects.append(AlarmRaised(WARNING, "gave_up", text))
    if not now.stuck and raised:
        effects.append(AlarmCleared(STUCK))
        return replace(state, alarms=state.alarms - {STUCK})
    return state
