"""What the robot does when something goes wrong: hostile counters, a silent base, half a sweep, a new map."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from fleet_world import FleetWorld, full_sweep, map_event, room

from hippomat_core.config import Config, FleetConfig, RobotConfig
from hippomat_core.messages import (
    BASE,
    AlarmRaised,
    BaseFeedback,
    ClaimChanged,
    Drive,
    PathPlanned,
    PortLost,
    PortOpened,
    SendState,
    StateHeard,
    StopHeard,
)
from hippomat_core.state import elsewhere
from hippomat_core.step import initial_state, step
from hippomat_core.tick import LOST_NS, heard_of_us, peers_in_the_way
from hippomat_core.wire.frames import (
    FLAG_LOCALIZED,
    FLAG_STOPPED,
    RESUME,
    STATE,
    STOP,
    AirClaim,
    Header,
    StopFrame,
)


def said(body, kind, since_ns=0):
    return [effect for stamp_ns, effect in body.effects if isinstance(effect, kind) and stamp_ns >= since_ns]


def without(body, kind):
    """The body no longer gets events of this kind."""
    body.take = lambda event, take=body.take: () if isinstance(event, kind) else take(event)


@pytest.fixture
def pair():
    """Two robots that drive to their tasks."""
    world = FleetWorld(2)
    world.run(6.0)
    assert any(drive.v_mps > 0 for drive in said(world.bodies[0], Drive, world.now_ns - 10**9))
    return world


# ---- STOP ---------------------------------------------------------------------------------------


def stop_heard(world, body, kind, counter):
    world.sequence = getattr(world, "sequence", 0) + 1
    header = Header(kind, False, 1, 1, 9, world.sequence, 0)
    body.take(StopHeard(world.now_ns + 10**7, 0, 0, -40, header, StopFrame(counter, 255, 0)))


def row_heard(world, body, **changes):
    """A newer row of robot 1 with changed fields."""
    other = world.bodies[1]
    other.sequence += 1
    frame = dataclasses.replace(said(other, SendState)[-1].frame, **changes)
    header = Header(STATE, False, 1, 1, 1, other.sequence, 0)
    body.take(StateHeard(world.now_ns + 10**7, 0, 0, -40, header, frame))


@pytest.mark.parametrize("counter", [6, 40_000, 65_535])
def test_a_running_peers_counter_never_keeps_a_later_stop_from_stopping(pair, counter):
    body = pair.bodies[0]
    row_heard(pair, body, stop_counter=counter)
    stop_heard(pair, body, STOP, 5)
    row_heard(pair, body, stop_counter=counter)
    assert body.state.stop.latched


def test_a_resume_for_a_stop_that_was_not_heard_leaves_later_stops_their_effect(pair):
    body = pair.bodies[0]
    stop_heard(pair, body, RESUME, 65_535)
    stop_heard(pair, body, STOP, 1)
    assert body.state.stop.latched


def test_a_resume_for_a_later_stop_than_ours_does_not_lift_ours(pair):
    body = pair.bodies[0]
    stop_heard(pair, body, STOP, 3)
    stop_heard(pair, body, RESUME, 8)
    assert body.state.stop.latched
    stop_heard(pair, body, RESUME, 3)
    assert not body.state.stop.latched


def test_the_last_counter_stays_latched_because_no_later_stop_could_be_told_from_it(pair):
    body = pair.bodies[0]
    stop_heard(pair, body, STOP, 65_535)
    stop_heard(pair, body, RESUME, 65_535)
    assert body.state.stop.latched


def test_a_peer_of_another_fleet_digest_can_stop_but_not_resume(pair):
    body = pair.bodies[0]
    row_heard(pair, body, stop_counter=3, flags=FLAG_STOPPED, fleet_digest=0xBAD)
    assert body.state.stop.latched
    row_heard(pair, body, stop_counter=3, flags=0, fleet_digest=0xBAD)
    assert body.state.stop.latched
    row_heard(pair, body, stop_counter=3, flags=0)
    assert not body.state.stop.latched


def test_a_peer_that_runs_on_because_it_missed_the_stop_resumes_nobody(pair):
    body = pair.bodies[0]
    stop_heard(pair, body, STOP, 2)
    row_heard(pair, body, stop_counter=1, flags=0)
    assert body.state.stop.latched


# ---- base and lidar -----------------------------------------------------------------------------


def test_a_base_that_sends_nothing_stops_the_robot_although_its_port_is_open(pair):
    body = pair.bodies[0]
    without(body, BaseFeedback)
    silent_ns = pair.now_ns
    pair.run(2.0)
    late = said(body, Drive, silent_ns + 1_200_000_000)
    assert late
    assert all((drive.v_mps, drive.reason) == (0.0, "stop:base_lost") for drive in late)
    assert "base_lost" in [alarm.code for alarm in said(body, AlarmRaised)]


def test_a_base_that_comes_back_starts_from_standing(pair):
    body = pair.bodies[0]
    while said(body, Drive)[-1].v_mps < 0.15:
        pair.tick()
    body.take(PortLost(pair.now_ns + 10**6, BASE, "unplugged"))
    body.v_mps = 0.0
    pair.run(1.0)
    back_ns = pair.now_ns
    body.take(PortOpened(pair.now_ns + 10**6, BASE, "back"))
    pair.run(0.1)
    most_mps = body.state.config.limits.accel_mps2 * 0.2  # the longest step the follower reckons with
    assert max(abs(drive.v_mps) for drive in said(body, Drive, back_ns)) <= most_mps / 2


@pytest.mark.parametrize("seen", [slice(0, 0), slice(0, 1), slice(0, 300), slice(30, 350)])
def test_a_sweep_with_a_hole_does_not_count_as_a_scan(pair, seen):
    body = pair.bodies[0]
    before = body.state.scan
    whole = full_sweep(pair.now_ns + 10**7)
    arrays = {name: getattr(whole, name)[seen] for name in ("quality", "angle_q6", "distance_q2")}
    body.take(dataclasses.replace(whole, **arrays))
    assert body.state.scan is before


def test_what_the_lidar_is_too_near_to_see_is_remembered_while_the_robot_stays_near(pair):
    body = pair.bodies[0]
    body.take(full_sweep(pair.now_ns, 0.152))
    odometry = body.state.odometry
    ahead = dataclasses.replace(odometry, x_m=odometry.x_m + 0.01)
    body.state = dataclasses.replace(body.state, odometry=ahead)
    for k in range(3):
        body.take(full_sweep(pair.now_ns + 1 + k))  # sees nothing at all
        assert 0 < len(body.state.scan.points) < 360
    body.state = dataclasses.replace(body.state, odometry=odometry)
    body.take(full_sweep(pair.now_ns + 4))
    assert len(body.state.scan.points) == 0


def test_a_robot_that_was_found_elsewhere_waits_until_peers_have_heard_of_it_there():
    world = FleetWorld(2)
    world.run(6.0)
    body = world.bodies[0]
    row_heard(world, body, heard=1)
    assert heard_of_us(body.state, world.now_ns)
    body.state = elsewhere(body.state, world.now_ns + 1)
    assert not heard_of_us(body.state, world.now_ns + 1)
    row_heard(world, body, heard=1)  # it may still mean the place before
    assert not heard_of_us(body.state, world.now_ns + 1)
    world.now_ns += 10**9
    assert not heard_of_us(body.state, world.now_ns)
    row_heard(world, body, heard=1)
    assert heard_of_us(body.state, world.now_ns + 10**7)


def just_ahead(body, away_m=0.26):
    """The fields of a STATE that stands in front of the body."""
    x_m, y_m, yaw_rad = body.state.pose
    x_cm = round(100 * (x_m + away_m * math.cos(yaw_rad)))
    return {"x_cm": x_cm, "y_cm": round(100 * (y_m + away_m * math.sin(yaw_rad))), "speed_2cmps": 0}


def test_a_peer_that_never_knew_where_it_is_stands_in_nobodys_way():
    world = FleetWorld(2)
    world.run(2.0)
    body = world.bodies[0]
    nobody = dataclasses.replace(body.state.fleet, peers=(None, None))
    body.state = dataclasses.replace(body.state, fleet=nobody)
    row_heard(world, body, flags=0)
    assert not body_peers(world, body)


def test_a_peer_that_gets_lost_stays_where_it_was_for_as_long_as_nobody_can_have_carried_it_far(pair):
    body = pair.bodies[0]
    ahead = just_ahead(body)
    row_heard(pair, body, **ahead)
    told = body_peers(pair, body)
    since_ns = pair.now_ns
    for _ in range(3):
        pair.now_ns += 2 * 10**8
        row_heard(pair, body, **{**ahead, "x_cm": 0, "y_cm": 0}, flags=0)
    (peer,) = body_peers(pair, body)
    assert (peer.x_m, peer.y_m) == (ahead["x_cm"] / 100, ahead["y_cm"] / 100)
    assert peer.intent.tolist() == told[0].intent.tolist()
    assert peer.age_s == pytest.approx(told[0].age_s + 0.6), "as of one that fell silent"
    pair.now_ns = since_ns + LOST_NS
    assert not body_peers(pair, body)


def test_a_peer_that_is_found_again_is_where_it_says(pair):
    body = pair.bodies[0]
    for flags, x_cm in [(FLAG_LOCALIZED, 100), (0, 0), (FLAG_LOCALIZED, 300)]:
        row_heard(pair, body, flags=flags, x_cm=x_cm)
    assert [peer.x_m for peer in body_peers(pair, body)] == [3.0]


def test_what_a_robot_with_another_map_means_to_drive_is_not_looked_for_in_ours(pair):
    body = pair.bodies[0]
    ahead = just_ahead(body)
    row_heard(pair, body, **ahead)
    assert body_peers(pair, body)[0].promises
    claim = AirClaim(1, 1, 0, 0, False, 1, 300, 300, 0, 0)
    far = {"intent_ix": 3, "intent_iy": 90, "intent_steps": np.array([14, 14], np.uint8), "claim": claim}
    row_heard(pair, body, **ahead, **far, fleet_digest=0xBAD)
    (peer,) = body_peers(pair, body)
    assert peer.intent.tolist() == [list(pair.grid.cell_of(peer.x_m, peer.y_m))]
    assert peer.destination is None
    assert not peer.promises
    row_heard(pair, body, **{**ahead, "x_cm": 20_000})
    row_heard(pair, body, **{**ahead, "x_cm": 20_000}, fleet_digest=0xBAD)
    assert body_peers(pair, body)[0].x_m == 200.0
    pair.run(0.2)  # a place that our map does not have is no fault


def test_a_lost_peers_promise_was_made_in_the_map_it_had_then(pair):
    body = pair.bodies[0]
    row_heard(pair, body, **just_ahead(body), fleet_digest=0xBAD)
    row_heard(pair, body, flags=0)
    (peer,) = body_peers(pair, body)
    assert not peer.promises


def body_peers(world, body):
    """The peers that the body's motion reckons with."""
    return peers_in_the_way(body.state, world.now_ns + 2 * 10**7)


