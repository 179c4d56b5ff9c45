"""The loop: happening -> bytes -> events -> step() -> effects -> bytes, and a record of each, in that order.

Decides nothing about robot or fleet; that is hippomat_core.step. Real time and replay differ only in the
reactor. Records are written in the order that replay relies on: the read, then for each event from it the
event, its effects, and the bytes written because of them.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Protocol

from hippomat_core.config import Config
from hippomat_core.maps.map_event import grid_in, map_event
from hippomat_core.maps.occupancy_grid import OccupancyGrid
from hippomat_core.messages import (
    BASE,
    LIDAR,
    PORT_NAMES,
    RADIO,
    ROS,
    AlarmCleared,
    AlarmRaised,
    Effect,
    Event,
    LoopsDue,
    MapReceived,
    PortLost,
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
from hippomat_host import happenings
from hippomat_host.clock import acted, now
from hippomat_host.fleet_view import FleetView
from hippomat_host.happenings import Happening
from hippomat_host.links import Link
from hippomat_host.loop_solver import LoopSolver
from hippomat_host.process_use import used
from hippomat_host.reactor import Reactor
from hippomat_host.screen import REFRESH_S, Screen
from hippomat_logs.recorder import RecorderStatus
from hippomat_logs.records import FROM_DEVICE, IDENTIFICATION, RUNNING, TO_DEVICE

USE_PERIOD_NS = 1_000_000_000


class Recording(Protocol):
    """What the loop needs of a recorder; hippomat_logs.recorder.Recorder is one."""

    def put(self, stamp_ns: int, message: Event | Effect) -> None: ...
    def serial(self, stamp_ns: int, port: int, direction: int, phase: int, data: bytes) -> None: ...
    def timing(self, stamp_ns: int, compute_ns: int, lag_ns: int) -> None: ...
    def process(self, stamp_ns: int, real_ns: int, cpu_ns: int, peak_memory_kib: int) -> None: ...
    def status(self) -> RecorderStatus: ...
    def close(self, timeout_s: float = 10.0) -> RecorderStatus: ...


class NoRecording:
    """--no-log."""

    def put(self, stamp_ns: int, message: Event | Effect) -> None: ...
    def serial(self, stamp_ns: int, port: int, direction: int, phase: int, data: bytes) -> None: ...
    def timing(self, stamp_ns: int, compute_ns: int, lag_ns: int) -> None: ...
    def process(self, stamp_ns: int, real_ns: int, cpu_ns: int, peak_memory_kib: int) -> None: ...
    def status(self) -> RecorderStatus:
        return RecorderStatus(0, 0, "", "")

    def close(self, timeout_s: float = 10.0) -> RecorderStatus:  # noqa: ARG002
        return self.status()


class Daemon:
    """One robot's loop over one reactor."""

    def __init__(
        self,
        config: Config,
        links: Sequence[Link],
        recording: Recording,
        screen: Screen,
        policy: bytes | None = None,
        grid: OccupancyGrid | None = None,
        solver: LoopSolver | None = None,
    ) -> None:
        self._solver = solver
        self._config, self._grid = config, grid
        self._map_epoch = 0
        self._links = {link.port: link for link in links}
        self._recording, self._screen = recording, screen
        self._state = initial_state(config, policy)
        self._view = FleetView()
        self._decoders: dict[int, DeviceDecoder] = {}  # of the ports that are open
        self._stamp_ns = 0
        self._shown_ns = 0
        self._use_due_ns = 0
        self._log_problem = ""
        self._actions: dict[str, Callable[[Happening], None]] = {
            happenings.START: self._start,
            happenings.MAP: self._map,
            happenings.TICK: self._tick,
            happenings.READ: self._read,
            happenings.EVENT: self._event,
            happenings.OPENED: self._opened,
            happenings.LOST: self._lost,
            happenings.NOTE: lambda told: self._screen.line(f"{PORT_NAMES[told.port]}: {told.text}"),
        }

    def run(self, reactor: Reactor) -> str:
        """Until the reactor's END; returns its reason. The caller then calls stop(), whatever happened."""
        busy_ns = 0
        while (told := reactor.next()).what != happenings.END:
            self._stamp_ns = told.stamp_ns
            begun_ns = now()
            self._actions[told.what](told)
            busy_ns += now() - begun_ns
            if told.what == happenings.TICK:
                self._recording.timing(told.stamp_ns, busy_ns, told.lag_ns)
                if told.stamp_ns >= self._use_due_ns:
                    self._use_due_ns = told.stamp_ns + USE_PERIOD_NS
                    self._recording.process(told.stamp_ns, *used())
                acted(self._config.robot.id, told.stamp_ns)
                busy_ns = 0
        self._stamp_ns = max(self._stamp_ns, told.stamp_ns)
        return told.text

    def stop(self) -> RecorderStatus:
        """Motors first: zeros to the base, then the lidar, then radio and log. Never raises."""
        with contextlib.suppress(Exception):
            self._write(BASE, encode_velocity(0.0, 0.0))
        self._close_link(BASE)
        with contextlib.suppress(Exception):
            self._write(LIDAR, rplidar.request(rplidar.STOP))
        self._close_link(LIDAR)
        self._close_link(ROS)
        self._close_link(RADIO)
        return self._recording.close()

    def _close_link(self, port: int) -> None:
        with contextlib.suppress(Exception):
            if port in self._links:
                self._links[port].close()

    # ---- happenings ----

    def _start(self, told: Happening) -> None:
        self._feed(Started(told.stamp_ns))
        acted(self._config.robot.id, told.stamp_ns)

    def _map(self, told: Happening) -> None:
        if self._grid is not None:
            self._new_map(self._grid, told.stamp_ns)

    def _new_map(self, grid: OccupancyGrid, stamp_ns: int) -> None:
        self._grid = grid
        self._map_epoch += 1
        self._feed(map_event(grid, stamp_ns, self._map_epoch))

    def _tick(self, told: Happening) -> None:
        self._feed(Tick(told.stamp_ns))
        answer = None if self._solver is None else self._solver.answer(told.stamp_ns)
        if answer is not None:
            self._feed(answer)
        if told.stamp_ns - self._shown_ns >= REFRESH_S * 1e9:
            self._shown_ns = told.stamp_ns
            self._show()

    def _read(self, told: Happening) -> None:
        self._recording.serial(told.stamp_ns, told.port, FROM_DEVICE, RUNNING, told.data)
        decoder = self._decoders.get(told.port)
        if decoder is not None:
            for event in decoder.events(told.stamp_ns, told.data):
                self._feed(event)

    def _event(self, told: Happening) -> None:
        if told.event is None:
            return
        event = replace(told.event, stamp_ns=told.stamp_ns)
        if isinstance(event, MapReceived):
            grid = grid_in(event)
            if grid == self._grid:  # latched topics come again with every connection
                return
            self._new_map(grid, told.stamp_ns)
            return
        self._feed(event)

    def _opened(self, told: Happening) -> None:
        for part in told.exchanged:
            self._recording.serial(told.stamp_ns, told.port, part.direction, IDENTIFICATION, part.data)
        if told.port != ROS:
            self._decoders[told.port] = decoder_for(told.port)
        self._screen.line(f"{PORT_NAMES[told.port]}: {self._links[told.port].path}: {told.text}")
        self._feed(PortOpened(told.stamp_ns, told.port, told.text))
        if told.port == LIDAR:
            self._write(LIDAR, rplidar.request(rplidar.SCAN))

    def _lost(self, told: Happening) -> None:
        self._decoders.pop(told.port, None)
        path = self._links[told.port].path
        self._screen.line(f"{PORT_NAMES[told.port]}: {path} was lost ({told.text}); trying to reopen it")
        self._feed(PortLost(told.stamp_ns, told.port, told.text))

    # ---- the core ----

    def _feed(self, event: Event) -> None:
        self._recording.put(event.stamp_ns, event)
        self._state, effects = step(self._state, event)
        for effect in effects:
            self._recording.put(event.stamp_ns, effect)
        self._view.event(event)
        for effect in effects:
            self._view.effect(effect)
            self._act(effect)
        if isinstance(event, RadioStatus) and to_be_told(self._config, event):
            self._write(RADIO, encode_message(hello_of(self._config)))

    def _act(self, effect: Effect) -> None:
        command = command_of(effect)
        if command is not None:
            self._write(*command)
        elif isinstance(effect, LoopsDue) and self._solver is not None and self._state.charting is not None:
            self._solver.ask(self._state.charting)
        elif isinstance(effect, AlarmRaised):
            self._screen.line(f"alarm {effect.code}: {effect.text}")
        elif isinstance(effect, AlarmCleared):
            self._screen.line(f"cleared {effect.code}")

    def _write(self, port: int, data: bytes) -> None:
        if port in self._decoders and self._links[port].write(data):
            self._recording.serial(self._stamp_ns, port, TO_DEVICE, RUNNING, data)

    def _show(self) -> None:
        log = self._recording.status()
        text = f"{log.file}  {log.records} records, {log.lost} lost" if log.file else "off  --no-log"
        text += f", {log.shed} shed" if log.shed else ""
        if log.problem != self._log_problem:
            self._log_problem = log.problem
            self._screen.line(f"log: {log.problem or 'recording again'}")
        self._screen.show(self._view.snapshot(self._stamp_ns), text)
