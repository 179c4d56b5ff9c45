"""What one run says of its radio: every frame sent and heard, on the radio's clock and on the log's.

Decides which boot of the radio a record belongs to, and what time of the log a time of the radio is. Reads
the first fields of the records only, as columns: they lie at the same bytes in every message of a kind.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hippomat_core import messages as m
from hippomat_core.wire.frames import RELAY, STATE, STOP, TASKS
from hippomat_logs.clock_map import BIN_NS, ClockMap, Floats, common_slope, fit_least_late
from hippomat_logs.column_table import NUMBER, TIME, Table, table_of
from hippomat_logs.definitions import HEARD
from hippomat_logs.reader import Run
from hippomat_logs.schema import CLASSES, TOPICS, type_name
from hippomat_logs.walk import RawMessage

KINDS = (*HEARD, m.FrameSent, m.RadioStatus, m.RoundEnded)
_AIR_KINDS = (STATE, RELAY, TASKS, STOP)  # of HEARD
LONG_BOOT_NS = 60 * BIN_NS  # tells the drift by itself
BATCH_ROWS = 20_000
LEADING_BYTES = 96  # hold the fields that are read
REBOOT_NS = 1_000_000_000  # a radio's clock that steps back by more has begun anew

Keys = NDArray[np.uint64]
Times = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Frames:
    """Frames on the air as one run knows them. keys: see key_of(); unique where they were sent, sorted."""

    keys: Keys  # (n,)
    numbers: Times  # (n,) of the records
    air_ns: Times  # (n,) when it was on the air, on the run's own log clock, by way of the radio's
    kinds: NDArray[np.uint8]  # (n,) wire.frames.STATE ..; a RESUME that was heard counts as STOP

    def where(self, chosen: NDArray[Any]) -> Frames:
        """Some of them: a mask or places."""
        return Frames(self.keys[chosen], self.numbers[chosen], self.air_ns[chosen], self.kinds[chosen])


NOTHING = Frames(np.empty(0, np.uint64), np.empty(0, np.int64), np.empty(0, np.int64), np.empty(0, np.uint8))


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
    numbers = np.concatenate([tables[kind][NUMBER] for kind in KINDS])
    order = np.argsort(numbers, kind="stable")
    numbers = numbers[order]
    log_ns = np.concatenate([tables[kind][TIME] for kind in KINDS])[order]
    radio_ns = np.concatenate([_radio_ns(tables[kind]) for kind in KINDS])[order]
    if not len(numbers):
        return Traffic(NOTHING, NOTHING, (0, 0), 0.0, 0)
    begins = np.flatnonzero(np.diff(radio_ns) < -REBOOT_NS) + 1  # of the radio's boots
    air_ns, spread_ns = _by_radio_clock(log_ns, radio_ns, np.split(np.arange(len(numbers)), begins))
    sent = _sent(run, tables[m.FrameSent], tables[m.RadioStatus], numbers[begins], numbers, air_ns)
    heard = _heard([tables[kind] for kind in HEARD], numbers, air_ns)
    return Traffic(sent, heard, (int(log_ns.min()), int(log_ns.max())), spread_ns, len(begins) + 1)


def _by_radio_clock(log_ns: Times, radio_ns: Times, boots: Sequence[Times]) -> tuple[Times, float]:
    """When the radio stamped each record, on the log's clock; the records were read a little later.

    The least late of every second stands for no delay at all. boots: indices of each boot's records; a short
    boot has the drift of all, for the crystal is the same.
    """
    late = [_Late.of(log_ns[boot], radio_ns[boot]) for boot in boots]
    drift = common_slope([(one.since_ns, one.late_ns) for one in late]) if len(late) > 1 else None
    air_ns, spread_ns = np.empty(len(log_ns), np.int64), 0.0
    for boot, one in zip(boots, late, strict=True):
        is_short = one.since_ns[-1] < LONG_BOOT_NS
        line = fit_least_late(one.since_ns, one.late_ns, drift if is_short else None)
        map_ = ClockMap(one.origin_ns, one.shift_ns, line.knots_ns, line.extras_ns)
        air_ns[boot] = map_(radio_ns[boot])
        spread_ns = max(spread_ns, line.uncertainty_ns(0.0))
    return air_ns, spread_ns


@dataclass(frozen=True, slots=True)
class _Late:
    """log = radio + shift_ns + late_ns, of one boot."""

    origin_ns: int
    shift_ns: int
    since_ns: Floats  # (n,) radio - origin_ns
    late_ns: Floats  # (n,)

    @classmethod
    def of(cls, log_ns: Times, radio_ns: Times) -> _Late:
        origin_ns, shift_ns = int(radio_ns[0]), int(log_ns[0] - radio_ns[0])
        since_ns = (radio_ns - origin_ns).astype(np.float64)
        return cls(origin_ns, shift_ns, since_ns, (log_ns - radio_ns - shift_ns).astype(np.float64))


def _tables(run: Run) -> dict[type, dict[str, NDArray[Any]]]:
    """The leading fields of every radio record, as columns; none of them varies in length."""
    batches: dict[str, list[Table]] = {TOPICS[kind]: [] for kind in KINDS}
    rows: dict[str, list[RawMessage]] = {topic: [] for topic in batches}
    for raw in run.raw_messages(rows):
        rows[raw.topic].append(raw)
        if len(rows[raw.topic]) == BATCH_ROWS:
            batches[raw.topic].append(_table(run, raw.topic, rows[raw.topic]))
            rows[raw.topic].clear()
    for topic, batch in batches.items():
        batch.append(_table(run, topic, rows[topic]))
    return {CLASSES[topic]: _joined(batch) for topic, batch in batches.items()}


def _table(run: Run, topic: str, rows: Sequence[RawMessage]) -> Table:
    kind = CLASSES[topic]
    fields = run.store.fields(type_name(kind))[: 5 if kind in HEARD else 7]
    data = [raw.data[:LEADING_BYTES] for raw in rows]
    return table_of(topic, fields, [raw.log_time_ns for raw in rows], [raw.number for raw in rows], data)


def _joined(batch: Sequence[Table]) -> dict[str, NDArray[Any]]:
    filled = [one for one in batch if len(one)] or batch[:1]
    return {name: np.concatenate([one[name] for one in filled]) for name in filled[0].columns}


def _radio_ns(table: dict[str, NDArray[Any]]) -> Times:
    name = "radio_time_us" if "radio_time_us" in table else "uptime_us"
    return table[name].astype(np.int64) * 1000 if name in table else np.empty(0, np.int64)


def _heard(tables: Sequence[dict[str, NDArray[Any]]], numbers: Times, air_ns: Times) -> Frames:
    kinds = np.repeat(np.array(_AIR_KINDS, np.uint8), [len(table[NUMBER]) for table in tables])
    tables = [table for table in tables if len(table[NUMBER])]
    if not tables:
        return NOTHING

    def all_of(name: str) -> NDArray[np.int64]:
        return np.concatenate([table[name].astype(np.int64) for table in tables])

    keys = key_of(all_of("header.sender"), all_of("header.boot"), all_of("header.sequence"))
    heard = all_of(NUMBER)
    return Frames(keys, heard, air_ns[np.searchsorted(numbers, heard)], kinds)


def _sent(
    run: Run,
    table: dict[str, NDArray[Any]],
    status: dict[str, NDArray[Any]],
    reboots: Times,
    numbers: Times,
    air_ns: Times,
) -> Frames:
    """Frames that went out, of boots whose counter the radio's status told.

    A frame's record does not say its boot: that ends where the radio's clock or its sequence begins anew.
    """
    if not len(table[NUMBER]) or not len(status[NUMBER]):
        return NOTHING
    sent, sequence = table[NUMBER], table["sequence"].astype(np.int64)
    clocks = np.searchsorted(reboots, sent, "right")
    restarts = sent[1:][(np.diff(sequence) < 0) & (np.diff(clocks) == 0)]
    edges = np.unique(np.concatenate([reboots, restarts]))
    of_frame = np.searchsorted(edges, sent, "right")
    of_status = np.searchsorted(edges, status[NUMBER], "right")
    boots, senders = np.full(len(edges) + 1, -1), np.full(len(edges) + 1, run.robot)
    for which in np.unique(of_status):
        told = np.flatnonzero(of_status == which)[0]
        boots[which], senders[which] = status["boot_counter"][told], status["robot"][told]
    keep = table["sent"] & (boots[of_frame] >= 0) & (senders[of_frame] >= 0)
    keys = key_of(senders[of_frame][keep], boots[of_frame][keep], sequence[keep])
    order = np.argsort(keys, kind="stable")
    sent, kinds = sent[keep][order], table["kind"][keep][order].astype(np.uint8)
    return Frames(keys[order], sent, air_ns[np.searchsorted(numbers, sent)], kinds)
