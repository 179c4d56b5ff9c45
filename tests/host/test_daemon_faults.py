"""A fault inside the daemon: motors first, then one line; the traceback goes into a file."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from hippomat_core.config import Config, FleetConfig
from hippomat_core.messages import BASE, LIDAR, RADIO, Effect, Event
from hippomat_core.wire import rplidar
from hippomat_core.wire.jetbot_base import encode_velocity
from hippomat_host.advice import Given
from hippomat_host.daemon import Daemon, NoRecording
from hippomat_host.faults import as_error
from hippomat_host.happenings import END, OPENED, READ, START, TICK, Happening
from hippomat_host.screen import PlainFace, Screen


class WiredLink:
    """A link to nothing that notes what was asked of it in the order of all links."""

    def __init__(self, port: int, done: list[tuple[int, object]]) -> None:
        self.port, self.path, self.running, self.due_ns = port, "/dev/x", True, 2**63
        self._done = done

    def filenos(self) -> list[int]:
        return []

    def data_fileno(self) -> int:
        return -1

    def poll(self, now_ns: int) -> Iterator[Happening]:  # noqa: ARG002
        return iter(())

    def write(self, data: bytes) -> bool:
        self._done.append((self.port, data))
        return True

    def close(self) -> None:
        self._done.append((self.port, "close"))
        if self.port == BASE:
            raise OSError("a fault on the way out must not keep the lidar running")


class Told:
    """A reactor with a list."""

    def __init__(self, *happenings: Happening) -> None:
        self._left = list(happenings)

    def begin(self) -> int:
        return 0

    def next(self) -> Happening:
        return self._left.pop(0)

    def close(self) -> None:
        """Nothing."""


class BrokenAtTick(NoRecording):
    def put(self, stamp_ns: int, message: Event | Effect) -> None:  # noqa: ARG002
        if type(message).__name__ == "Tick":
            raise RuntimeError("broken")


@pytest.fixture
def lines() -> list[str]:
    return []


@pytest.fixture
def screen(lines: list[str]) -> Iterator[Screen]:
    screen = Screen(lambda: PlainFace(Given("/dev/x"), lines.append))
    yield screen
    screen.close()


CONFIG = Config(fleet=FleetConfig(allocator="hungarian"))
OPEN = [Happening(0, START), *(Happening(0, OPENED, port, text="it") for port in (RADIO, BASE, LIDAR))]


def test_after_a_fault_the_base_is_stopped_first_and_the_rest_is_closed(screen: Screen) -> None:
    done: list[tuple[int, object]] = []
    daemon = Daemon(CONFIG, [WiredLink(port, done) for port in (RADIO, BASE, LIDAR)], BrokenAtTick(), screen)
    with pytest.raises(RuntimeError):
        daemon.run(Told(*OPEN, Happening(1, TICK)))
    done.clear()
    daemon.stop()
    assert done == [
        (BASE, encode_velocity(0.0, 0.0)),
        (BASE, "close"),
        (LIDAR, rplidar.request(rplidar.STOP)),
        (LIDAR, "close"),
        (RADIO, "close"),
    ]


def test_bytes_of_a_port_that_is_not_open_are_recorded_but_decode_to_nothing(screen: Screen) -> None:
    class Noting(NoRecording):
        def __init__(self) -> None:
            self.noted: list[str] = []

        def put(self, stamp_ns: int, message: Event | Effect) -> None:  # noqa: ARG002
            self.noted.append(type(message).__name__)

        def serial(self, stamp_ns: int, port: int, direction: int, phase: int, data: bytes) -> None:  # noqa: ARG002
            self.noted.append("serial")

    recording, done = Noting(), []
    daemon = Daemon(CONFIG, [WiredLink(BASE, done)], recording, screen)
    reason = daemon.run(
        Told(Happening(0, START), Happening(1, READ, BASE, b"\xaa\x55"), Happening(2, END, text="bye"))
    )
    assert reason == "bye"
    assert recording.noted == ["Started", "serial"]


def test_a_fault_is_one_line_and_its_traceback_a_file_next_to_the_log(tmp_path: Path) -> None:
    try:
        raise RuntimeError("broken")
    except RuntimeError as fault:
        error = as_error(fault, str(tmp_path), "the motors were stopped")
    (report,) = tmp_path.iterdir()
    assert str(error) == (
        f"internal fault (RuntimeError: broken); the motors were stopped; please report {report}"
    )
    assert "Traceback" in report.read_text()
    assert error.exit_code == 1
