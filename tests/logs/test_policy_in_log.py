"""A log carries the weights that decided: a replay needs no file beside it."""

from __future__ import annotations

import dataclasses
import time
from pathlib import Path

import numpy as np
import pytest
from recorded_run import CONFIG, START_NS, RecordedRun, record_run
from safetensors.numpy import save
from test_recorder import wait_until_written

from hippomat_core.allocation.paper_network import expected_shapes
from hippomat_core.config import Config
from hippomat_core.errors import LogError
from hippomat_core.messages import BASE
from hippomat_logs.reader import open_runs
from hippomat_logs.recovery import recover_directory
from hippomat_logs.replay import ReplayOptions, replay_run
from hippomat_logs.report import OK
from hippomat_logs.sink import ACTIVE


def weights(seed: int) -> bytes:
    draw = np.random.default_rng(seed)
    shapes = expected_shapes(CONFIG.fleet.task_slots)
    return save({key: draw.normal(size=shape).astype(np.float32) for key, shape in shapes.items()})


NETWORK = dataclasses.replace(
    CONFIG, fleet=dataclasses.replace(CONFIG.fleet, allocator="paper_network", policy="/gone.safetensors")
)


def test_a_run_is_replayed_with_the_weights_in_its_log(tmp_path: Path):
    made = record_run(tmp_path, ticks=150, config=NETWORK, policy=weights(1))
    (run,) = open_runs([tmp_path])
    assert run.policy == weights(1)
    report = replay_run(run, ReplayOptions(("L0", "L1", "L2")))
    assert [result.status for result in report.results] == [OK, OK, OK]
    assert report.results[2].compared == made.decisions


def rotated(tmp_path: Path) -> list[Path]:
    """A run of several parts."""
    small = dataclasses.replace(NETWORK, log=dataclasses.replace(NETWORK.log, part_mib=1))
    made, draw = RecordedRun(tmp_path, small, policy=weights(1)), np.random.default_rng(3)
    for _ in range(2):
        for k in range(12):
            made.recorder.serial(START_NS + k, BASE, 0, 1, draw.bytes(100_000))
        wait_until_written(made.recorder)
    made.recorder.close()
    parts = sorted(tmp_path.glob("*.mcap"))
    assert len(parts) > 1
    return parts


def test_every_part_of_a_run_carries_them(tmp_path: Path):
    parts = rotated(tmp_path)
    for part in parts:
        assert open_runs([part])[0].policy == weights(1)


def test_they_survive_a_recovery(tmp_path: Path):
    record_run(tmp_path, config=NETWORK, policy=weights(1))
    (path,) = tmp_path.glob("*.mcap")
    path.with_name(path.name + ACTIVE).write_bytes(path.read_bytes()[:-1000])
    path.unlink()
    recover_directory(tmp_path)
    (run,) = open_runs([tmp_path])
    assert run.recovered or run.manifest["recovered"] == "yes"
    assert run.policy == weights(1)


def test_weights_larger_than_a_part_do_not_fill_the_disk_with_parts(tmp_path: Path):
    robots = 40
    draw, shapes = np.random.default_rng(1), expected_shapes(CONFIG.fleet.task_slots)
    many = save({k: draw.normal(size=(robots, *shape)).astype(np.float32) for k, shape in shapes.items()})
    assert len(many) > 2 << 20
    fleet = dataclasses.replace(NETWORK.fleet, size=robots, round_s=0.2)
    small = Config(fleet=fleet, robot=NETWORK.robot, log=dataclasses.replace(NETWORK.log, part_mib=1))
    made = RecordedRun(tmp_path, small, policy=many)
    for k in range(3):
        made.recorder.serial(START_NS + k, BASE, 0, 1, b"bytes")
        wait_until_written(made.recorder)
        time.sleep(0.6)  # a flush
    made.recorder.close()
    assert len(list(tmp_path.glob("*.mcap"))) == 1
    assert open_runs([tmp_path])[0].policy == many


def test_a_log_without_the_weights_that_its_manifest_names_is_damaged(tmp_path: Path):
    record_run(tmp_path, config=NETWORK, policy=weights(1), recorded_policy=b"")
    with pytest.raises(LogError, match="holds another policy than its manifest names, or none"):
        open_runs([tmp_path])


def test_a_run_without_weights_carries_none(tmp_path: Path):
    record_run(tmp_path)
    assert open_runs([tmp_path])[0].policy == b""
