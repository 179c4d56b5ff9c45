"""Fleets of real radio cores in trouble: the others go on, and their status names who it is."""

from __future__ import annotations

import random
from collections.abc import Iterable
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from hippomat_core.wire.codec import encode_frame
from hippomat_core.wire.frames import NO_CLAIM, RESUME, STATE, STOP, Header, StateFrame
from hippomat_core.wire.link import FLAG_PASSIVE, FLAG_STOPPED, Command, encode_message
from hippomat_sim.air import AirSettings
from hippomat_sim.bench.radio_run import RadioRun
from hippomat_sim.bench.radio_settings import RadioSettings
from hippomat_sim.radio.fleet import FleetSetup, RadioFleet

ROBOTS, SECOND_US, SETTLED_US = 8, 1_000_000, 3_000_000
AGREED_US = 300


def settled_fleet(air: AirSettings | None = None, **setup: Any) -> RadioFleet:
    """Two seconds after the last of them has booted."""
    fleet = RadioFleet(FleetSetup(robots=ROBOTS, tasks=12, air=air or AirSettings(), **setup))
    fleet.run(SETTLED_US)
    fleet.rounds()
    return fleet


def bits(robots: Iterable[int]) -> int:
    return sum(1 << robot for robot in robots)


def all_but(*robots: int) -> list[int]:
    return [robot for robot in range(ROBOTS) if robot not in robots]


def spread_us(fleet: RadioFleet, stations: Iterable[int]) -> int:
    times_us = fleet.fleet_times_us()[list(stations)]
    assert times_us.min() >= 0
    return int(np.ptp(times_us))


def complete_share(told: NDArray[Any], robots: list[int]) -> float:
    """Of the rounds of these robots, in how many they hold the rows of all of them."""
    mine = told[np.isin(told["station"], robots)]
    assert len(mine)
    due = np.uint64(bits(robots))
    return float(((mine["held"] & due) == due).mean())


def named(fleet: RadioFleet, what: str, observers: list[int], until_us: int) -> dict[int, int]:
    """Per observer all robots that `what` of its condition names until then."""
    seen = dict.fromkeys(observers, 0)
    while fleet.now_us < until_us:
        fleet.run(fleet.now_us + 50_000)
        for station in observers:
            seen[station] |= getattr(fleet.condition(station), what)
    return seen


def test_a_killed_robot_is_missed_by_all_and_the_others_go_on() -> None:
    fleet = settled_fleet()
    assert {fleet.condition(0).alive} == {bits(all_but(0))}
    fleet.kill(3)
    died_us = fleet.now_us
    fleet.run(died_us + 200_000)
    fleet.rounds()
    fleet.run(died_us + 3_300_000)
    others = all_but(3)
    assert complete_share(fleet.rounds(), others) == 1.0
    for station in others:
        assert fleet.condition(station).alive == bits(set(others) - {station})
    assert spread_us(fleet, others) <= AGREED_US
    assert fleet.steps_back() == 0


@pytest.mark.parametrize("robot", [0, 5])
def test_a_rebooted_robot_is_named_and_joins_within_two_seconds(robot: int) -> None:
    fleet = settled_fleet()
    others = all_but(robot)
    boots = fleet.radios[robot].memory.boot_counter
    fleet.boot(robot)
    assert fleet.radios[robot].memory.boot_counter == boots + 1
    seen = named(fleet, "rebooted", others, fleet.now_us + 2 * SECOND_US)
    assert seen == dict.fromkeys(others, bits([robot]))
    assert complete_share(fleet.rounds(), others) == 1.0
    fleet.run(fleet.now_us + SECOND_US)
    assert complete_share(fleet.rounds(), list(range(ROBOTS))) == 1.0
    assert spread_us(fleet, range(ROBOTS)) <= AGREED_US
    assert fleet.steps_back() == 0


