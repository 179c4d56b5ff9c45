"""Motion capture beside the logs: clock and frame are found, errors come out as they were put in."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from fleet_logs import write_log
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from hippomat_core import messages as m
from hippomat_core.errors import HippomatError
from hippomat_logs.cli import main
from hippomat_logs.metrics.same_motion import Rigid, fit_rigid, match
from hippomat_logs.metrics.truth_files import Track, read_truth

SECONDS, TICK_S = 40.0, 0.05
MOVED = Rigid(5.0, -3.0, math.radians(-120.0))  # map frame -> that of the cameras


def way(robot: int, time_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n, 3) a robot that goes round with a speed of its own that changes and never repeats itself."""
    angle = 0.25 * time_s + (0.4 + 0.2 * robot) * np.sin(0.7 * time_s + robot) + np.sin(0.19 * time_s)
    radius_m = 1.0 + 0.5 * robot
    x, y = radius_m * np.cos(angle), radius_m * np.sin(angle)
    return np.column_stack([x, y, angle + math.pi / 2])


def wrong(robot: int, time_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n, 2) what the estimate is off by: robot 0 by 3 cm and back, robot 1 not at all."""
    return np.outer(np.where(np.sin(3.0 * time_s) > 0.0, 0.03, -0.03), [1.0, 0.0]) * (robot == 0)


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two robots; robot 1 does not know where it is between 10 s and 20 s, and is 2 m off then."""
    directory = tmp_path_factory.mktemp("truth")
    for robot in (0, 1):
        at_s = np.arange(0.0, SECONDS, TICK_S)
        poses = way(robot, at_s)
        poses[:, :2] += wrong(robot, at_s)
        stamped: list[tuple[float, object]] = []
        for k, time_s in enumerate(at_s.tolist()):
            lost = robot == 1 and 10.0 <= time_s < 20.0
            phase = "lost" if lost else "localized"
            stamped.append((time_s, m.Localized(0, phase, 0, 0, 0, 1, np.zeros(9), 0, 0, 0, 0)))
            x_m, y_m, yaw_rad = poses[k].tolist()
            stamped.append((time_s, m.PoseEstimated(x_m + 2.0 * lost, y_m, yaw_rad, 0.0, 0.0, "slam")))
        write_log(directory, robot, stamped)
    return directory


def write_csv(path: Path, frame: Rigid = MOVED, *, begun_s: float = 77.7, yaw: bool = True) -> Path:
    """100 Hz for longer than the logs, one millimetre of noise, a moment lost now and then."""
    random, at_s = np.random.default_rng(3), np.arange(-5.0, SECONDS + 5.0, 0.01)
    lines = ["frame,time_s,robot,x_m,y_m" + ",yaw_rad" * yaw]
    for robot in (0, 1):
        poses = frame(way(robot, at_s))
        poses[:, :2] += random.normal(0.0, 0.001, (len(at_s), 2))
        for k in np.flatnonzero(random.random(len(at_s)) > 0.02).tolist():
            turned = f",{math.remainder(poses[k, 2], math.tau):.5f}" * yaw
            lines.append(f"{k},{at_s[k] + begun_s:.4f},{robot},{poses[k, 0]:.5f},{poses[k, 1]:.5f}{turned}")
    path.write_text("\n".join(lines) + "\n")
    return path


def truth_of(logs: Path, capsys: pytest.CaptureFixture[str], *arguments: str) -> dict[str, object]:
    assert main(["metrics", str(logs), "--json", *arguments]) == 0
    found: dict[str, object] = json.loads(capsys.readouterr().out)["truth"]
    return found


