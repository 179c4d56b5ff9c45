"""Pseudo-terminals in the place of the recorded devices: they identify themselves, then offer recorded bytes.

Decides when a question is answered; which bytes come when is the replayer's affair. What the daemon writes is
drained and counted. Linux and other systems with pseudo-terminals.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import pty
import select
import termios
import tty
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from hippomat_core import messages as m
from hippomat_core.errors import LogError, WireError
from hippomat_core.wire import cobs, jetbot_base, link, rplidar
from hippomat_logs.reader import Run
from hippomat_logs.records import FROM_DEVICE, IDENTIFICATION, RUNNING, SerialRecord

Responder = Callable[[bytes], bytes]  # what the host wrote -> what the device answers


class FakePort:
    """One pseudo-terminal. `offer` what the device sends; service() moves bytes both ways without waiting."""

    def __init__(self, port: int, opening: bytes, responder: Responder) -> None:
        self.port = port
        self._master, self._slave = pty.openpty()  # our slave end keeps the master alive between two daemons
        tty.setraw(self._slave, termios.TCSANOW)
        os.set_blocking(self._master, False)
        self.path = os.ttyname(self._slave)
        self._responder = responder
        self._unsent = bytearray(opening)
        self.written_bytes = 0  # by the daemon

    def fileno(self) -> int:
        return self._master

    @property
    def wants_to_write(self) -> bool:
        return bool(self._unsent)

    @property
    def pending_bytes(self) -> int:
        """Bytes offered that nobody has read yet."""
        waiting = fcntl.ioctl(self._slave, termios.FIONREAD, bytes(4))
        return len(self._unsent) + int.from_bytes(waiting, "little")

    def offer(self, data: bytes) -> None:
        self._unsent += data

    def service(self) -> None:
        with contextlib.suppress(BlockingIOError):
            heard = os.read(self._master, 65536)
            self.written_bytes += len(heard)
            self._unsent += self._responder(heard)
        with contextlib.suppress(BlockingIOError):
            if self._unsent:
                del self._unsent[: os.write(self._master, self._unsent)]

    def close(self) -> None:
        os.close(self._master)
        os.close(self._slave)


class FakePorts:
    """The ports that a run had, as a context; `paths` by messages.RADIO, BASE, LIDAR."""

    def __init__(self, run: Run) -> None:
        heard = identification_bytes(run)
        self.ports = {port: _fake(port, data) for port, data in heard.items()}

    @property
    def paths(self) -> dict[int, str]:
        return {number: port.path for number, port in self.ports.items()}

    def service(self, timeout_s: float, also: Sequence[int] = ()) -> list[int]:
        """Move bytes for at most `timeout_s`; returns the descriptors of `also` that became readable."""
        ports = list(self.ports.values())
        writers = [port for port in ports if port.wants_to_write]
        readable, _, _ = select.select([*(port.fileno() for port in ports), *also], writers, [], timeout_s)
        for port in ports:
            port.service()
        return [fd for fd in also if fd in readable]

    def link_into(self, directory: Path) -> dict[int, Path]:
        """Symbolic links with readable names, as udev makes them."""
        links = {number: directory / m.PORT_NAMES[number] for number in self.ports}
        for number, path in links.items():
            path.unlink(missing_ok=True)
            path.symlink_to(self.ports[number].path)
        return links

    def __enter__(self) -> FakePorts:
        return self

    def __exit__(self, *_: object) -> None:
        for port in self.ports.values():
            port.close()


def identification_bytes(run: Run) -> dict[int, bytes]:
    """What each device sent while it was identified, by port, up to its first running byte."""
    heard: dict[int, bytearray] = {}
    running: set[int] = set()
    for record in run.records_in_order((SerialRecord, m.PortOpened)):
        serial = record.message
        if isinstance(serial, m.PortOpened):
            running.add(serial.port)
            heard.setdefault(serial.port, bytearray())
        if not isinstance(serial, SerialRecord) or serial.direction != FROM_DEVICE or serial.port in running:
            continue
        if serial.phase == IDENTIFICATION:
            heard.setdefault(serial.port, bytearray()).extend(serial.data)
        elif serial.phase == RUNNING:
            running.add(serial.port)
    with_ros = bool(run.config.ros.url)  # what ROS stands in for says nothing of itself
    return {port: bytes(data) for port, data in heard.items() if data or not with_ros}


def _fake(port: int, heard: bytes) -> FakePort:
    if port == m.BASE:
        return FakePort(port, _last_feedback(heard), lambda _: b"")
    if port == m.RADIO:
        return FakePort(port, b"", _Radio(heard))
    return FakePort(port, b"", _Lidar(heard))


def _last_feedback(heard: bytes) -> bytes:
    frames = [frame for frame in jetbot_base.Decoder().feed(heard) if frame.type == jetbot_base.FEEDBACK]
    if not frames:
        raise LogError("the log holds no frame by which the base was identified")
    return frames[-1].encode()


class _Radio:
    """Answers the first Hello of every identification with the recorded reply."""

    def __init__(self, heard: bytes) -> None:
        replies = [data for data in cobs.FrameDecoder().feed(heard) if data[:1] == bytes([link.HELLO_REPLY])]
        if not replies:
            raise LogError("the log holds no answer by which the radio was identified")
        self._reply = cobs.encode(replies[-1])
        self._frames = cobs.FrameDecoder()

    def __call__(self, heard: bytes) -> bytes:
        return b"".join(self._reply for payload in self._frames.feed(heard) if _is_hello(payload))


def _is_hello(payload: bytes) -> bool:
    try:
        return isinstance(link.decode_message(payload), link.Hello)
    except WireError:
        return False


class _Lidar:
    """Answers GET_INFO and GET_HEALTH; a scan's bytes, descriptor included, are offered by the replayer."""

    def __init__(self, heard: bytes) -> None:
        info, health = rplidar.find_info(heard), rplidar.find_health(heard)
        if info is None:
            raise LogError("the log holds no answer by which the lidar was identified")
        good = rplidar.Health(0, 0)
        self._answers = {
            rplidar.GET_INFO: rplidar.encode_info(info),
            rplidar.GET_HEALTH: rplidar.encode_health(health or good),
        }
        self._requests = rplidar.RequestDecoder()

    def __call__(self, heard: bytes) -> bytes:
        return b"".join(self._answers.get(command, b"") for command in self._requests.feed(heard))


def running_reads(run: Run) -> Iterator[SerialRecord]:
    """Every read of the running phase, in order."""
    for record in run.records_in_order((SerialRecord,)):
        serial = record.message
        if isinstance(serial, SerialRecord) and (serial.direction, serial.phase) == (FROM_DEVICE, RUNNING):
            yield serial
