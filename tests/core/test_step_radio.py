"""The robot core and its radio: rounds that it tells, rows it passes on, its STOP latch, its troubles."""

from __future__ import annotations

import dataclasses

import pytest
from fleet_world import TICK_NS, full_sweep, map_event, room
from radio_samples import radio_status
from slotted_world import ROUND_NS, SlottedWorld

from hippomat_core.config import Config, FleetConfig, RobotConfig
from hippomat_core.messages import (
    RADIO,
    AlarmCleared,
    AlarmRaised,
    ClaimChanged,
    Drive,
    PortOpened,
    RelayHeard,
    RoundDecided,
    RoundEnded,
    SendState,
    Started,
    StateHeard,
    StopHeard,
    Tick,
)
from hippomat_core.step import initial_state, step
from hippomat_core.tick import peers_in_the_way
from hippomat_core.wire.frames import FLAG_STOPPED, RESUME, STOP, Header, StopFrame
from hippomat_core.wire.link_messages import FLAG_AGREED, FLAG_OPEN, FLAG_PASSIVE

SECOND = 10**9


def said(body, kind, since_ns=0):
    return [effect for stamp_ns, effect in body.effects if isinstance(effect, kind) and stamp_ns >= since_ns]


def without(body, *kinds):
    """The body no longer gets events of these kinds."""
    body.take = lambda event, take=body.take: () if isinstance(event, kinds) else take(event)


@pytest.fixture(scope="module")
def minute():
    """Four robots at 30 % loss, half a minute; never changed by a test."""
    world = SlottedWorld(4, loss=0.3, seed=5, fleet=FleetConfig(task_slots=8, allocator="hungarian"))
    world.run(30.0)
    return world


def test_a_fleet_in_common_rounds_completes_tasks_once_and_without_conflict(minute):
    done = [(c.slot, c.generation) for body in minute.bodies for c in body.claims("completed")]
    assert len(done) >= 8
    assert len(done) == len(set(done))
    dropped = [c.cause for body in minute.bodies for c in body.claims("dropped")]
    assert not dropped


def test_every_round_ends_once_when_the_radio_says_so_and_for_all_alike(minute):
    for body in minute.bodies:
        told = [event.round for event in body.events if isinstance(event, RoundEnded)]
        ended = [decided.round for decided in said(body, RoundDecided)]
        assert ended[-len(told) :] == told
        assert len(ended) <= len(told) + 2, "before the radio told its first"


def test_a_state_goes_to_the_radio_at_the_end_of_the_round_and_not_at_a_tick(minute):
    body = minute.bodies[0]
    ends = {event.stamp_ns for event in body.events if isinstance(event, RoundEnded)}
    sent = [stamp_ns for stamp_ns, effect in body.effects if isinstance(effect, SendState)]
    assert set(sent[5:]) <= ends


def test_the_same_events_give_the_same_effects(minute):
    body = minute.bodies[1]
    assert any(isinstance(event, RelayHeard) for event in body.events)
    state, effects = initial_state(body.state.config), []
    for event in body.events:
        state, more = step(state, event)
        effects += more
    assert [repr(effect) for effect in effects] == [repr(effect) for _, effect in body.effects]


def test_all_robots_decide_on_the_same_rows_whoever_passed_them_on(minute):
    per_round = {}
    for body in minute.bodies:
        for decided in said(body, RoundDecided, minute.now_ns - 20 * SECOND):
            per_round.setdefault(decided.round, []).append(decided)
    same, relayed = 0, 0
    for all_decided in per_round.values():
        rows = {decided.row_slot.tobytes() + decided.row_available.tobytes() for decided in all_decided}
        same += len(rows) == 1
        relayed += any((decided.row_via != 255).any() for decided in all_decided)
    assert relayed > len(per_round) / 2
    assert same > 0.95 * len(per_round)


