"""The robot core through its only door, alone and as a fleet in lockstep."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from fleet_world import TICK_NS, FleetWorld, map_event, room

from hippomat_core.config import Config, FleetConfig, RobotConfig
from hippomat_core.errors import ConfigError, MapError
from hippomat_core.maps.occupancy_grid import OccupancyGrid
from hippomat_core.messages import (
    BASE,
    LIDAR,
    RADIO,
    AlarmCleared,
    AlarmRaised,
    ClaimChanged,
    Drive,
    PathPlanned,
    PortLost,
    PortOpened,
    RadioStatus,
    RoundDecided,
    ScanReceived,
    SendState,
    Started,
    StateHeard,
    StopHeard,
    TasksHeard,
    Tick,
)
from hippomat_core.step import initial_state, step
from hippomat_core.wire.frames import FLAG_STOPPED, RESUME, STATE, STOP, Header, StopFrame

FROM_RADIO = (StateHeard, TasksHeard, RadioStatus)


def of_kind(body, kind, since_ns=0):
    return [effect for stamp_ns, effect in body.effects if isinstance(effect, kind) and stamp_ns >= since_ns]


def codes(body, kind=AlarmRaised):
    return [alarm.code for alarm in of_kind(body, kind)]


@pytest.fixture(scope="module")
def minute():
    """Four robots, 20 % loss, half a minute; never changed by a test."""
    world = FleetWorld(4, loss=0.2, seed=5, fleet=FleetConfig(task_slots=8, allocator="hungarian"))
    nearest = []
    for _ in range(30 * 20):
        world.tick()
        nearest.append(world.nearest_m())
    return world, min(nearest)


def test_a_fleet_completes_tasks_without_touching_and_without_double_service(minute):
    world, nearest_m = minute
    done = [(c.slot, c.generation) for body in world.bodies for c in body.claims("completed")]
    assert len(done) >= 8
    assert len(done) == len(set(done))
    assert all(body.claims("completed") for body in world.bodies)
    assert nearest_m > 2 * world.bodies[0].state.config.robot.radius_m


def test_a_task_is_completed_only_by_a_robot_that_held_it_confirmed(minute):
    for body in minute[0].bodies:
        confirmed = {(c.slot, c.generation) for c in body.claims("confirmed")}
        assert {(c.slot, c.generation) for c in body.claims("completed")} <= confirmed


def test_the_same_events_give_the_same_effects(minute):
    body = minute[0].bodies[1]
    state, effects = initial_state(body.state.config), []
    for event in body.events:
        state, more = step(state, event)
        effects += more
    assert [repr(effect) for effect in effects] == [repr(effect) for _, effect in body.effects]


def test_events_do_not_change_the_state_they_are_applied_to(minute):
    body = minute[0].bodies[0]
    tick = Tick(body.state.odometry.stamp_ns + TICK_NS)
    first = step(body.state, tick)[1]
    again = step(body.state, tick)[1]
    assert repr(first) == repr(again)


def test_every_decision_names_the_rows_it_used(minute):
    decided = of_kind(minute[0].bodies[2], RoundDecided)
    late = decided[-1]
    assert late.costs.shape == (4 * 8,)
    assert np.count_nonzero(late.row_sequence) >= 3
    assert (late.row_age_ms[late.row_age_ms != 65535] < 3000).all()


def test_every_array_that_leaves_the_core_is_contiguous_and_can_be_logged(minute):
    for body in minute[0].bodies:
        for path in of_kind(body, PathPlanned):
            assert path.ix.flags.c_contiguous
            assert path.iy.flags.c_contiguous
            assert path.ix.dtype == path.iy.dtype == np.uint16


def test_nobody_moves_or_asks_before_it_has_listened_for_three_seconds():
    world = FleetWorld(2)
    world.run(2.9)
    for body in world.bodies:
        assert not body.claims("requested")
        assert all(d.v_mps == 0 for d in of_kind(body, Drive))


def test_an_observer_neither_sends_nor_drives():
    state = initial_state(Config(fleet=FleetConfig(allocator="hungarian")))
    grid = room()
    said = []
    for event in (Started(0), map_event(grid, 0), *(PortOpened(0, p, "test") for p in (RADIO, BASE, LIDAR))):
        state, effects = step(state, event)
        said += effects
    for k in range(100):
        state, effects = step(state, Tick(k * TICK_NS))
        said += effects
    assert not [effect for effect in said if isinstance(effect, SendState | Drive)]


def test_a_silent_lidar_stops_the_robot_and_frees_its_task_after_ten_seconds():
    world = FleetWorld(2)
    world.run(6.0)
    body = world.bodies[0]
    assert body.claims("requested")
    assert any(d.v_mps > 0 for d in of_kind(body, Drive, world.now_ns - 10**9))
    body.take(PortLost(world.now_ns + 10**6, LIDAR, "unplugged"))
    body.take = lambda event, take=body.take: () if isinstance(event, ScanReceived) else take(event)
    lost_ns = world.now_ns
    world.run(5.0)
    assert "lidar_lost" in codes(body)
    assert all(d.v_mps == 0 and d.reason == "stop:lidar_lost" for d in of_kind(body, Drive, lost_ns + 10**8))
    assert body.state.fleet.own_claim is not None
    world.run(6.0)
    assert body.state.fleet.own_claim is None
    assert body.claims("dropped")[-1].cause == "lidar_lost"


def test_a_lost_base_drops_the_claim_at_once_and_sends_no_command():
    world = FleetWorld(2)
    world.run(6.0)
    body = world.bodies[0]
    body.take(PortLost(world.now_ns + 10**6, BASE, "unplugged"))
    lost_ns = world.now_ns + 2 * 10**6
    world.run(0.3)
    assert body.claims("dropped")[-1].cause == "base_lost"
    assert not of_kind(body, Drive, lost_ns)
    body.take(PortOpened(world.now_ns + 10**6, BASE, "back"))
    world.run(0.3)
    assert "base_lost" in codes(body, AlarmCleared)


def test_a_robot_whose_radio_is_lost_drives_on_and_waits_at_the_task_for_its_confirmation():
    world = FleetWorld(3)
    world.run(6.0)
    body = world.bodies[0]
    claim = body.state.fleet.own_claim
    assert claim is not None
    cut_off(world, body)
    lost_ns = world.now_ns
    world.run(25.0)
    assert any(d.v_mps > 0 for d in of_kind(body, Drive, lost_ns))
    assert "radio_lost" in codes(body)
    assert body.state.outcome.arrived
    assert body.state.fleet.own_claim.id == claim.id
    assert [c.what for c in of_kind(body, ClaimChanged, lost_ns)] == ["unconfirmed"]


def test_a_robot_whose_radio_is_lost_asks_for_nothing_new():
    world = FleetWorld(3)
    world.run(3.2)
    body, other = world.bodies[:2]
    assert not body.claims("requested")
    cut_off(world, body)
    world.run(4.0)
    assert other.claims("requested")
    assert not body.claims("requested")
    assert of_kind(body, RoundDecided)[-1].reason == "radio_lost"
    body.take = type(body).take.__get__(body)
    body.take(PortOpened(world.now_ns + 10**6, RADIO, "back"))
    world.run(2.0)
    assert body.claims("requested")


def cut_off(world, body):
    """The robot's radio is unplugged; what the others send is lost on it."""
    body.take(PortLost(world.now_ns + 10**6, RADIO, "unplugged"))
    body.take = lambda event, take=body.take: () if isinstance(event, FROM_RADIO) else take(event)


