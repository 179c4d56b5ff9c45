"""Let allocator and planner decide once before the ports open: compiling must not stall the first round.

Takes seconds to a minute where nothing was compiled yet, and milliseconds from compiled code that was kept.
"""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable, Iterator

from hippomat_core.allocation.factory import make_allocator
from hippomat_core.allocation.warm_up import warm_up
from hippomat_core.config import FleetConfig, PlanningConfig
from hippomat_core.motion.planners import make_planner
from hippomat_core.motion.planners import warm_up as plan_once
from hippomat_logs.policy_files import naming, policy_name

PATIENCE_S = 1.0


def prepare_allocator(fleet: FleetConfig, policy: bytes | None, say: Callable[[str], None]) -> None:
    """Says so if it takes long. Raises ConfigError where allocator and policy do not fit the fleet."""
    named = contextlib.nullcontext() if policy is None else naming(policy_name(fleet))
    with named, told_if_slow(f"compiling the allocator {fleet.allocator}", say):
        allocator = make_allocator(fleet.allocator, policy, fleet.size, fleet.task_slots)
        warm_up(allocator, fleet.size, fleet.task_slots)


def prepare_planner(planning: PlanningConfig, say: Callable[[str], None]) -> None:
    """Says so if it takes long; nothing to do for wait and replan."""
    if planning.planner != "replan":
        with told_if_slow(f"compiling the planner {planning.planner}", say):
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
