"""One robot's computer without its process: bytes -> events -> step() -> effects -> bytes, like the daemon.

The order of records is the daemon's (hippomat_host/daemon.py). Knows no world and no other robot; time comes
with every call, and the devices' bytes wait in an inbox until the robot looks, as they do on a real one.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import Any, Protocol

from hippomat_core.config import Config
from hippomat_core.maps.map_event import map_event
from hippomat_core.maps.occupancy_grid import OccupancyGrid
from hippomat_core.messages import (
    BASE,
    LIDAR,
    PORT_NAMES,
    RADIO,
    Effect,
    Event,
    PortOpened,
    RadioStatus,
    Started,
    Tick,
)
from hippomat_core.step import initial_state, step
from hippomat_core.wire import rplidar
from hippomat_core.wire.device_commands import command_of, hello_of, to_be_told
from hippomat_core.wire.device_events import DeviceDecoder, decoder_for
from hippomat_core.wire.jetbot_base import encode_velocity
from hippomat_core.wire.link import encode_message
from hippomat_logs.records import FROM_DEVICE, IDENTIFICATION, RUNNING, TO_DEVICE

TICK_US = 50_000
LOOK_US = 4_000  # as long a daemon lets bytes gather
PORTS = (RADIO, BASE, LIDAR)
_NEVER_US = 2**62

Write = Callable[[int, bytes, int], None]  # port, bytes, now [us]
Feed = Callable[[Event], None]


class Recording(Protocol):
    """Where a robot's records go: a log, or figures that are made of them at once."""

    def put(self, stamp_ns: int, message: Event | Effect) -> None: ...
    def serial(self, stamp_ns: int, port: int, direction: int, phase: int, data: bytes) -> None: ...
    def close(self) -> Any: ...


class LockstepRobot:
    """begin() once, then act() whenever due_us says so, stop() at the end.

    stamp_ns of world time 0 is origin_ns. begins_us: the robot's devices were asked who they are shortly
    before, as in identify(). first_tick_us later comes its first tick: while a computer starts slowly, the
    buffers of its ports overflow, and what came more than 50 ms before that tick is never read.
    """

    def __init__(
        self,
        config: Config,
        policy: bytes | None,
        grid: OccupancyGrid,
        begins_us: int,
        origin_ns: int,
        write: Write,
        first_tick_us: int = TICK_US,
    ) -> None:
        self.config = config
        self.due_us = begins_us
        self._begins_us, self._origin_ns, self._write = begins_us, origin_ns, write
        self._grid = grid
        self._state = initial_state(config, policy)
        self._decoders: dict[int, DeviceDecoder] = {}
        self._inbox: deque[tuple[int, bytes]] = deque()
        self._asked: list[tuple[int, int, bytes]] = []  # port, direction, bytes
        self._recording: Recording | None = None
        self._tick_us = begins_us + first_tick_us
        self._looks_from_us = self._tick_us - TICK_US

    @property
    def running(self) -> bool:
        return self._recording is not None and self.due_us < _NEVER_US

    def identify(self, now_us: int) -> None:
        """What a daemon asks before it starts: a radio learns from it who it is and what its rounds are."""
        for port, data in (
            (RADIO, encode_message(hello_of(self.config))),
            (LIDAR, rplidar.request(rplidar.GET_INFO)),
        ):
            self._asked.append((port, TO_DEVICE, data))
            self._write(port, data, now_us)

    def hear(self, port: int, data: bytes, now_us: int) -> None:
        """A device sent bytes; they wait until act()."""
        if self.due_us == _NEVER_US:
            return
        if self._recording is None:
            self._asked.append((port, FROM_DEVICE, data))
            return
        if now_us < self._looks_from_us:
            return
        self._inbox.append((port, data))
        looks = -(-(now_us - self._begins_us) // LOOK_US)
        self.due_us = min(self.due_us, self._begins_us + looks * LOOK_US)

    def begin(self, now_us: int, recording: Recording) -> None:
        """The first events of a run."""
        self._recording = recording
        stamp_ns = self._stamp_ns(now_us)
        self._feed(Started(stamp_ns), now_us)
        self._feed(map_event(self._grid, stamp_ns, 1), now_us)
        for port in PORTS:
            for asked, direction, data in self._asked:
                if asked == port:
                    recording.serial(stamp_ns, port, direction, IDENTIFICATION, data)
            self._decoders[port] = decoder_for(port)
            self._feed(PortOpened(stamp_ns, port, f"simulated {PORT_NAMES[port]}"), now_us)
            if port == LIDAR:
                self._send(LIDAR, rplidar.request(rplidar.SCAN), now_us)
        self._asked.clear()
        self.due_us = self._tick_us

    def act(self, now_us: int) -> None:
        """Read what has come, then tick if it is time: the daemon's order."""
        while self._inbox:
            self._read(*self._joined(), now_us)
        if now_us >= self._tick_us:
            self._tick_us += TICK_US
            self._feed(Tick(self._stamp_ns(now_us)), now_us)
        self.due_us = min(self._tick_us, now_us + LOOK_US) if self._inbox else self._tick_us

    def stop(self, now_us: int) -> None:
        """Motors first, then the lidar, then the log."""
        if self._recording is None or self.due_us == _NEVER_US:
            return
        self._send(BASE, encode_velocity(0.0, 0.0), now_us)
        self._send(LIDAR, rplidar.request(rplidar.STOP), now_us)
        self._recording.close()
        self._inbox.clear()
        self.due_us = _NEVER_US

    def _joined(self) -> tuple[int, bytes]:
        """The oldest bytes of the inbox, with all that follow them from the same port."""
        port, data = self._inbox.popleft()
        while self._inbox and self._inbox[0][0] == port:
            data += self._inbox.popleft()[1]
        return port, data

    def _read(self, port: int, data: bytes, now_us: int) -> None:
        assert self._recording is not None
        stamp_ns = self._stamp_ns(now_us)
        self._recording.serial(stamp_ns, port, FROM_DEVICE, RUNNING, data)
        for event in self._decoders[port].events(stamp_ns, data):
            self._feed(event, now_us)

    def _feed(self, event: Event, now_us: int) -> None:
        assert self._recording is not None
        self._recording.put(event.stamp_ns, event)
        self._state, effects = step(self._state, event)
        for effect in effects:
            self._recording.put(event.stamp_ns, effect)
        for effect in effects:
            command = command_of(effect)
            if command is not None:
                self._send(*command, now_us)
        if isinstance(event, RadioStatus) and to_be_told(self.config, event):
            self._send(RADIO, encode_message(hello_of(self.config)), now_us)

    def _send(self, port: int, data: bytes, now_us: int) -> None:
        assert self._recording is not None
        self._recording.serial(self._stamp_ns(now_us), port, TO_DEVICE, RUNNING, data)
        self._write(port, data, now_us)

    def _stamp_ns(self, now_us: int) -> int:
        return self._origin_ns + now_us * 1000
