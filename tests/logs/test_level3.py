"""Level L3 on worlds that move exactly, too fast, or turned: what each figure must say."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import pytest
from recorded_run import room

from hippomat_logs.level3 import Command, Motion, Pose, drive_again, judge
from hippomat_logs.level3_picture import draw
from hippomat_logs.reader import Run
from hippomat_logs.report import RunReport

TICK_S, SECONDS = 0.05, 23.0
SPEED, TURN = 0.2, 0.25


class Unicycle:
    """Drives the commands as they are, faster by a factor, or with a wheel that pulls."""

    def __init__(self, faster: float = 1.0, pull_radps: float = 0.0) -> None:
        self._faster, self._pull_radps = faster, pull_radps

    def drive(self, start: Pose, commands: Sequence[Command], sample_times_s: Sequence[float]) -> list[Pose]:
        (x, y, yaw), time_s, poses = start, 0.0, []
        for until_s in sample_times_s:
            while time_s < until_s - 1e-9:
                _, v, wz = [c for c in commands if c[0] <= time_s + 1e-9][-1]
                step_s = min(0.01, until_s - time_s)
                yaw += (wz + self._pull_radps) * step_s
                x += self._faster * v * math.cos(yaw) * step_s
                y += self._faster * v * math.sin(yaw) * step_s
                time_s += step_s
            poses.append((x, y, math.remainder(yaw, math.tau)))
        return poses

    def close(self) -> None: ...


def recorded() -> Motion:
    """Straight, a left turn, straight again; as an exact robot drives it."""
    commands = [(0.0, SPEED, 0.0), (8.0, SPEED / 2, TURN), (12.0, SPEED, 0.0)]
    times = [TICK_S * k for k in range(1, round(SECONDS / TICK_S))]
    poses = Unicycle().drive((1.0, 1.0, 3.0), commands, times)
    return Motion([(0.0, (1.0, 1.0, 3.0)), *zip(times, poses, strict=True)], commands, room())


def test_a_robot_that_moves_as_recorded_has_no_error() -> None:
    driven = drive_again(recorded(), Unicycle())
    result = judge(driven, strict=True)
    assert result.status == "reproduced"
    assert result.compared == len(driven.times_s) - 1
    assert result.figures["share_within"] == 1.0
    for name in ("ate_m", "ate_deg", "rpe_m_per_s", "rpe_deg_per_s", "drift_m"):
        assert result.figures[name] == pytest.approx(0.0, abs=1e-3), name
    assert result.figures["driven_m"] == pytest.approx(SPEED * (8 + 2 + 11), abs=0.05)
    assert len(driven.begins) == 5


def test_a_robot_that_is_too_fast_misses_and_strict_makes_it_a_divergence() -> None:
    driven = drive_again(recorded(), Unicycle(faster=1.4))
    result = judge(driven, strict=False)
    assert result.status == "missed"
    assert "misses the bar of 95 %" in result.detail
    assert result.figures["rpe_m_per_s"] == pytest.approx(0.4 * SPEED, rel=0.1)  # a tenth is turned slower
    assert driven.errors_m.max() == pytest.approx(0.4 * SPEED * 5.0, rel=0.05)  # at a window's end
    assert driven.drift_m[-1] > driven.errors_m.max()
    assert RunReport("r", 0, [judge(driven, strict=True)]).exit_code == 2


def test_a_robot_that_pulls_to_a_side_shows_in_the_rotations() -> None:
    result = judge(drive_again(recorded(), Unicycle(pull_radps=0.02)), strict=False)
    assert result.figures["rpe_deg_per_s"] == pytest.approx(math.degrees(0.02), rel=0.02)
    assert result.figures["ate_deg"] == pytest.approx(math.degrees(0.02 * 5 / math.sqrt(3)), rel=0.1)


def test_a_picture_is_drawn_for_each_robot(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    run = Run((tmp_path / "robot03_x_000.mcap",), {"robot": "3"})
    motion = recorded()
    path = draw(run, motion, drive_again(motion, Unicycle(faster=1.4)), tmp_path / "plots")
    assert path.name == "robot03_x_L3.png"
    assert path.stat().st_size > 20_000
