"""The three devices on pseudo-terminals, in threads of the test, speaking the real protocols.

They do what the hardware does and keep what they were told with its stamp. The base holds its last velocity
for ever.
"""

from __future__ import annotations

import contextlib
import math
import os
import select
import threading
import time
import tty
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from radio_samples import reply_of, status_of

from hippomat_core.wire import jetbot_base, rplidar
from hippomat_core.wire.cobs import FrameDecoder, encode
from hippomat_core.wire.frames import PROTOCOL_VERSION
from hippomat_core.wire.link import (
    LINK_VERSION,
    Hello,
    SendBody,
    decode_message,
    encode_message,
    encode_payload,
)


class Device(threading.Thread):
    """One device behind `link`, a name that outlives unplugging."""

    period_s = 0.02

    def __init__(self, link: Path) -> None:
        super().__init__(name=type(self).__name__, daemon=True)
        self.link = link
        self.received: list[tuple[float, bytes]] = []  # monotonic [s], bytes
        self._ended = threading.Event()
        self._lock = threading.Lock()
        self.plug_in()
        self.start()

    def plug_in(self) -> None:
        with self._lock:
            self.fd, self._slave = os.openpty()
            tty.setraw(self._slave)
            os.set_blocking(self.fd, False)
            self.link.unlink(missing_ok=True)
            self.link.symlink_to(os.ttyname(self._slave))
            self.plugged = True

    def unplug(self) -> None:
        with self._lock:
            if self.plugged:
                self.plugged = False
                os.close(self.fd)
                os.close(self._slave)
                self.link.unlink(missing_ok=True)

    def close(self) -> None:
        self._ended.set()
        self.join()
        self.unplug()

    def run(self) -> None:
        while not self._ended.is_set():
            with self._lock:
                if self.plugged:
                    self._serve()
            time.sleep(0.001)

    def _serve(self) -> None:
        if select.select([self.fd], [], [], 0.005)[0]:
            data = os.read(self.fd, 4096)
            self.received.append((time.monotonic(), data))
            self.hears(data)
        self.passes(time.monotonic())

    def sends(self, data: bytes) -> None:
        with contextlib.suppress(BlockingIOError):
            os.write(self.fd, data)

    def hears(self, data: bytes) -> None:
        """Bytes from the host."""

    def passes(self, now_s: float) -> None:
        """Time."""


class Silent(Device):
    """A port with nothing behind it."""


class Chatter(Device):
    """A device of another kind, e.g. a GPS receiver."""

    def passes(self, now_s: float) -> None:  # noqa: ARG002
        self.sends(b"$GPGGA,123519,4807.038,N,01131.000,E,1,08,0.9,545.4,M,46.9,M,,*47\r\n")
        time.sleep(0.02)


class Base(Device):
    """The base: feedback at 50 Hz, keeps its last velocity."""

    def __init__(self, link: Path) -> None:
        self.velocities: list[tuple[float, float, float]] = []  # monotonic [s], v, wz
        self._decoder = jetbot_base.Decoder()
        self._next_s = 0.0
        self._pose = [0.0, 0.0, 0.0]
        super().__init__(link)

    @property
    def velocity(self) -> tuple[float, float]:
        return self.velocities[-1][1:] if self.velocities else (0.0, 0.0)

    def moving(self) -> bool:
        return self.velocity != (0.0, 0.0)

    def hears(self, data: bytes) -> None:
        for frame in self._decoder.feed(data):
            if frame.type == jetbot_base.VELOCITY:
                self.velocities.append((time.monotonic(), *jetbot_base.decode_velocity(frame)))

    def passes(self, now_s: float) -> None:
        if now_s < self._next_s:
            return
        self._next_s = now_s + 0.02
        v, wz = self.velocity
        x, y, yaw = self._pose
        moved = (x + v * 0.02 * math.cos(yaw), y + v * 0.02 * math.sin(yaw), yaw + wz * 0.02)
        self._pose = list(moved)
        self.sends(
            jetbot_base.encode_feedback(
                jetbot_base.Feedback(
                    odom_x_mm=round(moved[0] * 1000),
                    odom_y_mm=round(moved[1] * 1000),
                    odom_yaw_mrad=round(moved[2] * 1000),
                    delta_x_mm=round(v * 20),
                    delta_yaw_mrad=round(wz * 20),
                )
            )
        )


