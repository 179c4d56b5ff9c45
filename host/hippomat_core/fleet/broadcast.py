"""What we say at the end of a round: the STATE frame, and TASKS where somebody's generations differ.

Decides what goes on the air and how often; knows no bytes.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hippomat_core.fleet import votes as rule_f
from hippomat_core.fleet.claims import free_tag
from hippomat_core.fleet.inputs import Outlook, OwnInputs
from hippomat_core.fleet.snapshot import task_states
from hippomat_core.fleet.state import FleetState
from hippomat_core.wire.frames import (
    ASSIGNED,
    BLOCKED,
    IDLE,
    NO_CLAIM,
    SERVING,
    UNREACHABLE,
    StateFrame,
    TasksFrame,
)

_URGENT_ROUNDS = 3  # whoever turned a slot says so in this many rounds
_TALKERS = 5  # of the others, about so many answer a differing digest in one round


def state_frame(fleet: FleetState, stamp_ns: int, own: OwnInputs, priced: NDArray[np.uint16]) -> StateFrame:
    """Our STATE. priced: (M,) generations that own's costs are for; slots turned since cost 'unreachable'."""
    claim = fleet.own_claim
    outlook = Outlook(0.0, own.costs_here()) if claim is None else own.outlook_of(claim)
    if outlook.costs_q.shape != priced.shape:
        raise ValueError(f"costs for {outlook.costs_q.shape} tasks, {priced.shape} needed")
    costs = np.where(priced == fleet.tasks.generations, outlook.costs_q, UNREACHABLE).astype(np.uint8)
    for slot, generation, _ in fleet.shunned:
        if fleet.tasks.generations[slot] == generation:
            costs[slot] = UNREACHABLE
    trusted = stamp_ns >= fleet.trusted_from_ns
    own_id = claim.id if claim is not None else None
    return StateFrame(
        status=_status(fleet, stamp_ns, own),
        flags=own.flags,
        x_cm=own.x_cm,
        y_cm=own.y_cm,
        z_cm=own.z_cm,
        yaw_256=own.yaw_256,
        speed_2cmps=own.speed_2cmps,
        claim=claim.on_air(outlook.eta_s) if claim is not None else NO_CLAIM,
        costs=_frozen(costs),
        task_states=task_states(fleet),
        intent_ix=own.intent.ix,
        intent_iy=own.intent.iy,
        intent_iz=own.intent.iz,
        intent_steps=own.intent.steps,
        heard=0,  # the radio knows when it sends
        endorsed=rule_f.quoted_tags(fleet.votes if trusted else (), own_id, len(fleet.peers)),
        fleet_digest=fleet.digest or 0,
        generations_digest=fleet.tasks.digest,
        stop_counter=own.stop_counter,
    )


def _status(fleet: FleetState, stamp_ns: int, own: OwnInputs) -> int:
    """IDLE means: can be given a task at the end of the next round."""
    if fleet.own_claim is not None and own.status == IDLE:
        return SERVING if fleet.own_claim.serving_ns is not None else ASSIGNED
    next_ns = stamp_ns + fleet.timing.round_ns
    listening = (
        not fleet.in_step
        or fleet.silent_from_ns is None
        or next_ns - fleet.silent_from_ns < fleet.timing.tag_reuse_ns
    )
    ready = own.can_request and not listening and free_tag(fleet.tag_free_ns, next_ns) is not None
    return BLOCKED if own.status == IDLE and not ready else own.status


def tasks_frames(fleet: FleetState, stamp_ns: int) -> tuple[TasksFrame, ...]:
    """At most one TASKS frame: at once where we turned a slot, else in turn where a digest differs."""
    if fleet.robot < 0:
        return ()
    round_ns = fleet.timing.round_ns
    urgent = stamp_ns - fleet.self_turned_ns < _URGENT_ROUNDS * round_ns
    alive = fleet.alive_peers(stamp_ns)
    differs = any(peer.frame.generations_digest != fleet.tasks.digest for peer in alive)
    turns = -(-len(alive) // _TALKERS) or 1
    my_turn = (fleet.clock.round + fleet.robot) % turns == 0
    if not alive or not (urgent or (differs and my_turn)):
        return ()
    cursor = fleet.tasks_cursor * 11 % len(fleet.tasks.generations)
    return (fleet.tasks.frame(cursor),)


def _frozen(array: NDArray[np.uint8]) -> NDArray[np.uint8]:
    array.flags.writeable = False
    return array
