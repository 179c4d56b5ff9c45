"""What is compiled before the ports open where ROS gives a part of what the robot needs."""

from __future__ import annotations

from dataclasses import replace

import pytest

from hippomat_core.config import Config, LogConfig, RobotConfig, RosConfig
from hippomat_host import startup
from hippomat_host.advice import Given

MAPS = RosConfig(url="ws://robot:9090", map=True, pose=False, lidar=False, base=False)


class PortsOpen(Exception):
    """As far as this test goes."""


def compiled(monkeypatch, config, map_file=""):
    """Whether the localizer was, when the ports are opened."""
    told = []

    def opened(*_):
        raise PortsOpen

    for name in ("prepare_allocator", "prepare_control", "prepare_mapper", "prepare_planner"):
        monkeypatch.setattr(startup, name, lambda *_: None)
    monkeypatch.setattr(startup, "prepare_localizer", lambda _: told.append(True))
    monkeypatch.setattr(startup, "make_links", opened)
    with pytest.raises(PortsOpen):
        startup.run(config, Given("radio", map=map_file, robot=config.robot.id), None)
    return bool(told)


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({}, True),  # an own lidar in a map of ROS
        ({"pose": True}, False),
        ({"lidar": True}, False),
        ({"map": False}, False),  # there is no map at all
    ],
)
def test_the_localizer_is_compiled_before_a_map_from_ros_needs_it(monkeypatch, changes, expected):
    config = Config(robot=RobotConfig(0), ros=replace(MAPS, **changes), log=LogConfig(enabled=False))
    assert compiled(monkeypatch, config) == expected


def test_an_observer_compiles_no_localizer(monkeypatch):
    config = Config(robot=RobotConfig(-1), ros=MAPS, log=LogConfig(enabled=False))
    assert not compiled(monkeypatch, config)