class Radio(Device):
    """The radio: answers Hello, adopts an id, status once a second, keeps the bodies it should send."""

    def __init__(
        self, link: Path, robot: int = 255, fleet: int = 1, protocol: int = PROTOCOL_VERSION, boot_id: int = 7
    ) -> None:
        self.robot, self.fleet, self.protocol, self.boot_id = robot, fleet, protocol, boot_id
        self._own_robot, self.schedule = robot, (100, 5)
        self.bodies: list[SendBody] = []
        self.hellos: list[Hello] = []
        self._frames = FrameDecoder()
        self._next_s = 0.0
        super().__init__(link)

    def hears(self, data: bytes) -> None:
        for payload in self._frames.feed(data):
            message = decode_message(payload)
            if isinstance(message, Hello):
                self.hellos.append(message)
                if message.link_version == LINK_VERSION:
                    self.robot = message.robot if self.robot == 255 else self.robot
                    self.schedule = (message.round_ms, message.slots)
                self.sends(self._reply())
            elif isinstance(message, SendBody):
                self.bodies.append(message)

    def passes(self, now_s: float) -> None:
        if now_s >= self._next_s:
            self._next_s = now_s + 1.0
            self.sends(encode_message(status_of(uptime_us=int(now_s * 1e6), **self._identity())))

    def restart(self) -> None:
        """It forgets the schedule, and its id where it had adopted one."""
        self.boot_id, self.robot, self.schedule = self.boot_id + 1, self._own_robot, (100, 5)

    def _identity(self) -> dict[str, int]:
        round_ms, slots = self.schedule
        identity = {"boot_id": self.boot_id, "robot": self.robot, "fleet": self.fleet}
        return {**identity, "round_ms": round_ms, "slots": slots}

    def _reply(self) -> bytes:
        reply = reply_of(mac=bytes(range(6)), **self._identity())
        payload = bytearray(encode_payload(reply))
        payload[2] = self.protocol
        return encode(bytes(payload))


class Lidar(Device):
    """The lidar: 360 samples a sweep, 8 sweeps a second, walls at 3 m all around."""

    info = rplidar.Info(24, 29, 1, 7, bytes(range(16)))

    def __init__(self, link: Path) -> None:
        self.scanning = False
        self._requests = rplidar.RequestDecoder()
        self._next_s = 0.0
        angles = np.arange(360, dtype=np.uint16) * 64
        self.sweep = rplidar.Sweep(
            np.full(360, 47, np.uint8), angles, np.full(360, 12_000, np.uint16)
        ).encode()
        super().__init__(link)

    def hears(self, data: bytes) -> None:
        for command in self._requests.feed(data):
            if command == rplidar.GET_INFO:
                self.sends(rplidar.encode_info(self.info))
            elif command == rplidar.SCAN:
                self.sends(rplidar.encode_scan_descriptor())
            self.scanning = command == rplidar.SCAN or (self.scanning and command == rplidar.GET_HEALTH)

    def passes(self, now_s: float) -> None:
        if self.scanning and now_s >= self._next_s:
            self._next_s = now_s + 0.125
            self.sends(self.sweep)


@contextlib.contextmanager
def plugged(*devices: Device) -> Iterator[None]:
    """Devices that are unplugged at the end, whatever happens."""
    try:
        yield
    finally:
        for device in devices:
            device.close()


def wait_until(true_at_last: object, timeout_s: float = 30.0) -> bool:
    """Poll a callable; False if it was not true in time."""
    assert callable(true_at_last)
    until_s = time.monotonic() + timeout_s
    while not true_at_last():
        if time.monotonic() > until_s:
            return False
        time.sleep(0.01)
    return True
