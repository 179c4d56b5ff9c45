"""Real radios on a desk: the firmware's C behind pseudo-terminals, with a simulated air between them.

A station is a radio with a port for the command under test, or one whose robot sends a STATE every round and
shows in it what its radio says about STOP. World time is the machine's; what is late is made up for in order.
"""

from __future__ import annotations

import contextlib
import select
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from hippomat_core.wire import frames as air
from hippomat_core.wire.cobs import FrameDecoder
from hippomat_core.wire.codec import encode_body
from hippomat_core.wire.link import (
    FLAG_STOPPED,
    Round,
    SendBody,
    Status,
    decode_message,
    encode_message,
)
from hippomat_sim.devices.virtual_radio import VirtualRadio
from hippomat_sim.medium import AirSettings, Heard, Left, Medium
from hippomat_sim.pty_port import PtyPort
from hippomat_sim.radio import Memory

KEY = bytes.fromhex("000102030405060708090a0b0c0d0e0f")
OTHER_KEY = bytes(range(100, 116))


class Seat:
    """The robot behind a radio, as far as STOP is concerned."""

    def __init__(self, size: int) -> None:
        self.size = size
        self.sends = True  # its daemon runs
        self.obeys = True  # and stops when it is told to
        self.stopped, self.counter = False, 0
        self._frames = FrameDecoder()

    def hears(self, data: bytes) -> Iterator[bytes]:
        """Bytes of the radio in, bytes for it out."""
        for payload in self._frames.feed(data):
            message = decode_message(payload)
            if isinstance(message, Status) and self.obeys:
                self.stopped, self.counter = bool(message.flags & FLAG_STOPPED), message.stop_counter
            elif isinstance(message, Round) and self.sends:
                yield encode_message(SendBody(air.STATE, encode_body(self._state())))

    def _state(self) -> air.StateFrame:
        flags = air.FLAG_LOCALIZED | air.FLAG_STOPPED * self.stopped
        costs, none = np.zeros(4, np.uint8), np.zeros(0, np.uint8)
        return air.StateFrame(
            *(air.IDLE, flags, 0, 0, 0, 0, 0, air.NO_CLAIM, costs, costs, 0, 0, 0, none),
            *(0, np.zeros(self.size, np.uint8), 0xF1EE7, 2, self.counter),
        )


class Desk(threading.Thread):
    """Radios with these memories. Those in `robots` are robots, the others have a port in `directory`."""

    def __init__(
        self, directory: Path, memories: list[Memory], robots: list[int], settings: AirSettings, seed: int = 1
    ) -> None:
        super().__init__(name="desk", daemon=True)
        self.medium = Medium(len(memories), settings, seed)
        self.radios = [
            VirtualRadio(station, seed, self.medium, memory) for station, memory in enumerate(memories)
        ]
        self.seats = {station: Seat(5) for station in robots}
        self.ports = {
            station: PtyPort(directory / f"radio{station}")
            for station in range(len(memories))
            if station not in robots
        }
        self.restarts_vanish: set[int] = set()  # stations whose port goes away when they restart
        self.lock = threading.Lock()
        self._boots = [radio.boots for radio in self.radios]
        self._hidden: dict[int, tuple[Path, int]] = {}  # ports that are away: name, until
        self._begun_ns = time.monotonic_ns()
        self._ended = threading.Event()
        self.start()

    def path(self, station: int) -> Path:
        return self.ports[station].link

    def press_button(self, station: int) -> None:
        with self.lock:
            self.radios[station].press_button(self._now_us())

    def close(self) -> None:
        self._ended.set()
        self.join()
        for port in self.ports.values():
            port.close()

    def run(self) -> None:
        while not self._ended.is_set():
            fds = [port.fd for port in self.ports.values()]
            readable = set(select.select(fds, [], [], self._wait_s())[0])
            with self.lock:
                now_us = self._now_us()
                self._advance(now_us)
                for station, port in list(self.ports.items()):
                    if port.fd in readable:
                        self.radios[station].receive(now_us, port.read())
                        self._serve(station, now_us)
                self._ports_come_back(now_us)

    def _now_us(self) -> int:
        return (time.monotonic_ns() - self._begun_ns) // 1000

    def _wait_s(self) -> float:
        return min(0.01, max(0, self._next_us() - self._now_us()) / 1e6)

    def _next_us(self) -> int:
        wakes = [radio.wake_us for radio in self.radios]
        air_us = self.medium.next_us()
        return min(wakes) if air_us is None else min(*wakes, air_us)

    def _advance(self, now_us: int) -> None:
        while (due_us := self._next_us()) <= now_us:
            while (happening := self.medium.pop(due_us)) is not None:
                self._deliver(happening)
            for station, radio in enumerate(self.radios):
                if radio.wake_us <= due_us:
                    radio.tick(due_us)
                    self._serve(station, due_us)

    def _deliver(self, happening: Heard | Left) -> None:
        if isinstance(happening, Heard):
            radio = self.radios[happening.receiver]
            radio.heard(happening.at_us, happening.rssi_dbm, happening.sender, happening.frame)
            self._serve(happening.receiver, happening.at_us)
        else:
            self.radios[happening.sender].sent(happening.at_us)
            self._serve(happening.sender, happening.at_us)

    def _serve(self, station: int, now_us: int) -> None:
        radio = self.radios[station]
        if station in self.seats:
            for answer in self.seats[station].hears(radio.for_host()):
                radio.receive(now_us, answer)
        elif data := radio.for_host():
            if station in self.ports:
                self.ports[station].write(data, now_us / 1e6)
            radio.tick(now_us)  # the host has the answer: a provisioned radio may restart
        if radio.boots != self._boots[station]:
            self._boots[station] = radio.boots
            if station in self.restarts_vanish and station in self.ports:
                self._hidden[station] = self.ports[station].link, now_us + 500_000
                self.ports.pop(station).close()

    def _ports_come_back(self, now_us: int) -> None:
        for station, (link, until_us) in list(self._hidden.items()):
            if now_us >= until_us:
                del self._hidden[station]
                self.ports[station] = PtyPort(link)


@contextlib.contextmanager
def desk(
    directory: Path,
    memories: list[Memory],
    robots: list[int] | None = None,
    loss: float = 0.0,
    change: Callable[[Desk], None] | None = None,
) -> Iterator[Desk]:
    """Radios that are switched off at the end, whatever happens."""
    made = Desk(directory, memories, robots or [], AirSettings(loss=loss))
    try:
        if change is not None:
            change(made)
        yield made
    finally:
        made.close()


def a_fleet(count: int, *, fleet: int = 1, channel: int = 1, key: bytes = b"") -> list[Memory]:
    """The memories of robots 0 .. count - 1."""
    return [
        Memory(robot, fleet, channel, provisioned=True, key=key, boot_counter=1_760_000_000)
        for robot in range(count)
    ]


def a_dongle(*, fleet: int = 1, channel: int = 1, key: bytes = b"") -> Memory:
    return Memory(255, fleet, channel, provisioned=True, key=key, boot_counter=1_760_000_000)
