"""How a daemon introduces itself to its radio, and when it does so again."""

from __future__ import annotations

import signal
from pathlib import Path

import pytest
from host_devices import wait_until
from host_process import robot_in
from radio_samples import radio_status, reply_of

from hippomat_core.config import Config, FleetConfig, RobotConfig
from hippomat_core.errors import PortError
from hippomat_core.messages import RADIO
from hippomat_core.wire.device_commands import hello_of, to_be_told
from hippomat_core.wire.link import FLAG_OPEN, FLAG_PROVISIONED, LINK_VERSION, Hello
from hippomat_host.acceptance import accept, greeting_of
from hippomat_host.identify import ASK, Identity

FLEET = FleetConfig(id=7, size=12, channel=6, round_s=0.15)
ROBOT, OBSERVER = Config(FLEET, RobotConfig(id=3)), Config(FLEET)
RIGHT = {
    "robot": 3,
    "fleet": 7,
    "channel": 6,
    "round_ms": 150,
    "slots": 12,
    "flags": FLAG_OPEN | FLAG_PROVISIONED,
}


def test_a_robot_says_its_fleet_and_rounds_and_an_observer_only_asks() -> None:
    assert greeting_of(ROBOT) == Hello(LINK_VERSION, 3, 7, 6, 150, 12)
    assert greeting_of(OBSERVER) == ASK
    assert ASK.link_version != LINK_VERSION
    assert hello_of(OBSERVER).robot == 255


@pytest.mark.parametrize(
    ("config", "changes", "told"),
    [
        (ROBOT, {}, False),
        (ROBOT, {"round_ms": 100}, True),
        (ROBOT, {"slots": 5}, True),
        (ROBOT, {"robot": 255, "flags": FLAG_OPEN}, True),  # it restarted and forgot who it is
        (ROBOT, {"robot": 255}, False),  # an operator's: no Hello changes that
        (OBSERVER, {"slots": 5}, False),  # a robot's radio keeps its robot's rounds
        (OBSERVER, {"robot": 255}, False),
        (OBSERVER, {"robot": 255, "slots": 5}, True),
        (OBSERVER, {"robot": 255, "fleet": 1}, False),
        (OBSERVER, {"robot": 255, "fleet": 1, "flags": FLAG_OPEN}, True),
        (OBSERVER, {"robot": 255, "flags": FLAG_OPEN}, False),
    ],
)
def test_hello_is_repeated_where_it_can_change_something(
    config: Config, changes: dict[str, int], told: bool
) -> None:
    assert to_be_told(config, radio_status(0, **{**RIGHT, **changes})) is told


@pytest.mark.parametrize(
    ("changes", "parts"),
    [
        ({"robot": 4}, ("is robot 4, not robot 3", "give --robot 4")),
        ({"robot": 255}, ("is an operator's, not robot 3's",)),
        ({"fleet": 8}, ("belongs to fleet 8, not 7", "set [fleet] id = 8")),
        ({"channel": 11}, ("is on channel 11, not 6", "set [fleet] channel = 11")),
    ],
)
def test_a_radio_that_does_not_fit_is_refused_with_both_remedies(
    changes: dict[str, int], parts: tuple[str, ...]
) -> None:
    found = Identity(RADIO, "radio", reply_of(**{**RIGHT, **changes}))
    with pytest.raises(PortError) as caught:
        accept(ROBOT, "/dev/x", RADIO, found)
    write = "`hippomat-host provision --port /dev/x --fleet 7 --robot 3 --channel 6 --open` writes it anew"
    for part in (*parts, write):
        assert part in str(caught.value)
    assert accept(OBSERVER, "/dev/x", RADIO, found) == "radio"


def test_a_radio_that_restarts_is_told_the_rounds_again(tmp_path: Path) -> None:
    with robot_in(tmp_path) as robot:
        robot.radio.schedule = (200, 9)
        process = robot.start()
        assert wait_until(lambda: robot.radio.schedule == (100, 1), 20.0), robot.said()
        robot.radio.restart()
        assert wait_until(lambda: robot.radio.schedule == (100, 1), 5.0), robot.said()
        hellos = len(robot.radio.hellos)
        assert not wait_until(lambda: len(robot.radio.hellos) > hellos, 2.5)  # and then no more
        process.send_signal(signal.SIGINT)
        assert process.wait(10.0) == 0
