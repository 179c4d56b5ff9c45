"""Robots of a fleet must decide with the same weights, unless its settings let them differ."""

from __future__ import annotations

import numpy as np
import pytest
from fleet_world import map_event, room
from safetensors.numpy import save

from hippomat_core.allocation.paper_network import expected_shapes
from hippomat_core.config import Config, FleetConfig, RobotConfig
from hippomat_core.messages import Started
from hippomat_core.step import initial_state, step


def digest(seed: int, per_robot: bool) -> int:
    draw = np.random.default_rng(seed)
    shapes = expected_shapes(6)
    weights = save({key: draw.normal(size=shape).astype(np.float32) for key, shape in shapes.items()})
    fleet = FleetConfig(task_slots=6, allocator="paper_network", policy_per_robot=per_robot)
    state = initial_state(Config(fleet=fleet, robot=RobotConfig(0)), weights)
    for event in (Started(0), map_event(room(), 0)):
        state, _ = step(state, event)
    assert state.fleet.digest is not None
    return state.fleet.digest


def test_other_weights_make_another_fleet():
    assert digest(1, per_robot=False) == digest(1, per_robot=False) != digest(2, per_robot=False)


def test_where_each_robot_may_have_its_own_weights_they_are_not_compared():
    assert digest(1, per_robot=True) == digest(2, per_robot=True)


@pytest.mark.parametrize("seed", [1, 2])
def test_a_fleet_of_own_weights_is_not_one_of_common_weights(seed: int):
    assert digest(seed, per_robot=True) != digest(seed, per_robot=False)
