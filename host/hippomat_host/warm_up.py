"""Decide, localize, plan and drive once before the ports open: what numba compiles must not stall a robot.

Takes seconds to a minute where nothing was compiled yet, and milliseconds from compiled code that was kept.
"""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable, Iterator

from hippomat_core.allocation.factory import make_allocator
from hippomat_core.allocation.warm_up import warm_up
from hippomat_core.config import Config, FleetConfig, PlanningConfig
from hippomat_core.control.warm_up import warm_up as warm_up_control
from hippomat_core.motion.planners import make_planner
from hippomat_core.motion.planners import warm_up as plan_once
from hippomat_core.planning import warm_up as planning_warm_up
from hippomat_core.slam import warm_up as slam
from hippomat_core.slam.mapper_warm_up import warm_up_mapper
from hippomat_logs.policy_files import naming, policy_name

PATIENCE_S = 1.0


def prepare_allocator(fleet: FleetConfig, policy: bytes | None, say: Callable[[str], None]) -> None:
    """Says so if it takes long. Raises ConfigError where allocator and policy do not fit the fleet."""
    named = contextlib.nullcontext() if policy is None else naming(policy_name(fleet))
    with named, told_if_slow(f"compiling the allocator {fleet.allocator}", say):
        allocator = make_allocator(fleet.allocator, policy, fleet.size, fleet.task_slots)
        warm_up(allocator, fleet.size, fleet.task_slots)


def prepare_control(config: Config, say: Callable[[str], None]) -> None:
    """The same for path following and the scan guard."""
    with told_if_slow("compiling the control kernels", say):
        warm_up_control(config)


def prepare_localizer(say: Callable[[str], None]) -> None:
    """Says so if it takes long."""
    with told_if_slow("compiling the localizer", say):
        slam.warm_up()


def prepare_mapper(say: Callable[[str], None]) -> None:
    """Says so if it takes long."""
    with told_if_slow("compiling the mapper", say):
        warm_up_mapper()


def prepare_planner(planning: PlanningConfig, say: Callable[[str], None]) -> None:
    """Says so if it takes long: ways for one robot, and where the fleet decides together, moves of all."""
    with told_if_slow("compiling the planner", say):
        planning_warm_up.warm_up()
        if planning.planner != "replan":
            plan_once(make_planner(planning.planner))


@contextlib.contextmanager
def told_if_slow(what: str, say: Callable[[str], None], patience_s: float = PATIENCE_S) -> Iterator[None]:
    """Says what is being done while it takes longer than patience_s, and afterwards how long it took."""
    begun_s = time.monotonic()
    timer = threading.Timer(patience_s, say, (f"{what}; only the first start takes so long ...",))
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()
    took_s = time.monotonic() - begun_s
    if took_s >= patience_s:
        say(f"{what}: done after {took_s:.0f} s")
