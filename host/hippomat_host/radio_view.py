"""What the daemon's screen says of radio, air and STOP: from the radio's status to short texts. Pure.

What somebody has to look after is raised as an alarm by the robot core (fleet/radio_health.py).
"""

from __future__ import annotations

from hippomat_core.messages import RadioStatus
from hippomat_core.wire import link
from hippomat_core.wire.frames import OPERATOR
from hippomat_host.fleet_view import FleetView
from hippomat_host.radio_words import DROPS, latched, stop_reason


def air(radio: RadioStatus) -> str:
    """The key, the time, and how many frames."""
    key = "OPEN: no key, anyone may send" if radio.flags & link.FLAG_OPEN else "sealed"
    time = "fleet time agreed" if radio.flags & link.FLAG_AGREED else "fleet time not agreed yet"
    counts = f"{radio.sent} frames sent, {radio.received} received, {radio.send_failed} failed"
    return f"{key}; {time}; {counts}"


def dropped(radio: RadioStatus) -> str:
    """Counters that are not 0, by cause."""
    counts = {name: getattr(radio, name) for name in DROPS}
    return ", ".join(f"{count} {name.removeprefix('dropped_')}" for name, count in counts.items() if count)


def stopped(view: FleetView) -> str:
    """The STOP that holds and how it ends; "" where none does."""
    radio = view.radio
    if radio is None or not latched(radio):
        return ""
    told = view.stop
    cause = ""
    if told is not None and told.frame.counter == radio.stop_counter:
        origin = "an operator" if told.frame.origin == OPERATOR else f"robot {told.frame.origin}"
        cause = f" ({stop_reason(told.frame.reason)}, by {origin})"
    return f"STOP {radio.stop_counter}{cause} holds until `hippomat-host resume` with any other radio"


def mark(radio: RadioStatus | None, robot: int, silent: bool) -> str:
    """One peer's radio trouble in a word."""
    bit = 1 << robot
    if radio is not None and radio.duplicate & bit:
        return "duplicate"
    if radio is not None and radio.babbling & bit:
        return "babbling"
    return "silent" if silent else ""
