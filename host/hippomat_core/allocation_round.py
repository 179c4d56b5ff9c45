"""The end of an allocation round, seen from the robot: what every task costs from here, and what goes to the
radio at once.

A round ends when the radio says so (RoundEnded), or at a tick where the radio is silent. What is decided then
is in fleet/rounds.py.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import NDArray

from hippomat_core.allocation.quantise import quantise, saturated
from hippomat_core.faults import with_faults
from hippomat_core.fleet.claims import OwnClaim
from hippomat_core.fleet.inputs import Intent, Outlook, OwnInputs
from hippomat_core.fleet.progress import held_up_s, observed
from hippomat_core.fleet.rounds import end_round, ended_alone, radio_ended
from hippomat_core.messages import (
    WARNING,
    AlarmCleared,
    AlarmRaised,
    Effect,
    RoundEnded,
    SendState,
    SendTasks,
)
from hippomat_core.planning.distance_field import distance_at, distances_at
from hippomat_core.planning.ground import Ground
from hippomat_core.planning.reservations import encode_intent
from hippomat_core.reactions import Permissions, permissions
from hippomat_core.replaced import replace
from hippomat_core.state import State
from hippomat_core.wire.frames import (
    FLAG_GUARD,
    FLAG_LOCALIZED,
    FLAG_SATURATED,
    FLAG_STOPPED,
    IDLE,
    LOST,
)

STRANGER_NS = 3_000_000_000  # a peer unheard for longer has no say in who is right

Stepped = tuple[State, tuple[Effect, ...]]


def round_ended(state: State, event: RoundEnded) -> Stepped:
    """The radio observed a round: it ends for us too, unless that is no news."""
    now_ns = event.stamp_ns
    fleet, ends = radio_ended(state.fleet, event)
    effects: list[Effect] = []
    if fleet.clock.steps != state.fleet.clock.steps:
        text = "the clocks of robot and radio have stepped apart: listening anew before anything is requested"
        effects.append(AlarmRaised(WARNING, "clock_step", text))
    state = replace(state, fleet=fleet)
    if not ends or state.observes or state.ground is None:
        return state, tuple(effects)
    state = with_faults(state, now_ns, effects)
    state = _round(state, state.ground, now_ns, permissions(dict(state.faults), now_ns), effects)
    return state, tuple(effects)


def round_without_radio(state: State, now_ns: int, allowed: Permissions, effects: list[Effect]) -> State:
    """The round ends by our own count, if that is due."""
    if state.observes or state.ground is None or not state.fleet.clock.due(now_ns):
        return state
    state = replace(state, fleet=ended_alone(state.fleet, now_ns))
    return _round(state, state.ground, now_ns, allowed, effects)


def _round(
    state: State, ground: Ground | None, now_ns: int, allowed: Permissions, effects: list[Effect]
) -> State:
    assert ground is not None
    state = _with_progress(_with_fields(state, ground), ground, now_ns)
    over, costs_here = False, partial(_costs_here, state, ground)
    if state.fleet.own_claim is None:  # with a claim they are asked for only if it ends now
        costs_s = _travel_costs_s(state, ground, state.pose[:2])
        over = bool(saturated(costs_s, ground.c_max_s).any())
        costs_here = partial(quantise, costs_s, ground.c_max_s)
    state = _saturation_alarm(state, over, ground.c_max_s, effects)
    own = _own_inputs(state, ground, now_ns, costs_here, over, allowed)
    fleet, outcome = end_round(state.fleet, now_ns, own)
    effects += outcome.effects
    if outcome.state_frame is not None:
        effects.append(SendState(outcome.state_frame))
    effects += [SendTasks(frame) for frame in outcome.tasks_frames]
    return replace(state, fleet=fleet, gives_up=False)


def _with_fields(state: State, ground: Ground) -> State:
    """A distance field for every open task and for the destination of our claim."""
    tasks, claim = state.fleet.tasks, state.fleet.own_claim
    held = state.fields.by_task
    if held.keys() >= tasks.open_keys and (claim is None or claim.id.task in held):
        return state
    positions_m, grid = tasks.positions_m(), ground.costmap.grid
    goals = {task: grid.cell_of(*positions_m[task[0], :2].tolist()) for task in sorted(tasks.open_keys)}
    if claim is not None:
        goals[claim.id.task] = grid.cell_of(*claim.destination_m[:2])
    return replace(state, fields=state.fields.with_goals(ground.costmap.graph, goals, grid.resolution_m))


def _travel_costs_s(state: State, ground: Ground, place_m: tuple[float, float]) -> NDArray[np.float64]:
    """(M,) [s] from a place (x, y) to every open task at our speed; inf where unreachable or not open."""
    held = [state.fields.by_task.get(task) for task in state.fleet.tasks.keys]
    ways_m = distances_at(ground.costmap, [field for field in held if field is not None], *place_m)
    known_s = ways_m / state.config.limits.speed_mps
    if len(known_s) == len(held):
        return known_s
    costs_s = np.full(len(held), math.inf)
    costs_s[[field is not None for field in held]] = known_s
    return costs_s


def _costs_here(state: State, ground: Ground) -> NDArray[np.uint8]:
    """(M,) their codes, for our row."""
    return quantise(_travel_costs_s(state, ground, state.pose[:2]), ground.c_max_s)


def _with_progress(state: State, ground: Ground, now_ns: int) -> State:
    """What this round adds to it."""
    claim = state.fleet.own_claim
    if claim is None:
        return replace(state, progress=None)
    free_s = _eta_s(state, ground, claim) + claim.dwell_left_s(now_ns, state.config.fleet.dwell_s)
    return replace(state, progress=observed(state.progress, claim, free_s, now_ns))


def _outlook(state: State, ground: Ground, now_ns: int, claim: OwnClaim) -> Outlook:
    """When and where we shall be free with this claim: the way there, its service, the ways from there.

    While we are held up, the same hold-up is expected to last as long again.
    """
    eta_s, late_s = _eta_s(state, ground, claim), held_up_s(state.progress, claim, now_ns)
    free_s = eta_s + late_s + claim.dwell_left_s(now_ns, state.config.fleet.dwell_s)
    costs_s = free_s + _travel_costs_s(state, ground, claim.destination_m[:2])
    return Outlook(eta_s + late_s if eta_s > 0.0 else 0.0, quantise(costs_s, ground.c_max_s))


def _eta_s(state: State, ground: Ground, claim: OwnClaim) -> float:
    """Until we are there: along the path that we drive, by the distance field where there is none yet."""
    navigator, outcome = state.navigator, state.outcome
    speed_mps = state.config.limits.speed_mps
    if outcome is not None and navigator.destination == claim.destination_m[:2]:
        return outcome.remaining_m / speed_mps
    field = state.fields.by_task.get(claim.id.task)
    return math.inf if field is None else distance_at(ground.costmap, field, *state.pose[:2]) / speed_mps


def _saturation_alarm(state: State, over: bool, c_max_s: float, effects: list[Effect]) -> State:
    """For the row of a free robot; one that holds a claim may be free later than c_max without harm."""
    if state.fleet.own_claim is not None or over == ("saturated" in state.alarms):
        return state
    if not over:
        effects.append(AlarmCleared("saturated"))
        return replace(state, alarms=state.alarms - {"saturated"})
    text = f"a travel cost exceeds c_max = {c_max_s:.1f} s and is sent as c_max: raise [fleet] c_max_s"
    effects.append(AlarmRaised(WARNING, "saturated", text))
    return replace(state, alarms=state.alarms | {"saturated"})


def _own_inputs(
    state: State,
    ground: Ground,
    now_ns: int,
    costs_here: Callable[[], NDArray[np.uint8]],
    over: bool,
    allowed: Permissions,
) -> OwnInputs:
    x_m, y_m, yaw_rad = state.pose
    codes = {code for code, _ in state.faults}
    localized = "not_localized" not in codes
    flags = (
        FLAG_STOPPED * state.stop.latched
        | FLAG_LOCALIZED * localized
        | FLAG_GUARD * state.held
        | FLAG_SATURATED * over
    )
    outcome, stranger = state.outcome, _is_stranger(state, now_ns)
    return OwnInputs(
        costs_here=costs_here,
        c_max_s=ground.c_max_s,
        outlook=partial(_outlook, state, ground, now_ns),
        can_request=allowed.may_request and not stranger,
        why_not=allowed.why_not or ("another digest than the fleet" if stranger else ""),
        arrived=outcome is not None and outcome.arrived,
        may_serve=allowed.may_serve,
        drop_claim=allowed.drop_claim or ("stuck" if state.gives_up else ""),
        shun_s=state.config.recovery.shun_s if state.gives_up else 0.0,
        x_cm=_centimetres(x_m),
        y_cm=_centimetres(y_m),
        yaw_256=round(yaw_rad / math.tau * 256) % 256,
        speed_2cmps=min(round(abs(state.velocity[0]) * 50), 255),
        status=IDLE if localized else LOST,
        flags=flags,
        intent=_intent(state),
        stop_counter=state.stop.counter,
    )


def _is_stranger(state: State, now_ns: int) -> bool:
    """True where at least as many robots have another map or other settings as share ours.

    Such a robot would get no majority for a claim, but would drive for it in a frame that may not be theirs.
    """
    alive = [
        peer.agrees
        for peer in state.fleet.peers
        if peer is not None and now_ns - peer.stamp_ns <= STRANGER_NS
    ]
    differ = alive.count(False)
    return differ > 0 and differ >= 1 + alive.count(True)


def _centimetres(length_m: float) -> int:
    return min(max(round(length_m * 100), -32768), 32767)


def _intent(state: State) -> Intent:
    if state.outcome is not None:
        ix, iy, steps = encode_intent(state.outcome.intent)
        return Intent(ix, iy, 0, steps)
    if state.ground is None:
        return Intent()
    grid = state.ground.costmap.grid
    ix, iy = grid.cell_of(*state.pose[:2])
    return Intent(min(max(ix, 0), grid.width - 1), min(max(iy, 0), grid.height - 1))
