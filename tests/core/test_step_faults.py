"""What the robot does when something goes wrong: hostile counters, a silent base, half a sweep, a new map."""

from __future__ import annotations

import dataclasses

import pytest
from fleet_world import FleetWorld

from hippomat_core.messages import (
    Drive,
    SendState,
    StateHeard,
    StopHeard,
)
from hippomat_core.wire.frames import FLAG_STOPPED, RESUME, STATE, STOP, Header, StopFrame


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
    header = Header(kind, 1, 1, 9, world.sequence, 0)
    body.take(StopHeard(world.now_ns + 10**7, 0, -40, header, StopFrame(counter, 255, 0)))


def row_heard(world, body, **changes):
    """A newer row of robot 1 with changed fields."""
    other = world.bodies[1]
    other.sequence += 1
    frame = dataclasses.replace(said(other, SendState)[-1].frame, **changes)
    header = Header(STATE, 1, 1, 1, other.sequence, 0)
    body.take(StateHeard(world.now_ns + 10**7, 0, -40, header, frame))


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
