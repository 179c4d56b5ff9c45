"""The same daemon on recorded reads, told what happens next: the same decisions, in the same order."""

from __future__ import annotations

import json
import signal
import socket
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
from host_devices import Device, Radio, plugged, wait_until
from host_process import DAEMON, driving_robot, hippomat_host

from hippomat_core.messages import PORT_NAMES, Effect, MapReceived, PortLost, PortOpened, Started, Tick
from hippomat_core.wire.jetbot_base import FEEDBACK, Decoder
from hippomat_logs.reader import read_records
from hippomat_logs.records import FROM_DEVICE, IDENTIFICATION, RUNNING, SerialRecord


class Played(Device):
    """A port that answers the first byte asked, or offers at once, what identified the recorded device."""

    def __init__(self, link: Path, answer: bytes, at_once: bool) -> None:
        self.answer, self.at_once = answer, at_once
        super().__init__(link)

    def hears(self, data: bytes) -> None:
        asked = b"\xa5\x50" in data or len(data) > 4
        if self.answer and not self.at_once and asked:
            self.sends(self.answer)
            self.answer = b""

    def passes(self, now_s: float) -> None:  # noqa: ARG002
        if self.at_once and self.answer:
            self.sends(self.answer)
            self.answer = b""


def records_of(directory: Path) -> list[Any]:
    (log,) = directory.iterdir()
    return [message for *_, message in read_records(log)]


def instruction(record: Any) -> dict[str, Any] | None:
    at = {"at": int(getattr(record, "stamp_ns", 0))}
    if isinstance(record, Started):
        return {**at, "do": "start"}
    if isinstance(record, MapReceived):
        return {**at, "do": "map"}
    if isinstance(record, Tick):
        return {**at, "do": "tick"}
    if isinstance(record, PortOpened):
        return {**at, "do": "opened", "port": PORT_NAMES[record.port], "device": record.device}
    if isinstance(record, PortLost):
        return {**at, "do": "lost", "port": PORT_NAMES[record.port], "reason": record.reason}
    if isinstance(record, SerialRecord) and (record.direction, record.phase) == (FROM_DEVICE, RUNNING):
        return {**at, "do": "read", "port": PORT_NAMES[record.port], "bytes": len(record.data)}
    return None


def identification(records: list[Any], port: int) -> bytes:
    return b"".join(
        bytes(record.data)
        for record in records
        if isinstance(record, SerialRecord)
        and (record.port, record.direction, record.phase) == (port, FROM_DEVICE, IDENTIFICATION)
    )


def decisions(records: list[Any]) -> list[Any]:
    effects = Effect.__args__
    return [record for record in records if isinstance(record, effects)]


def equal(one: Any, other: Any) -> bool:
    if type(one) is not type(other):
        return False
    if isinstance(one, np.ndarray):
        return one.dtype == other.dtype and np.array_equal(one, other)
    if hasattr(one, "__dataclass_fields__"):
        return all(equal(getattr(one, name), getattr(other, name)) for name in one.__dataclass_fields__)
    return bool(one == other)


def test_a_recorded_run_played_in_lockstep_gives_the_same_decisions(tmp_path: Path) -> None:
    live, again = tmp_path / "live", tmp_path / "again"
    live.mkdir()
    again.mkdir()
    with driving_robot(live) as robot:
        assert robot.process is not None
        assert wait_until(robot.sends_states)
        robot.process.send_signal(signal.SIGTERM)
        assert robot.process.wait(10.0) == 0
        options = robot.options
    recorded = records_of(live / "runs")
    (frame,) = Decoder().feed(identification(recorded, 1))
    assert frame.type == FEEDBACK
    devices = {
        "radio": Played(again / "radio", identification(recorded, 0), at_once=False),
        "base": Played(again / "base", frame.encode(), at_once=True),
        "lidar": Played(again / "lidar", identification(recorded, 2)[-27:], at_once=False),
    }
    replaced = {str(live / name): str(again / name) for name in devices} | {
        str(live / "runs"): str(again / "runs")
    }
    with plugged(*devices.values()), socket.socket(socket.AF_UNIX) as server:
        server.bind(str(again / "socket"))
        server.listen(1)
        command = [*[replaced.get(option, option) for option in options], "--lockstep", str(again / "socket")]
        _play(server, command, recorded, devices)
    played = decisions(records_of(again / "runs"))
    expected = decisions(recorded)
    assert len(expected) > 100
    assert len(played) == len(expected)
    differing = [pair for pair in zip(expected, played, strict=True) if not equal(*pair)]
    assert differing == []


def _play(server: socket.socket, command: list[str], recorded: list[Any], devices: dict[str, Played]) -> None:
    with subprocess.Popen([*DAEMON, *command], stdout=subprocess.PIPE, stderr=subprocess.STDOUT) as process:
        server.settimeout(20.0)
        connection, _ = server.accept()
        with connection, connection.makefile("rb") as answers:
            for record in recorded:
                told = instruction(record)
                if told is None:
                    continue
                if told["do"] == "read":
                    devices[told["port"]].sends(bytes(record.data))
                connection.sendall(json.dumps(told).encode() + b"\n")
                assert json.loads(answers.readline()) == {"ok": True}
            connection.sendall(b'{"at": 1, "do": "end"}\n')
            assert json.loads(answers.readline()) == {"ok": True}
        assert process.wait(10.0) == 0


def test_a_lockstep_socket_without_replayer_is_named(tmp_path: Path) -> None:
    radio = Radio(tmp_path / "radio")
    with plugged(radio):
        ended = hippomat_host("--port", radio.link, "--no-log", "--lockstep", tmp_path / "nobody")
    assert ended.returncode == 1
    assert "no replayer listens there" in ended.stderr
    assert len(ended.stderr.splitlines()) == 1
