"""A port that goes away and comes back under the same name, while the daemon goes on."""

from __future__ import annotations

import signal
from pathlib import Path

from host_devices import wait_until
from host_process import driving_robot

from hippomat_core.messages import LIDAR, RADIO, PortLost, PortOpened
from hippomat_host.links import FIRST_RETRY_NS, LAST_RETRY_NS, Backoff
from hippomat_logs.reader import read_records


def test_back_off_doubles_from_a_tenth_of_a_second_to_five() -> None:
    backoff = Backoff()
    waits = [backoff.next_ns(0) for _ in range(8)]
    assert waits[:3] == [FIRST_RETRY_NS, 2 * FIRST_RETRY_NS, 4 * FIRST_RETRY_NS]
    assert waits[-1] == LAST_RETRY_NS
    backoff.reset()
    assert backoff.next_ns(0) == FIRST_RETRY_NS


def test_every_port_is_reopened_after_unplugging_and_the_robot_drives_on(tmp_path: Path) -> None:
    with driving_robot(tmp_path) as robot:
        assert robot.process is not None
        for device in (robot.radio, robot.lidar):
            device.unplug()
        assert wait_until(lambda: robot.said().count("was lost") == 2), robot.said()
        robot.radio.hellos.clear()
        robot.lidar.scanning = False
        for device in (robot.radio, robot.lidar):
            device.plug_in()
        assert wait_until(lambda: bool(robot.radio.hellos) and robot.lidar.scanning), robot.said()
        robot.base.unplug()
        assert wait_until(lambda: robot.said().count("was lost") == 3), robot.said()
        robot.base.velocities.clear()
        robot.base.plug_in()
        assert wait_until(lambda: bool(robot.base.velocities)), robot.said()
        assert wait_until(robot.drives, 20.0), robot.said()
        robot.process.send_signal(signal.SIGTERM)
        assert robot.process.wait(10.0) == 0
        (log,) = robot.log.iterdir()
        messages = [message for *_, message in read_records(log)]
        opened = [message.port for message in messages if isinstance(message, PortOpened)]
        lost = [message.port for message in messages if isinstance(message, PortLost)]
        assert sorted(opened) == [0, 0, 1, 1, 2, 2]
        assert sorted(lost) == [0, 1, 2]
        assert {RADIO, LIDAR} == set(lost[:2])


def test_another_device_under_the_old_name_is_named_and_not_used(tmp_path: Path) -> None:
    with driving_robot(tmp_path) as robot:
        robot.radio.unplug()
        assert wait_until(lambda: "was lost" in robot.said()), robot.said()
        robot.radio.robot = 4
        robot.radio.plug_in()
        assert wait_until(lambda: "is robot 4, not robot 0" in robot.said()), robot.said()
        robot.radio.bodies.clear()
        assert not wait_until(lambda: bool(robot.radio.bodies), 0.5)
