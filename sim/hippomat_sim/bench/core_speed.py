"""How fast this core is just now. A shared machine changes its speed by half from one hour to the next, so a
figure of processor time says little without it."""

from __future__ import annotations

import time

_ADDITIONS = 200_000


def additions(count: int) -> int:
    """A fixed piece of work for the interpreter."""
    total = 0
    for number in range(count):
        total += number
    return total


def core_speed() -> float:
    """Additions a second in Python, in millions, of processor time."""
    begin_s = time.thread_time()
    additions(_ADDITIONS)
    return _ADDITIONS / (time.thread_time() - begin_s) / 1e6


def said(speed: float) -> str:
    return f"This core did {speed:.1f} million additions a second in Python meanwhile."
