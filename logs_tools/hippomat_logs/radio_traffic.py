"""What one run says of its radio: every frame sent and heard, on the radio's clock and on the log's.

Decides which boot of the radio a record belongs to, and what time of the log a time of the radio is. Reads
the first fields of the records only, as columns: they lie at the same bytes in every message of a kind.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hippomat_core import messages as m
from hippomat_logs.clock_map import ClockMap, fit_least_late
from hippomat_logs.column_table import NUMBER, TIME, Table, table_of
from hippomat_logs.reader import Run
from hippomat_logs.schema import TOPICS, type_name

HEARD = (m.StateHeard, m.RelayHeard, m.TasksHeard, m.StopHeard)
KINDS = (*HEARD, m.FrameSent, m.RadioStatus, m.RoundEnded)
REBOOT_NS = 1_000_000_000  # a radio's clock that steps back by more has begun anew

Keys = NDArray[np.uint64]
Times = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Frames:
    """Frames on the air as one run knows them. keys: see key_of(); unique where they were sent, sorted."""

    keys: Keys  # (n,)
    numbers: Times  # (n,) of the records
    air_ns: Times  # (n,) when it was on the air, on the run's own log clock, by way of the radio's


@dataclass(frozen=True, slots=True)
class Traffic:
    """One run's."""

    sent: Frames
    heard: Frames
    span_ns: tuple[int, int]  # log times of its first and last radio record; equal: it has none
    latency_ns: float  # spread of the least late radio records about the radio's clock
    boots: int  # of the radio, within the run


def key_of(sender: NDArray[np.int64], boot: NDArray[np.int64], sequence: NDArray[np.int64]) -> Keys:
    """Names a frame among all: sender 8 bits, its radio's boot counter 32, sequence 24."""
    parts = sender.astype(np.uint64), boot.astype(np.uint64), sequence.astype(np.uint64)
    return parts[0] << np.uint64(56) | (parts[1] << np.uint64(24)) | parts[2]


def traffic_of(run: Run) -> Traffic:
    """Raises LogError for a damaged log."""
    tables = _tables(run)
    numbers, log_ns, radio_ns = (
        np.concatenate([_column(tables[kind], which) for kind in KINDS]) for which in range(3)
    )
    order = np.argsort(numbers, kind="stable")
    numbers, log_ns, radio_ns = numbers[order], log_ns[order], radio_ns[order]
    if not len(numbers):
        nothing = Frames(np.empty(0, np.uint64), np.empty(0, np.int64), np.empty(0, np.int64))
        return Traffic(nothing, nothing, (0, 0), 0.0, 0)
    begins = np.flatnonzero(np.diff(radio_ns) < -REBOOT_NS) + 1  # of the radio's boots
    air_ns, spread_ns = np.empty(len(numbers), np.int64), 0.0
    for part in np.split(np.arange(len(numbers)), begins):
        air_ns[part], late_ns = _by_radio_clock(log_ns[part], radio_ns[part])
        spread_ns = max(spread_ns, late_ns)
    air = dict(zip(numbers.tolist(), air_ns.tolist(), strict=True))
    sent = _sent(run, tables[m.FrameSent], tables[m.RadioStatus], numbers[begins], air)
    heard = _heard([tables[kind] for kind in HEARD], air)
    return Traffic(sent, heard, (int(log_ns.min()), int(log_ns.max())), spread_ns, len(begins) + 1)


def _by_radio_clock(log_ns: Times, radio_ns: Times) -> tuple[Times, float]:
    """When the radio stamped each record, on the log's clock; the records were read a little later.

    The least late of every second stands for no delay at all.
    """
    origin_ns, shift_ns = int(radio_ns[0]), int(log_ns[0] - radio_ns[0])
    since_ns = (radio_ns - origin_ns).astype(np.float64)
    line = fit_least_late(since_ns, (log_ns - radio_ns - shift_ns).astype(np.float64))
    return ClockMap(origin_ns, shift_ns, line.knots_ns, line.extras_ns)(radio_ns), line.spread_ns


def _tables(run: Run) -> dict[type, Table]:
    """The leading fields of every radio record; none of them varies in length."""
    leading = {kind: 5 if kind in HEARD else 7 for kind in KINDS}
    rows: dict[str, tuple[list[int], list[int], list[bytes]]] = {TOPICS[kind]: ([], [], []) for kind in KINDS}
    for raw in run.raw_messages(rows):
        times, numbers, payloads = rows[raw.topic]
        times.append(raw.log_time_ns)
        numbers.append(raw.number)
        payloads.append(raw.data[:96])
    return {
        kind: table_of(TOPICS[kind], run.store.fields(type_name(kind))[: leading[kind]], *rows[TOPICS[kind]])
        for kind in KINDS
    }


def _column(table: Table, which: int) -> Times:
    """Record numbers, log times, radio times [ns]."""
    if which == 2:
        name = "radio_time_us" if "radio_time_us" in table.columns else "uptime_us"
        return table[name].astype(np.int64) * 1000 if len(table) else np.empty(0, np.int64)
    return table[(NUMBER, TIME)[which]]


def _heard(tables: Sequence[Table], air: dict[int, int]) -> Frames:
    tables = [table for table in tables if len(table)]
    if not tables:
        return Frames(np.empty(0, np.uint64), np.empty(0, np.int64), np.empty(0, np.int64))

    def all_of(name: str) -> NDArray[np.int64]:
        return np.concatenate([table[name].astype(np.int64) for table in tables])

    numbers = all_of(NUMBER)
    keys = key_of(all_of("header.sender"), all_of("header.boot"), all_of("header.sequence"))
    return Frames(keys, numbers, np.array([air[number] for number in numbers.tolist()], np.int64))


def _sent(run: Run, table: Table, status: Table, reboots: Times, air: dict[int, int]) -> Frames:
    """Frames that went out, of boots whose counter the radio's status told.

    A frame's record does not say its boot: that ends where the radio's clock or its sequence begins anew.
    """
    if not len(table) or not len(status):
        return Frames(np.empty(0, np.uint64), np.empty(0, np.int64), np.empty(0, np.int64))
    numbers, sequence = table[NUMBER], table["sequence"].astype(np.int64)
    clocks = np.searchsorted(reboots, numbers, "right")
    restarts = numbers[1:][(np.diff(sequence) < 0) & (np.diff(clocks) == 0)]
    edges = np.unique(np.concatenate([reboots, restarts]))
    of_frame, of_status = (
        np.searchsorted(edges, numbers, "right"),
        np.searchsorted(edges, status[NUMBER], "right"),
    )
    boots, senders = np.full(len(edges) + 1, -1), np.full(len(edges) + 1, run.robot)
    for which in np.unique(of_status):
        told = np.flatnonzero(of_status == which)[0]
        boots[which], senders[which] = status["boot_counter"][told], status["robot"][told]
    keep = table["sent"] & (boots[of_frame] >= 0) & (senders[of_frame] >= 0)
    keys = key_of(senders[of_frame][keep], boots[of_frame][keep], sequence[keep])
    order = np.argsort(keys, kind="stable")
    numbers = numbers[keep][order]
    return Frames(keys[order], numbers, np.array([air[number] for number in numbers.tolist()], np.int64))
