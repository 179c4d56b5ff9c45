"""Records that only the log knows: serial bytes, timing and what was lost. All others are the core's.

Also which records are bulk: they go first where room or time runs out, so that decisions stay.
"""

from __future__ import annotations

from dataclasses import dataclass

from hippomat_core.fields import I64, U8, U32, U64
from hippomat_core.messages import LIDAR, LaserScanReceived, MapDrawn, ScanReceived

FROM_DEVICE, TO_DEVICE = 0, 1
IDENTIFICATION, RUNNING = 0, 1


@dataclass(frozen=True, slots=True)
class SerialRecord:
    """Bytes exactly as one read or write moved them."""

    stamp_ns: I64
    port: U8  # messages.RADIO, BASE, LIDAR
    direction: U8  # FROM_DEVICE, TO_DEVICE
    phase: U8  # IDENTIFICATION, RUNNING
    crc32: U32  # of data; survives tools that recompute the file's own checksums
    data: bytes


@dataclass(frozen=True, slots=True)
class TimingRecord:
    """What one pass of the daemon's loop cost."""

    stamp_ns: I64
    compute_ns: U64
    lag_ns: U64  # how late the pass began


@dataclass(frozen=True, slots=True)
class ProcessRecord:
    """What the daemon's process has used so far, all its threads together; once a second."""

    stamp_ns: I64
    real_ns: U64  # the machine's monotonic clock, also where stamps are a simulator's
    cpu_ns: U64
    peak_memory_kib: U64


@dataclass(frozen=True, slots=True)
class DropRecord:
    """Stands in the place of records first..last, which the log lost; its own number is `last`."""

    first: U64
    last: U64
    cause: str


_BULK = (ScanReceived, LaserScanReceived, MapDrawn)


def is_bulk(record: object) -> bool:
    """Scans, grids and the lidar's bytes: nine tenths of a log, and no decision among them."""
    return isinstance(record, _BULK) or (type(record) is SerialRecord and record.port == LIDAR)