def test_clock_frame_and_errors_are_found(
    logs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    truth = truth_of(logs, capsys, "--truth", str(write_csv(tmp_path / "mocap.csv")))
    frame = Rigid(**truth["match"]["frame"])  # type: ignore[index]
    there_and_back = frame(MOVED(np.array([[1.0, 2.0, 0.3]])))[0]
    assert there_and_back[:2] == pytest.approx([1.0, 2.0], abs=0.005)
    assert truth["match"]["correlation"] > 0.8  # type: ignore[index]  # what it is off by moves too
    first, second = truth["robots"]  # type: ignore[misc]
    assert first["ate_m"] == pytest.approx(0.03, abs=0.002)
    assert first["median_m"] == pytest.approx(0.03, abs=0.003)
    assert second["most_m"] < 0.01  # while it knew its place
    assert second["known"] == pytest.approx(0.75, abs=0.01)
    assert second["rpe_m"] < 0.005
    assert first["yaw_deg"] < 0.3
    for robot, one in enumerate((first, second)):
        at_s = np.arange(-5.0, SECONDS + 5.0, 0.01)
        driven_m = float(np.hypot(*np.diff(way(robot, at_s)[:, :2], axis=0).T).sum())
        assert one["driven_m"] == pytest.approx(driven_m, rel=0.02)  # although the cameras tremble


def test_the_maps_frame_is_not_fitted(logs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """An offset between the frames is then an error."""
    csv = write_csv(tmp_path / "map.csv", Rigid(0.1, 0.0, 0.0), yaw=False)
    truth = truth_of(logs, capsys, "--truth", str(csv), "--truth-frame", "map")
    first, second = truth["robots"]  # type: ignore[misc]
    assert second["median_m"] == pytest.approx(0.1, abs=0.02)
    assert (first["yaw_deg"], first["rpe_deg"]) == (None, None)
    fitted = truth_of(logs, capsys, "--truth", str(csv))
    assert fitted["robots"][1]["median_m"] < 0.01  # type: ignore[index]


def test_the_nearest_that_two_robots_came(
    logs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    truth = truth_of(logs, capsys, "--truth", str(write_csv(tmp_path / "mocap.csv")))
    at_s = np.arange(-5.0, SECONDS + 5.0, 0.01)
    apart_m = np.hypot(*(way(0, at_s) - way(1, at_s))[:, :2].T)
    assert truth["nearest"]["clear_m"] == pytest.approx(apart_m.min() - 0.24, abs=0.01)  # type: ignore[index]
    assert truth["nearest"]["robots"] == [0, 1]  # type: ignore[index]


def test_the_table_is_80_columns_wide(logs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["metrics", str(logs), "--truth", str(write_csv(tmp_path / "mocap.csv"))]) == 0
    out = capsys.readouterr().out
    assert "RPE 1 s" in out
    assert max(map(len, out[: out.index("beside the paper")].splitlines())) <= 80
    assert any(line.startswith("frame of the truth: turned 1") for line in out.splitlines())


@given(st.floats(-5, 5), st.floats(-5, 5), st.floats(-3.1, 3.1), st.integers(0, 1000))
def test_a_rigid_transform_is_found_exactly(x_m: float, y_m: float, yaw_rad: float, seed: int) -> None:
    points = np.random.default_rng(seed).normal(0.0, 2.0, (12, 3))
    found = fit_rigid(points, Rigid(x_m, y_m, yaw_rad)(points))
    assert found(points)[:, :2] == pytest.approx(Rigid(x_m, y_m, yaw_rad)(points)[:, :2], abs=1e-6)


@given(st.floats(-1e9, 1e9), st.integers(0, 50))
def test_any_offset_of_the_clock_is_found(offset_s: float, later_s: int) -> None:
    at_s = np.arange(0.0, SECONDS, 0.05)
    told = {0: Track(at_s + offset_s, way(0, at_s))}
    begun_s = min(later_s, SECONDS / 3)
    true_s = np.arange(begun_s, SECONDS, 0.01)
    found = match(told, {0: Track(true_s, way(0, true_s))}, fit_frame=True)
    assert found.offset_s == pytest.approx(offset_s, abs=0.005)


def test_the_motion_of_another_run_is_refused() -> None:
    at_s = np.arange(0.0, SECONDS, 0.05)
    noise = np.cumsum(np.random.default_rng(1).normal(0.0, 0.01, (len(at_s), 3)), axis=0)
    with pytest.raises(HippomatError, match="is it of this run"):
        match({0: Track(at_s, way(0, at_s))}, {0: Track(at_s, noise)}, fit_frame=True)


def test_robots_that_stood_still_give_no_frame(tmp_path: Path) -> None:
    still = np.zeros((100, 3))
    with pytest.raises(HippomatError, match="--truth-frame map"):
        fit_rigid(still, still)
    assert tmp_path.is_dir()


@dataclass(frozen=True)
class Refused:
    text: str
    said: str


@pytest.mark.parametrize(
    "case",
    [
        Refused("", "no column time_s, robot, x_m, y_m"),
        Refused("time_s,robot,x_m\n1,2,3\n", "no column y_m"),
        Refused("time_s,robot,x_m,y_m\n1,2,3,4\n", "no robot at two moments"),
        Refused("time_s,robot,x_m,y_m\n1,2,,4\n", "line 2: x_m = '' is no number"),
        Refused("time_s,robot,x_m,y_m\n1,2,nan,4\n", "line 2: x_m = 'nan' is not finite"),
        Refused("time_s,robot,x_m,y_m\n1,2.5,1,4\n", "line 2: robot = 2.5 is no robot's id"),
        Refused("time_s,robot,x_m,y_m\n1,70,1,4\n", "robot = 70 is no robot's id"),
        Refused("\0\xff\0", "no column"),
    ],
)
def test_a_file_that_is_none_is_refused_by_line_and_value(tmp_path: Path, case: Refused) -> None:
    path = tmp_path / "mocap.csv"
    path.write_text(case.text)
    with pytest.raises(HippomatError, match=case.said.replace(".", r"\.")):
        read_truth(path)
    with pytest.raises(HippomatError, match="no such file"):
        read_truth(tmp_path / "none.csv")
    (tmp_path / "truth.npz").write_bytes(b"no zip")
    with pytest.raises(HippomatError, match=r"is no truth\.npz"):
        read_truth(tmp_path / "truth.npz")


def test_robots_that_the_logs_do_not_have_are_named(
    logs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "other.csv"
    path.write_text("time_s,robot,x_m,y_m\n1,7,0,0\n2,7,1,0\n")
    assert main(["metrics", str(logs), "--truth", str(path)]) == 1
    assert "--truth has robots 7" in capsys.readouterr().err


def test_speeds_that_repeat_are_told_apart_by_the_way() -> None:
    """Nine seconds of the same speeds again and again, each time in another direction."""
    at_s = np.arange(0.0, 90.0, 0.05)
    speed = 0.2 * (1.0 + np.sin(math.tau * at_s / 9.0))
    turned = np.random.default_rng(4).uniform(-2.0, 2.0, 10)[(at_s // 9.0).astype(int)]
    steps = np.column_stack([speed * np.cos(turned), speed * np.sin(turned)]) * 0.05
    poses = np.column_stack([np.cumsum(steps, axis=0), turned])
    part = slice(620, 1500)
    told = {0: Track(at_s[part] + 1000.0, poses[part])}
    found = match(told, {0: Track(at_s, poses)}, fit_frame=True)
    assert found.offset_s == pytest.approx(1000.0, abs=0.005)
