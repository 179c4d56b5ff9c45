"""`hippomat-host ports`: every serial port of this machine and what is behind it, busy ones included."""

from __future__ import annotations

import glob
import os
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

from rich.table import Table
from serial.tools.list_ports import comports

from hippomat_core.errors import PortError
from hippomat_host.acceptance import FLAGS
from hippomat_host.identify import ASK, UNKNOWN
from hippomat_host.probe import probe
from hippomat_host.radio_words import conditions
from hippomat_host.screen import table_console
from hippomat_host.serial_port import BusyPort, present_ports


@dataclass(frozen=True, slots=True)
class Found:
    """One row: the device, what it is, what it says, the flag that wants it, its other names."""

    path: str
    what: str
    text: str
    flag: str
    names: tuple[str, ...]
    usb: str = ""  # vendor, product and serial number: what a udev rule for /dev/hippomat-* matches


def list_ports(paths: Sequence[str]) -> int:
    """Print the table of `paths`, or of all ports; 0 if there was any, else 1 and a line that says so."""
    devices = sorted({os.path.realpath(path): path for path in paths or present_ports()}.values())
    if not devices:
        raise PortError(
            "no serial port is plugged in (looked for /dev/ttyACM*, /dev/ttyUSB*, /dev/hippomat-*)"
        )
    with ThreadPoolExecutor(max_workers=len(devices)) as pool:
        rows = list(pool.map(_found, devices))
    usb = {os.path.realpath(port.device): port.usb_info() for port in comports() if port.vid is not None}
    rows = [replace(row, usb=usb.get(os.path.realpath(row.path), "")) for row in rows]
    table = Table(box=None, header_style="bold", padding=(0, 2, 0, 0))
    for name in ("port", "what", "use as", "details"):
        table.add_column(name, overflow="fold")
    for row in rows:
        also = "".join(f"\nalso called {name}" for name in row.names)
        table.add_row(row.path, row.what, row.flag, "\n".join(filter(None, (row.text, row.usb))) + also)
    table_console().print(table)
    return 0


def _found(path: str) -> Found:
    names = _names(path)
    try:
        identity = probe(path, ASK, UNKNOWN)
    except BusyPort as error:
        who = "another user's process" if error.owner is None else "process {}: {}".format(*error.owner)
        return Found(path, "busy", f"in use by {who}", "", names)
    except PortError as error:
        return Found(path, "-", str(error).removeprefix(f"{path}: ").removeprefix(f"{path} "), "", names)
    flag = "" if identity.port == UNKNOWN else FLAGS[identity.port]
    holds = conditions(identity.reply.flags) if identity.reply is not None else []
    return Found(path, identity.name, "; ".join([identity.text, *holds]), flag, names)


def _names(path: str) -> tuple[str, ...]:
    device = os.path.realpath(path)
    links = [*glob.glob("/dev/serial/by-id/*"), *glob.glob("/dev/hippomat-*")]
    return tuple(sorted(link for link in links if link != path and os.path.realpath(link) == device))