def babble(fleet: RadioFleet, station: int, until_us: int, period_us: int) -> None:
    """STATE after STATE under the station's id, from the station's MAC."""
    body = StateFrame(
        *(0, 0, 0, 0, 0, 0, 0, NO_CLAIM, np.zeros(12, np.uint8), np.zeros(12, np.uint8)),
        *(0, 0, 0, np.zeros(0, np.uint8), 0, np.zeros(ROBOTS, np.uint8), 1, 0, 0),
    )
    boot = fleet.radios[station].memory.boot_counter
    sequence = 100_000
    while fleet.now_us < until_us:
        sequence += 1
        fleet_us = int(fleet.fleet_times_us()[0])
        frame = encode_frame(Header(STATE, False, 1, station, boot, sequence, fleet_us), body)
        fleet.medium.send(fleet.now_us, station, frame)
        fleet.run(fleet.now_us + period_us)


def test_a_babbling_robot_is_named_and_the_others_go_on() -> None:
    fleet = settled_fleet()
    fleet.kill(6)  # its firmware has gone mad: the radio sends, nothing else works
    others = all_but(6)
    babble(fleet, 6, fleet.now_us + 3 * SECOND_US, period_us=1000)
    for station in others:
        assert fleet.condition(station).babbling == bits([6])
        assert fleet.radios[station].counters.dropped_babble > 500
    assert complete_share(fleet.rounds(), others) >= 0.99
    assert spread_us(fleet, others) <= AGREED_US
    fleet.run(fleet.now_us + 4 * SECOND_US)
    assert {fleet.condition(station).babbling for station in others} == {0}
    assert fleet.steps_back() == 0


def test_a_radio_with_the_id_of_another_keeps_silent_and_says_so() -> None:
    fleet = settled_fleet(spares=1)
    double = ROBOTS
    fleet.boot(double, robot=2)
    fleet.run(fleet.now_us + 2 * SECOND_US)
    assert fleet.condition(double).duplicate == bits([2])
    assert fleet.condition(double).flags & FLAG_PASSIVE
    assert fleet.medium.counts[double].sent == 0
    assert not fleet.condition(2).flags & FLAG_PASSIVE
    assert complete_share(fleet.rounds(), list(range(ROBOTS))) == 1.0


def test_two_robots_of_one_id_that_meet_fall_silent_and_are_named_by_all() -> None:
    fleet = settled_fleet(spares=1)
    double, near_it = ROBOTS, [5, 6, 7]
    fleet.medium.partition([[*near_it, double], all_but(*near_it)])
    fleet.run(fleet.now_us + 4 * SECOND_US)  # until nobody near it remembers the other
    fleet.boot(double, robot=2)
    fleet.run(fleet.now_us + 2 * SECOND_US)
    fleet.rounds()
    fleet.medium.heal()
    seen = named(fleet, "duplicate", [*range(ROBOTS), double], fleet.now_us + SECOND_US)
    assert seen == dict.fromkeys(range(ROBOTS + 1), bits([2]))
    for station in (2, double):
        assert fleet.condition(station).flags & FLAG_PASSIVE
    sent = [fleet.medium.counts[station].sent for station in (2, double)]
    fleet.rounds()
    fleet.run(fleet.now_us + 3 * SECOND_US)
    assert [fleet.medium.counts[station].sent for station in (2, double)] == sent
    assert complete_share(fleet.rounds(), all_but(2)) == 1.0
    assert spread_us(fleet, all_but(2)) <= AGREED_US
    assert fleet.steps_back() == 0


