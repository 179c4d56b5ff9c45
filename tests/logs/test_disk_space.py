"""A disk that runs low: bulk goes first, decisions stay, and a run that cannot fit does not begin."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from log_samples import CONFIG, START_NS, new_recorder

from hippomat_core import messages as m
from hippomat_core.config import LogConfig
from hippomat_core.errors import HippomatError
from hippomat_logs import open_run
from hippomat_logs.disk_space import KEEP_ALL, MIB, NO_BULK, NO_VIEWS, DiskWatch
from hippomat_logs.reader import Run, open_runs
from hippomat_logs.records import DropRecord, SerialRecord

SCAN = m.ScanReceived(
    START_NS, np.full(90, 9, np.uint8), np.arange(90, dtype=np.uint16), np.full(90, 4000, np.uint16)
)


def test_a_run_that_the_disk_cannot_hold_is_refused_with_the_ways_out(tmp_path: Path) -> None:
    config = dataclasses.replace(CONFIG, log=LogConfig(expected_min=60.0, rate_mib_per_min=10.0))
    with pytest.raises(HippomatError) as caught:
        new_recorder(tmp_path, config=config, free=lambda: 599 * MIB)
    assert "60 min (10 MiB/min) needs 600 MiB" in str(caught.value)
    assert "599 MiB free: make room, choose another disk (--log DIR), or lower [log] expected_min" in str(
        caught.value
    )
    assert list(tmp_path.iterdir()) == []
    new_recorder(tmp_path, config=config, free=lambda: 600 * MIB).close()
    new_recorder(
        tmp_path, config=config, free=lambda: 0, lossless=True
    ).close()  # a replay asks for no forecast


@given(st.lists(st.integers(0, 400), max_size=60))
def test_levels_rise_at_once_and_fall_with_some_room_to_spare(free_mib: list[int]) -> None:
    left = [1000]
    watch = DiskWatch(100, lambda: left[0] * MIB)
    level = KEEP_ALL
    for mib in free_mib:
        left[0] = mib
        before, level = level, watch.level()
        assert level >= (NO_BULK if mib < 50 else NO_VIEWS if mib < 100 else KEEP_ALL)
        assert level == KEEP_ALL or mib <= (62.5 if level == NO_BULK else 125)
        assert level <= before or mib < 100
        assert (watch.problem == "") == (level == KEEP_ALL)


def test_scans_are_shed_and_decisions_kept_while_the_disk_is_low(tmp_path: Path) -> None:
    left = [1000 * MIB]
    recorder = new_recorder(tmp_path, free=lambda: left[0])

    def ticks_until(done: Callable[[], bool]) -> None:
        until_s = time.monotonic() + 20.0
        while not done() and time.monotonic() < until_s:
            recorder.put(SCAN.stamp_ns, SCAN)
            recorder.serial(START_NS, m.LIDAR, 0, 1, b"lidar")
            recorder.serial(START_NS, m.BASE, 0, 1, b"base")
            recorder.put(START_NS, m.Drive(0.1, 0.0, "follow"))
            time.sleep(0.01)

    ticks_until(lambda: recorder.status().records >= 200)
    left[0] = 30 * MIB
    ticks_until(lambda: recorder.status().shed > 50)
    assert "30 MiB free: scans, grids and views are not recorded, decisions are" in recorder.status().problem
    left[0] = 1000 * MIB
    ticks_until(lambda: recorder.status().problem == "")
    status = recorder.close()
    assert status.lost == 0
    run = open_runs_of(tmp_path)
    records = [record.message for record in run.records_in_order()]
    kinds = {kind: sum(isinstance(record, kind) for record in records) for kind in (m.Drive, m.ScanReceived)}
    assert kinds[m.Drive] == status.records / 4
    base = sum(isinstance(r, SerialRecord) and r.port == m.BASE for r in records)
    assert base == status.records / 4
    dropped = sum(r.last - r.first + 1 for r in records if isinstance(r, DropRecord))
    assert dropped == status.shed
    assert kinds[m.ScanReceived] == status.records / 4 - status.shed / 2
    assert len(run.lost) == 1
    assert "lost: disk low: bulk was shed" in run.lost[0]
    assert len(open_run(tmp_path)["/scan"]) <= kinds[m.ScanReceived]


def open_runs_of(directory: Path) -> Run:
    (run,) = open_runs([directory])
    list(run.records_in_order())
    return run


def test_a_queue_that_fills_up_sheds_scans_before_anything_else(tmp_path: Path) -> None:
    recorder = new_recorder(tmp_path, queue_records=200)
    for _ in range(60):  # far faster than the writer, which sleeps between its syncs
        recorder.put(SCAN.stamp_ns, SCAN)
        recorder.put(START_NS, m.Drive(0.1, 0.0, "follow"))
        recorder.serial(START_NS, m.LIDAR, 0, 1, b"lidar")
    status = recorder.close()
    assert status.shed > 0
    assert status.lost == 0
    (run,) = open_runs([tmp_path])
    assert sum(isinstance(record.message, m.Drive) for record in run.records_in_order()) == 60
    assert any("queue half full: bulk was shed" in line for line in run.lost)
