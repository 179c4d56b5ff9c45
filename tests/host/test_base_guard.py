"""The guard process on a base that holds its last velocity for ever; the test plays the daemon."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from host_devices import Base, Chatter, Device, Silent, plugged, wait_until

from hippomat_core.wire.jetbot_base import FEEDBACK, Decoder, encode_velocity

FORWARD = encode_velocity(0.2, 0.0)


class GuardProcess:
    """A guard with its daemon's end of the wire."""

    def __init__(self, path: Path) -> None:
        self.daemon, theirs = socket.socketpair()
        with theirs:
            self.process = subprocess.Popen(
                [sys.executable, "-m", "hippomat_host.base_guard", str(path)],
                stdin=theirs.fileno(),
                stdout=subprocess.PIPE,
                start_new_session=True,
            )

    def report(self) -> dict[str, Any]:
        assert self.process.stdout is not None
        report: dict[str, Any] = json.loads(self.process.stdout.readline())
        return report

    def command_for(self, seconds: float) -> None:
        until_s = time.monotonic() + seconds
        while time.monotonic() < until_s:
            self.daemon.send(FORWARD)
            time.sleep(0.05)


@contextlib.contextmanager
def guard_of(device: Device) -> Iterator[GuardProcess]:
    guard = GuardProcess(device.link)
    try:
        with plugged(device):
            yield guard
    finally:
        guard.daemon.close()
        guard.process.kill()
        guard.process.wait()
        if guard.process.stdout is not None:
            guard.process.stdout.close()


@pytest.fixture
def link(tmp_path: Path) -> Path:
    return tmp_path / "base"


def test_the_guard_listens_before_it_writes_and_then_drives_as_told(link: Path) -> None:
    base = Base(link)
    with guard_of(base) as guard:
        heard = bytes.fromhex(guard.report()["identified"])
        frames = list(Decoder().feed(heard))
        assert [frame.type for frame in frames] == [FEEDBACK]
        assert heard.endswith(frames[0].encode())
        guard.command_for(0.2)
        assert wait_until(base.moving)
        assert {v for _, v, _ in base.velocities} <= {0.0, 0.2}


def test_bytes_of_the_base_reach_the_daemon_unchanged_from_the_next_frame_on(link: Path) -> None:
    with guard_of(Base(link)) as guard:
        guard.report()
        decoder, frames = Decoder(), []
        while len(frames) < 10:
            frames += list(decoder.feed(guard.daemon.recv(4096)))
        assert decoder.skipped_bytes == 0


def test_a_silent_daemon_stops_the_base_by_the_guards_own_clock_within_300_ms(link: Path) -> None:
    base = Base(link)
    with guard_of(base) as guard:
        guard.report()
        guard.command_for(0.3)
        assert wait_until(base.moving)
        silent_ns = guard.report()["silent_ns"]
        assert 200e6 <= silent_ns <= 300e6
        assert wait_until(lambda: not base.moving(), 2.0)
        guard.command_for(0.2)  # and it is no latch
        assert wait_until(base.moving)


def test_a_daemon_that_is_gone_stops_the_base_and_ends_the_guard(link: Path) -> None:
    base = Base(link)
    with guard_of(base) as guard:
        guard.report()
        guard.command_for(0.3)
        assert wait_until(base.moving)
        guard.daemon.close()
        assert guard.process.wait(5.0) == 0
        assert wait_until(lambda: not base.moving(), 2.0)
        assert [v for _, v, _ in base.velocities[-3:]] == [0.0] * 3


def test_the_guard_outlives_ctrl_c_and_obeys_sigterm_with_zeros(link: Path) -> None:
    base = Base(link)
    with guard_of(base) as guard:
        guard.report()
        os.kill(guard.process.pid, signal.SIGINT)
        guard.command_for(0.3)
        assert wait_until(base.moving)
        assert os.getsid(guard.process.pid) == guard.process.pid
        guard.process.terminate()
        assert guard.process.wait(5.0) == 0
        assert wait_until(lambda: not base.moving(), 2.0)


def test_a_daemon_that_reads_nothing_does_not_hold_up_the_zeros(link: Path) -> None:
    base = Base(link)
    with guard_of(base) as guard:
        guard.report()
        guard.daemon.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 2304)
        guard.command_for(1.0)
        assert wait_until(base.moving)
        assert 200e6 <= guard.report()["silent_ns"] <= 400e6


@pytest.mark.parametrize("kind", [Silent, Chatter])
def test_nothing_is_written_to_a_port_that_is_no_base(link: Path, kind: type[Device]) -> None:
    device = kind(link)
    with guard_of(device) as guard:
        assert "sent no base frame" in guard.report()["foreign"]
        assert guard.process.wait(5.0) == 1
        assert device.received == []


def test_the_guard_says_that_its_port_is_gone(link: Path) -> None:
    base = Base(link)
    with guard_of(base) as guard:
        guard.report()
        base.unplug()
        assert "failed" in guard.report()
        assert guard.process.wait(5.0) == 1


def test_the_guard_starts_without_numpy() -> None:
    code = "import hippomat_host.base_guard, sys; sys.exit('numpy' in sys.modules or 'rich' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
