"""Identify what is behind one port, and wait for it: `hippomat-host ports`, and naming a wrong device."""

from __future__ import annotations

import os
import select
import time

from hippomat_core.errors import PortError
from hippomat_core.wire.link import Hello
from hippomat_host.identify import UNKNOWN, Identifier, Identity
from hippomat_host.serial_port import open_port, read_port, set_speed, write_port


def probe(path: str, hello: Hello, expected: int) -> Identity:
    """At most about three seconds; raises PortError where the port cannot be opened."""
    identifier = Identifier(time.monotonic_ns(), hello, expected)
    fd = open_port(path, identifier.baud)
    try:
        return identify(fd, identifier)
    except OSError as error:
        raise PortError(f"{path} went away while it was identified: {error.strerror or error}") from None
    finally:
        os.close(fd)


def identify(fd: int, identifier: Identifier) -> Identity:
    """Waits for an open port; raises OSError where it goes away."""
    while identifier.identity is None:
        now_ns = time.monotonic_ns()
        if select.select([fd], [], [], max(0, identifier.due_ns - now_ns) / 1e9)[0]:
            identifier.feed(read_port(fd))
        baud = identifier.baud
        asked = identifier.poll(time.monotonic_ns())
        if identifier.baud != baud:
            set_speed(fd, identifier.baud)
        if asked:
            write_port(fd, asked)
    return identifier.identity or Identity(UNKNOWN, "silent")
