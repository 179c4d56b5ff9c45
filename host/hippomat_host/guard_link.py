"""The base's link: a motor guard process owns the port (base_guard.py), a ChildLink starts and watches it.

To the rest of the daemon it is a link like the others: the base's own bytes come out, velocity frames go in.
If a guard dies, the base is stopped from here before a new guard is started.
"""

from __future__ import annotations

import contextlib
import os
import socket
from collections.abc import Iterator
from typing import Any

from hippomat_core.errors import PortError
from hippomat_core.messages import BASE
from hippomat_core.wire.link import Hello
from hippomat_host.child_link import ChildLink
from hippomat_host.deadman import ZERO
from hippomat_host.happenings import NOTE, OPENED, READ, Exchanged, Happening
from hippomat_host.links import SILENT_NS, Acceptance
from hippomat_host.probe import probe
from hippomat_host.serial_port import open_port, write_port
from hippomat_logs.records import FROM_DEVICE


class GuardLink(ChildLink):
    """The base behind its guard."""

    def __init__(self, path: str, hello: Hello, accept: Acceptance) -> None:
        super().__init__(BASE, path, "motor guard", ["hippomat_host.base_guard", path])
        self._hello, self._accept = hello, accept

    def _read(self, now_ns: int) -> Iterator[Happening]:
        if self._data is None:
            return
        with contextlib.suppress(BlockingIOError):
            data = self._data.recv(4096, socket.MSG_DONTWAIT)
            if not data:
                return  # its last report says why
            self._due_ns = now_ns + SILENT_NS[BASE]
            yield Happening(now_ns, READ, BASE, data)

    def _reported(self, report: dict[str, Any], now_ns: int) -> Iterator[Happening]:
        if "identified" in report:
            heard = Exchanged(now_ns, FROM_DEVICE, bytes.fromhex(report["identified"]))
            self._has_opened(now_ns + SILENT_NS[BASE])
            yield Happening(now_ns, OPENED, BASE, text="JetBot ROS AI kit", exchanged=(heard,))
        elif "silent_ns" in report:
            yield Happening(now_ns, NOTE, BASE, text=stopped_text(report["silent_ns"]))
        elif "foreign" in report:
            raise PortError(self._named(report["foreign"]))
        else:
            raise PortError(str(report.get("failed", report)))

    def _named(self, complaint: str) -> str:
        """The complaint, or what is there instead; asking takes seconds, so only before the first start."""
        if self._opened_once:
            return complaint
        self._end_child()
        self._accept(self.path, BASE, probe(self.path, self._hello, BASE))
        return complaint

    def _ended(self) -> None:
        stop_base(self.path)


def stopped_text(silent_ns: int) -> str:
    return f"the motor guard stopped the base: no command for {silent_ns / 1e6:.0f} ms"


def stop_base(path: str) -> None:
    """Zeros to a base that was identified before and whose guard is dead."""
    with contextlib.suppress(OSError, PortError):
        fd = open_port(path)
        try:
            write_port(fd, ZERO * 3)  # one damaged zero must not be the last word
        finally:
            os.close(fd)
