"""The daemon's three serial links: opened, identified, used, lost, reopened with back-off. Never blocks.

A link is polled by a reactor and answers with happenings. Radio and lidar are opened here; the base belongs
to the motor guard (guard_link.py). Which device is acceptable is decided in acceptance.py.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Callable, Iterator
from typing import Protocol

from hippomat_core.errors import HippomatError
from hippomat_core.messages import LIDAR
from hippomat_core.wire.link import Hello
from hippomat_host.happenings import LOST, NOTE, OPENED, READ, Exchanged, Happening
from hippomat_host.identify import Identifier, Identity
from hippomat_host.serial_port import motor_off, motor_on, open_port, read_port, set_speed, write_port
from hippomat_logs.records import FROM_DEVICE, TO_DEVICE

FIRST_RETRY_NS = 100_000_000
LAST_RETRY_NS = 5_000_000_000
SILENT_NS = (5_000_000_000, 2_000_000_000, 3_000_000_000)  # by port: longer means that it has to be reopened
MAX_UNWRITTEN = 4096

NEVER_NS = 2**63


class Link(Protocol):
    """One serial link as reactor and daemon see it."""

    port: int
    path: str

    @property
    def running(self) -> bool:
        """Identified and in use."""
        ...

    @property
    def due_ns(self) -> int:
        """When poll() must be called even if nothing is readable."""
        ...

    def filenos(self) -> list[int]:
        """What to wait on."""
        ...

    def poll(self, now_ns: int) -> Iterator[Happening]:
        """Move on without waiting; raises HippomatError while it has never been opened and cannot be."""
        ...

    def data_fileno(self) -> int:
        """Where the running device's bytes are read, for a reactor that reads them itself."""
        ...

    def write(self, data: bytes) -> bool:
        """Hand bytes to the running device; False if they were dropped."""
        ...

    def close(self) -> None:
        """Leave the device as it should be left."""
        ...


class Backoff:
    """When to try again: 0.1 s, doubling to 5 s."""

    def __init__(self) -> None:
        self._wait_ns = FIRST_RETRY_NS

    def next_ns(self, now_ns: int) -> int:
        due_ns = now_ns + self._wait_ns
        self._wait_ns = min(2 * self._wait_ns, LAST_RETRY_NS)
        return due_ns

    def reset(self) -> None:
        self._wait_ns = FIRST_RETRY_NS


Acceptance = Callable[[str, int, Identity], str]  # (path, expected port, identity) -> text; raises


class SerialLink:
    """Radio or lidar."""

    def __init__(self, port: int, path: str, hello: Hello, accept: Acceptance) -> None:
        self.port, self.path = port, path
        self._hello, self._accept = hello, accept
        self._fd = -1
        self._identifier: Identifier | None = None
        self._exchanged: list[Exchanged] = []
        self._opened_once = False
        self._problem = ""
        self._backoff = Backoff()
        self._due_ns = 0
        self._unwritten = b""

    @property
    def running(self) -> bool:
        return self._fd >= 0 and self._identifier is None

    @property
    def due_ns(self) -> int:
        return self._due_ns

    def filenos(self) -> list[int]:
        return [self._fd] if self._fd >= 0 else []

    def data_fileno(self) -> int:
        return self._fd

    def poll(self, now_ns: int) -> Iterator[Happening]:
        try:
            if self._fd < 0:
                if now_ns >= self._due_ns:
                    self._open(now_ns)
            elif self._identifier is not None:
                yield from self._identify(self._identifier, now_ns)
            else:
                yield from self._read(now_ns)
        except (OSError, HippomatError) as error:
            yield from self._lost(now_ns, error)

    def write(self, data: bytes) -> bool:
        if not self.running or len(self._unwritten) > MAX_UNWRITTEN:
            return False
        with contextlib.suppress(OSError):  # a lost port is noticed where it is read
            self._unwritten += data
            self._unwritten = self._unwritten[write_port(self._fd, self._unwritten) :]
        return True

    def close(self) -> None:
        if self._fd < 0:
            return
        with contextlib.suppress(OSError):
            if self.port == LIDAR and self.running:
                motor_off(self._fd)
        os.close(self._fd)
        self._fd, self._identifier, self._unwritten = -1, None, b""

    def _open(self, now_ns: int) -> None:
        identifier = Identifier(now_ns, self._hello, self.port)
        self._fd = open_port(self.path, identifier.baud)
        self._exchanged = []
        self._identifier = identifier
        self._due_ns = self._identifier.due_ns

    def _identify(self, identifier: Identifier, now_ns: int) -> Iterator[Happening]:
        data = read_port(self._fd)
        taken = data[: identifier.feed(data)]
        if taken:
            self._exchanged.append(Exchanged(now_ns, FROM_DEVICE, taken))
        baud = identifier.baud
        asked = identifier.poll(now_ns)
        if identifier.baud != baud:
            set_speed(self._fd, identifier.baud)
        if asked:
            self._exchanged.append(Exchanged(now_ns, TO_DEVICE, asked))
            write_port(self._fd, asked)
        self._due_ns = identifier.due_ns
        if identifier.identity is not None:
            text = self._accept(self.path, self.port, identifier.identity)
            if self.port == LIDAR:  # not before: DTR low with RTS high holds an ESP32 in reset
                motor_on(self._fd)
            self._identifier, self._opened_once, self._problem = None, True, ""
            self._backoff.reset()
            self._due_ns = now_ns + SILENT_NS[self.port]
            yield Happening(now_ns, OPENED, self.port, text=text, exchanged=tuple(self._exchanged))
            if identifier.leftover:
                yield Happening(now_ns, READ, self.port, identifier.leftover)

    def _read(self, now_ns: int) -> Iterator[Happening]:
        data = read_port(self._fd)
        if data:
            self._due_ns = now_ns + SILENT_NS[self.port]
            yield Happening(now_ns, READ, self.port, data)
        elif now_ns >= self._due_ns:
            raise OSError(0, f"silent for {SILENT_NS[self.port] / 1e9:.0f} s")

    def _lost(self, now_ns: int, error: OSError | HippomatError) -> Iterator[Happening]:
        was_running = self.running
        self.close()
        if not self._opened_once:
            raise error
        self._due_ns = self._backoff.next_ns(now_ns)
        reason = (error.strerror or str(error)) if isinstance(error, OSError) else str(error)
        if was_running:
            yield Happening(now_ns, LOST, self.port, text=reason)
        elif reason != self._problem:  # said once, not at every try
            yield Happening(now_ns, NOTE, self.port, text=reason)
        self._problem = reason
