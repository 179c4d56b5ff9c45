"""The configuration tree: everything it refuses, it refuses by name."""

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hippomat_core.config import Config, config_from_dict, config_to_dict, parse_config
from hippomat_core.errors import ConfigError


def test_an_empty_file_is_the_default_configuration():
    assert parse_config("") == Config()


def test_a_configuration_survives_the_way_through_the_manifest():
    config = parse_config('[fleet]\nsize = 7\nallocator = "greedy"\n[robot]\nid = 3\nradius_m = 0.1\n')
    assert config_from_dict(config_to_dict(config)) == config


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("[fleets]\nsize = 3", r"unknown section \[fleets\]"),
        ("fleet = 3", r"\[fleet\] must be a table"),
        ("[fleet]\nrobots = 3", r"\[fleet\] unknown key 'robots'; known: id, size"),
        ("[fleet]\nsize = 65", r"\[fleet\] size = 65 is outside 1 \.\. 64"),
        ("[fleet]\ntask_slots = 81", r"task_slots = 81 is outside 1 \.\. 80"),
        ("[fleet]\nsize = 3.5", r"size = 3\.5 must be of type int"),
        ("[fleet]\nsize = true", r"size = True must be of type int"),
        ("[limits]\nspeed_mps = nan", r"speed_mps = nan is outside"),
        ('[fleet]\nallocator = "magic"', r"'magic' is not one of graphsage, paper_network, hungarian"),
        ("[fleet]\nsize = 3\n[robot]\nid = 3", r"id = 3 is not in a fleet of size 3 \(ids 0\.\.2\)"),
        (
            "[fleet]\nsize = 33",
            r"size = 33 does not fit on the air in rounds of 0\.1 s: set round_s = 0\.104",
        ),
        (
            "[fleet]\nround_s = 0.0594",
            r"round_s = 0\.0594 is no whole number of milliseconds.* set round_s = 0\.059",
        ),
        ("[robot]\nradius_m = 0.2", r"inflation_radius = 0\.17 is less than .* = 0\.230"),
        ("[fleet\nsize", "not valid TOML"),
    ],
)
def test_what_cannot_be_used_is_refused_by_file_section_key_value_and_range(text, named):
    with pytest.raises(ConfigError, match=named) as caught:
        parse_config(text, "lab.toml")
    assert str(caught.value).startswith("lab.toml: ")


@given(st.floats(0.02, 5.0), st.integers(1, 32))
def test_any_value_in_range_is_taken(speed_mps, size):
    config = parse_config(f"[limits]\nspeed_mps = {speed_mps!r}\n[fleet]\nsize = {size}")
    assert (config.limits.speed_mps, config.fleet.size) == (speed_mps, size)


def test_the_example_file_shows_every_key_with_its_default():
    text = (Path(__file__).parents[2] / "hippomat.toml").read_text()
    assert parse_config(text) == Config()
    for section, values in config_to_dict(Config()).items():
        assert f"[{section}]" in text
        assert all(f"\n{key} = " in text for key in values)
