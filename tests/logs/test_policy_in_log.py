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
from hippomat_core.messages import BASE, RoundDecided
from hippomat_logs.reader import open_runs
from hippomat_logs.recovery import recover_directory
from hippomat_logs.replay import ReplayOptions, replay_run
from hippomat_logs.report import NOT_RUN, NOT_WHOLE, OK
from hippomat_logs.sink import ACTIVE
from hippomat_logs.walk import ATTACHMENT


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


def attachment_at(path: Path) -> int:
    """Where the record of the weights begins."""
    data, at = path.read_bytes(), 8
    while data[at] != ATTACHMENT:
        at += 9 + int.from_bytes(data[at + 1 : at + 9], "little")
    return at


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
    assert run.manifest["recovered"] == "yes"
    assert run.policy == weights(1)


def test_a_run_whose_last_part_was_cut_inside_its_weights_has_those_of_its_other_parts(tmp_path: Path):
    parts = rotated(tmp_path)
    head, data = attachment_at(parts[-1]), parts[-1].read_bytes()
    parts[-1].with_name(parts[-1].name + ACTIVE).write_bytes(data[: head + 2000])
    parts[-1].unlink()
    (line,) = recover_directory(tmp_path)
    assert "0 records kept" in line
    (run,) = open_runs([tmp_path])
    assert run.policy == weights(1)
    assert sum(1 for _ in run.records_in_order()) > 0
    (alone,) = open_runs([parts[-1]])
    assert alone.policy == b""


def test_damaged_weights_cost_a_recovery_none_of_the_records_behind_them(tmp_path: Path):
    made = record_run(tmp_path, ticks=100, config=NETWORK, policy=weights(1))
    (path,) = tmp_path.glob("*.mcap")
    data = bytearray(path.read_bytes())
    data[attachment_at(path) + 2000] ^= 0x10
    path.with_name(path.name + ACTIVE).write_bytes(data)
    path.unlink()
    (line,) = recover_directory(tmp_path)
    assert "attachment at byte" in line
    (run,) = open_runs([tmp_path])
    assert sum(type(record.message) is RoundDecided for record in run.records_in_order()) == made.decisions
    report = replay_run(run, ReplayOptions(("L0", "L1", "L2", "daemon")))
    assert {result.level: result.status for result in report.results} == {
        "L0": NOT_WHOLE, "L1": OK, "L2": NOT_RUN, "daemon": NOT_RUN,
    }  # fmt: skip
    assert "the weights that decided are lost" in report.results[0].detail
    assert report.exit_code == 3


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


@pytest.mark.parametrize("policy", [b"no weights at all", save({"a": np.full(3, np.nan, np.float32)})])
def test_weights_in_a_log_that_cannot_be_read_are_damage_of_that_file(tmp_path: Path, policy: bytes):
    record_run(tmp_path, config=NETWORK, policy=weights(1), recorded_policy=policy)
    with pytest.raises(LogError, match=r"_000\.mcap: .*policy.*") as caught:
        open_runs([tmp_path])
    assert caught.value.exit_code == 3


def test_each_robot_of_a_fleet_with_weights_of_its_own_is_replayed_with_those(tmp_path: Path):
    for robot in range(2):
        fleet = dataclasses.replace(NETWORK.fleet, policy_per_robot=True)
        config = Config(fleet=fleet, robot=dataclasses.replace(NETWORK.robot, id=robot))
        record_run(tmp_path, ticks=100, config=config, policy=weights(robot))
    runs = open_runs([tmp_path])
    assert [run.policy for run in runs] == [weights(0), weights(1)]
    for run in runs:
        results = replay_run(run, ReplayOptions(("L0", "L2"))).results
        assert [result.status for result in results] == [OK, OK]


def test_a_log_without_the_weights_that_its_manifest_names_is_damaged(tmp_path: Path):
    record_run(tmp_path, config=NETWORK, policy=weights(1), recorded_policy=b"")
    with pytest.raises(LogError, match="holds another policy than its manifest names, or none"):
        open_runs([tmp_path])


def test_a_run_without_weights_carries_none(tmp_path: Path):
    record_run(tmp_path)
    assert open_runs([tmp_path])[0].policy == b""
