"""Planners by name."""

from __future__ import annotations

from hippomat_core.config import PLANNERS
from hippomat_core.errors import ConfigError
from hippomat_core.motion.pibt import PibtPlanner
from hippomat_core.motion.scene import MotionPlanner
from hippomat_core.motion.wait_and_replan import WaitAndReplanPlanner
from hippomat_core.motion.window import WindowPlanner


def make_planner(name: str) -> MotionPlanner:
    """A fresh planner; ConfigError for a name that is not in PLANNERS."""
    if name == "window":
        return WindowPlanner()
    if name == "pibt":
        return PibtPlanner()
    if name == "replan":
        return WaitAndReplanPlanner()
    raise ConfigError(f"planner {name!r} is unknown: choose one of {', '.join(PLANNERS)}")
