"""Real pseudo-terminals: exact bytes, closing and reopening, nobody reading, and a foreign lidar client."""

from __future__ import annotations

import contextlib
import math
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import serial
from radio_samples import hello_of_robot
from rplidar import RPLidar
from sim_rooms import box_room

from hippomat_core.messages import BASE, LIDAR, RADIO
from hippomat_core.wire.cobs import FrameDecoder
from hippomat_core.wire.jetbot_base import BAUD, Decoder, decode_feedback, encode_velocity
from hippomat_core.wire.link import HelloReply, decode_message, encode_message
from hippomat_sim.pty_port import PtyPort
from hippomat_sim.simulation import Simulation, SimulationSetup


@pytest.fixture
def port(tmp_path: Path) -> Iterator[PtyPort]:
    port = PtyPort(tmp_path / "device0")
    yield port
    port.close()


def opened(path: Path) -> serial.Serial:
    return serial.Serial(str(path), BAUD, timeout=0.5)


def test_every_byte_passes_unchanged_in_both_directions(port: PtyPort) -> None:
    every_byte = bytes(range(256)) * 2
    with opened(port.link) as host:
        port.write(every_byte, 0.0)
        assert host.read(512) == every_byte
        host.write(every_byte)
        host.flush()
        received = b""
        while len(received) < 512:
            received += port.read()
        assert received == every_byte


def test_the_port_survives_being_closed_and_opened_again(port: PtyPort) -> None:
    for turn in range(3):
        with opened(port.link) as host:
            port.write(b"\x03\x0a\x0d\x11\x13" + bytes([turn]), turn)
            assert host.read(6) == b"\x03\x0a\x0d\x11\x13" + bytes([turn])
        assert port.read() == b""  # nobody there is no error, and nothing is echoed


def test_nobody_reading_never_blocks_and_what_is_dropped_is_counted(port: PtyPort) -> None:
    for k in range(3000):
        port.write(bytes(200), k * 0.01)
    assert port.dropped_bytes > 500_000
    with opened(port.link) as host:
        host.reset_input_buffer()
        port.write(b"fresh", 30.0)
        assert host.read_until(b"fresh").endswith(b"fresh")


def test_a_slow_reader_loses_nothing(port: PtyPort) -> None:
    with opened(port.link) as host:
        taken = b""
        for k in range(20):
            port.write(bytes([k]) * 100, k * 0.4)
            if k % 2:
                taken += host.read(200)
        assert taken == b"".join(bytes([k]) * 100 for k in range(20))
    assert port.dropped_bytes == 0


@contextlib.contextmanager
def running(simulation: Simulation) -> Iterator[None]:
    """The simulation on the real clock, in a thread, until the block ends."""
    ended = threading.Event()

    def pace() -> None:
        start = time.monotonic()
        while not ended.is_set():
            now_us = int((time.monotonic() - start) * 1e6)
            simulation.advance(now_us)
            simulation.serve(simulation.wait_for_bytes(simulation.next_us() / 1e6 - now_us / 1e6), now_us)

    thread = threading.Thread(target=pace)
    thread.start()
    try:
        yield
    finally:
        ended.set()
        thread.join()


@pytest.fixture
def simulation(tmp_path: Path) -> Iterator[Simulation]:
    poses = np.array([[1.0, 1.5, 0.0], [3.0, 1.5, math.pi]])
    simulation = Simulation(SimulationSetup(box_room(), poses), tmp_path / "ports")
    yield simulation
    simulation.close()


class TurningLidar(RPLidar):  # type: ignore[misc]
    """A pseudo-terminal has no DTR line, by which the client switches the motor."""

    def start_motor(self) -> None:
        self.motor_running = True

    def stop_motor(self) -> None:
        self.motor_running = False


def test_a_foreign_rplidar_client_reads_info_health_and_full_sweeps(simulation: Simulation) -> None:
    with running(simulation):
        client = TurningLidar(str(simulation.ports[0][LIDAR].link), timeout=3)
        try:
            assert client.get_info()["model"] == 24
            assert client.get_health() == ("Good", 0)
            sweeps = [sweep for _, sweep in zip(range(3), client.iter_scans(min_len=300), strict=False)]
        finally:
            client.stop()
            client.disconnect()
    for sweep in sweeps[1:]:
        assert len(sweep) > 340
        ahead = [mm for _, angle, mm in sweep if 178 < angle < 182]  # the lidar faces backwards
        assert np.median(ahead) == pytest.approx(2000 - 120, abs=30)  # the other robot


def test_a_base_frame_moves_the_robot_and_its_odometry(simulation: Simulation) -> None:
    link = simulation.ports[0][BASE].link
    with running(simulation), opened(link) as host:
        host.write(encode_velocity(0.2, 0.0))
        feedback = []
        decoder = Decoder()
        while len(feedback) < 25:
            feedback += [decode_feedback(frame) for frame in decoder.feed(host.read(45))]
        host.write(encode_velocity(0.0, 0.0))
    assert feedback[-1].odom_x_mm > 100
    assert simulation.world.poses[0, 0] > 1.1
    assert simulation.world.poses[1] == pytest.approx([3.0, 1.5, math.pi])


def test_the_radio_answers_hello_with_the_identity_it_adopted(simulation: Simulation) -> None:
    with running(simulation), opened(simulation.ports[1][RADIO].link) as host:
        host.write(encode_message(hello_of_robot(1)))
        decoder, messages = FrameDecoder(), []
        while not any(isinstance(message, HelloReply) for message in messages):
            messages += [decode_message(payload) for payload in decoder.feed(host.read(64))]
    reply = next(message for message in messages if isinstance(message, HelloReply))
    assert (reply.robot, reply.fleet) == (1, 1)


def test_a_command_moves_the_world_the_same_way_each_time(tmp_path: Path) -> None:
    def run(name: str) -> np.ndarray:
        poses = np.array([[1.0, 1.5, 0.0], [3.0, 1.5, math.pi]])
        simulation = Simulation(SimulationSetup(box_room(), poses, seed=4), tmp_path / name)
        try:
            simulation.robots[0].base.receive(encode_velocity(0.2, 0.3))
            for robot in simulation.robots:
                robot.lidar.receive(b"\xa5\x20")
            simulation.advance(2_000_000)
            return np.array([poses for _, poses, _ in simulation.truth])
        finally:
            simulation.close()

    assert np.array_equal(run("a"), run("b"))
