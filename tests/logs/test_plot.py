"""The quick look at a run: what of the map is drawn."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from log_samples import CONFIG, START_NS, new_recorder
from numpy.typing import NDArray

from hippomat_core import messages as m
from hippomat_logs.cli import main

UNKNOWN_GREY, PATH_BLUE = (191, 191, 191), (31, 119, 180)


def written_log(directory: Path, cells: NDArray[np.int8], way_m: NDArray[np.float64]) -> Path:
    """A log with a map of 20 m by 20 m around the origin and the poses of a robot."""
    recorder = new_recorder(directory, CONFIG)
    recorder.put(START_NS, m.MapReceived(START_NS, 1, 400, 400, 0.05, -10.0, -10.0, cells.ravel()))
    for k, (x_m, y_m) in enumerate(way_m, start=1):
        recorder.put(START_NS + k * 50_000_000, m.PoseEstimated(x_m, y_m, 0.0, 0.1, 0.0, "slam"))
    recorder.close()
    (log,) = directory.glob("*.mcap")
    return log


def mostly_unknown() -> NDArray[np.int8]:
    """Known from (-1, -2) to (4, 3) m, walls around it."""
    cells = np.full((400, 400), -1, np.int8)
    cells[160:260, 180:280] = 100
    cells[162:258, 182:278] = 0
    return cells


def pixels(path: Path) -> NDArray[np.int64]:
    image = pytest.importorskip("matplotlib.image")
    return np.asarray(np.rint(255 * image.imread(path)[..., :3]), np.int64)


def share(picture: NDArray[np.int64], colour: tuple[int, int, int]) -> float:
    return float((np.abs(picture - colour).max(axis=-1) <= 3).mean())


def test_the_picture_ends_where_the_known_cells_and_the_path_do(tmp_path: Path) -> None:
    way_m = np.column_stack([np.linspace(0.0, 2.0, 20), np.zeros(20)])
    log = written_log(tmp_path / "log", mostly_unknown(), way_m)
    assert main(["plot", str(log), "-o", str(tmp_path / "x.png")]) == 0
    picture = pixels(tmp_path / "x.png")
    assert 0.0 < share(picture, UNKNOWN_GREY) < 0.05
    assert share(picture, PATH_BLUE) > 0.001


def test_a_path_that_leaves_the_map_and_a_map_that_knows_nothing_are_drawn_whole(tmp_path: Path) -> None:
    way_m = np.column_stack([np.linspace(0.0, 14.0, 20), np.zeros(20)])  # the map ends at 10 m
    for name, cells in (("left", mostly_unknown()), ("unknown", np.full((400, 400), -1, np.int8))):
        log = written_log(tmp_path / name, cells, way_m)
        assert main(["plot", str(log), "-o", str(tmp_path / f"{name}.png")]) == 0
        picture = pixels(tmp_path / f"{name}.png")
        assert share(picture, PATH_BLUE) > 0.001
        columns = np.flatnonzero((np.abs(picture - PATH_BLUE).max(axis=-1) <= 3).sum(axis=0))
        assert columns[-1] > columns[0] + 300
