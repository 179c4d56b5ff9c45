"""The pseudo-terminals that stand for recorded devices."""

from __future__ import annotations

import io
import os
import re
import select
import threading
import time
from pathlib import Path

import pytest
from radio_samples import hello_of_robot, reply_of
from recorded_run import peer_bytes, record_run, sweep_bytes
from rich.console import Console

from hippomat_core import messages as m
from hippomat_core.errors import HippomatError
from hippomat_core.wire import cobs, jetbot_base, link, rplidar
from hippomat_logs.fake_ports import FakePorts
from hippomat_logs.reader import Run, open_runs
from hippomat_logs.serve import serve

HELLO_REPLY_BYTES = len(link.encode_message(reply_of(boot_id=77, robot=0)))


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    directory = tmp_path_factory.mktemp("fake")
    record_run(directory, ticks=10)
    return open_runs([directory])[0]


def read_until(fd: int, count: int, ports: FakePorts | None) -> bytes:
    data, until_s = b"", time.monotonic() + 10
    while len(data) < count and time.monotonic() < until_s:
        if ports is not None:
            ports.service(0.01)
        if select.select([fd], [], [], 0.01)[0]:
            data += os.read(fd, count - len(data))
    return data


def test_each_device_identifies_itself_as_recorded(run: Run) -> None:
    with FakePorts(run) as ports:
        fds = {port: os.open(path, os.O_RDWR | os.O_NOCTTY) for port, path in ports.paths.items()}
        feedback = read_until(fds[m.BASE], 45, ports)
        assert [frame.type for frame in jetbot_base.Decoder().feed(feedback)] == [jetbot_base.FEEDBACK]
        os.write(fds[m.RADIO], link.encode_message(hello_of_robot(0)))
        reply = read_until(fds[m.RADIO], HELLO_REPLY_BYTES, ports)
        os.write(fds[m.LIDAR], rplidar.request(rplidar.STOP) + rplidar.request(rplidar.GET_INFO))
        info = rplidar.find_info(read_until(fds[m.LIDAR], 27, ports))
        assert info is not None
        assert info.serial == bytes(16)
        payloads = list(cobs.FrameDecoder().feed(reply))
        assert isinstance(link.decode_message(payloads[0]), link.HelloReply)
        for fd in fds.values():
            os.close(fd)


def test_more_bytes_than_a_terminal_holds_arrive_whole(run: Run) -> None:
    data = bytes(range(256)) * 100
    with FakePorts(run) as ports:
        fd = os.open(ports.paths[m.LIDAR], os.O_RDWR | os.O_NOCTTY)
        ports.ports[m.LIDAR].offer(data)
        assert read_until(fd, len(data), ports) == data
        os.close(fd)


def test_serve_offers_the_recorded_bytes_to_a_daemon_of_the_users(run: Run) -> None:
    said = io.StringIO()
    codes: list[int] = []
    server = threading.Thread(target=lambda: codes.append(serve([run], Console(file=said, width=500), 20.0)))
    server.start()
    until_s = time.monotonic() + 10
    while "waiting" not in said.getvalue() and time.monotonic() < until_s:
        time.sleep(0.01)
    assert "start the daemon: hippomat-host --port" in said.getvalue()
    paths = dict(re.findall(r"(radio|lidar|base) +\S+ -> (\S+)", said.getvalue()))
    fds = {name: os.open(path, os.O_RDWR | os.O_NOCTTY) for name, path in paths.items()}
    os.write(fds["radio"], link.encode_message(hello_of_robot(0)))
    scan = read_until(fds["lidar"], 5 * len(sweep_bytes()), None)
    assert len(scan) == 5 * len(sweep_bytes())
    assert scan == 5 * sweep_bytes()
    radio = read_until(fds["radio"], HELLO_REPLY_BYTES + 5 * len(peer_bytes(0)), None)
    read_until(fds["base"], 45 * 11, None)
    messages = [link.decode_message(payload) for payload in cobs.FrameDecoder().feed(radio)]
    assert isinstance(messages[0], link.HelloReply)
    assert isinstance(messages[1], link.Heard)
    for fd in fds.values():
        os.close(fd)
    server.join(20)
    assert codes == [0]


def test_serve_wants_one_run_of_each_robot(run: Run) -> None:
    with pytest.raises(HippomatError, match="robot 0 has two runs"):
        serve([run, run], Console(file=io.StringIO()))


def test_serve_goes_on_step_by_step_as_it_is_asked(run: Run) -> None:
    """Enter: one read; a number; seconds; nonsense is told; q ends it."""
    said, (keyboard, typed) = io.StringIO(), os.pipe()
    codes: list[int] = []
    console = Console(file=said, width=500)
    server = threading.Thread(target=lambda: codes.append(serve([run], console, 1.0, True, keyboard)))
    server.start()
    until_s = time.monotonic() + 10
    while "waiting" not in said.getvalue() and time.monotonic() < until_s:
        time.sleep(0.01)
    paths = dict(re.findall(r"(radio|lidar|base) +\S+ -> (\S+)", said.getvalue()))
    fds = {name: os.open(path, os.O_RDWR | os.O_NOCTTY) for name, path in paths.items()}
    os.write(fds["radio"], link.encode_message(hello_of_robot(0)))
    feedback = read_until(fds["base"], 45, None)  # of the identification
    os.write(typed, b"\n")
    feedback += read_until(fds["base"], 45, None)
    assert len(feedback) == 90
    radio = read_until(fds["radio"], HELLO_REPLY_BYTES, None)
    os.write(typed, b"what\n1\n")
    assert len(read_until(fds["radio"], len(peer_bytes(0)), None)) == len(peer_bytes(0))
    assert len(radio) == HELLO_REPLY_BYTES
    os.write(typed, b"0.1s\n")
    assert len(read_until(fds["base"], 90, None)) == 90  # the ticks at 0.05 s and 0.1 s
    os.write(typed, b"q\n")
    server.join(20)
    assert codes == [0]
    assert "'what'? Enter: one read" in said.getvalue()
    assert re.search(r"0\.005 s  robot 0  radio \d+ bytes >", said.getvalue())
    for fd in (*fds.values(), keyboard, typed):
        os.close(fd)


def test_links_have_the_ports_names(run: Run, tmp_path: Path) -> None:
    with FakePorts(run) as ports:
        links = ports.link_into(tmp_path)
        assert {path.name for path in links.values()} == {"radio", "base", "lidar"}
        assert os.readlink(links[m.BASE]) == ports.paths[m.BASE]
