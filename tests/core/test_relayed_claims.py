"""Claims that others pass on: what they may do to votes and to our own claim, and what they may not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from fleet_seat import (
    air_claim,
    claimed_slot,
    of,
    ready,
    relayed,
    requesting,
    seat,
    tag_of,
)

from hippomat_core.fleet.votes import DORMANT, GIVEN, UNKNOWN_ROUND, Vote, after_row, claim_of
from hippomat_core.messages import ClaimChanged, ConflictSeen, RoundDecided, TaskTurned
from hippomat_core.wire.frames import BLOCKED, CLAIMED, UNREACHABLE, WAITING

ONLY_SLOT_0 = (1, UNREACHABLE, UNREACHABLE, UNREACHABLE)


def decided(outcome):
    (made,) = of(RoundDecided, outcome.effects)
    return made


def vote_on(taken, robot):
    return [vote for vote in taken.fleet.votes if vote.claim.robot == robot]


def test_a_claim_heard_through_others_only_earns_our_vote():
    taken = ready(3, 1)
    taken.hear(1, taken.row())
    taken.relay(1, relayed(2, air_claim(3, tag=2)))
    frame = taken.round(can_request=False).state_frame
    assert frame.endorsed.tolist() == [0, 0, 2]
    assert frame.task_states[3] == CLAIMED


def test_a_vote_for_a_claim_heard_through_others_is_the_vote_for_the_same_claim_heard_directly():
    taken = ready(3, 1)
    taken.relay(1, relayed(2, air_claim(3, tag=2)))
    taken.round(can_request=False)
    (vote,) = vote_on(taken, 2)
    assert vote.claim.round == UNKNOWN_ROUND
    taken.hear(2, taken.row(air_claim(3, tag=2)))
    (vote,) = vote_on(taken, 2)
    assert (vote.phase, vote.claim.round) == (GIVEN, 3)
    assert taken.round(can_request=False).state_frame.endorsed.tolist() == [0, 0, 2]


def test_rows_passed_on_keep_a_vote_but_never_release_it():
    taken = ready(3, 1, 2)
    taken.hear(1, taken.row())
    taken.hear(2, taken.row(air_claim(3, tag=2)))
    taken.round(can_request=False)
    for _ in range(20):
        taken.hear(1, taken.row())
        told = taken.relay(1, relayed(2))
        frame = taken.round(can_request=False).state_frame
        assert frame.endorsed.tolist() == [0, 0, 2], "another's word releases no vote"
        assert frame.task_states[3] == WAITING, "though nobody seems to claim it any more"
    assert told == []
    taken.hear(2, taken.row())
    assert taken.round(can_request=False).state_frame.endorsed.tolist() == [0, 0, 0]


def test_a_vote_lives_as_long_as_the_claim_is_passed_on():
    taken = ready(3, 1)
    for _ in range(40):
        taken.hear(1, taken.row())
        taken.relay(1, relayed(2, air_claim(3, tag=2)))
        frame = taken.round(can_request=False).state_frame
    assert frame.endorsed.tolist() == [0, 0, 2]
    frames = [outcome.state_frame for outcome in taken.rounds(3.2, 1, can_request=False)]
    assert frames[25].endorsed.tolist() == [0, 0, 2]
    assert frames[-1].endorsed.tolist() == [0, 0, 0]


def test_we_do_not_claim_where_a_vote_earned_through_others_binds_us():
    taken = ready(3, 1)
    taken.round(costs=ONLY_SLOT_0, can_request=False)
    taken.hear(1, taken.row())
    taken.relay(1, relayed(2, air_claim(0)))
    taken.round(costs=ONLY_SLOT_0)
    for _ in range(5):  # the claim seems to be gone, but the vote is not released
        taken.hear(1, taken.row(status=BLOCKED))
        taken.relay(1, relayed(2, status=BLOCKED))
        outcome = taken.round(costs=ONLY_SLOT_0)
        assert decided(outcome).reason == "endorses another claim there"


def test_no_vote_is_read_out_of_a_row_passed_on():
    taken, outcome = requesting(3, 1)
    for _ in range(5):
        taken.hear(1, taken.row())
        taken.relay(1, relayed(2))
        outcome = taken.round()
    assert not outcome.confirmed
    taken.hear(1, taken.row(endorsed=tag_of(outcome)))
    assert taken.round().confirmed


def test_a_better_claim_heard_through_others_wins_and_the_conflict_has_a_cause():
    taken, _ = requesting(3, 1)
    slot = claimed_slot(taken)
    taken.hear(1, taken.row())
    taken.relay(1, relayed(2, air_claim(slot, cost=0)))
    outcome = taken.round()
    (conflict,) = of(ConflictSeen, outcome.effects)
    assert (conflict.other, conflict.kept, conflict.cause) == (2, False, "loss")
    assert of(ClaimChanged, outcome.effects)[0].what == "dropped"


@pytest.mark.parametrize(("passed_on", "cause"), [(False, "loss"), (True, "staleness")])
def test_a_conflict_with_a_robot_whose_row_was_passed_on_is_not_loss(passed_on, cause):
    taken = ready(3, 1)
    taken.hear(1, taken.row())
    if passed_on:
        taken.relay(1, relayed(2))
    assert taken.round().has_claim
    taken.hear(2, taken.row(air_claim(claimed_slot(taken), cost=0)))
    (conflict,) = of(ConflictSeen, taken.round().effects)
    assert conflict.cause == cause


def test_a_claim_passed_on_proves_its_generation():
    taken = ready(3, 1)
    told = taken.relay(1, relayed(2, air_claim(1, generation=4)))
    (turned,) = of(TaskTurned, told)
    assert (turned.slot, turned.generation, turned.cause) == (1, 4, "heard")
    made = decided(taken.round(can_request=False))
    assert made.generations.tolist() == [0, 4, 0, 0]
    assert made.task_states[1] == CLAIMED


def test_a_slot_that_turned_is_allocated_only_when_rows_price_it_whoever_passed_them_on():
    taken = ready(3, 1)
    taken.round(can_request=False)
    taken.round(costs=ONLY_SLOT_0)
    taken.hear_tasks(1, replace(taken.fleet.tasks.slot(0), generation=1))
    reasons = []
    for _ in range(3):
        taken.hear(1, taken.row())
        taken.relay(1, relayed(2, status=BLOCKED))
        reasons.append(decided(taken.round(costs=ONLY_SLOT_0)).reason)
    assert reasons == ["no task for this robot"] * 2 + ["requested"]


def test_a_vote_that_outlived_its_owner_is_revived_for_that_claim_and_not_for_a_later_one_like_it():
    claim = claim_of(1, air_claim(0))
    asleep = (Vote(claim, DORMANT, 0),)
    turned = np.array([1, 0, 0, 0], np.uint16)
    timing = seat().fleet.timing
    later = replace(claim, round=claim.round + 1)
    assert later == claim
    assert after_row(asleep, 1, later, True, turned, 1, timing) == ()
    assert after_row(asleep, 1, claim, True, turned, 1, timing)[0].phase == GIVEN
    passed_on = (Vote(replace(claim, round=UNKNOWN_ROUND), DORMANT, 0),)
    assert after_row(passed_on, 1, claim, True, turned, 1, timing)[0].phase == GIVEN


def test_the_smallest_key_gets_the_vote_whoever_told_of_it():
    taken = ready(4, 1, 3)
    taken.hear(1, taken.row(air_claim(2, cost=9)))
    taken.relay(1, relayed(2, air_claim(2, cost=8, tag=3)))
    assert taken.round(can_request=False).state_frame.endorsed.tolist() == [0, 0, 3, 0]