def test_robots_that_never_hear_each_other_share_tasks_and_see_no_pose_of_each_other():
    world = SlottedWorld(3, seed=2, fleet=FleetConfig(task_slots=6, allocator="hungarian"))
    world.hears = lambda sender, receiver: sender != receiver and {sender, receiver} != {0, 2}
    world.run(15.0)
    done = [(c.slot, c.generation) for body in world.bodies for c in body.claims("completed")]
    assert len(done) == len(set(done)) >= 3
    assert not [c for body in world.bodies for c in body.claims("dropped")]
    first = world.bodies[0].state
    assert first.fleet.row(2).via == 1
    assert [peer.robot for peer in peers_in_the_way(first, world.now_ns)] == [1]


def test_when_the_radio_tells_no_rounds_they_go_on_at_ticks():
    world = SlottedWorld(2)
    world.run(6.0)
    body = world.bodies[0]
    before = said(body, RoundDecided)[-1].round
    without(body, RoundEnded)
    since_ns = world.now_ns + ROUND_NS
    world.run(5.0)
    rounds = [decided.round for decided in said(body, RoundDecided, since_ns)]
    assert len(rounds) >= 48
    assert rounds[0] == before + 1
    assert rounds == list(range(rounds[0], rounds[0] + len(rounds)))


