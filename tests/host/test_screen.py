"""What is on the terminal, and that a terminal which takes nothing holds up nobody."""

from __future__ import annotations

import threading
import time

import numpy as np
from rich.console import Console

from hippomat_core.messages import (
    WARNING,
    AlarmCleared,
    AlarmRaised,
    ClaimChanged,
    PortLost,
    PortOpened,
    StateHeard,
    TasksHeard,
)
from hippomat_core.wire.frames import STATE, TASKS, AirClaim, Header, StateFrame, TasksFrame
from hippomat_host.advice import Given
from hippomat_host.fleet_view import FleetView
from hippomat_host.render import picture, plain
from hippomat_host.screen import Screen

OBSERVER = Given("/dev/ttyACM0")
ROBOT = Given("/dev/ttyACM0", "/dev/b", "/dev/l", "", "lab.yaml", 2, "1,2,0")
S = 10**9


def state_of(robot: int, stamp_ns: int, sequence: int, boot: int = 1) -> StateHeard:
    claim = AirClaim(3, 7, 40, 1, True, 1, 10, 20, 0, 55)
    empty = np.zeros(0, np.uint8)
    frame = StateFrame(1, 0, 123, -45, 0, 64, 0, claim, empty, empty, 0, 0, 0, empty, 0, empty, 0xABC, 0, 0)
    return StateHeard(stamp_ns, 0, 0, -61, Header(STATE, False, 1, robot, boot, sequence, 0), frame)


def shown(view: FleetView, given: Given, width: int = 120) -> str:
    console = Console(width=width, markup=False, record=True, file=open("/dev/null", "w"))  # noqa: SIM115
    with console.file:
        console.print(picture(view, given, "run.mcap  7 records, 0 lost"))
        return console.export_text()


def test_the_table_shows_the_fleet_that_is_heard() -> None:
    view = FleetView()
    view.event(PortOpened(0, 0, "hippomat 0.1.0"))
    for sequence in (1, 2, 4, 5):
        view.event(state_of(3, S, sequence))
    text = shown(view.snapshot(S + S // 2), OBSERVER)
    row = next(line for line in text.splitlines() if "0.5 s" in line)
    for part in ("assigned", "-61", "20%", "1.23", "-0.45", "90°", "task 3.7 confirmed", "00000abc"):
        assert part in row
    assert "missing the base (--base)" in text
    assert "hippomat-host --port /dev/ttyACM0 --base BASE" in text


def test_a_restarted_radio_is_no_loss_and_other_frames_count() -> None:
    view = FleetView()
    view.event(state_of(3, 0, 100))
    view.event(state_of(3, 0, 1, boot=2))
    view.event(TasksHeard(S, 0, 0, -50, Header(TASKS, False, 1, 3, 2, 2, 0), TasksFrame(())))
    peer = view.peers[3]
    assert peer.loss == 0.0
    assert (peer.stamp_ns, peer.rssi_dbm) == (S, -50)
    assert peer.frame is not None


def test_alarms_and_lost_ports_are_shown_until_they_are_over() -> None:
    view = FleetView()
    view.event(PortOpened(0, 1, "JetBot"))
    view.event(PortLost(0, 1, "gone"))
    view.effect(AlarmRaised(WARNING, "base_lost", "the base does not answer"))
    text = shown(view.snapshot(0), ROBOT)
    assert "base_lost: the base does not answer" in text
    assert "not there: trying again" in text
    assert "alarms: base_lost" in plain(view.snapshot(0), ROBOT)
    view.effect(AlarmCleared("base_lost"))
    assert "base_lost" not in shown(view.snapshot(0), ROBOT)


def test_completed_tasks_are_counted() -> None:
    view = FleetView()
    for what in ("requested", "confirmed", "completed"):
        view.effect(ClaimChanged(what, "", 1, 2, 1, 9, 4, 0.0, 0.0, 0.0))
    assert "no claim; done 1; hears nobody" in plain(view.snapshot(0), ROBOT)


def test_the_next_command_keeps_what_was_given() -> None:
    given = Given("/dev/r", lidar="/dev/l", config="my.toml", robot=3)
    assert given.missing == ["the base (--base)", "the fleet's map (--map)", "where it stands (--start)"]
    assert given.next_command() == (
        "hippomat-host --port /dev/r --base BASE --lidar /dev/l --config my.toml --map MAP.yaml --robot 3 "
        "--start X,Y,YAW"
    )


class Stuck:
    """A terminal after Ctrl-S."""

    def __init__(self) -> None:
        self.go = threading.Event()
        self.lines: list[str] = []

    def line(self, text: str) -> None:
        self.go.wait(5.0)
        self.lines.append(text)

    def view(self, view: FleetView, log: str) -> None:
        """Nothing."""

    def close(self) -> None:
        """Nothing."""


def test_a_stuck_terminal_holds_up_nobody_and_old_lines_give_way() -> None:
    face = Stuck()
    screen = Screen(lambda: face)
    screen.line("first")
    while screen.waiting:
        time.sleep(0.01)
    for number in range(1000):
        screen.line(str(number))
    face.go.set()
    screen.close()
    assert face.lines[0] == "first"
    assert face.lines[-1] == "999"
    assert len(face.lines) < 500
