"""hippomat-logs map: a robot was pushed about, and its log becomes the map of the place."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest
from lidar_world import LidarWorld, flat

from hippomat_core import messages as m
from hippomat_core.config import SlamConfig
from hippomat_logs.cli import main
from hippomat_logs.manifest import run_manifest
from hippomat_logs.map_files import load_map
from hippomat_logs.recorder import Recorder

START = (2.0, 2.5, 0.0)


@dataclass
class RecordedWorld(LidarWorld):
    """Keeps what it fed."""

    events: list[m.Event] = field(default_factory=list)

    def feed(self, event: m.Event) -> None:
        super().feed(event)
        self.events.append(event)

    def record(self, directory: Path, without: type | None = None) -> None:
        config = self.state.config
        manifest = run_manifest(config, session_id="0000abcd", policy=None)
        recorder = Recorder(
            directory, manifest, config=config, wall_ns=10**18, stamp_ns=0, lossless=True, policy=b""
        )
        for event in self.events:
            if without is None or not isinstance(event, without):
                recorder.put(event.stamp_ns, event)
        recorder.close()


@pytest.fixture(scope="module")
def pushed() -> RecordedWorld:
    """Through the whole room and back, without a map."""
    world = RecordedWorld(flat(), START, START, seed=3, slam=SlamConfig(mode="map"), maps=False)
    for seconds, v_mps, wz_radps in [(4, 0.2, 0), (2, 0, 1.5), (5, 0.25, 0.2), (3, 0, -1.4), (6, 0.2, 0.3)]:
        world.drive(seconds, v_mps, wz_radps)
    return world


def walls_m(path: Path) -> np.ndarray:
    """(n, 2) [m] middles of the occupied cells."""
    grid = load_map(path)
    iy, ix = np.nonzero(grid.cells == 100)
    return np.stack([grid.origin_x_m + (ix + 0.5) * 0.05, grid.origin_y_m + (iy + 0.5) * 0.05], axis=1)


def test_the_map_lies_in_the_frame_of_the_start_pose_and_shows_the_walls(pushed, tmp_path, capsys):
    pytest.importorskip("gtsam")
    pushed.record(tmp_path)
    out = tmp_path / "lab.yaml"
    assert main(["map", str(tmp_path), "-o", str(out), "--picture", str(tmp_path / "lab.png")]) == 0
    said = capsys.readouterr().out
    assert "keyframes" in said
    found, (iy, ix) = walls_m(out), np.nonzero(flat().cells == 100)
    there = np.stack([(ix + 0.5) * 0.05, (iy + 0.5) * 0.05], axis=1)
    away_m = np.hypot(*(found[:, None] - there[None]).transpose(2, 0, 1)).min(axis=1)
    assert len(found) > 300
    assert np.mean(away_m < 0.11) > 0.97
    assert (tmp_path / "lab.png").stat().st_size > 10_000
    again = tmp_path / "again.yaml"
    assert main(["map", str(tmp_path), "-o", str(again)]) == 0
    first, second = (path.with_suffix(".pgm").read_bytes() for path in (out, again))
    assert first == second, "the same log, the same map"


@pytest.mark.parametrize(
    ("name", "text"),
    [("lab.png", "must end in .yaml"), ("nowhere/lab.yaml", "there is no directory")],
)
def test_a_place_that_no_map_can_be_written_to_is_refused_before_the_work(tmp_path, capsys, name, text):
    assert main(["map", str(tmp_path), "-o", str(tmp_path / name)]) == 1
    assert text in capsys.readouterr().err.replace("\n", " ")


def test_a_log_without_sweeps_says_whose_log_is_needed(pushed, tmp_path, capsys):
    pushed.record(tmp_path, without=m.ScanReceived)
    assert main(["map", str(tmp_path), "-o", str(tmp_path / "lab.yaml")]) != 0
    assert "no whole lidar sweep was recorded" in capsys.readouterr().err.replace("\n", " ")
    assert not (tmp_path / "lab.yaml").exists()
