"""One robot's view of the fleet, driven by hand: rows heard, round ends, alarms, the row that it sends."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest

from hippomat_core.config import Config, FleetConfig, RobotConfig
from hippomat_core.fleet.digest import fleet_digest
from hippomat_core.fleet.holding import is_confirmed_at
from hippomat_core.fleet.inputs import Intent, OwnInputs
from hippomat_core.fleet.rounds import RoundOutcome, end_round
from hippomat_core.fleet.sites import task_sites
from hippomat_core.fleet.state import (
    FleetState,
    heard_relay,
    heard_state,
    heard_tasks,
    initial,
    started,
    with_map,
)
from hippomat_core.messages import (
    AlarmCleared,
    AlarmRaised,
    ClaimChanged,
    ConflictSeen,
    Effect,
    PeerClaimSeen,
    RoundDecided,
    TaskTurned,
)
from hippomat_core.wire.codec import decode_frame, encode_frame
from hippomat_core.wire.frames import (
    ASSIGNED,
    BLOCKED,
    CLAIMED,
    DONE,
    FLAG_LOCALIZED,
    FLAG_STOPPED,
    IDLE,
    LOST,
    NO_CLAIM,
    RELAY,
    SERVING,
    STATE,
    TASKS,
    UNREACHABLE,
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
        header = Header(STATE, 1, robot, boot, self.sequence if sequence is None else sequence, 0)
        self.fleet, effects = heard_state(self.fleet, self.now_ns, header, frame, -40 - robot)
        return effects

    def hear_tasks(self, robot: int, *slots: TaskSlot) -> list[Effect]:
        header = Header(TASKS, 1, robot, 1, 0, 0)
        self.fleet, effects = heard_tasks(self.fleet, self.now_ns, header, TasksFrame(slots))
        return effects

    def round(self, costs: object = (10, 20, 30, 40), **own: object) -> RoundOutcome:
        self.now_ns += ROUND // 2
        inputs = OwnInputs(np.asarray(costs, np.uint8), **{"can_request": True, **own})  # type: ignore[arg-type]
        self.fleet, outcome = end_round(self.fleet, self.now_ns, inputs)
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


def seat(size: int = 3, robot: int = 0, mapped: bool = True, **fleet: object) -> Seat:
    settings = FleetConfig(size=size, task_slots=M, **fleet)  # type: ignore[arg-type]
    state = started(initial(Config(fleet=settings, robot=RobotConfig(id=robot))), 0)
    if mapped:
        state, _ = with_map(state, 0, SITES, DIGEST)
    return Seat(state)


def ready(size: int = 3, *peers: int, **fleet: object) -> Seat:
    """A seat after its silence, at the moment before its first request."""
    taken = seat(size, **fleet)
    outcomes = taken.rounds(3.5, *(peers or range(1, size)))
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


# ---- the round ----------------------------------------------------------------------------------


def test_a_robot_is_silent_after_its_start_and_says_so():
    taken = seat()
    outcomes = taken.rounds(3.4, 1, 2)
    frames = [outcome.state_frame for outcome in outcomes]
    assert all(frame is not None and frame.status == BLOCKED for frame in frames)
    reasons = {decided.reason for outcome in outcomes for decided in of(RoundDecided, outcome.effects)}
    assert reasons == {"listening after the start"}


def test_a_robot_just_started_votes_for_nobody():
    taken = seat()
    for _ in range(29):
        taken.hear(1, taken.row(air_claim(2)))
        frame = taken.round().state_frame
        assert frame is not None
        assert not frame.endorsed.any()
    taken.rounds(0.2)
    taken.hear(1, taken.row(air_claim(2)))
    frame = taken.round().state_frame
    assert frame is not None
    assert frame.endorsed.tolist() == [0, 1, 0]


def test_a_robot_listens_longer_while_its_peers_know_other_generations():
    taken = seat()
    for _ in range(40):
        for robot in (1, 2):
            taken.hear(robot, taken.row(generations_digest=1))
        assert not taken.round().has_claim
    taken.rounds(0.3, 1, 2)
    assert taken.fleet.own_claim is not None


def test_the_request_is_decided_on_the_row_that_was_broadcast():
    taken = ready()
    taken.hear(1, taken.row())
    taken.hear(2, taken.row())
    outcome = taken.round(costs=(250, 1, 250, 250))
    frame = outcome.state_frame
    assert frame is not None
    assert (frame.claim.slot, frame.claim.cost) == (0, 10)
    assert frame.status == ASSIGNED
    assert frame.costs.tolist() == [250, 1, 250, 250]
    assert frame.task_states.tolist() == [CLAIMED, WAITING, WAITING, WAITING]
    assert frame.endorsed.tolist() == [frame.claim.tag, 0, 0]
    assert frame.heard == 0b110
    assert outcome.destination == tuple(taken.fleet.tasks.positions_m()[0])
    assert [change.what for change in of(ClaimChanged, outcome.effects)] == ["requested"]


def test_the_decision_records_the_rows_it_used():
    taken = ready(3, 1)
    taken.hear(1, taken.row(costs=np.array([1, 2, 3, 4], np.uint8)), boot=7, sequence=4242)
    (decided,) = of(RoundDecided, taken.round().effects)
    assert decided.row_sequence.tolist() == [0, 4242, 0]
    assert decided.row_boot.tolist() == [0, 7, 0]
    assert decided.row_age_ms.tolist() == [100, 50, 65535]
    assert decided.row_rssi_dbm.tolist() == [0, -41, 0]
    assert decided.row_available.tolist()[1:] == [1, 0]
    assert decided.costs.reshape(3, M).tolist() == [[10, 20, 30, 40], [1, 2, 3, 4], [UNREACHABLE] * 4]


@pytest.mark.parametrize(
    "change",
    [
        {"flags": FLAG_LOCALIZED | FLAG_STOPPED},
        {"flags": 0},
        {"status": BLOCKED},
        {"status": LOST},
        {"claim": air_claim(3), "status": ASSIGNED},
    ],
)
def test_a_peer_that_cannot_take_a_task_is_not_allocated_one(change):
    taken = ready()
    taken.hear(1, taken.row(**{"costs": np.zeros(M, np.uint8), **change}))
    (decided,) = of(RoundDecided, taken.round().effects)
    assert decided.row_available[1] == 0


def test_a_robot_that_cannot_request_says_why_and_shows_as_blocked():
    taken = ready()
    outcome = taken.rounds(0.2, 1, 2, can_request=False, why_not="lidar lost")[-1]
    assert of(RoundDecided, outcome.effects)[0].reason == "lidar lost"
    assert outcome.state_frame is not None
    assert outcome.state_frame.status == BLOCKED


def test_a_claim_is_confirmed_by_a_majority_and_lapses_with_its_lease():
    taken, outcome = requesting()
    assert not outcome.confirmed
    taken.hear(1, taken.row(endorsed=tag_of(outcome)))
    outcome = taken.round()
    assert outcome.confirmed
    assert outcome.state_frame is not None
    assert outcome.state_frame.claim.confirmed
    heard_ns = taken.now_ns - ROUND
    assert is_confirmed_at(taken.fleet, heard_ns + 3 * ROUND)
    assert not is_confirmed_at(taken.fleet, heard_ns + 3 * ROUND + 1)
    later = [taken.round() for _ in range(3)]
    assert [step.confirmed for step in later] == [True, True, False]
    assert of(ClaimChanged, later[-1].effects)[0].what == "unconfirmed"


def test_votes_that_quote_another_tag_or_come_from_another_fleet_count_for_nothing():
    taken, outcome = requesting()
    taken.hear(1, taken.row(endorsed=tag_of(outcome) % 3 + 1))
    taken.hear(2, taken.row(endorsed=tag_of(outcome), fleet_digest=1))
    assert not taken.round().confirmed


def test_what_was_read_after_a_hold_up_neither_votes_nor_is_voted_for():
    taken, outcome = requesting()
    taken.now_ns += 2 * 10**9  # the process was stopped; its serial port kept what came meanwhile
    taken.hear(1, taken.row(endorsed=tag_of(outcome)))
    taken.hear(2, taken.row(air_claim(3), endorsed=tag_of(outcome)))
    outcome = taken.round()
    assert not outcome.confirmed
    assert outcome.state_frame is not None
    assert outcome.state_frame.endorsed.tolist()[1:] == [0, 0]
    taken.hear(1, taken.row(endorsed=tag_of(outcome)))
    taken.now_ns += ROUND // 2
    taken.hear(1, taken.row(endorsed=tag_of(outcome)))
    assert taken.round().confirmed


def test_the_inferior_claim_is_dropped_with_the_cause():
    taken, outcome = requesting()
    slot = claimed_slot(taken)
    news = taken.hear(1, taken.row(air_claim(slot, cost=1)))
    assert [seen.what for seen in of(PeerClaimSeen, news)] == ["requested"]
    outcome = taken.round()
    (conflict,) = of(ConflictSeen, outcome.effects)
    assert (conflict.other, conflict.kept, conflict.cause) == (1, False, "staleness")
    assert of(ClaimChanged, outcome.effects)[0].cause == "conflict: staleness"
    assert not outcome.has_claim
    assert outcome.state_frame is not None
    assert outcome.state_frame.endorsed.tolist() == [0, 1, 0], "and we vote for the superior one"


def test_the_superior_claim_stays_and_the_conflict_is_told_once():
    taken, _ = requesting()
    slot = claimed_slot(taken)
    seen = []
    for _ in range(3):
        taken.hear(1, taken.row(air_claim(slot, cost=99)))
        seen += of(ConflictSeen, taken.round().effects)
    assert [conflict.kept for conflict in seen] == [True]


def test_the_callers_reason_drops_the_claim_and_its_tag_rests():
    taken, outcome = requesting()
    dropped = taken.round(drop_claim="base lost", can_request=False)
    assert of(ClaimChanged, dropped.effects)[0].cause == "base lost"
    assert dropped.destination is None
    again = taken.rounds(0.3, 1, 2)[-1]
    assert again.has_claim
    assert tag_of(again) != tag_of(outcome)


def serve(taken: Seat, outcome: RoundOutcome, **own: object) -> list[RoundOutcome]:
    outcomes = []
    for _ in range(10):
        taken.hear(1, taken.row(endorsed=tag_of(outcome)))
        outcomes.append(taken.round(**{"arrived": True, **own}))
    return outcomes


def test_a_task_is_completed_after_the_dwell_and_its_slot_turns():
    taken, outcome = requesting(turnover="on_completion", dwell_s=0.3)
    slot = claimed_slot(taken)
    effects = [effect for step in serve(taken, outcome) for effect in step.effects]
    assert [change.what for change in of(ClaimChanged, effects)][:2] == ["confirmed", "completed"]
    (turned,) = [turn for turn in of(TaskTurned, effects) if turn.slot == slot]
    assert (turned.generation, turned.cause) == (1, "completed")


def test_serving_is_told_interrupted_and_begun_again():
    taken, outcome = requesting(turnover="on_completion", dwell_s=0.3)
    taken.hear(1, taken.row(endorsed=tag_of(outcome)))
    serving = taken.round(arrived=True)
    assert serving.state_frame is not None
    assert serving.state_frame.status == SERVING
    for arrived in (True, False, True, True, True):
        taken.hear(1, taken.row(endorsed=tag_of(outcome)))
        assert taken.round(arrived=arrived).has_claim
    taken.hear(1, taken.row(endorsed=tag_of(outcome)))
    assert not taken.round(arrived=True).has_claim


def test_an_unconfirmed_robot_waits_at_the_task():
    taken, _ = requesting(turnover="on_completion")
    outcomes = [taken.round(arrived=True) for _ in range(20)]
    assert all(outcome.has_claim for outcome in outcomes)


def test_on_claim_the_slot_turns_when_the_claim_is_confirmed_and_the_destination_stays():
    taken, outcome = requesting(turnover="on_claim")
    slot = claimed_slot(taken)
    steps = serve(taken, outcome, arrived=False)
    turns = [turn for step in steps for turn in of(TaskTurned, step.effects)]
    assert [(turn.slot, turn.generation, turn.cause) for turn in turns] == [(slot, 1, "claimed")]
    assert {step.destination for step in steps} == {outcome.destination}
    first = next(step for step in steps if of(TaskTurned, step.effects))
    assert first.state_frame is not None
    assert first.state_frame.costs[slot] == UNREACHABLE, "the new task has no price yet"
    assert first.state_frame.task_states[slot] == WAITING
    assert len(first.tasks_frames) == 1


def test_a_fixed_slot_is_done_after_its_service():
    taken, outcome = requesting(turnover="never")
    slot = claimed_slot(taken)
    serve(taken, outcome)
    assert taken.fleet.tasks.states[slot] == DONE
    assert taken.fleet.tasks.generations[slot] == 1


def test_a_lone_robot_needs_nobody_and_two_serve_alone_when_one_is_gone():
    alone, outcome = requesting(1)
    assert alone.round().confirmed
    pair, outcome = requesting(2, 1)
    assert not pair.rounds(1.0, 1)[-1].confirmed, "the other is heard and does not vote"
    assert not pair.rounds(2.5)[-1].confirmed
    assert pair.rounds(1.0)[-1].confirmed, "unheard for three seconds"
    assert outcome.has_claim


def test_with_policy_wait_a_minority_never_serves():
    pair, _ = requesting(2, 1, partition="wait")
    assert not any(outcome.confirmed for outcome in pair.rounds(6.0))


def test_a_claim_that_a_hearing_majority_refuses_is_let_go_and_its_task_left_to_others():
    taken, _ = requesting()
    slot = claimed_slot(taken)
    outcomes = taken.rounds(6.5, 1, 2)
    causes = [change.cause for outcome in outcomes for change in of(ClaimChanged, outcome.effects)]
    assert "refused" in causes
    frame = outcomes[-1].state_frame
    assert frame is not None
    assert frame.costs[slot] == UNREACHABLE


# ---- peers --------------------------------------------------------------------------------------


def test_a_dead_peers_claim_expires_and_its_task_waits_again():
    taken = ready()
    taken.hear(1, taken.row(air_claim(0, confirmed=True)))
    assert taken.rounds(0.1, 2)[-1].state_frame.task_states[0] == CLAIMED  # type: ignore[union-attr]
    outcomes = taken.rounds(3.0, 2, can_request=False)
    seen = [event for outcome in outcomes for event in of(PeerClaimSeen, outcome.effects)]
    assert [(event.robot, event.slot, event.what) for event in seen] == [(1, 0, "expired")]
    assert outcomes[-1].state_frame.task_states[0] == WAITING  # type: ignore[union-attr]


def test_a_peers_claim_is_followed_through_its_life():
    taken = ready()
    told = taken.hear(1, taken.row(air_claim(0)))
    told += taken.hear(1, taken.row(air_claim(0, confirmed=True)))
    told += taken.hear(1, taken.row(air_claim(0, confirmed=True)))
    told += taken.hear(1, taken.row(air_claim(2, tag=2)))
    told += taken.hear(1, taken.row())
    assert [event.what for event in of(PeerClaimSeen, told)] == [
        "requested",
        "confirmed",
        "gone",
        "requested",
        "gone",
    ]


def test_an_older_row_never_replaces_a_newer_one():
    taken = seat()
    taken.hear(1, taken.row(x_cm=1), sequence=10)
    for late in (10, 9):
        assert taken.hear(1, taken.row(x_cm=2), sequence=late) == []
    assert taken.fleet.peers[1].frame.x_cm == 1  # type: ignore[union-attr]
    taken.hear(1, taken.row(x_cm=3), boot=2, sequence=1)
    assert taken.fleet.peers[1].frame.x_cm == 3  # type: ignore[union-attr]
    assert of(AlarmRaised, taken.hear(1, taken.row(x_cm=4), boot=1, sequence=11))[0].code == "peer_duplicate"
    assert taken.fleet.peers[1].frame.x_cm == 3  # type: ignore[union-attr]


def test_sequence_numbers_run_round():
    taken = seat()
    taken.hear(1, taken.row(x_cm=1), sequence=2**24 - 1)
    taken.hear(1, taken.row(x_cm=2), sequence=0)
    assert taken.fleet.peers[1].frame.x_cm == 2  # type: ignore[union-attr]


def test_a_peer_of_another_fleet_digest_is_named_once_and_left_out_until_it_agrees():
    taken = ready()
    (alarm,) = taken.hear(1, taken.row(air_claim(0), fleet_digest=0x1234))
    assert isinstance(alarm, AlarmRaised)
    assert alarm.code == "peer_digest"
    assert all(part in alarm.text for part in ("robot 1", "00001234", "robot 0", "0000abcd"))
    assert taken.hear(1, taken.row(air_claim(0), fleet_digest=0x1234)) == []
    outcome = taken.round()
    assert of(RoundDecided, outcome.effects)[0].row_available[1] == 0
    assert outcome.state_frame is not None
    assert outcome.state_frame.endorsed.tolist()[1] == 0
    assert taken.hear(1, taken.row())[0] == AlarmCleared("peer_digest")


def test_a_row_of_other_sizes_is_of_another_fleet_whatever_its_digest():
    taken = seat()
    alarms = taken.hear(1, taken.row(costs=np.zeros(9, np.uint8), task_states=np.zeros(9, np.uint8)))
    assert [alarm.code for alarm in of(AlarmRaised, alarms)] == ["peer_digest"]
    assert taken.round().state_frame is not None


def test_another_radio_with_our_id_makes_us_passive():
    taken, _ = requesting()
    (alarm,) = taken.hear(0, taken.row())
    assert isinstance(alarm, AlarmRaised)
    assert alarm.code == "duplicate_id"
    outcome = taken.round()
    assert outcome.state_frame is None
    assert not outcome.has_claim
    assert of(ClaimChanged, outcome.effects)[0].cause == "duplicate id"
    assert taken.hear(0, taken.row()) == []


def test_a_robot_outside_the_roster_is_named_once():
    taken = seat()
    alarms = taken.hear(9, taken.row()) + taken.hear(9, taken.row())
    assert [alarm.code for alarm in of(AlarmRaised, alarms)] == ["unknown_robot"]


def test_a_relayed_row_is_a_sign_of_life():
    taken = ready()
    taken.hear(1, taken.row(air_claim(0)))
    row = RelayRow(1, 2, 1, 0, 0, 5, False, 1, 0, 0, 0, 0, 0, np.zeros(M, np.uint8))
    outcomes = []
    for _ in range(40):
        taken.hear(2, taken.row())
        header = Header(RELAY, 1, 2, 1, taken.sequence, 0)
        taken.fleet, _ = heard_relay(taken.fleet, taken.now_ns, header, RelayFrame((row,)))
        outcomes.append(taken.round(can_request=False))
    assert not [event for outcome in outcomes for event in of(PeerClaimSeen, outcome.effects)]
    assert outcomes[-1].state_frame is not None
    assert outcomes[-1].state_frame.endorsed.tolist() == [0, 1, 0]


def test_an_observer_follows_the_fleet_and_says_nothing():
    observer = seat(robot=-1, mapped=False)
    observer.hear(1, observer.row())
    outcome = observer.round()
    assert outcome.state_frame is None
    assert outcome.tasks_frames == ()
    assert of(RoundDecided, outcome.effects)[0].reason == "observing"
    assert [peer is not None for peer in observer.fleet.peers].count(True) == 1


def test_without_a_map_a_robot_sends_nothing_and_accuses_nobody():
    taken = seat(mapped=False)
    assert taken.hear(1, taken.row()) == []
    outcome = taken.round()
    assert outcome.state_frame is None
    assert of(RoundDecided, outcome.effects)[0].reason == "no map"


def test_a_new_map_drops_the_claim_and_begins_anew():
    taken, _ = requesting()
    taken.fleet, effects = with_map(taken.fleet, taken.now_ns, SITES, 77)
    assert [change.cause for change in of(ClaimChanged, effects)] == ["map changed"]
    assert len(of(TaskTurned, effects)) == M
    assert not taken.round().has_claim


def test_rows_from_before_a_new_map_count_for_nothing_until_their_senders_agree_on_it():
    taken, outcome = requesting()
    taken.hear(1, taken.row(air_claim(3), endorsed=tag_of(outcome)))
    taken.fleet, effects = with_map(taken.fleet, taken.now_ns, SITES, 77)
    assert [gone.what for gone in of(PeerClaimSeen, effects)] == ["gone"]
    assert taken.fleet.alive_peers(taken.now_ns) == []
    assert taken.fleet.peers[1].claim is None
    decided = of(RoundDecided, taken.round().effects)[0]
    assert not decided.row_available[1:].any()
    (alarm,) = of(AlarmRaised, taken.hear(1, taken.row()))
    assert alarm.code == "peer_digest"
    taken.hear(2, taken.row(fleet_digest=77))
    assert [peer.robot for peer in taken.fleet.alive_peers(taken.now_ns)] == [2]


def test_what_was_refused_on_the_last_map_is_not_refused_on_a_new_one():
    taken = seat()
    taken.fleet = replace(taken.fleet, shunned=((0, 0, 10**12),))
    taken.fleet, _ = with_map(taken.fleet, taken.now_ns, SITES, 77)
    assert taken.fleet.shunned == ()


def test_a_peer_that_changes_its_claim_in_every_row_does_not_fill_the_memory():
    taken, _ = requesting()
    slot = claimed_slot(taken)
    for number in range(40):
        taken.hear(1, taken.row(replace(air_claim(slot, cost=99), round=number)))
        taken.round()
    assert len(taken.fleet.own_claim.opposed) == 1


def test_a_stale_claim_read_during_a_hold_up_gets_no_vote_when_the_hold_up_is_over():
    taken = ready()
    taken.now_ns += 2 * 10**9
    taken.hear(2, taken.row(air_claim(3)))
    taken.now_ns += ROUND // 2
    outcome = taken.round()
    assert outcome.state_frame.endorsed[2] == 0
    taken.hear(2, taken.row(air_claim(3)))
    assert taken.round().state_frame.endorsed[2] == 1


def test_costs_for_another_number_of_tasks_are_refused():
    with pytest.raises(ValueError, match="needed"):
        seat().round(costs=(1, 2, 3))


def test_rounds_are_due_once_each():
    taken = seat()
    assert taken.fleet.round_due(0)
    taken.now_ns = -ROUND // 2
    taken.round()
    assert not taken.fleet.round_due(ROUND - 1)
    assert taken.fleet.round_due(ROUND)


def test_the_largest_fleet_fits_the_frame():
    settings = FleetConfig(size=64, task_slots=80, round_s=0.2)
    fleet = started(initial(Config(fleet=settings, robot=RobotConfig(id=63))), 0)
    sites = task_sites(np.ones((160, 160), np.bool_), 0.05, 0.0, 0.0, 0.12)
    fleet, _ = with_map(fleet, 0, sites, DIGEST)
    intent = Intent(1, 2, 0, np.full(12, 14, np.uint8))
    own = OwnInputs(np.zeros(80, np.uint8), can_request=True, intent=intent, eta_s=1e9)
    fleet, outcome = end_round(fleet, 1, own)
    assert outcome.state_frame is not None
    header = Header(STATE, 1, 63, 1, 1, 0)
    _, decoded = decode_frame(encode_frame(header, outcome.state_frame))
    assert repr(decoded) == repr(outcome.state_frame)


# ---- tasks on the air ---------------------------------------------------------------------------


def test_newer_generations_are_learnt_from_tasks_and_from_claims():
    taken = ready()
    (turned,) = taken.hear_tasks(1, TaskSlot(2, 5, WAITING, 1, 2, 0), TaskSlot(60, 9, WAITING, 0, 0, 0))
    assert (turned.slot, turned.generation, turned.cause) == (2, 5, "heard")  # type: ignore[union-attr]
    assert taken.hear_tasks(1, TaskSlot(2, 4, WAITING, 1, 2, 0)) == []
    news = taken.hear(1, taken.row(air_claim(3, generation=2)))
    assert [(turn.slot, turn.generation) for turn in of(TaskTurned, news)] == [(3, 2)]
    assert taken.fleet.tasks.generations.tolist() == [0, 0, 5, 2]


def test_tasks_of_strangers_are_not_believed():
    taken = ready()
    assert taken.hear_tasks(60, TaskSlot(2, 5, WAITING, 1, 2, 0)) == []
    taken.hear(1, taken.row(fleet_digest=1))
    assert taken.hear_tasks(1, TaskSlot(2, 5, WAITING, 1, 2, 0)) == []


def test_a_newer_generation_supersedes_our_unconfirmed_claim():
    taken, _ = requesting()
    slot = claimed_slot(taken)
    taken.hear_tasks(1, TaskSlot(slot, 1, WAITING, 1, 2, 0))
    outcome = taken.round()
    assert of(ClaimChanged, outcome.effects)[0].cause == "superseded"


def test_a_differing_digest_is_answered_with_tasks_in_turn_and_an_equal_one_is_not():
    taken = ready(3, 1, 2)
    assert all(outcome.tasks_frames == () for outcome in taken.rounds(0.5, 1, 2))
    answers = []
    for _ in range(5):
        taken.hear(1, taken.row(generations_digest=99))
        answers.append(len(taken.round().tasks_frames))
    assert answers == [1] * 5


def test_orders_open_slots_and_end_with_their_service():
    taken = ready(task_source="orders", turnover="on_completion")
    assert not any(outcome.has_claim for outcome in taken.rounds(1.0, 1, 2))
    taken.hear_tasks(255, TaskSlot(1, 1, WAITING, 123, -45, 0))
    outcome = taken.rounds(0.4, 1, 2)[-1]
    assert outcome.destination == (1.23, -0.45, 0.0)
    serve(taken, outcome)
    assert taken.fleet.tasks.slot(1) == TaskSlot(1, 2, DONE, 123, -45, 0)


def test_every_setting_of_the_fleet_enters_its_digest_but_not_the_path_of_the_policy():
    base = FleetConfig()
    first = fleet_digest(base, 20.0, b"map")
    others = [
        fleet_digest(replace(base, task_slots=13), 20.0, b"map"),
        fleet_digest(replace(base, seed=2), 20.0, b"map"),
        fleet_digest(replace(base, turnover="never"), 20.0, b"map"),
        fleet_digest(base, 20.1, b"map"),
        fleet_digest(base, 20.0, b"other map"),
        fleet_digest(base, 20.0, b"map", b"weights"),
    ]
    assert len({first, *others}) == 7
    assert fleet_digest(replace(base, policy="elsewhere.safetensors"), 20.0, b"map") == first
    assert fleet_digest(replace(base, c_max_s=3.0), 20.0, b"map") == first, "the c_max in use counts"
