"""fleet.toml: what it says reaches the robot it is said of, and a mistake is named."""

from __future__ import annotations

from pathlib import Path

import pytest

from hippomat_core.config import config_from_dict
from hippomat_core.errors import ConfigError
from hippomat_core.fleet.roster import merged, parse_roster

EXAMPLE = (Path(__file__).resolve().parents[2] / "fleet.toml").read_text(encoding="utf-8")


def test_the_example_in_the_repository_gives_every_robot_its_own_settings():
    roster = parse_roster(EXAMPLE)
    assert roster.map == "lab.yaml"
    configs = [config_from_dict(roster.settings(robot)) for robot in range(4)]
    assert [config.robot.id for config in configs] == [0, 1, 2, 3]
    assert {config.fleet.size for config in configs} == {4}
    assert [config.limits.speed_mps for config in configs] == [0.2, 0.2, 0.4, 0.2]
    assert (configs[2].robot.start_x_m, configs[2].robot.start_yaw_rad) == (3.0, 3.14)
    assert all(config.robot.start_known for config in configs)


def test_robots_share_what_the_fleet_must_agree_on():
    roster = parse_roster(EXAMPLE)
    assert len({config_from_dict(roster.settings(robot)).fleet for robot in range(4)}) == 1


def test_a_robot_without_a_start_has_to_look_for_itself():
    config = config_from_dict(parse_roster("[[robots]]\nid = 4").settings(4))
    assert not config.robot.start_known
    assert config.fleet.size == 5


def test_an_observer_gets_the_fleet_and_is_no_robot():
    config = config_from_dict(parse_roster(EXAMPLE).settings(-1))
    assert (config.robot.id, config.fleet.size) == (-1, 4)


def test_later_settings_win_key_by_key():
    assert merged({"a": {"x": 1, "y": 2}}, {"a": {"y": 3}}, {"b": {}}) == {"a": {"x": 1, "y": 3}, "b": {}}


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("map = 3\n[[robots]]\nid = 0", ("map = 3",)),
        ("[fleet]\nid = 1", ("[[robots]]",)),
        ("[[robots]]\nname = 'ada'", ("no id",)),
        ("[[robots]]\nid = 64", ("id = 64", "0 .. 63")),
        ("[[robots]]\nid = 1\n[[robots]]\nid = 1", ("id = 1", "twice")),
        ("[[robots]]\nid = 1\nname='a'\n[[robots]]\nid = 2\nname='a'", ("'a'", "twice")),
        ("[[robots]]\nid = 1\nstart = [1.0, 2.0]", ("robot 1", "[x, y, yaw]")),
        ("[[robots]]\nid = 1\nvehicle = 'tank'", ("'tank'", "none")),
        ("[[robots]]\nid = 1\nspeed = 2", ("'speed'", "known: id, name")),
        ("[robot]\nid = 1\n[[robots]]\nid = 1", ("[robot] id", "[[robots]]")),
        ("[motors]\n[[robots]]\nid = 1", ("[motors]",)),
        ("vehicles = 3\n[[robots]]\nid = 1", ("[vehicles]",)),
        ("[vehicles.a.motors]\n[[robots]]\nid = 1", ("[vehicles.a]", "[motors]")),
    ],
)
def test_a_mistake_is_named(text, words):
    with pytest.raises(ConfigError) as error:
        parse_roster(text, "lab/fleet.toml")
    assert str(error.value).startswith("lab/fleet.toml")
    assert all(word in str(error.value) for word in words)


def test_a_robot_that_is_not_in_the_roster_is_told_who_is():
    with pytest.raises(ConfigError, match=r"robot 7 is not in the roster; known: 0 \(ada\), 1 \(bob\)"):
        parse_roster(EXAMPLE).settings(7)
