"""What this process has used of the machine: for the log, once a second. All its threads, no child of it."""

from __future__ import annotations

import resource
import time


def used() -> tuple[int, int, int]:
    """(the machine's monotonic clock [ns], processor time of all threads [ns], most memory so far [KiB])."""
    return time.monotonic_ns(), time.process_time_ns(), resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
