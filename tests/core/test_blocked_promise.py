"""A robot that is held up on its way promises less and less: nobody waits for it for as long as it stands."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from fleet_world import Body, FleetWorld
from hypothesis import given
from hypothesis import strategies as st
from test_step import codes, of_kind

from hippomat_core.config import FleetConfig, RecoveryConfig
from hippomat_core.fleet.claims import Basis, OwnClaim
from hippomat_core.fleet.progress import USUAL_S, held_up_s, observed
from hippomat_core.fleet.votes import ClaimId
from hippomat_core.messages import RoundDecided, SendState
from hippomat_core.wire.frames import UNREACHABLE
from hippomat_logs.policy_files import packaged_policy

SECOND = 10**9
SOON_S = 12.0  # after this long beside a robot that stands still, nobody waits for it any more
CASES = [("look_ahead", 10), ("look_ahead", 16), ("look_ahead", 22), ("graphsage", 10), ("graphsage", 17)]
NOBODY = np.zeros(2, np.bool_)
CLAIM = OwnClaim(ClaimId(0, 1, 0, 1, 20, 5), 0, 100, 100, 0, Basis(NOBODY, NOBODY, NOBODY, "look_ahead"))


class HeldUpWorld(FleetWorld):
    """Whatever its core commands, a robot among `stuck` does not move."""

    stuck: frozenset[int] = frozenset()

    def _advance(self, robot: int) -> None:
        if robot in self.stuck:
            self.bodies[robot].v_mps = self.bodies[robot].wz_radps = 0.0
        super()._advance(robot)


PATIENT = RecoveryConfig(stuck_s=600.0, waiting_s=3600.0, distant_s=3600.0)  # nobody gives a task back


def world(allocator: str, seed: int) -> HeldUpWorld:
    fleet = FleetConfig(task_slots=2, turnover="on_completion", allocator=allocator, seed=seed)
    return HeldUpWorld(
        2, fleet=fleet, policy=packaged_policy() if allocator == "graphsage" else None, recovery=PATIENT
    )


def waits(body: Body) -> bool:
    """It could have a task, and leaves it to the other one, which is busy."""
    decided = of_kind(body, RoundDecided)[-1]
    other = 1 - body.state.config.robot.id
    return decided.reason == "no task for this robot" and bool(decided.row_busy[other])


def until_one_waits(there: FleetWorld, rounds: int) -> int | None:
    """Who waits for a whole second, if anybody does."""
    since = [0, 0]
    for _ in range(rounds):
        there.run(0.1)
        for robot, body in enumerate(there.bodies):
            since[robot] = since[robot] + 1 if waits(body) else 0
            if since[robot] >= 10:
                return robot
    return None


def held_up(allocator: str, seed: int) -> tuple[HeldUpWorld, int]:
    """A world in which one robot waits for the other, which stands still from now on; who waits."""
    there = world(allocator, seed)
    waiting = until_one_waits(there, 150)
    assert waiting is not None
    there.stuck = frozenset({1 - waiting})
    return there, waiting


@pytest.mark.parametrize(("allocator", "seed"), CASES)
def test_an_idle_robot_waits_for_one_that_is_held_up_for_a_while_and_then_takes_the_task(allocator, seed):
    there, waiting = held_up(allocator, seed)
    there.run(1.0)
    assert waits(there.bodies[waiting]), "a moment's hold-up is no reason"
    there.run(SOON_S)
    assert there.bodies[waiting].state.fleet.own_claim is not None


def test_a_robot_that_comes_nearer_again_promises_what_it_did_before():
    there, waiting = held_up("look_ahead", 16)
    blocked = there.bodies[1 - waiting]
    before_s = eta_s(blocked)
    there.run(5.0)
    assert eta_s(blocked) == pytest.approx(before_s + 5.0 - USUAL_S, abs=0.3)
    there.stuck = frozenset()
    there.run(2.0)
    assert eta_s(blocked) < before_s


def test_beyond_c_max_it_promises_nothing_that_anybody_would_wait_for():
    there, waiting = held_up("look_ahead", 16)
    there.run(60.0)
    frame = of_kind(there.bodies[1 - waiting], SendState)[-1].frame
    assert set(frame.costs.tolist()) <= {254, UNREACHABLE}
    assert not any("saturated" in codes(body) for body in there.bodies)


def eta_s(body: Body) -> float:
    """Until it is at its destination, as it says."""
    return of_kind(body, SendState)[-1].frame.claim.eta_ds / 10


# ---- the rule ----


@given(st.lists(st.floats(0.0, 100.0), min_size=1, max_size=40))
def test_a_hold_up_counts_from_when_the_robot_was_nearest(ways_s):
    progress, nearest = None, 0
    for second, free_s in enumerate(ways_s):
        progress = observed(progress, CLAIM, free_s, second * SECOND)
        nearest = int(np.argmin(ways_s[: second + 1]))
        assert held_up_s(progress, CLAIM, second * SECOND) == max(second - nearest - USUAL_S, 0.0)


def test_another_claim_is_another_way():
    progress = observed(None, CLAIM, 3.0, 0)
    assert held_up_s(progress, CLAIM, 9 * SECOND) == 7.0
    other = replace(CLAIM, id=replace(CLAIM.id, tag=2))
    assert held_up_s(progress, other, 9 * SECOND) == 0.0
    assert observed(progress, other, 8.0, 9 * SECOND).since_ns == 9 * SECOND


def test_a_way_that_is_found_at_last_is_progress():
    progress = observed(None, CLAIM, math.inf, 0)
    assert held_up_s(progress, CLAIM, 5 * SECOND) == 3.0
    assert observed(progress, CLAIM, 20.0, 5 * SECOND).since_ns == 5 * SECOND
