"""Let the allocator decide once before the ports open: what numba compiles must not stall the first round.

Takes seconds to a minute where nothing was compiled yet, and milliseconds from compiled code that was kept.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

from hippomat_core.allocation.factory import make_allocator
from hippomat_core.allocation.warm_up import warm_up
from hippomat_core.config import FleetConfig

PATIENCE_S = 1.0


def prepare_allocator(fleet: FleetConfig, policy: bytes | None, say: Callable[[str], None]) -> None:
    """Says so if it takes long. Raises ConfigError where allocator and policy do not fit the fleet."""
    begun_s = time.monotonic()
    text = f"compiling the allocator {fleet.allocator}; only the first start takes so long ..."
    timer = threading.Timer(PATIENCE_S, say, (text,))
    timer.daemon = True
    timer.start()
    try:
        allocator = make_allocator(fleet.allocator, policy, fleet.size, fleet.task_slots)
        warm_up(allocator, fleet.size, fleet.task_slots)
    finally:
        timer.cancel()
    took_s = time.monotonic() - begun_s
    if took_s >= PATIENCE_S:
        say(f"the allocator is ready after {took_s:.0f} s")
