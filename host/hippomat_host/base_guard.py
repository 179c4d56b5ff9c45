"""The process that owns the base's port, so that a crashed or stopped daemon cannot leave motors running.

Between daemon and base it is a wire with a dead man's switch: bytes of the base go up unchanged, velocity
frames come down and are repeated every 20 ms, and zeros take their place when none came for 200 ms or the
daemon is gone. It listens first and writes nothing to a port that is no base. When to stop is in deadman.py.

    python -m hippomat_host.base_guard DEVICE      stdin: socket to the daemon; stdout: reports as JSON lines
"""

from __future__ import annotations

import contextlib
import json
import os
import select
import signal
import socket
import sys
import time

from hippomat_core.errors import HippomatError
from hippomat_core.wire.jetbot_base import FEEDBACK, Decoder
from hippomat_host.clock import adopt, now
from hippomat_host.deadman import PERIOD_NS, ZERO, Deadman
from hippomat_host.serial_port import open_port, read_port, write_port

LISTEN_NS = 1_000_000_000
LAST_ZEROS = 6  # the base holds its last velocity for ever: one damaged zero must not be the last word


class _Stop(Exception):
    """The guard's work ends; the message says why."""


class Guard:
    """One port, one daemon."""

    def __init__(self, port: int, daemon: socket.socket) -> None:
        self._port, self._daemon = port, daemon
        self._commands = Decoder()
        self._deadman = Deadman()
        self._unwritten = b""
        self._tripped = False

    def identified(self) -> bytes | None:
        """Bytes up to the first whole feedback frame, read within LISTEN_NS; None if there was none."""
        decoder, heard, until_ns = Decoder(), bytearray(), now() + LISTEN_NS
        while (left_ns := until_ns - now()) > 0:
            if not select.select([self._port], [], [], left_ns / 1e9)[0]:
                break
            byte = read_port(self._port, 1)  # one by one: what follows belongs to the running phase
            heard += byte
            if any(frame.type == FEEDBACK for frame in decoder.feed(byte)):
                return bytes(heard)
        return None

    def run(self) -> None:
        """Forward until the daemon or the port is gone; raises _Stop or OSError."""
        daemon = self._daemon.fileno()
        while True:
            now_ns = now()
            self._drive(now_ns)
            wait_s = max(0, self._deadman.next_ns - now_ns) / 1e9
            readable, _, _ = select.select([self._port, daemon], [], [], wait_s)
            if daemon in readable:
                self._take_commands()
            if self._port in readable:
                data = read_port(self._port)
                with contextlib.suppress(BlockingIOError):  # a stopped daemon reads nothing: its loss
                    self._daemon.send(data, socket.MSG_DONTWAIT | socket.MSG_NOSIGNAL)

    def stop(self) -> None:
        """The last words to the base."""
        signal.signal(signal.SIGTERM, signal.SIG_IGN)
        for _ in range(LAST_ZEROS):
            self._write(ZERO)
            time.sleep(PERIOD_NS / 1e9)

    def _take_commands(self) -> None:
        try:
            data = self._daemon.recv(4096, socket.MSG_DONTWAIT)
        except BlockingIOError:
            return
        except OSError as error:
            raise _Stop(f"the daemon is gone: {error.strerror}") from None
        if not data:
            raise _Stop("the daemon is gone")
        for frame in self._commands.feed(data):
            self._deadman = self._deadman.commanded(now(), frame)
        self._tripped = False

    def _drive(self, now_ns: int) -> None:
        self._deadman, frame = self._deadman.output(now_ns)
        if frame:
            self._write(frame)
        commanded_ns = self._deadman.commanded_ns
        if frame and commanded_ns is not None and self._deadman.silent(now_ns) and not self._tripped:
            self._tripped = True
            report(silent_ns=now() - commanded_ns)

    def _write(self, frame: bytes) -> None:
        """A frame is finished before the next begins; an older whole frame makes room for a newer one."""
        self._unwritten = self._unwritten[write_port(self._port, self._unwritten) :]
        if not self._unwritten:
            self._unwritten = frame[write_port(self._port, frame) :]
            if len(self._unwritten) == len(frame):
                self._unwritten = b""


def report(**facts: object) -> None:
    """One line for the daemon; it may be gone."""
    with contextlib.suppress(OSError):
        os.write(1, json.dumps(facts).encode() + b"\n")


def main(path: str) -> int:
    """The process: exit status 0 if the daemon ended it, 1 if the port did."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the terminal's Ctrl-C is the daemon's affair
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    signal.signal(signal.SIGPIPE, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, _terminated)
    os.set_blocking(1, False)  # a daemon that does not read must not hold up the zeros
    try:
        adopt([path])
        guard = Guard(open_port(path), socket.socket(fileno=0))
        heard = guard.identified()
    except _Stop:
        return 0
    except (HippomatError, OSError) as error:
        report(failed=str(error))
        return 1
    if heard is None:
        report(foreign=f"{path} sent no base frame within {LISTEN_NS / 1e9:.1f} s")
        return 1
    report(identified=heard.hex())
    return _guarded(guard)


def _guarded(guard: Guard) -> int:
    try:
        guard.run()
    except _Stop:
        return 0
    except OSError as error:
        report(failed=error.strerror or str(error))
        return 1
    finally:
        with contextlib.suppress(OSError):
            guard.stop()
    return 0


def _terminated(_signal: int, _frame: object) -> None:
    raise _Stop("terminated")


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
