"""Rule F by its parts: votes, tags, conflicts. The whole in a lossy air: test_fleet_sim.py."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hippomat_core.config import FleetConfig
from hippomat_core.fleet.claims import (
    Basis,
    OwnClaim,
    conflict_cause,
    free_tag,
    is_superior,
    quorum,
    serves_alone,
    tag_ended,
)
from hippomat_core.fleet.timing import Timing
from hippomat_core.fleet.votes import (
    DORMANT,
    DOUBTFUL,
    FALLOW,
    GIVEN,
    ClaimId,
    Votes,
    after_relay,
    after_row,
    aged,
    bars,
    cast,
    quoted_tags,
)
from hippomat_core.wire.frames import RelayRow

TIMING = Timing.of(FleetConfig())
ROUND = TIMING.round_ns
DEAD = TIMING.dead_ns
OPEN = np.zeros(3, np.uint16)  # every slot at generation 0


def claim(robot: int, slot: int = 0, generation: int = 0, tag: int = 1, cost: int = 10) -> ClaimId:
    return ClaimId(robot, slot, generation, tag, cost, round=7)


def voted(*claims: ClaimId, at_ns: int = 0) -> Votes:
    return heard((), claims, at_ns)


def heard(
    votes: Votes,
    claims: Iterable[ClaimId],
    at_ns: int,
    newest: np.ndarray = OPEN,
    own: ClaimId | None = None,
) -> Votes:
    return cast(votes, [(claim, at_ns) for claim in claims], newest, own)


def row(votes: Votes, robot: int, held: ClaimId | None, at_ns: int, same: bool = True) -> Votes:
    return after_row(votes, robot, held, same, OPEN, at_ns, TIMING)


def age(votes: Votes, at_ns: int, newest: np.ndarray = OPEN, keeps_old: bool = False) -> Votes:
    return aged(votes, newest, keeps_old, at_ns, TIMING)


def quoted(votes: Votes) -> list[int]:
    return quoted_tags(votes, None, 4).tolist()


# ---- voting -------------------------------------------------------------------------------------


def test_within_a_round_the_smallest_cost_and_id_gets_the_vote():
    votes = voted(claim(3, cost=9), claim(2, cost=8), claim(1, cost=8, tag=2))
    assert quoted(votes) == [0, 2, 0, 0]


def test_a_vote_stays_with_the_first_heard_when_a_better_claim_follows():
    votes = heard(voted(claim(3, cost=9)), [claim(1, cost=1)], ROUND)
    assert quoted(votes) == [0, 0, 0, 1]


def test_nobody_votes_where_it_claims_itself_or_for_an_older_or_unknown_generation():
    newest = np.array([0, 2, 0], np.uint16)
    claims = [claim(1, slot=0), claim(2, slot=1, generation=1), claim(3, slot=2, generation=1)]
    assert heard((), claims, 0, newest, own=claim(0, slot=0)) == ()


def test_a_vote_is_released_by_the_owners_newer_row_without_the_claim():
    votes = row(voted(claim(1)), 1, None, ROUND)
    assert votes == ()
    other_claim = row(voted(claim(1)), 1, claim(1, slot=2, tag=2), ROUND)
    assert other_claim == ()


def test_anothers_row_releases_nothing():
    assert row(voted(claim(1)), 2, None, ROUND) == voted(claim(1))


def test_an_owner_who_lets_go_with_other_generations_may_have_completed_the_task():
    votes = row(voted(claim(1)), 1, None, ROUND, same=False)
    assert [vote.phase for vote in votes] == [DOUBTFUL]
    assert quoted(votes) == [0, 0, 0, 0]
    assert bars(votes, (0, 0))
    assert heard(votes, [claim(2)], 2 * ROUND) == votes
    assert row(votes, 1, None, 3 * ROUND, same=True) == ()
    assert age(votes, ROUND + DEAD) == ()
    assert age(votes, 2 * ROUND, np.array([1, 0, 0], np.uint16), keeps_old=True) == ()


def test_a_dead_mans_task_lies_fallow_until_his_last_vote_has_run_out_everywhere():
    votes = age(voted(claim(1)), DEAD)
    assert quoted(votes) == [0, 1, 0, 0]
    votes = age(votes, DEAD + 1)
    assert [vote.phase for vote in votes] == [FALLOW]
    assert quoted(votes) == [0, 0, 0, 0]
    late = DEAD + 1 + TIMING.fallow_ns
    assert heard(age(votes, late - 1), [claim(2)], late - 1)[0].claim.robot == 1
    assert quoted(heard(age(votes, late), [claim(2)], late)) == [0, 0, 1, 0]
    assert TIMING.fallow_ns >= TIMING.lease_ns + TIMING.delay_ns


def test_a_claim_in_service_keeps_its_votes_when_the_slot_has_turned():
    turned = np.array([1, 0, 0], np.uint16)
    assert quoted(age(voted(claim(1)), ROUND, turned, keeps_old=True)) == [0, 1, 0, 0]
    assert age(voted(claim(1)), ROUND, turned, keeps_old=False) == ()


def test_the_vote_for_a_claim_in_service_revives_with_its_owner_and_for_nobody_else():
    turned = np.array([1, 0, 0], np.uint16)
    asleep = age(age(voted(claim(1)), DEAD + 1), DEAD + 2, turned, keeps_old=True)
    assert [vote.phase for vote in asleep] == [DORMANT]
    assert heard(asleep, [claim(2)], DEAD + 3, turned) == asleep
    awake = after_row(asleep, 1, claim(1), True, turned, DEAD + 4, TIMING)
    assert quoted(awake) == [0, 1, 0, 0]
    assert after_row(asleep, 1, None, False, turned, DEAD + 4, TIMING) == ()


def relayed(held: ClaimId) -> RelayRow:
    return RelayRow(
        *(held.robot, 0, 1, held.slot, held.generation, held.cost, False, held.tag),
        *(True, False, 0, 0, 0, 0, OPEN),
    )


def test_a_relayed_row_keeps_a_vote_alive_only_if_it_carries_that_claim():
    votes = voted(claim(1))
    assert after_relay(votes, relayed(claim(1)), DEAD)[0].seen_ns == DEAD
    # the owner lives but has moved on: else its old tag would be quoted for ever
    assert after_relay(votes, relayed(claim(1, slot=2, tag=2)), DEAD) == votes


STEPS = st.lists(
    st.tuples(
        st.integers(1, 20),  # rounds until then
        st.sampled_from(["claims", "lets go", "is silent", "dies"]),
        st.integers(1, 3),  # robot
    ),
    max_size=40,
)


@given(STEPS)
@settings(max_examples=150)
def test_a_voter_changes_its_mind_only_after_a_release_or_a_fallow_time(steps):
    """Law: from one claim's last quote to another's first on one task, the owner let go or time ran out."""
    votes: Votes = ()
    holds: dict[int, ClaimId] = {}
    died: dict[int, ClaimId] = {}
    let_go: set[ClaimId] = set()
    last_quoted: tuple[ClaimId, int] | None = None
    now_ns = 0
    for rounds, what, robot in steps:
        for _ in range(rounds):
            now_ns += ROUND
            if what == "claims":
                holds.setdefault(robot, claim(robot, tag=now_ns // ROUND % 3 + 1, cost=robot))
            elif what == "lets go":
                let_go |= {held.pop(robot) for held in (holds, died) if robot in held}
            elif what == "dies" and robot in holds:
                died[robot] = holds.pop(robot)  # its next row, after a reboot, lets the claim go
            if what in ("claims", "lets go"):
                votes = row(votes, robot, holds.get(robot), now_ns)
            claims = [holds[robot]] if what == "claims" else []
            votes = heard(age(votes, now_ns), claims, now_ns)
            given_to = [vote.claim for vote in votes if vote.phase == GIVEN]
            assert len(given_to) <= 1
            for now_quoted in given_to:
                if last_quoted is not None and now_quoted != last_quoted[0]:
                    waited_ns = now_ns - last_quoted[1]
                    moved_on = now_quoted.robot == last_quoted[0].robot or last_quoted[0] in let_go
                    assert moved_on or waited_ns > TIMING.lease_ns + TIMING.delay_ns
                last_quoted = (now_quoted, now_ns)


# ---- claiming -----------------------------------------------------------------------------------


def own(cost: int = 10, confirmed: bool = False, **basis: object) -> OwnClaim:
    fields: dict[str, object] = {
        "late": np.zeros(4, np.bool_),
        "available": np.ones(4, np.bool_),
        "digests_agree": np.ones(4, np.bool_),
        "allocator": "random",
    }
    return OwnClaim(
        claim(1, cost=cost),
        0,
        0,
        0,
        0,
        Basis(**{**fields, **basis}),
        confirmed=confirmed,  # type: ignore[arg-type]
    )


def test_a_tag_comes_back_only_when_no_voter_can_still_quote_its_last_claim():
    tags, used = (0, 0, 0), []
    for step in range(3):
        tag = free_tag(tags, step)
        assert tag is not None
        used.append(tag)
        tags = tag_ended(tags, tag, step, TIMING)
    assert sorted(used) == [1, 2, 3]
    reuse_ns = DEAD + TIMING.lease_ns + TIMING.delay_ns
    assert free_tag(tags, reuse_ns - 1) is None
    assert free_tag(tags, reuse_ns) == used[0]


def test_a_confirmed_claim_is_superior_and_then_the_smaller_cost_and_id():
    assert is_superior(own(10), claim(2, cost=11), False)
    assert is_superior(own(10), claim(2, cost=10), False)
    assert not is_superior(own(10), claim(0, cost=10), False)
    assert not is_superior(own(10), claim(2, cost=99), True)
    assert is_superior(own(10, confirmed=True), claim(2, cost=1), False)


@pytest.mark.parametrize(
    ("cause", "basis", "cost"),
    [
        ("loss", {"late": np.array([False, False, True, False])}, 9),
        ("loss", {"late": np.array([False, False, True, False])}, 10),
        ("staleness", {"late": np.array([True, False, False, False])}, 9),
        ("staleness", {"digests_agree": np.array([True, True, False, True])}, 9),
        ("staleness", {"allocator": "hungarian"}, 9),
        ("tie", {"allocator": "hungarian"}, 10),
        ("policy", {}, 9),
    ],
)
def test_the_cause_of_a_conflict_is_told_from_what_was_known_at_the_request(cause, basis, cost):
    assert conflict_cause(own(10, **basis), claim(2, cost=cost)) == cause


@pytest.mark.parametrize(
    ("roster", "alive", "serve", "needed"),
    [
        *[(5, 5, False, 3), (5, 2, False, 3), (5, 2, True, 2), (5, 3, True, 3), (4, 4, False, 3)],
        *[(4, 1, True, 1), (2, 2, True, 2), (2, 1, True, 1), (2, 1, False, 2), (64, 64, False, 33)],
        (1, 1, False, 1),
    ],
)
def test_more_than_half_of_the_roster_confirms_unless_a_part_may_serve_alone(roster, alive, serve, needed):
    assert quorum(roster, alive, serve) == needed


def test_only_rosters_under_three_serve_alone_by_themselves():
    assert [serves_alone("auto", size) for size in (1, 2, 3)] == [True, True, False]
    assert serves_alone("serve", 30)
    assert not serves_alone("wait", 1)


def test_long_rounds_stretch_every_interval():
    slow = Timing.of(replace(FleetConfig(), round_s=1.0))
    assert (slow.lease_ns, slow.dead_ns) == (3 * 10**9, 10 * 10**9)
    for timing in (slow, TIMING):  # what rule F's proof needs, see votes.py
        assert timing.dead_ns > timing.lease_ns + timing.delay_ns
        assert timing.delay_ns <= timing.lease_ns
    assert TIMING.dead_ns == 3 * 10**9
