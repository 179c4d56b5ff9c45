"""What the daemon's screen says of radio, air and STOP: from the radio's status to short texts. Pure."""

from __future__ import annotations

from hippomat_core.messages import RadioStatus
from hippomat_core.wire import link
from hippomat_core.wire.frames import OPERATOR
from hippomat_host.fleet_view import FleetView
from hippomat_host.radio_words import DROPS, latched, named, robots_of, stop_reason

_QUIET = ("dropped_replayed",)  # relays and floods bring every frame more than once


def air(radio: RadioStatus) -> str:
    """The key, the time, and how many frames."""
    key = "OPEN: no key, anyone may send" if radio.flags & link.FLAG_OPEN else "sealed"
    time = "fleet time agreed" if radio.flags & link.FLAG_AGREED else "fleet time not agreed yet"
    counts = f"{radio.sent} frames sent, {radio.received} received, {radio.send_failed} failed"
    return f"{key}; {time}; {counts}"


def dropped(radio: RadioStatus) -> str:
    """Counters that are not 0, by cause."""
    counts = {name: getattr(radio, name) for name in DROPS if name not in _QUIET}
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


def troubles(radio: RadioStatus) -> list[str]:
    """What somebody has to look after, and who it is."""
    found = []
    own = 1 << radio.robot if radio.robot < 64 else 0
    if radio.flags & link.FLAG_PASSIVE:
        found.append(f"another radio sends as robot {radio.robot}: ours keeps silent; provision one anew")
    if radio.flags & link.FLAG_UNSAFE:
        found.append("our radio cannot store its boot counter: flash it anew")
    if radio.duplicate & ~own:
        found.append(f"two radios under one id: {named(robots_of(radio.duplicate & ~own))}")
    if radio.babbling:
        found.append(f"too many frames from {named(robots_of(radio.babbling))}")
    return found


def mark(radio: RadioStatus | None, robot: int, silent: bool) -> str:
    """One peer's radio trouble in a word."""
    bit = 1 << robot
    if radio is not None and radio.duplicate & bit:
        return "duplicate"
    if radio is not None and radio.babbling & bit:
        return "babbling"
    return "silent" if silent else ""
