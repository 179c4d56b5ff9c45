"""What the daemon's screen says of key, time, STOP and radios in trouble."""

from __future__ import annotations

import pytest
from radio_samples import radio_status
from test_screen import OBSERVER, ROBOT, S, shown, state_of

from hippomat_core.messages import StopHeard
from hippomat_core.wire.frames import OPERATOR, RESUME, STOP, Header, StopFrame
from hippomat_core.wire.link import FLAG_AGREED, FLAG_OPEN
from hippomat_host.fleet_view import FleetView
from hippomat_host.render import plain


def view_with(**status: int) -> FleetView:
    view = FleetView()
    view.event(radio_status(0, **status))
    return view


def stop_heard(kind: int, counter: int, origin: int, reason: int) -> StopHeard:
    header = Header(kind, False, 1, OPERATOR, 1, 1, 0)
    return StopHeard(0, 0, 0, -50, header, StopFrame(counter, origin, reason))


@pytest.mark.parametrize(
    ("flags", "parts"),
    [
        (FLAG_OPEN, ("OPEN: no key, anyone may send", "fleet time not agreed yet")),
        (FLAG_AGREED, ("sealed", "fleet time agreed")),
    ],
)
def test_the_air_is_told_to_be_open_or_sealed_and_agreed_or_not(flags: int, parts: tuple[str, ...]) -> None:
    view = view_with(flags=flags)
    for part in parts:
        assert part in shown(view.snapshot(0), ROBOT)
    assert ("; OPEN" in plain(view, OBSERVER)) == bool(flags & FLAG_OPEN)
    assert ("; sealed" in plain(view, ROBOT)) != bool(flags & FLAG_OPEN)


def test_a_stop_is_told_with_its_counter_its_cause_and_how_it_ends() -> None:
    view = view_with(stop_counter=4, stop_resumed=3)
    assert "STOP 4 holds until `hippomat-host resume`" in shown(view.snapshot(0), ROBOT)
    view.event(stop_heard(STOP, 4, OPERATOR, 2))
    for text in (shown(view.snapshot(0), ROBOT), plain(view, ROBOT), plain(view, OBSERVER)):
        assert "STOP 4 (person, by an operator) holds until `hippomat-host resume`" in " ".join(text.split())
    view.event(stop_heard(RESUME, 4, OPERATOR, 0))
    view.event(radio_status(0, stop_counter=4, stop_resumed=4))
    assert "STOP" not in plain(view, ROBOT)
    view.event(radio_status(0, stop_counter=5, stop_resumed=4))
    view.event(stop_heard(STOP, 5, 1, 1))
    assert "STOP 5 (button, by robot 1)" in plain(view, ROBOT)


def test_radios_in_trouble_are_marked() -> None:
    view = view_with(duplicate=0b1000, babbling=0b10000, flags=0, dropped_forged=3, dropped_replayed=9)
    for robot in (2, 3, 4):
        view.event(state_of(robot, S, 1))
    text = shown(view.snapshot(5 * S), OBSERVER, width=130)
    rows = {line.split()[1]: line for line in text.splitlines() if "assigned" in line}
    assert "silent" in rows["2"]
    assert "duplicate" in rows["3"]
    assert "babbling" in rows["4"]
    assert "3 forged" in text
    assert "9 replayed" in text


def test_an_operators_frames_make_no_row() -> None:
    view = view_with()
    view.event(stop_heard(STOP, 1, OPERATOR, 0))
    assert view.peers == {}
