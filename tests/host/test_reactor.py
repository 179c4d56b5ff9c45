"""In which order the daemon is told: what has come goes before a tick, which takes its time."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator

from hippomat_core.messages import RADIO
from hippomat_host.happenings import READ, START, TICK, Happening
from hippomat_host.reactor import TICK_NS, RealReactor, StopSignal


class PipeLink:
    """A running link whose bytes are those of a pipe."""

    port, path, running, due_ns = RADIO, "pipe", True, 2**63

    def __init__(self) -> None:
        self._reader, self.writer = os.pipe()
        os.set_blocking(self._reader, False)

    def filenos(self) -> list[int]:
        return [self._reader]

    def data_fileno(self) -> int:
        return self._reader

    def poll(self, now_ns: int) -> Iterator[Happening]:
        yield Happening(now_ns, READ, RADIO, os.read(self._reader, 4096))

    def write(self, data: bytes) -> bool:  # noqa: ARG002
        return True

    def close(self) -> None:
        os.close(self._reader)
        os.close(self.writer)


def test_bytes_that_came_while_the_daemon_was_busy_go_before_the_tick_that_is_due() -> None:
    link = PipeLink()
    reactor = RealReactor([link], StopSignal(), has_map=False)
    reactor.begin()
    assert reactor.next().what == START
    for number in range(3):
        os.write(link.writer, bytes([number]))
        time.sleep(1.2 * TICK_NS / 1e9)  # busy with something else
        told = reactor.next()
        assert (told.what, told.data) == (READ, bytes([number]))
        tick = reactor.next()
        assert tick.what == TICK
        assert tick.lag_ns > 0
    link.close()


def test_ticks_come_without_bytes_and_with_a_flood_of_them() -> None:
    link = PipeLink()
    reactor = RealReactor([link], StopSignal(), has_map=False)
    start_ns = reactor.begin()
    assert reactor.next().what == START
    assert reactor.next().what == TICK
    ticks, told = 0, Happening(start_ns, START)
    while told.stamp_ns < start_ns + 10 * TICK_NS:
        os.write(link.writer, b"x")
        told = reactor.next()
        ticks += told.what == TICK
    assert 5 <= ticks <= 10
    link.close()