def test_stop_latches_until_its_counter_is_resumed():
    world = FleetWorld(2)
    world.run(6.0)
    body, other = world.bodies
    header = Header(STOP, False, 1, 255, 1, 1, 0)
    body.take(StopHeard(world.now_ns + 10**6, 0, 0, -40, header, StopFrame(4, 255, 0)))
    stopped_ns = world.now_ns + 10**8
    world.run(1.0)
    assert all(d.v_mps == 0 for d in of_kind(body, Drive, stopped_ns))
    assert all(d.v_mps == 0 for d in of_kind(other, Drive, stopped_ns + 3 * 10**8)), "the STATE carries it on"
    assert of_kind(body, SendState)[-1].frame.flags & FLAG_STOPPED
    for k, counter in enumerate((3, 4)):
        resume = dataclasses.replace(header, kind=RESUME, sequence=2 + k)
        body.take(StopHeard(world.now_ns + 10**6, 0, 0, -40, resume, StopFrame(counter, 255, 0)))
        assert body.state.stop.latched == (counter < 4)
    world.run(2.0)
    assert not other.state.stop.latched
    assert any(d.v_mps > 0 for d in of_kind(body, Drive, world.now_ns - 10**9))


def test_a_peer_with_another_fleet_digest_is_named_and_not_allocated_against():
    world = FleetWorld(2)
    world.run(5.0)
    body = world.bodies[0]
    frame = dataclasses.replace(of_kind(world.bodies[1], SendState)[-1].frame, fleet_digest=0xBAD)
    body.take(StateHeard(world.now_ns + 10**7, 0, 0, -40, Header(STATE, False, 1, 1, 1, 9999, 0), frame))
    alarm = of_kind(body, AlarmRaised)[-1]
    assert alarm.code == "peer_digest"
    assert "robot 1" in alarm.text
    assert "00000bad" in alarm.text
    assert body.state.fleet.peers[1].claim is None


def test_a_map_without_room_is_refused_by_name():
    state = initial_state(Config(fleet=FleetConfig(allocator="hungarian"), robot=RobotConfig(0)))
    wall = OccupancyGrid(np.full((10, 10), 100, np.int8), 0.05, 0.0, 0.0)
    with pytest.raises(MapError, match="inflation_radius"):
        step(state, map_event(wall, 0))


def test_more_task_slots_than_the_map_has_room_for_are_refused_with_the_limit():
    state = initial_state(
        Config(fleet=FleetConfig(task_slots=80, allocator="hungarian"), robot=RobotConfig(0))
    )
    with pytest.raises(ConfigError, match="task_slots"):
        step(state, map_event(room(2.0), 0))