# ---- the map ------------------------------------------------------------------------------------


def digest_of(source, **robot):
    fleet = FleetConfig(task_slots=6, c_max_s=60.0, task_source=source, allocator="hungarian")
    config = Config(fleet=fleet, robot=RobotConfig(0, **robot))
    return step(initial_state(config), map_event(room(), 0))[0].fleet.digest


def test_robots_that_would_place_the_tasks_elsewhere_are_of_another_fleet():
    assert digest_of("continuous", radius_m=0.12) != digest_of("continuous", radius_m=0.15)
    assert digest_of("continuous", start_x_m=1.0) == digest_of("continuous", start_x_m=2.0)


def test_where_orders_say_the_places_robots_of_two_sizes_may_work_together():
    assert digest_of("orders", radius_m=0.12) == digest_of("orders", radius_m=0.15)


def test_a_new_map_in_mid_run_lets_the_fleet_go_on_when_everyone_has_it(pair):
    grid = room(4.0)
    for body in pair.bodies:
        body.take(map_event(grid, pair.now_ns + 10**7, epoch=2))
    changed_ns = pair.now_ns
    pair.run(10.0)
    for body in pair.bodies:
        requested = said(body, ClaimChanged, changed_ns)
        assert [change.what for change in requested].count("requested") >= 1
        assert not said(body, AlarmRaised, changed_ns + 10**9)
        assert {path.map_epoch for path in said(body, PathPlanned, changed_ns + 10**8)} == {2}
