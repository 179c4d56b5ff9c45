"""A link whose device belongs to a child process: started, watched, and started anew with back-off.

The child has one end of a socket as standard input, for data in both directions, and reports as JSON lines on
standard output. What it reports, and what its data are, is its link's affair (guard_link.py, ros/links.py).
"""

from __future__ import annotations

import json
import os
import socket
import subprocess
import sys
from collections.abc import Iterator, Sequence
from typing import Any

from hippomat_core.errors import HippomatError, PortError
from hippomat_host.happenings import LOST, NOTE, Happening
from hippomat_host.links import Backoff

START_NS = 10_000_000_000  # a child that has said nothing by then hangs
EXIT_S = 1.0


class ChildLink:
    """One child process. A link says what a report means, and reads the data."""

    def __init__(self, port: int, path: str, name: str, command: Sequence[str]) -> None:
        """command: a Python module and its arguments   name: of the child, for messages"""
        self.port, self.path = port, path
        self._name, self._command = name, list(command)
        self._child: subprocess.Popen[bytes] | None = None
        self._data: socket.socket | None = None
        self._reports = b""
        self._last_words = ""
        self._running = False
        self._opened_once = False
        self._problem = ""
        self._backoff = Backoff()
        self._due_ns = 0

    # ---- what differs ----

    def _read(self, now_ns: int) -> Iterator[Happening]:
        """What the running child's socket holds, without waiting."""
        raise NotImplementedError

    def _reported(self, report: dict[str, Any], now_ns: int) -> Iterator[Happening]:
        """One report; raises HippomatError where it says that the device cannot be used."""
        raise NotImplementedError

    def _ended(self) -> None:
        """A running child is gone, and not because we closed it."""

    # ---- the link ----

    @property
    def running(self) -> bool:
        return self._running

    @property
    def due_ns(self) -> int:
        return self._due_ns

    @property
    def child_pid(self) -> int | None:
        """For tests and for `ps`."""
        return None if self._child is None else self._child.pid

    def filenos(self) -> list[int]:
        if self._child is None or self._child.stdout is None or self._data is None:
            return []
        data = [self._data.fileno()] if self._running else []
        return [*data, self._child.stdout.fileno()]

    def data_fileno(self) -> int:
        return -1 if self._data is None else self._data.fileno()

    def poll(self, now_ns: int) -> Iterator[Happening]:
        try:
            if self._child is None:
                if now_ns >= self._due_ns:
                    self._start(now_ns)
                return
            if self._running:
                yield from self._read(now_ns)
            for report in self._read_reports():
                yield from self._reported(report, now_ns)
            if now_ns >= self._due_ns:
                raise PortError(f"{self.path}: the {self._name} has been silent for too long")
        except (OSError, HippomatError) as error:
            yield from self._lost(now_ns, error)

    def write(self, data: bytes) -> bool:
        if not self._running or self._data is None:
            return False
        try:
            return self._data.send(data, socket.MSG_DONTWAIT | socket.MSG_NOSIGNAL) == len(data)
        except OSError:  # a dead child is noticed where it is read
            return False

    def close(self) -> None:
        """End the child's input: it finishes and leaves."""
        self._end_child()

    def _start(self, now_ns: int) -> None:
        ours, theirs = socket.socketpair()
        with theirs:
            self._child = subprocess.Popen(
                [sys.executable, "-m", *self._command],
                stdin=theirs.fileno(),
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                start_new_session=True,  # Ctrl-C at the terminal does not reach it
            )
        if self._child.stdout is not None:
            os.set_blocking(self._child.stdout.fileno(), False)
        self._data, self._reports, self._last_words = ours, b"", ""
        self._due_ns = now_ns + START_NS

    def _has_opened(self, due_ns: int) -> None:
        """The child said that its device works; due_ns: when it will have been silent for too long."""
        self._running, self._opened_once, self._problem = True, True, ""
        self._backoff.reset()
        self._due_ns = due_ns

    def _read_reports(self) -> Iterator[dict[str, Any]]:
        if self._child is None or self._child.stdout is None:
            return
        ended = False
        try:
            chunk = os.read(self._child.stdout.fileno(), 65536)
            ended = not chunk
            self._reports += chunk
        except BlockingIOError:
            pass
        *lines, self._reports = self._reports.split(b"\n")
        for line in lines:
            report = _report(line)
            if report is not None:
                yield report
            else:  # an interpreter that could not even start, or a library's warning
                self._last_words = f": {line.decode(errors='replace')}"
        if ended:
            raise PortError(f"the {self._name} of {self.path} died{self._last_words}")

    def _lost(self, now_ns: int, error: OSError | HippomatError) -> Iterator[Happening]:
        was_running, self._running = self._running, False
        self._end_child(kill=True)
        if not self._opened_once:
            raise error
        reason = (error.strerror or str(error)) if isinstance(error, OSError) else str(error)
        if was_running:
            self._ended()
            self._due_ns = now_ns  # the first try at once: only a child stops a base for good
            yield Happening(now_ns, LOST, self.port, text=reason)
        else:
            self._due_ns = self._backoff.next_ns(now_ns)
            if reason != self._problem:
                yield Happening(now_ns, NOTE, self.port, text=reason)
        self._problem = reason

    def _end_child(self, kill: bool = False) -> None:
        child, self._child, self._running = self._child, None, False
        if self._data is not None:
            self._data.close()
            self._data = None
        if child is None:
            return
        if kill:
            child.kill()
        try:
            child.wait(EXIT_S)
        except subprocess.TimeoutExpired:
            child.kill()
            child.wait()
        if child.stdout is not None:
            child.stdout.close()


def _report(line: bytes) -> dict[str, Any] | None:
    """None for what else a child prints: its standard error comes the same way."""
    try:
        report = json.loads(line)
    except ValueError:
        return None
    return report if isinstance(report, dict) else None
