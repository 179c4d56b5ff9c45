"""A reactor without a clock: a replayer says over a socket what happens next and when.

One JSON line per happening, answered by {"ok": true} once the daemon has acted on it:
  {"at": ns, "do": "start" | "map" | "tick" | "end"}
  {"at": ns, "do": "opened" | "lost", "port": "radio" | "base" | "lidar" | "ros"}  (also "device", "reason")
  {"at": ns, "do": "read", "port": ..., "bytes": n}      exactly n bytes from that port's real descriptor
  {"at": ns, "do": "event", "port": "ros"}               the next event of the ROS feed
  {"at": ns, "do": "answer", "data": base64}             a recorded LoopsClosed
The ports are real and are identified in real time before the socket is answered.
"""

from __future__ import annotations

import base64
import json
import os
import select
import socket
import time
from collections.abc import Mapping, Sequence
from typing import Any

from hippomat_core.errors import HippomatError
from hippomat_core.messages import PORT_NAMES, Event, LoopsClosed
from hippomat_host.happenings import END, EVENT, LOST, MAP, OPENED, READ, START, TICK, Happening
from hippomat_host.links import Link
from hippomat_host.reactor import StopSignal, bring_up
from hippomat_host.ros.links import FeedLink
from hippomat_logs.schema import MessageStore

READ_TIMEOUT_S = 20.0


class LockstepReactor:
    """Happenings as instructed. Raises HippomatError for an instruction that makes no sense."""

    def __init__(self, path: str, links: Sequence[Link], stop: StopSignal, has_map: bool) -> None:
        self._links: Mapping[int, Link] = {link.port: link for link in links}
        self._stop, self._has_map = stop, has_map
        self._identified = {told.port: told for told in bring_up(links, stop) if told.what == OPENED}
        self._socket = _connected(path)
        self._lines = self._socket.makefile("rb")
        self._unanswered = False
        self._first: Happening | None = None
        self._store: MessageStore | None = None  # slow to build

    def begin(self) -> int:
        first = self._first = self.next()
        if first.what not in (START, END):
            raise HippomatError(f"lockstep: the first instruction was {first.what!r}, not 'start'")
        return first.stamp_ns

    def next(self) -> Happening:
        if self._first is not None:
            first, self._first = self._first, None
            return first
        self._answer()
        line = b"" if self._stop.name else self._lines.readline()
        if not line:
            return Happening(0, END, text="the replayer hung up")
        self._unanswered = True
        try:
            instruction = json.loads(line)
            return self._happening(instruction, instruction["at"], instruction["do"])
        except (ValueError, KeyError, TypeError) as error:
            raise HippomatError(f"lockstep: instruction {line!r} cannot be used: {error!r}") from None

    def close(self) -> None:
        self._answer()
        self._lines.close()
        self._socket.close()

    def _answer(self) -> None:
        if self._unanswered:
            self._unanswered = False
            try:
                self._socket.sendall(b'{"ok": true}\n')
            except OSError:
                self._stop.name = "the replayer hung up"

    def _happening(self, instruction: dict[str, Any], at_ns: int, what: str) -> Happening:
        if what in (START, TICK, END):
            return Happening(at_ns, what)
        if what == "answer":
            self._store = self._store or MessageStore()
            event = self._store.decode(LoopsClosed, base64.b64decode(instruction["data"]))
            return Happening(at_ns, EVENT, event=event)
        if what == MAP:
            if not self._has_map:
                raise HippomatError("lockstep: the run had a map: give --map")
            return Happening(at_ns, MAP)
        port = PORT_NAMES.index(instruction["port"])
        if port not in self._links:
            raise HippomatError(f"lockstep: the run had a {instruction['port']}, this daemon was given none")
        if what == READ:
            return Happening(at_ns, READ, port, self._read(self._links[port], instruction["bytes"]))
        if what == EVENT:
            return Happening(at_ns, EVENT, port, event=self._event(self._links[port]))
        if what == LOST:
            return Happening(at_ns, LOST, port, text=instruction.get("reason", "as recorded"))
        if what == OPENED:
            told = self._identified[port]
            text = instruction.get("device", told.text)
            return Happening(at_ns, OPENED, port, text=text, exchanged=told.exchanged)
        raise HippomatError(f"lockstep: unknown instruction {what!r}")

    def _event(self, link: Link) -> Event:
        event = link.take(READ_TIMEOUT_S) if isinstance(link, FeedLink) else None
        if event is None:
            raise HippomatError(f"lockstep: {link.path} offered no event")
        return event

    def _read(self, link: Link, count: int) -> bytes:
        fd, data, until_s = link.data_fileno(), b"", time.monotonic() + READ_TIMEOUT_S
        while len(data) < count:
            left_s = until_s - time.monotonic()
            if left_s <= 0 or not select.select([fd], [], [], left_s)[0]:
                raise HippomatError(f"lockstep: {link.path} offered {len(data)} of {count} bytes")
            chunk = os.read(fd, count - len(data))
            if not chunk:
                raise HippomatError(f"lockstep: {link.path} hung up after {len(data)} of {count} bytes")
            data += chunk
        return data


def _connected(path: str) -> socket.socket:
    connection = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    try:
        connection.connect(path)
    except OSError as error:
        connection.close()
        raise HippomatError(
            f"--lockstep {path}: no replayer listens there ({error.strerror}); start hippomat-replay instead"
        ) from None
    return connection
