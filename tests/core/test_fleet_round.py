"""The end of a round, driven by hand: silence, request, confirmation, conflict, service."""

from __future__ import annotations

import numpy as np
import pytest
from fleet_seat import (
    ROUND,
    M,
    air_claim,
    claimed_slot,
    of,
    ready,
    requesting,
    seat,
    serve,
    tag_of,
)

from hippomat_core.fleet.holding import is_confirmed_at
from hippomat_core.messages import (
    ClaimChanged,
    ConflictSeen,
    PeerClaimSeen,
    RoundDecided,
    TaskTurned,
)
from hippomat_core.wire.frames import (
    ASSIGNED,
    BLOCKED,
    CLAIMED,
    DONE,
    FLAG_LOCALIZED,
    FLAG_STOPPED,
    LOST,
    SERVING,
    UNREACHABLE,
    WAITING,
)


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
    assert frame.heard == 0, "the radio knows when it sends"
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
