"""What a few figures mean, wherever they are computed: travel costs out of their codes, CF1, ticks.

Knows records and the core's own rules, no logs.
"""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np

from hippomat_core.allocation.quantise import dequantise
from hippomat_core.config import Config
from hippomat_core.maps.map_event import grid_in
from hippomat_core.messages import MapReceived, RelayHeard, StateHeard, StopHeard, TasksHeard
from hippomat_core.planning.ground import ground_of

Task = tuple[int, int]  # slot, generation
HEARD = (StateHeard, RelayHeard, TasksHeard, StopHeard)  # frames of other radios
TICKS_PER_S = 20  # messages.Tick


def c_max_s(config: Config, said: MapReceived) -> float:
    """The cost that the largest code stands for: from the settings, or from the map as robots compute it.

    Raises MapError where the map is none to drive on.
    """
    return config.fleet.c_max_s or ground_of(grid_in(said), said.epoch, config).c_max_s


def cost_s(code: int, longest_s: float) -> float:
    """Travel cost out of its code; nan where c_max is unknown (0), inf where unreachable."""
    return float(dequantise(np.array([code], np.uint8), longest_s)[0]) if longest_s else math.nan


def conflict_free_rate(requests: Iterable[tuple[int, Task]]) -> float:
    """CF1 of the paper: of the tasks in requests (robot, task), the share that exactly one robot requested.

    nan where there are none.
    """
    robots: dict[Task, set[int]] = {}
    for robot, task in requests:
        robots.setdefault(task, set()).add(robot)
    return sum(len(who) == 1 for who in robots.values()) / len(robots) if robots else math.nan
