"""The base's link: a motor guard process owns the port, this end starts, watches and restarts it.

To the rest of the daemon it is a link like the others: the base's own bytes come out, velocity frames go in.
If a guard dies, the base is stopped from here before a new guard is started.
"""

from __future__ import annotations

import contextlib
import json
import os
import socket
import subprocess
import sys
from collections.abc import Iterator
from typing import Any

from hippomat_core.errors import HippomatError, PortError
from hippomat_core.messages import BASE
from hippomat_core.wire.link import Hello
from hippomat_host.deadman import ZERO
from hippomat_host.happenings import LOST, NOTE, OPENED, READ, Exchanged, Happening
from hippomat_host.links import SILENT_NS, Acceptance, Backoff
from hippomat_host.probe import probe
from hippomat_host.serial_port import open_port, write_port
from hippomat_logs.records import FROM_DEVICE

START_NS = 10_000_000_000  # a guard that has said nothing by then hangs
EXIT_S = 1.0


class GuardLink:
    """The base behind its guard."""

    port = BASE

    def __init__(self, path: str, hello: Hello, accept: Acceptance) -> None:
        self.path = path
        self._hello, self._accept = hello, accept
        self._guard: subprocess.Popen[bytes] | None = None
        self._data: socket.socket | None = None
        self._reports = b""
        self._last_words = ""
        self._running = False
        self._opened_once = False
        self._problem = ""
        self._backoff = Backoff()
        self._due_ns = 0

    @property
    def running(self) -> bool:
        return self._running

    @property
    def due_ns(self) -> int:
        return self._due_ns

    @property
    def guard_pid(self) -> int | None:
        """The guard's process, for tests and for `ps`."""
        return None if self._guard is None else self._guard.pid

    def filenos(self) -> list[int]:
        if self._guard is None or self._guard.stdout is None or self._data is None:
            return []
        data = [self._data.fileno()] if self._running else []
        return [*data, self._guard.stdout.fileno()]

    def data_fileno(self) -> int:
        return -1 if self._data is None else self._data.fileno()

    def poll(self, now_ns: int) -> Iterator[Happening]:
        try:
            if self._guard is None:
                if now_ns >= self._due_ns:
                    self._start(now_ns)
                return
            if self._running:
                yield from self._read(now_ns)
            for report in self._read_reports():
                yield from self._reported(report, now_ns)
            if now_ns >= self._due_ns:
                raise PortError(f"{self.path}: the base has been silent for too long")
        except (OSError, HippomatError) as error:
            yield from self._lost(now_ns, error)

    def write(self, data: bytes) -> bool:
        if not self._running or self._data is None:
            return False
        try:
            return self._data.send(data, socket.MSG_DONTWAIT | socket.MSG_NOSIGNAL) == len(data)
        except OSError:  # a dead guard is noticed where it is read
            return False

    def close(self) -> None:
        """End the guard's input: it sends zeros and leaves."""
        self._end_guard()

    def _start(self, now_ns: int) -> None:
        ours, theirs = socket.socketpair()
        with theirs:
            self._guard = subprocess.Popen(
                [sys.executable, "-m", "hippomat_host.base_guard", self.path],
                stdin=theirs.fileno(),
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                start_new_session=True,  # Ctrl-C at the terminal does not reach it
            )
        if self._guard.stdout is not None:
            os.set_blocking(self._guard.stdout.fileno(), False)
        self._data, self._reports, self._last_words = ours, b"", ""
        self._due_ns = now_ns + START_NS

    def _read(self, now_ns: int) -> Iterator[Happening]:
        if self._data is None:
            return
        with contextlib.suppress(BlockingIOError):
            data = self._data.recv(4096, socket.MSG_DONTWAIT)
            if not data:
                return  # its last report says why
            self._due_ns = now_ns + SILENT_NS[BASE]
            yield Happening(now_ns, READ, BASE, data)

    def _read_reports(self) -> Iterator[dict[str, Any]]:
        if self._guard is None or self._guard.stdout is None:
            return
        ended = False
        with contextlib.suppress(BlockingIOError):
            chunk = os.read(self._guard.stdout.fileno(), 65536)
            ended = not chunk
            self._reports += chunk
        *lines, self._reports = self._reports.split(b"\n")
        for line in lines:
            if line.startswith(b"{"):
                yield json.loads(line)
            else:  # an interpreter that could not even start
                self._last_words = f": {line.decode(errors='replace')}"
        if ended:
            raise PortError(f"the motor guard of {self.path} died{self._last_words}")

    def _reported(self, report: dict[str, Any], now_ns: int) -> Iterator[Happening]:
        if "identified" in report:
            heard = Exchanged(now_ns, FROM_DEVICE, bytes.fromhex(report["identified"]))
            self._running, self._opened_once, self._problem = True, True, ""
            self._backoff.reset()
            self._due_ns = now_ns + SILENT_NS[BASE]
            yield Happening(now_ns, OPENED, BASE, text="JetBot ROS AI kit", exchanged=(heard,))
        elif "silent_ns" in report:
            text = f"the motor guard stopped the base: no command for {report['silent_ns'] / 1e6:.0f} ms"
            yield Happening(now_ns, NOTE, BASE, text=text)
        elif "foreign" in report:
            raise PortError(self._named(report["foreign"]))
        else:
            raise PortError(str(report.get("failed", report)))

    def _named(self, complaint: str) -> str:
        """The complaint, or what is there instead; asking takes seconds, so only before the first start."""
        if self._opened_once:
            return complaint
        self._end_guard()
        self._accept(self.path, BASE, probe(self.path, self._hello, BASE))
        return complaint

    def _lost(self, now_ns: int, error: OSError | HippomatError) -> Iterator[Happening]:
        was_running, self._running = self._running, False
        self._end_guard(kill=True)
        if not self._opened_once:
            raise error
        reason = (error.strerror or str(error)) if isinstance(error, OSError) else str(error)
        if was_running:
            stop_base(self.path)
            self._due_ns = now_ns  # the first try at once: only a guard stops the base for good
            yield Happening(now_ns, LOST, BASE, text=reason)
        else:
            self._due_ns = self._backoff.next_ns(now_ns)
            if reason != self._problem:
                yield Happening(now_ns, NOTE, BASE, text=reason)
        self._problem = reason

    def _end_guard(self, kill: bool = False) -> None:
        guard, self._guard, self._running = self._guard, None, False
        if self._data is not None:
            self._data.close()
            self._data = None
        if guard is None:
            return
        if kill:
            guard.kill()
        try:
            guard.wait(EXIT_S)
        except subprocess.TimeoutExpired:
            guard.kill()
            guard.wait()
        if guard.stdout is not None:
            guard.stdout.close()


def stop_base(path: str) -> None:
    """Zeros to a base that was identified before and whose guard is dead."""
    with contextlib.suppress(OSError, PortError):
        fd = open_port(path)
        try:
            write_port(fd, ZERO * 3)  # one damaged zero must not be the last word
        finally:
            os.close(fd)
