"""The process that drives a base through ROS: velocities as /cmd_vel behind a dead man's switch (deadman.py).

It repeats the daemon's velocity at a steady rate, and zeros when none came for 200 ms or the daemon is gone.
What it cannot do: stop a robot that it does not reach. If rosbridge or the network fails, the base's own
driver must stop by its time-out (docs/ros.md). Its connection is its own: no map is ever in a command's way.

    python -m hippomat_host.ros.base_guard CONFIG    stdin: socket to the daemon; stdout: reports, JSON lines
"""

from __future__ import annotations

import contextlib
import json
import select
import signal
import socket
import sys
import time
from typing import Any

from hippomat_core.config import RosConfig
from hippomat_core.errors import HippomatError
from hippomat_core.wire.jetbot_base import Decoder, decode_velocity
from hippomat_host.base_guard import LAST_ZEROS, report
from hippomat_host.deadman import ZERO, Deadman
from hippomat_logs.ros.client import Rosbridge
from hippomat_logs.ros.rosbridge import advertise, publish, unadvertise

Twist = dict[str, Any]


class _Stop(Exception):
    """The daemon is gone, or said so."""


class Guard:
    """One connection, one daemon, which sends velocity frames as to a serial base."""

    def __init__(self, ros: RosConfig, bridge: Rosbridge, daemon: socket.socket) -> None:
        self._ros, self._bridge, self._daemon = ros, bridge, daemon
        self._commands = Decoder()
        self._deadman = Deadman(period_ns=round(1e9 / ros.cmd_vel_hz))
        self._tripped = False
        bridge.say(advertise(ros.cmd_vel_topic, f"geometry_msgs/{ros.cmd_vel_type}"))

    def run(self) -> None:
        """Forward until the daemon or the connection is gone; raises _Stop or PortError."""
        while True:
            now_ns = time.monotonic_ns()
            self._drive(now_ns)
            wait_s = max(0, self._deadman.next_ns - now_ns) / 1e9
            if select.select([self._daemon], [], [], wait_s)[0]:
                self._take_commands()
            self._listen()

    def stop(self) -> None:
        """The last words to the base."""
        for _ in range(LAST_ZEROS):
            self._say(ZERO)
            time.sleep(1.0 / self._ros.cmd_vel_hz / 2)
        self._bridge.say(unadvertise(self._ros.cmd_vel_topic))

    def _take_commands(self) -> None:
        try:
            data = self._daemon.recv(4096)
        except OSError as error:
            raise _Stop(f"the daemon is gone: {error.strerror}") from None
        if not data:
            raise _Stop("the daemon is gone")
        for frame in self._commands.feed(data):
            self._deadman = self._deadman.commanded(time.monotonic_ns(), frame)
        self._tripped = False

    def _drive(self, now_ns: int) -> None:
        self._deadman, frame = self._deadman.output(now_ns)
        if frame:
            self._say(frame)
        commanded_ns = self._deadman.commanded_ns
        if frame and commanded_ns is not None and self._deadman.silent(now_ns) and not self._tripped:
            self._tripped = True
            report(silent_ns=time.monotonic_ns() - commanded_ns)

    def _listen(self) -> None:
        """A connection that was closed is noticed here; what rosbridge says is for the user."""
        said = self._bridge.hear(0)
        if said is not None and said["op"] == "status" and said.get("level") == "error":
            report(remark=f"rosbridge says: {' '.join(str(said.get('msg')).split())[:200]}")

    def _say(self, frame: bytes) -> None:
        (decoded,) = Decoder().feed(frame)
        message = twist(*decode_velocity(decoded))
        if self._ros.cmd_vel_type == "TwistStamped":  # the stamp is left to rosbridge: its clock is ROS's
            message = {"header": {"frame_id": self._ros.base_frame}, "twist": message}
        self._bridge.say(publish(self._ros.cmd_vel_topic, message))


def twist(v_mps: float, wz_radps: float) -> Twist:
    """geometry_msgs/Twist: x forward, turn about z."""
    return {
        "linear": {"x": v_mps, "y": 0.0, "z": 0.0},
        "angular": {"x": 0.0, "y": 0.0, "z": wz_radps},
    }


def main(settings: str) -> int:
    """0 if the daemon ended it, 1 if the connection did."""
    for number in (signal.SIGINT, signal.SIGHUP):
        signal.signal(number, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, _terminated)
    ros = RosConfig(**json.loads(settings))
    try:
        with Rosbridge(ros.url) as bridge:
            guard = Guard(ros, bridge, socket.socket(fileno=0))
            report(connected=ros.url)
            return _guarded(guard)
    except _Stop:
        return 0
    except HippomatError as error:
        report(failed=str(error))
        return 1


def _guarded(guard: Guard) -> int:
    try:
        guard.run()
    except _Stop:
        return 0
    finally:
        signal.signal(signal.SIGTERM, signal.SIG_IGN)
        with contextlib.suppress(HippomatError):
            guard.stop()
    return 0


def _terminated(_signal: int, _frame: object) -> None:
    raise _Stop("terminated")


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
