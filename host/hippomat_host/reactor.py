"""What happens next? One queue of happenings from three links, the clock and the signals.

The daemon asks next() and nothing else, so that the same daemon runs on real time (here) and in a replay's
lockstep (lockstep.py). Knows no protocol and no robot.
"""

from __future__ import annotations

import contextlib
import os
import select
import signal
import socket
import time
from collections import deque
from collections.abc import Sequence
from dataclasses import replace
from typing import Protocol

from hippomat_host.clock import now
from hippomat_host.happenings import END, MAP, START, TICK, Happening
from hippomat_host.links import Link

TICK_NS = 50_000_000
PAUSE_NS = 4_000_000  # devices write byte by byte: one wake-up every 4 ms takes what came together
STOP_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


class Reactor(Protocol):
    """Where the daemon's happenings come from."""

    def begin(self) -> int:
        """The stamp of the START that next() gives first; the log begins there."""
        ...

    def next(self) -> Happening:
        """Wait for the next happening; an END is the last."""
        ...

    def close(self) -> None:
        """The daemon has acted on everything."""
        ...


class StopSignal:
    """SIGINT, SIGTERM and SIGHUP as something that select() sees. Use as a context."""

    def __init__(self) -> None:
        self._reader, self._writer = socket.socketpair()
        self._reader.setblocking(False)
        self._writer.setblocking(False)
        self.name = ""

    def __enter__(self) -> StopSignal:
        for number in STOP_SIGNALS:
            signal.signal(number, self._noted)
        signal.set_wakeup_fd(self._writer.fileno(), warn_on_full_buffer=False)
        return self

    def __exit__(self, *_: object) -> None:
        signal.set_wakeup_fd(-1)

    def fileno(self) -> int:
        return self._reader.fileno()

    def _noted(self, number: int, _frame: object) -> None:
        self.name = signal.Signals(number).name


def wait(links: Sequence[Link], stop: StopSignal, until_ns: int) -> list[Happening]:
    """What the links have to tell, waiting at most until `until_ns`."""
    owners = {fd: link for link in links for fd in link.filenos()}
    due_ns = min([until_ns, *(link.due_ns for link in links)])
    readable = _readable([*owners, stop.fileno()], max(0, due_ns - now()))
    ready = {id(owners[fd]) for fd in readable if fd in owners}
    happened: list[Happening] = []
    for link in links:
        now_ns = now()
        if id(link) in ready or now_ns >= link.due_ns:
            happened += link.poll(now_ns)
    return happened


def bring_up(links: Sequence[Link], stop: StopSignal) -> list[Happening]:
    """Wait until every link runs; what happened meanwhile. Raises HippomatError for one that cannot."""
    happened: list[Happening] = []
    while not stop.name and not all(link.running for link in links):
        happened += wait([link for link in links if not link.running], stop, now() + TICK_NS)
    return happened


class RealReactor:
    """The monotonic clock, real ports, a tick every 50 ms."""

    def __init__(self, links: Sequence[Link], stop: StopSignal, has_map: bool) -> None:
        """Waits until every link is identified; raises HippomatError for one that cannot be."""
        self._links, self._stop, self._has_map = links, stop, has_map
        self._before = bring_up(links, stop)
        self._queue: deque[Happening] = deque()
        self._tick_ns = 0
        self._woken_ns = 0
        self._looked = False  # for bytes, since the tick became due

    def begin(self) -> int:
        start_ns = now()
        self._queue.append(Happening(start_ns, START))
        if self._has_map:
            self._queue.append(Happening(start_ns, MAP))
        # What came while the ports were identified enters now: nothing enters the core before START.
        self._queue.extend(replace(told, stamp_ns=start_ns) for told in self._before)
        self._tick_ns = start_ns + TICK_NS
        return start_ns

    def next(self) -> Happening:
        while True:
            if self._stop.name:
                return Happening(now(), END, text=self._stop.name)
            if self._queue:
                return self._queue.popleft()
            now_ns = now()
            if now_ns >= self._tick_ns:
                if self._looked:
                    self._looked = False
                    return self._tick(now_ns)
                self._look(now_ns)  # a tick takes its time: what has come goes first
                continue
            pause_ns = self._woken_ns + PAUSE_NS - now_ns
            if pause_ns > 0:
                time.sleep(min(pause_ns, self._tick_ns - now_ns) / 1e9)
            self._look(self._tick_ns)

    def _look(self, until_ns: int) -> None:
        self._queue.extend(wait(self._links, self._stop, until_ns))
        self._woken_ns = now()
        self._looked = self._woken_ns >= self._tick_ns

    def close(self) -> None:
        """Nothing to hand back."""

    def _tick(self, now_ns: int) -> Happening:
        lag_ns = now_ns - self._tick_ns
        missed = lag_ns // TICK_NS  # ticks that never came are not made up for
        self._tick_ns += (missed + 1) * TICK_NS
        return Happening(now_ns, TICK, lag_ns=lag_ns)


def _readable(fds: list[int], wait_ns: int) -> list[int]:
    poller = select.poll()
    for fd in fds:
        poller.register(fd, select.POLLIN)
    found = [fd for fd, _ in poller.poll(-(-wait_ns // 1_000_000))]
    with contextlib.suppress(BlockingIOError):
        if fds[-1] in found:
            os.read(fds[-1], 64)
    return found