def test_after_a_hold_up_old_rows_count_for_nothing_and_one_round_ends():
    world = SlottedWorld(3)
    world.run(8.0)
    body = world.bodies[0]
    waiting = []
    take = body.take
    body.take = lambda event: waiting.append(event) or ()
    for _ in range(30):
        world.now_ns += TICK_NS
        if world.now_ns % ROUND_NS == 0:
            world._round(world.now_ns // ROUND_NS)
    body.take = take
    begun_ns = world.now_ns + 50_000_000
    body.take(world._feedback(body, begun_ns))
    body.take(full_sweep(begun_ns))
    for event in waiting:
        body.take(dataclasses.replace(event, stamp_ns=begun_ns))
    (decided,) = said(body, RoundDecided, begun_ns)
    assert decided.round == world.now_ns // ROUND_NS
    assert decided.reason in ("held up", "holds a claim")
    (state,) = said(body, SendState, begun_ns)
    others = [tag for robot, tag in enumerate(state.frame.endorsed) if robot != 0]
    assert others == [0, 0]


# ---- STOP ---------------------------------------------------------------------------------------


def started(**robot):
    """A core that has just started, with a map and a radio."""
    state = initial_state(
        Config(
            fleet=FleetConfig(allocator="hungarian"),
            robot=RobotConfig(2, 1.0, 1.0, 0.0, start_known=True, **robot),
        )
    )
    for event in (Started(0), map_event(room(), 0), PortOpened(0, RADIO, "test")):
        state, _ = step(state, event)
    return state


def test_a_daemon_that_starts_after_a_stop_stands_still_at_once():
    state, _ = step(started(), radio_status(10**6, stop_counter=4, stop_resumed=3))
    assert state.stop.latched
    state, effects = step(state, Tick(5 * SECOND))
    (alarm,) = [effect for effect in effects if isinstance(effect, AlarmRaised) and effect.code == "stop"]
    assert "STOP 4" in alarm.text
    assert "hippomat-host resume" in alarm.text
    state, _ = step(state, radio_status(6 * SECOND, stop_counter=4, stop_resumed=4))
    assert not state.stop.latched
    _, effects = step(state, Tick(6 * SECOND + TICK_NS))
    assert AlarmCleared("stop") in effects


def test_a_radio_that_knows_less_takes_no_stop_back():
    state = started()
    stop = Header(STOP, True, 1, 255, 1, 1, 0)
    state, _ = step(state, StopHeard(10**6, 0, 0, -40, stop, StopFrame(7, 255, 0)))
    state, _ = step(state, radio_status(2 * 10**6, stop_counter=4, stop_resumed=4))
    assert state.stop.latched
    resume = dataclasses.replace(stop, kind=RESUME)
    for counter, latched in ((6, True), (7, False)):
        state, _ = step(state, StopHeard(3 * 10**6, 0, 0, -40, resume, StopFrame(counter, 255, 0)))
        assert state.stop.latched == latched


@pytest.mark.parametrize("sealed", [True, False])
def test_in_an_open_fleet_the_alarm_says_that_anybody_can_stop_it(sealed):
    state = started()
    stop = Header(STOP, sealed, 1, 255, 1, 1, 0)
    state, _ = step(state, StopHeard(10**6, 0, 0, -40, stop, StopFrame(1, 255, 0)))
    _, effects = step(state, Tick(5 * SECOND))
    (text,) = [one.text for one in effects if isinstance(one, AlarmRaised) and one.code == "stop"]
    assert ("OPEN: anybody in range can send it" in text) == (not sealed)


def test_a_stop_in_the_radio_of_one_robot_stops_those_that_come_later():
    world = SlottedWorld(2)
    world.run(6.0)
    body, other = world.bodies
    stamp_ns = world.now_ns + 10**6
    body.take(radio_status(stamp_ns, boot_id=7, robot=0, slots=2, stop_counter=2))
    stopped_ns = world.now_ns + 4 * ROUND_NS
    world.run(1.0)
    for robot in (body, other):
        assert all(drive.v_mps == 0 for drive in said(robot, Drive, stopped_ns))
        assert said(robot, SendState)[-1].frame.flags & FLAG_STOPPED


# ---- troubles -----------------------------------------------------------------------------------


def test_a_robot_whose_radio_is_passive_drops_its_claim_and_listens_anew_afterwards():
    world = SlottedWorld(3)
    world.run(6.0)
    body = world.bodies[0]
    assert body.state.fleet.own_claim is not None
    passive_ns = world.now_ns + 10**6
    status = radio_status(passive_ns, boot_id=7, robot=0, slots=3, flags=FLAG_AGREED | FLAG_PASSIVE)
    assert "radio_passive" in [alarm.code for alarm in body.take(status) if isinstance(alarm, AlarmRaised)]
    world.run(0.5)
    assert [c.cause for c in said(body, ClaimChanged, passive_ns)] == ["duplicate id"]
    assert not said(body, SendState, passive_ns)
    world.run(2.0)  # its next status says that this is over
    assert "radio_passive" in [alarm.code for alarm in said(body, AlarmCleared, passive_ns)]
    assert said(body, RoundDecided)[-1].reason == "listening after the start"
    world.run(5.0)
    assert body.claims("requested")[-1] in said(body, ClaimChanged, passive_ns + 3 * SECOND)


def test_radio_troubles_are_alarms_of_the_robot():
    state = started()
    state, effects = step(state, radio_status(10**6, flags=FLAG_OPEN, babbling=1 << 4))
    assert {effect.code for effect in effects} == {"radio_open", "peer_babbling:4"}
    state, effects = step(state, radio_status(10**6 + SECOND, flags=FLAG_OPEN))
    assert effects == (AlarmCleared("peer_babbling:4"),)
    _, effects = step(state, radio_status(10**6 + 2 * SECOND, boot_id=6, flags=FLAG_OPEN))
    assert [effect.code for effect in effects] == ["radio_restarted"]


def test_rows_that_a_stalled_link_brings_late_are_not_trusted():
    """The process runs, and its ticks come; only what the radio tells is old."""
    world = SlottedWorld(3)
    world.run(8.0)
    body = world.bodies[0]
    last = next(event for event in reversed(body.events) if isinstance(event, StateHeard))
    header = dataclasses.replace(last.header, sequence=last.header.sequence + 1)
    for late_ms, trusted in ((150, True), (400, False)):
        stamp_ns = body.events[-1].stamp_ns + 10**6
        radio_us = stamp_ns // 1000 - late_ms * 1000
        header = dataclasses.replace(header, sequence=header.sequence + 1)
        body.take(dataclasses.replace(last, stamp_ns=stamp_ns, radio_time_us=radio_us, header=header))
        assert (body.state.fleet.trusted_from_ns <= stamp_ns) == trusted
