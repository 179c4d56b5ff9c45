"""Replay with the real daemon: recorded bytes on fake serial ports, one happening at a time.

The daemon's clock is the log's; what it decides goes into a log of its own, which is then compared with the
recorded one. Knows the daemon's lockstep protocol (hippomat_host/lockstep.py), not its inside.
"""

from __future__ import annotations

import base64
import contextlib
import json
import socket
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from hippomat_core import messages as m
from hippomat_core.config import RosConfig
from hippomat_core.errors import HippomatError
from hippomat_logs.daemon_process import DaemonProcess, daemon_command
from hippomat_logs.fake_ports import FakePorts
from hippomat_logs.level2 import EffectComparison
from hippomat_logs.reader import Record, Run, open_runs
from hippomat_logs.records import FROM_DEVICE, RUNNING, SerialRecord
from hippomat_logs.report import FAILED, OK, Divergence, LevelResult
from hippomat_logs.ros.fake_rosbridge import FakeRosbridge
from hippomat_logs.ros.topics import FROM_ROS, is_of_ros, topic_of, topics_of
from hippomat_logs.schema import EFFECTS, EVENTS, MessageStore

ANSWER_S = 30.0
START_S = 60.0
PROGRESS_STEP = 500
TOLD = (SerialRecord, m.Started, m.MapReceived, m.Tick, m.PortOpened, m.PortLost, m.LoopsClosed, *FROM_ROS)


def replay_in_daemon(run: Run, exact: bool, progress: Callable[[str, int], None]) -> LevelResult:
    """Drive one daemon through `run` and compare what it decided."""
    with tempfile.TemporaryDirectory(prefix="hippomat-replay-") as name:
        directory = Path(name)
        again = _drive(run, directory, progress)
        return compare_runs(run, again, exact)


def instruction(message: Any, ros: RosConfig, store: MessageStore) -> dict[str, Any] | None:
    """What the daemon is told for one record; None for what it does by itself."""
    if is_of_ros(message, ros):
        return {"at": message.stamp_ns, "do": "event", "port": m.PORT_NAMES[m.ROS]}
    if isinstance(message, m.LoopsClosed):  # the daemon's solver takes its time, and so is not asked again
        data = base64.b64encode(store.encode(message)).decode()
        return {"at": message.stamp_ns, "do": "answer", "data": data}
    if isinstance(message, SerialRecord):
        if (message.direction, message.phase) != (FROM_DEVICE, RUNNING) or not message.data:
            return None
        port = m.PORT_NAMES[message.port]
        return {"at": message.stamp_ns, "do": "read", "port": port, "bytes": len(message.data)}
    for kind, what in ((m.Started, "start"), (m.MapReceived, "map"), (m.Tick, "tick")):
        if isinstance(message, kind):
            return {"at": message.stamp_ns, "do": what}
    if isinstance(message, m.PortOpened):
        port = m.PORT_NAMES[message.port]
        return {"at": message.stamp_ns, "do": "opened", "port": port, "device": message.device}
    if isinstance(message, m.PortLost):
        port = m.PORT_NAMES[message.port]
        return {"at": message.stamp_ns, "do": "lost", "port": port, "reason": message.reason}
    return None


def _drive(run: Run, directory: Path, progress: Callable[[str, int], None]) -> Run:
    """Run the daemon to the end of the log; its own log, opened."""
    logs, address = directory / "log", directory / "lockstep"
    with (
        FakePorts(run) as ports,
        _rosbridge(run.config.ros) as bridge,
        socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as listener,
    ):
        listener.bind(str(address))
        listener.listen(1)
        command = daemon_command(run, directory, ports.paths)
        command += [] if bridge is None else ["--ros", bridge.url]
        command += ["--lockstep", str(address), "--log", str(logs)]
        with (
            DaemonProcess(command, run, directory) as daemon,
            _accepted(listener, ports, daemon) as connection,
        ):
            _instruct(run, connection, ports, bridge, daemon, progress)
            _wait_for_end(ports, daemon)
    runs = open_runs([logs])
    if len(runs) != 1:
        raise HippomatError(f"the replaying daemon wrote {len(runs)} logs instead of one")
    return runs[0]


@contextlib.contextmanager
def _rosbridge(ros: RosConfig) -> Iterator[FakeRosbridge | None]:
    """A stand-in where the run had ROS."""
    if not ros.url:
        yield None
        return
    with FakeRosbridge(once=True) as bridge:
        for topic in topics_of(ros):
            bridge.topic(topic.name, topic.kind)
        yield bridge


def _wait_for_subscriptions(bridge: FakeRosbridge, ros: RosConfig) -> None:
    """What is said before the daemon's feed has subscribed would be lost."""
    until_s = time.monotonic() + ANSWER_S
    while not all(bridge.subscribed(topic.name) for topic in topics_of(ros)):
        if time.monotonic() > until_s:
            raise HippomatError(f"the daemon did not subscribe to ROS's topics within {ANSWER_S:.0f} s")
        time.sleep(0.01)


