"""A serial device's end of a pseudo-terminal: exact bytes, a stable name, and no waiting for the other side.

Knows bytes, not protocols. The slave is kept open here, so that its raw mode survives whoever opens and
closes it. Nobody reading is no error: real adapters drop what is not fetched, and so does this, counted.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import struct
import termios
import tty
from pathlib import Path

_READ = 4096
_UNREAD_S = 1.0  # bytes that lie unread for this long belong to nobody


class PtyPort:
    """Device side of one port. `link` is the name that the host opens, a link to /dev/pts/N."""

    def __init__(self, link: Path) -> None:
        self.link = link
        self.dropped_bytes = 0
        self.fd, self._slave = os.openpty()
        tty.setraw(self._slave, termios.TCSANOW)
        os.set_blocking(self.fd, False)
        link.unlink(missing_ok=True)
        link.symlink_to(os.ttyname(self._slave))
        self._unread = 0
        self._pending = 0  # what the kernel holds for the host, at most: it shows 4 KiB of its 64
        self._fetched_s = 0.0  # when somebody last took bytes, or none were waiting

    def close(self) -> None:
        """Hang up: whoever has the port open sees the end of it."""
        for fd in (self.fd, self._slave):
            os.close(fd)
        self.link.unlink(missing_ok=True)

    def read(self) -> bytes:
        """What the host wrote since the last call; never waits."""
        chunks = []
        with contextlib.suppress(BlockingIOError):
            while len(chunk := os.read(self.fd, _READ)) > 0:
                chunks.append(chunk)
                if len(chunk) < _READ:
                    break
        return b"".join(chunks)

    def write(self, data: bytes, now_s: float) -> None:
        """Offer bytes to the host; never waits. What finds no room, or no reader, is dropped and counted."""
        self._forget_the_unread(now_s)
        try:
            done = os.write(self.fd, data)
        except BlockingIOError:
            done = 0
        self._pending += done
        self.dropped_bytes += len(data) - done

    def _forget_the_unread(self, now_s: float) -> None:
        unread = self._waiting()
        if unread == 0 or unread < self._unread:
            self._fetched_s, self._pending = now_s, unread
        elif now_s - self._fetched_s > _UNREAD_S:
            self.dropped_bytes += self._pending
            termios.tcflush(self._slave, termios.TCIFLUSH)
            unread = self._pending = 0
        self._unread = unread

    def _waiting(self) -> int:
        count: int = struct.unpack("i", fcntl.ioctl(self._slave, termios.FIONREAD, b"\0" * 4))[0]
        return count
