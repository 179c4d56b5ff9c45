"""The terminal: a live table where there is one, plain lines elsewhere, written by a thread of its own.

A terminal that does not take its bytes (Ctrl-S, a full pipe) must not hold up the robot: the loop only leaves
the newest view and appends lines to a bounded queue.
"""

from __future__ import annotations

import sys
import threading
import time
from collections import deque
from collections.abc import Callable
from typing import Protocol

from rich.console import Console
from rich.live import Live
from rich.text import Text

from hippomat_host.advice import Given
from hippomat_host.fleet_view import FleetView
from hippomat_host.render import picture, plain

REFRESH_S = 0.5
LINE_EVERY_S = 5.0
MAX_LINES = 200
PIPE_WIDTH = 120
_WAKE_S = 0.1


class Face(Protocol):
    """How views and lines are put on a terminal; called from one thread."""

    def line(self, text: str) -> None: ...
    def view(self, view: FleetView, log: str) -> None: ...
    def close(self) -> None: ...


class Screen:
    """Called by the daemon's loop, never waits. close() writes what is left, within a second."""

    def __init__(self, face: Callable[[], Face]) -> None:
        self._lines: deque[str] = deque(maxlen=MAX_LINES)
        self._view: tuple[FleetView, str] | None = None
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._write, args=(face,), name="screen", daemon=True)
        self._thread.start()

    def line(self, text: str) -> None:
        self._lines.append(text)

    @property
    def waiting(self) -> int:
        """Lines that are not on the terminal yet."""
        return len(self._lines)

    def show(self, view: FleetView, log: str) -> None:
        """view: a snapshot; only the newest is drawn."""
        self._view = (view, log)

    def close(self) -> None:
        self._closing.set()
        self._thread.join(1.0)

    def _write(self, make_face: Callable[[], Face]) -> None:
        try:
            face = make_face()
            while not self._closing.wait(_WAKE_S):
                self._draw(face)
                self._say(face)
            self._draw(face)
            face.close()
            self._say(face)  # the last words stand below the table
        except (OSError, ValueError):  # the terminal is gone; the robot goes on
            return

    def _draw(self, face: Face) -> None:
        view, self._view = self._view, None
        if view is not None:
            face.view(*view)

    def _say(self, face: Face) -> None:
        while self._lines:
            face.line(self._lines.popleft())


class LiveFace:
    """A table that is redrawn in place; lines scroll above it."""

    def __init__(self, given: Given, console: Console | None = None) -> None:
        self._given = given
        self._console = console or Console(highlight=False, markup=False)
        self._live = Live(console=self._console, auto_refresh=False, redirect_stderr=False)
        self._live.start()

    def line(self, text: str) -> None:
        self._console.print(Text(f"{time.strftime('%H:%M:%S')} {text}"))

    def view(self, view: FleetView, log: str) -> None:
        self._live.update(picture(view, self._given, log), refresh=True)

    def close(self) -> None:
        self._live.stop()


class PlainFace:
    """Lines with the time of day, for pipes and service managers."""

    def __init__(self, given: Given, write: Callable[[str], None] | None = None) -> None:
        self._given = given
        self._write = write or _to_stdout
        self._told_s = time.monotonic() - LINE_EVERY_S + 1.0

    def line(self, text: str) -> None:
        self._write(f"{time.strftime('%H:%M:%S')} {text}")

    def view(self, view: FleetView, log: str) -> None:  # noqa: ARG002
        if time.monotonic() - self._told_s >= LINE_EVERY_S:
            self._told_s = time.monotonic()
            self.line(plain(view, self._given))

    def close(self) -> None:
        """Nothing to put back."""


def screen_for(given: Given) -> Screen:
    """A live table on a terminal, plain lines anywhere else."""
    if sys.stdout.isatty():
        return Screen(lambda: LiveFace(given))
    return Screen(lambda: PlainFace(given))


def table_console() -> Console:
    """For one table; a pipe takes it whole, whatever the terminal's width would be."""
    return Console(highlight=False, markup=False, width=None if sys.stdout.isatty() else PIPE_WIDTH)


def _to_stdout(text: str) -> None:
    print(text, flush=True)