def _accepted(listener: socket.socket, ports: FakePorts, daemon: DaemonProcess) -> socket.socket:
    """The daemon's connection, made once it has identified its ports."""
    until_s = time.monotonic() + START_S
    while listener.fileno() not in ports.service(0.05, [listener.fileno()]):
        if daemon.exit_code is not None:
            raise HippomatError(f"the daemon ended with {daemon.exit_code}: {daemon.last_words()}")
        if time.monotonic() > until_s:
            raise HippomatError(f"the daemon did not get ready in {START_S:.0f} s: {daemon.last_words()}")
    return listener.accept()[0]


def _instruct(
    run: Run,
    connection: socket.socket,
    ports: FakePorts,
    bridge: FakeRosbridge | None,
    daemon: DaemonProcess,
    progress: Callable[[str, int], None],
) -> None:
    ros = run.config.ros  # reading it is slow
    if bridge is not None:
        _wait_for_subscriptions(bridge, ros)
    last_ns = done = 0
    for record in run.records_in_order(TOLD):
        told = instruction(record.message, ros, run.store)
        if told is None:
            continue
        if isinstance(record.message, SerialRecord):
            ports.ports[record.message.port].offer(record.message.data)
        elif bridge is not None and is_of_ros(record.message, ros):
            bridge.say_event(topic_of(record.message, ros), record.message)
        last_ns = int(told["at"])
        _tell(told, connection, ports, daemon)
        done += 1
        if done % PROGRESS_STEP == 0:
            progress("daemon", record.number)
    _tell({"at": last_ns, "do": "end"}, connection, ports, daemon)


def _tell(told: dict[str, Any], connection: socket.socket, ports: FakePorts, daemon: DaemonProcess) -> None:
    """One line there, one line back, while the ports keep moving."""
    with contextlib.suppress(BrokenPipeError, ConnectionResetError):  # why is asked below
        connection.sendall(json.dumps(told).encode() + b"\n")
    answer, until_s = b"", time.monotonic() + ANSWER_S
    while not answer.endswith(b"\n"):
        if connection.fileno() in ports.service(0.5, [connection.fileno()]):
            chunk = _received(connection)
            if not chunk:
                daemon.wait()
                raise HippomatError(f"the daemon hung up at {told}: {daemon.last_words()}")
            answer += chunk
        elif time.monotonic() > until_s:
            raise HippomatError(f"the daemon did not answer {told} within {ANSWER_S:.0f} s")
    if json.loads(answer).get("ok") is not True:
        raise HippomatError(f"the daemon refused {told}: {answer.decode().strip()}")


def _received(connection: socket.socket) -> bytes:
    try:
        return connection.recv(4096)
    except ConnectionResetError:
        return b""


def _wait_for_end(ports: FakePorts, daemon: DaemonProcess) -> None:
    until_s = time.monotonic() + ANSWER_S
    while daemon.exit_code is None:
        ports.service(0.05)
        if time.monotonic() > until_s:
            raise HippomatError(f"the daemon did not end within {ANSWER_S:.0f} s: {daemon.last_words()}")
    if daemon.exit_code != 0:
        raise HippomatError(f"the daemon ended with {daemon.exit_code}: {daemon.last_words()}")


# ---- comparing two logs ----


def decided(run: Run) -> Iterator[tuple[int, Record]]:
    """(tick, record) of every event and effect."""
    tick = 0
    for record in run.records_in_order(EVENTS + EFFECTS):
        tick += isinstance(record.message, m.Tick)
        yield tick, record


def compare_runs(recorded: Run, again: Run, exact: bool) -> LevelResult:
    """Both logs hold the same events and effects in the same order."""
    compare = EffectComparison(recorded.store, exact)
    started_ns, decisions, compared = int(recorded.manifest.get("started_ns", "0")), 0, 0
    others = decided(again)
    for tick, record in decided(recorded):
        _, other = next(others, (0, None))
        found = ("record", type(record.message).__name__, "the daemon's log ends") if other is None else None
        if other is not None:
            found = compare.first_difference(record.message, other.message)
        if found is not None:
            time_s = (record.log_time_ns - recorded.wall_offset_ns - started_ns) / 1e9
            where = Divergence("daemon", recorded.robot, tick, record.number, time_s, *found)
            return LevelResult("daemon", FAILED, decisions, "decisions", "", [], where)
        compared += 1
        decisions += isinstance(record.message, m.RoundDecided)
    left = next(others, None)
    if left is not None and not recorded.recovered:
        tick, other = left
        where = Divergence("daemon", recorded.robot, tick, 0, 0.0, "record", "the log ends", other.message)
        return LevelResult("daemon", FAILED, decisions, "decisions", "", [], where)
    detail = f"{compared:,} events and effects, on fake ports"
    return LevelResult("daemon", OK if compared else FAILED, decisions, "decisions", detail)
