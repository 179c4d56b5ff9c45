"""The row of a robot that holds a claim counts from there: until it is free, and on."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from fleet_seat import ROUND, Seat, air_claim, of, ready, relayed
from fleet_world import FleetWorld
from test_step import codes, of_kind

from hippomat_core.allocation.quantise import dequantise, quantise
from hippomat_core.config import FleetConfig
from hippomat_core.fleet.inputs import Outlook
from hippomat_core.messages import RoundDecided, SendState
from hippomat_core.planning.distance_field import distance_at
from hippomat_core.wire.frames import FLAG_SATURATED, NO_SLOT

AFTER = np.array([201, 202, 203, 204], np.uint8)


def claiming(**fleet: object) -> tuple[Seat, object]:
    taken = ready(3, **fleet)
    for robot in (1, 2):
        taken.hear(robot, taken.row())
    return taken, taken.round(outlook=lambda _: Outlook(7.5, AFTER))


def test_the_state_that_makes_a_claim_tells_when_the_robot_will_be_free():
    _, outcome = claiming()
    assert outcome.has_claim
    frame = outcome.state_frame
    assert frame.costs.tolist() == AFTER.tolist()
    assert frame.claim.eta_ds == 75
    assert frame.claim.cost == 10, "frozen as the free robot's row had it"


def test_a_robot_that_lets_its_claim_go_is_priced_from_where_it_stands():
    taken, _ = claiming()
    outcome = taken.round(drop_claim="base_lost", outlook=lambda _: Outlook(7.5, AFTER))
    assert outcome.state_frame.claim.slot == NO_SLOT
    assert outcome.state_frame.costs.tolist() == [10, 20, 30, 40]


def test_a_robot_is_asked_what_tasks_cost_from_here_only_if_its_claim_ends():
    taken, _ = claiming()
    wrong = (1, 2, 3)  # refused where they are used
    outcome = taken.round(costs=wrong, outlook=lambda _: Outlook(7.5, AFTER))
    assert outcome.state_frame.costs.tolist() == AFTER.tolist()
    with pytest.raises(ValueError, match=r"costs for \(3,\) tasks, \(4,\) needed"):
        taken.round(costs=wrong, drop_claim="base_lost", outlook=lambda _: Outlook(7.5, AFTER))


def test_the_rest_of_the_service_is_all_that_is_left_on_arrival():
    taken, _ = claiming(dwell_s=0.5)
    claim = taken.fleet.own_claim
    assert claim.dwell_left_s(taken.now_ns, 0.5) == 0.5
    for _ in range(3):
        for robot in (1, 2):
            taken.hear(robot, taken.row(endorsed=claim.id.tag))
        taken.round(arrived=True)
    claim = taken.fleet.own_claim
    assert claim.serving_ns is not None
    assert claim.dwell_left_s(claim.serving_ns + 2 * ROUND, 0.5) == pytest.approx(0.3)
    assert claim.dwell_left_s(claim.serving_ns + 20 * ROUND, 0.5) == 0.0


def test_who_is_busy_is_recorded_with_the_decision_whoever_told_it():
    taken, _ = claiming()
    taken.hear(1, taken.row())
    taken.relay(1, relayed(2, air_claim(3)))
    (decided,) = of(RoundDecided, taken.round().effects)
    assert decided.row_busy.tolist() == [1, 0, 1]
    assert decided.row_available.tolist() == [0, 1, 0]


@pytest.fixture(scope="module")
def world():
    """Three robots, a quarter of a minute; never changed by a test."""
    made = FleetWorld(3, fleet=FleetConfig(task_slots=6, turnover="on_completion", allocator="hungarian"))
    made.run(15.0)
    return made


def test_every_task_costs_the_way_to_the_claim_its_service_and_the_way_from_there(world):
    seen = 0
    for body in world.bodies:
        state, frame = body.state, of_kind(body, SendState)[-1].frame
        claim = state.fleet.own_claim
        if claim is None or claim.serving_ns is not None or frame.claim.slot == NO_SLOT:
            continue
        ground, x_m, y_m = state.ground, frame.claim.x_cm / 100, frame.claim.y_cm / 100
        free_s = frame.claim.eta_ds / 10 + 0.5
        costs_s = dequantise(frame.costs, ground.c_max_s)
        newest = state.fleet.tasks.generations
        for (slot, generation), field in state.fields.by_task.items():
            if frame.costs[slot] < 254 and generation == newest[slot]:
                way_s = distance_at(ground.costmap, field, x_m, y_m) / state.config.limits.speed_mps
                assert costs_s[slot] == pytest.approx(free_s + way_s, abs=0.4)
                seen += 1
    assert seen >= 6


def test_a_claim_is_requested_at_the_price_of_a_free_robot(world):
    for body in world.bodies:
        ground = body.state.ground
        frames = {e.frame.claim.tag: e.frame for e in reversed(of_kind(body, SendState))}
        for claim in body.claims("requested"):
            eta_s = frames[claim.tag].claim.eta_ds / 10
            assert claim.cost == pytest.approx(int(quantise(eta_s, ground.c_max_s)), abs=6)
            break


def test_rows_beyond_c_max_saturate_without_an_alarm_while_a_claim_is_held():
    fleet = FleetConfig(task_slots=6, allocator="hungarian")
    listening = FleetWorld(2, fleet=fleet)
    listening.run(3.0)
    bodies = listening.bodies
    idle_s = [
        dequantise(of_kind(body, SendState)[-1].frame.costs, body.state.ground.c_max_s) for body in bodies
    ]
    world = FleetWorld(2, fleet=replace(fleet, c_max_s=1.02 * float(np.max(idle_s))))
    world.run(6.0)
    frames = [effect.frame for body in world.bodies for effect in of_kind(body, SendState)]
    assert any((frame.costs == 254).any() for frame in frames)
    assert not any(frame.flags & FLAG_SATURATED for frame in frames)
    assert not any("saturated" in codes(body) for body in world.bodies)


def test_a_free_robots_row_beyond_c_max_still_raises_it():
    world = FleetWorld(2, fleet=FleetConfig(task_slots=6, c_max_s=3.0, allocator="hungarian"))
    world.run(1.0)
    assert all(codes(body).count("saturated") == 1 for body in world.bodies)
