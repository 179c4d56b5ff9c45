"""What our radio's status says is wrong: alarms with ids and a remedy, each raised once and cleared."""

from __future__ import annotations

from dataclasses import replace

import pytest
from radio_samples import radio_status

from hippomat_core.config import Config, FleetConfig, RobotConfig
from hippomat_core.fleet.radio_health import RadioHealth, judged
from hippomat_core.messages import ERROR, INFO, WARNING, AlarmRaised
from hippomat_core.wire.link_messages import (
    FLAG_AGREED,
    FLAG_OPEN,
    FLAG_PASSIVE,
    FLAG_UNSAFE,
    NO_ROBOT,
)

CONFIG = Config(fleet=FleetConfig(size=5), robot=RobotConfig(id=2))
SECOND = 10**9


class Radio:
    """Robot 2's radio, told of once a second; keyed, with a fleet time agreed, unless said otherwise."""

    def __init__(self, config=CONFIG, **always):
        self.config, self.always = config, {"flags": FLAG_AGREED, **always}
        self.health, self.second = RadioHealth(), 60

    def says(self, seconds=1, **changes):
        """Alarms of `seconds` statuses, as (code, level and text, or None where it is cleared)."""
        told = {}
        for _ in range(seconds):
            self.second += 1
            stamp_ns, uptime_us = self.second * SECOND, self.second * 1_000_000
            values = {"uptime_us": uptime_us, **self.always, **changes}
            self.health, effects = judged(self.health, radio_status(stamp_ns, **values), self.config)
            for effect in effects:
                assert effect.code not in told, "each once"
                raised = isinstance(effect, AlarmRaised)
                told[effect.code] = (effect.level, effect.text) if raised else None
        return told


def test_a_healthy_radio_raises_nothing():
    assert Radio().says(30, alive=0b11011) == {}


@pytest.mark.parametrize(
    ("code", "level", "wrong", "words"),
    [
        ("radio_passive", ERROR, {"flags": FLAG_AGREED | FLAG_PASSIVE}, ["robot 2", "own id", "restart"]),
        ("radio_unsafe", ERROR, {"flags": FLAG_AGREED | FLAG_UNSAFE}, ["boot counter", "provision"]),
        ("radio_open", INFO, {"flags": FLAG_AGREED | FLAG_OPEN}, ["OPEN", "anybody", "--key-file"]),
        ("peer_duplicate:4", WARNING, {"duplicate": 1 << 4}, ["robot 4", "own id"]),
        ("peer_babbling:1", WARNING, {"babbling": 1 << 1}, ["robot 1", "restart"]),
        ("peer_rebooted:3", INFO, {"rebooted": 1 << 3}, ["robot 3", "restarted"]),
        ("radio_identity", ERROR, {"robot": 4}, ["robot 4 instead of 2"]),
        ("radio_identity", ERROR, {"channel": 9, "slots": 7}, ["channel 9 instead of 1", "size 7"]),
        ("time_not_agreed", WARNING, {"flags": 0, "alive": 0b1001}, ["robots 0, 3", "round_s"]),
    ],
)
def test_what_is_wrong_is_named_once_and_cleared_when_it_is_over(code, level, wrong, words):
    radio = Radio()
    radio.says()
    told = radio.says(12, **wrong)
    assert list(told) == [code]
    assert told[code][0] == level
    assert all(word in told[code][1] for word in words), told[code][1]
    assert radio.says(1, alive=wrong.get("alive", 0)) == {code: None}


def test_a_peer_that_goes_silent_is_named_and_cleared_when_it_is_back():
    radio = Radio()
    radio.says(3, alive=0b11001)
    told = radio.says(5, alive=0b10001)
    assert list(told) == ["peer_silent:3"]
    assert told["peer_silent:3"][0] == WARNING
    assert "robot 3 was not heard for 3 s" in told["peer_silent:3"][1]
    assert radio.says(1, alive=0b11001) == {"peer_silent:3": None}


def test_a_radio_that_restarts_listens_before_it_calls_peers_silent():
    radio = Radio()
    radio.says(3, alive=0b11001)
    radio.says(1, alive=0b01001)  # robot 4 is silent
    for second in range(1, 5):
        assert radio.says(1, boot_id=9, uptime_us=second * 999_000) == {}
    told = radio.says(1, boot_id=9, alive=0b01000)
    assert list(told) == ["peer_silent:0"]
    assert radio.health.raised == {"peer_silent:0", "peer_silent:4"}


def test_a_fleet_time_that_takes_a_moment_to_be_agreed_is_no_alarm():
    radio = Radio()
    assert radio.says(5, flags=0, alive=1) == {}
    assert radio.says(1, alive=1) == {}
    assert "time_not_agreed" not in radio.says(20, flags=0), "nobody to agree with"
    slow = Radio(replace(CONFIG, fleet=FleetConfig(size=5, round_s=1.0)), round_ms=1000)
    assert slow.says(10, flags=0, alive=1) == {}
    assert list(slow.says(2, flags=0, alive=1)) == ["time_not_agreed"]


@pytest.mark.parametrize(
    ("cause", "flags", "words"),
    [
        ("foreign", 0, ["another fleet or firmware on channel 1", "another channel"]),
        ("seal", FLAG_OPEN, ["of a fleet 1 with a key", "provision this radio"]),
        ("seal", 0, ["without a key", "provision the radio that sends them"]),
        ("forged", 0, ["forged", "another key", "provision every radio with one key"]),
        ("replayed", 0, ["heard before", "lost its boot counter"]),
    ],
)
def test_drops_that_grow_are_named_with_their_cause(cause, flags, words):
    radio = Radio(flags=FLAG_AGREED | flags)
    counter = f"dropped_{cause}"
    radio.says(1, **{counter: 1000})
    assert radio.says(10, **{counter: 1005}) == {}, "a few are no alarm"
    for second in range(1, 31):
        told = radio.says(1, **{counter: 1005 + 5 * second})
        assert bool(told) == (second == 10)
        if told:
            (level, text) = told[f"radio_{cause}"]
            assert level == WARNING
            assert text.startswith("50 frames")
            assert all(word in text for word in words), text
    assert radio.says(10, **{counter: 1155}) == {f"radio_{cause}": None}


def test_counters_that_begin_anew_are_no_growth():
    radio = Radio()
    radio.says(15, dropped_foreign=4_000_000)
    assert radio.says(15, boot_id=9, dropped_foreign=3) == {}


def test_a_radio_that_was_told_anew_what_it_is_is_no_alarm():
    radio = Radio()
    radio.says()
    assert radio.says(1, boot_id=9, robot=NO_ROBOT) == {}
    assert radio.says(1, boot_id=9) == {}


def test_an_observer_may_listen_through_any_robots_radio():
    radio = Radio(Config(fleet=FleetConfig(size=9)))
    assert radio.says(5) == {}
    assert radio.health.muted(radio.config) == ""


def test_a_robot_whose_radio_is_passive_or_another_robot_takes_no_part():
    radio = Radio()
    assert radio.health.muted(CONFIG) == ""
    for changes, why in (
        ({"flags": FLAG_PASSIVE}, "duplicate id"),
        ({"robot": 4}, "the radio is robot 4"),
        ({"robot": NO_ROBOT}, ""),
        ({}, ""),
    ):
        radio.says(1, **changes)
        assert radio.health.muted(CONFIG) == why


def test_our_own_id_among_the_duplicates_is_told_once_as_passive():
    radio = Radio()
    told = radio.says(2, flags=FLAG_AGREED | FLAG_PASSIVE, duplicate=1 << 2)
    assert list(told) == ["radio_passive"]