@pytest.mark.parametrize("cut_off", [[0], [1, 4, 6], [0, 1, 2, 3]])
def test_parts_go_on_alone_and_agree_again_when_they_meet(cut_off: list[int]) -> None:
    fleet = settled_fleet(seed=sum(cut_off))
    parts = [cut_off, all_but(*cut_off)]
    fleet.medium.partition(parts)
    fleet.run(fleet.now_us + SECOND_US)
    fleet.rounds()
    fleet.run(fleet.now_us + 60 * SECOND_US)
    told = fleet.rounds()
    for part in parts:
        assert complete_share(told, part) == 1.0
        assert spread_us(fleet, part) <= AGREED_US
    fleet.medium.heal()
    fleet.run(fleet.now_us + 2 * SECOND_US)
    fleet.rounds()
    for _ in range(50):
        fleet.run(fleet.now_us + 100_000)
        assert spread_us(fleet, range(ROBOTS)) <= AGREED_US
    assert complete_share(fleet.rounds(), list(range(ROBOTS))) == 1.0
    assert fleet.steps_back() == 0


def test_late_frames_do_not_drag_the_time() -> None:
    fleet = settled_fleet(AirSettings(late=0.1))
    spreads = []
    for _ in range(300):
        fleet.run(fleet.now_us + 100_000)
        spreads.append(spread_us(fleet, range(ROBOTS)))
    assert max(spreads) <= AGREED_US
    assert fleet.steps_back() == 0
    assert complete_share(fleet.rounds(), list(range(ROBOTS))) >= 0.999


def test_clocks_agree_although_some_have_just_booted() -> None:
    fleet = RadioFleet(FleetSetup(robots=ROBOTS, tasks=12, boots_within_us=1))
    fleet.run(100 * SECOND_US)
    for robot in all_but(2, 3):
        fleet.boot(robot)
    fleet.run(fleet.now_us + 2 * SECOND_US)
    assert spread_us(fleet, range(ROBOTS)) <= AGREED_US
    assert fleet.fleet_times_us().min() > 100 * SECOND_US
    assert fleet.steps_back() == 0


def raise_stop(fleet: RadioFleet, station: int) -> None:
    fleet.tell(station, encode_message(Command(STOP, 0, 1)))


@pytest.mark.parametrize("seed", range(3))
def test_a_stop_reaches_everyone_within_300_ms_at_30_percent_loss(seed: int) -> None:
    fleet = settled_fleet(AirSettings(loss=0.3), seed=seed)
    raised_us = fleet.now_us
    raise_stop(fleet, random.Random(seed).randrange(ROBOTS))
    fleet.run(raised_us + 300_000)
    assert all(time_us is not None for time_us in fleet.stopped_us())
    assert all(fleet.condition(station).flags & FLAG_STOPPED for station in range(ROBOTS))


def test_a_stop_outlives_a_reboot_and_stops_who_comes_late_until_it_is_resumed() -> None:
    fleet = settled_fleet(AirSettings(loss=0.3))
    fleet.kill(4)
    raise_stop(fleet, 1)
    fleet.run(fleet.now_us + 10 * SECOND_US)
    fleet.boot(2)
    assert fleet.condition(2).flags & FLAG_STOPPED
    fleet.boot(4)
    assert not fleet.condition(4).flags & FLAG_STOPPED
    fleet.run(fleet.now_us + 2 * SECOND_US)
    assert fleet.condition(4).flags & FLAG_STOPPED
    counter = fleet.condition(1).stop_counter
    fleet.tell(0, encode_message(Command(RESUME, counter, 0)))
    fleet.run(fleet.now_us + SECOND_US)
    assert not any(fleet.condition(station).flags & FLAG_STOPPED for station in range(ROBOTS))


def quiet(_: float) -> None:
    """Nobody watches."""


def test_two_minutes_of_deaths_reboots_partitions_and_late_frames() -> None:
    """The hour is `hippomat-bench radio --faults --seconds 3600`."""
    ours = RadioRun(RadioSettings(nodes=30, seconds=120, script=True, late=0.1, stops=1), quiet).execute()
    assert ours.faults == 10
    assert max(ours.agreement_us) <= AGREED_US
    assert (ours.steps_back, ours.wrong_rows) == (0, 0)
    assert ours.traffic.direct.mean >= 0.995
    assert ours.complete >= 0.999
    assert ours.stop_ms[0] <= 300
