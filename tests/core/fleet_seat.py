"""One robot of a fleet driven by hand: rows heard, round ends. For tests of the fleet's state."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from hippomat_core.config import Config, FleetConfig, RobotConfig
from hippomat_core.fleet.hearing import heard_relay, heard_state, heard_tasks
from hippomat_core.fleet.inputs import OwnInputs
from hippomat_core.fleet.rounds import RoundOutcome, end_round, ended_alone
from hippomat_core.fleet.sites import task_sites
from hippomat_core.fleet.state import FleetState, initial, started, with_map
from hippomat_core.messages import (
    Effect,
)
from hippomat_core.wire.frames import (
    ASSIGNED,
    FLAG_LOCALIZED,
    IDLE,
    NO_CLAIM,
    RELAY,
    STATE,
    TASKS,
    WAITING,
    AirClaim,
    Header,
    RelayFrame,
    RelayRow,
    StateFrame,
    TasksFrame,
    TaskSlot,
)

SITES = task_sites(np.ones((60, 60), np.bool_), 0.05, 0.0, 0.0, 0.12)
DIGEST = 0xABCD
ROUND = 100_000_000
M = 4


@dataclass
class Seat:
    """Robot 0 of a fleet, its clock and the sequence numbers of the peers played by the test."""

    fleet: FleetState
    now_ns: int = 0
    sequence: int = 0

    def hear(self, robot: int, frame: StateFrame, boot: int = 1, sequence: int | None = None) -> list[Effect]:
        self.sequence += 1
        number = self.sequence if sequence is None else sequence
        header = Header(STATE, False, 1, robot, boot, number, self.now_ns // 1000)
        self.fleet, effects = heard_state(self.fleet, self.now_ns, header, frame, -40 - robot)
        return effects

    def relay(self, via: int, *rows: RelayRow, age_ns: int = 0, **header: object) -> list[Effect]:
        """Robot `via` passes rows on, in the round that we are in; age_ns: how long ago it sent that."""
        self.sequence += 1
        fleet_us = (self.now_ns - age_ns) // 1000
        told = Header(RELAY, False, 1, via, 1, self.sequence, fleet_us)
        frame = RelayFrame(len(self.fleet.peers), 0, rows)
        told = replace(told, **header)  # type: ignore[arg-type]
        self.fleet, effects = heard_relay(self.fleet, self.now_ns, told, frame, -70 - via)
        return effects

    def hear_tasks(self, robot: int, *slots: TaskSlot) -> list[Effect]:
        header = Header(TASKS, False, 1, robot, 1, 0, 0)
        self.fleet, effects = heard_tasks(self.fleet, self.now_ns, header, TasksFrame(slots))
        return effects

    def round(self, costs: object = (10, 20, 30, 40), **own: object) -> RoundOutcome:
        self.now_ns += ROUND // 2
        row = np.asarray(costs, np.uint8)
        inputs = OwnInputs(lambda: row, **{"can_request": True, **own})  # type: ignore[arg-type]
        self.fleet, outcome = end_round(ended_alone(self.fleet, self.now_ns), self.now_ns, inputs)
        self.now_ns += ROUND // 2
        return outcome

    def rounds(self, seconds: float, *peers: int, **own: object) -> list[RoundOutcome]:
        outcomes = []
        for _ in range(round(seconds * 10)):
            for robot in peers:
                self.hear(robot, self.row())
            outcomes.append(self.round(**own))
        return outcomes

    def row(self, claim: AirClaim = NO_CLAIM, endorsed: int = 0, **others: object) -> StateFrame:
        """A peer's row that agrees with us; endorsed: the tag it quotes for us."""
        frame = StateFrame(
            status=IDLE if claim is NO_CLAIM else ASSIGNED,
            flags=FLAG_LOCALIZED,
            x_cm=100,
            y_cm=-50,
            z_cm=0,
            yaw_256=64,
            speed_2cmps=10,
            claim=claim,
            costs=np.full(M, 200, np.uint8),
            task_states=np.full(M, WAITING, np.uint8),
            intent_ix=5,
            intent_iy=6,
            intent_iz=0,
            intent_steps=np.array([14, 16], np.uint8),
            heard=0,
            endorsed=np.eye(1, len(self.fleet.peers), 0, dtype=np.uint8)[0] * np.uint8(endorsed),
            fleet_digest=DIGEST,
            generations_digest=self.fleet.tasks.digest,
            stop_counter=0,
        )
        return replace(frame, **others)  # type: ignore[arg-type]


def relayed(robot: int, claim: AirClaim = NO_CLAIM, **others: object) -> RelayRow:
    """A row of `robot` as RELAY carries it: free and idle unless it claims."""
    row = RelayRow(
        robot=robot,
        age=0,
        status=IDLE if claim is NO_CLAIM else ASSIGNED,
        slot=claim.slot,
        generation=claim.generation,
        cost=claim.cost,
        confirmed=claim.confirmed,
        tag=claim.tag,
        localized=True,
        stopped=False,
        x_cm=claim.x_cm,
        y_cm=claim.y_cm,
        z_cm=claim.z_cm,
        eta_s=claim.eta_ds // 10,
        costs=np.full(M, 100, np.uint8),
    )
    return replace(row, **others)  # type: ignore[arg-type]


def seat(size: int = 3, robot: int = 0, mapped: bool = True, **fleet: object) -> Seat:
    chosen = {"allocator": "hungarian", **fleet}
    settings = FleetConfig(size=size, task_slots=M, **chosen)  # type: ignore[arg-type]
    state = started(initial(Config(fleet=settings, robot=RobotConfig(id=robot))), 0)
    if mapped:
        state, _ = with_map(state, 0, SITES, DIGEST)
    return Seat(state)


def ready(size: int = 3, *peers: int, **fleet: object) -> Seat:
    """A seat after its silence, at the moment before its first request."""
    taken = seat(size, **fleet)
    outcomes = taken.rounds(3.6, *(peers or range(1, size)))
    assert not any(outcome.has_claim for outcome in outcomes)
    return taken


def requesting(size: int = 3, *peers: int, **fleet: object) -> tuple[Seat, RoundOutcome]:
    taken = ready(size, *peers, **fleet)
    outcomes = taken.rounds(0.2, *(peers or range(1, size)))
    assert outcomes[-1].has_claim
    return taken, outcomes[-1]


def air_claim(
    slot: int, cost: int = 5, generation: int = 0, tag: int = 1, confirmed: bool = False
) -> AirClaim:
    return AirClaim(slot, generation, cost, 3, confirmed, tag, 50, 60, 0, 12)


def of(kind: type, effects: object) -> list:
    return [effect for effect in effects if isinstance(effect, kind)]


def claimed_slot(taken: Seat) -> int:
    assert taken.fleet.own_claim is not None
    return taken.fleet.own_claim.id.slot


def tag_of(outcome: RoundOutcome) -> int:
    assert outcome.state_frame is not None
    return outcome.state_frame.claim.tag


def serve(taken: Seat, outcome: RoundOutcome, **own: object) -> list[RoundOutcome]:
    outcomes = []
    for _ in range(10):
        taken.hear(1, taken.row(endorsed=tag_of(outcome)))
        outcomes.append(taken.round(**{"arrived": True, **own}))
    return outcomes
