"""Planners by name."""

from __future__ import annotations

import numpy as np

from hippomat_core.config import PLANNERS
from hippomat_core.errors import ConfigError
from hippomat_core.motion.graph import motion_graph, moves_to
from hippomat_core.motion.pibt import PibtPlanner
from hippomat_core.motion.scene import MotionPlanner, Scene
from hippomat_core.motion.wait_and_replan import WaitAndReplanPlanner
from hippomat_core.motion.window import WindowPlanner


def warm_up(planner: MotionPlanner) -> None:
    """Plan once for two robots: what numba compiles must not stall the first decision."""
    graph = motion_graph(np.ones((3, 3), np.bool_), diagonals=True)
    node, goal = np.array([0, 4], np.int32), np.array([8, 4], np.int32)
    fields = np.array([moves_to(graph, int(one)) for one in goal])
    still, rows = np.zeros(2, np.int32), np.arange(2, dtype=np.int32)
    ticks, since = np.ones(2, np.int32), np.zeros(2, np.int64)
    planner.plan(Scene(0, graph, node, still, node.copy(), ticks, goal, rows, since, fields), None)


def make_planner(name: str) -> MotionPlanner:
    """A fresh planner; ConfigError for a name that is not in PLANNERS."""
    if name == "window":
        return WindowPlanner()
    if name == "pibt":
        return PibtPlanner()
    if name == "replan":
        return WaitAndReplanPlanner()
    raise ConfigError(f"planner {name!r} is unknown: choose one of {', '.join(PLANNERS)}")
