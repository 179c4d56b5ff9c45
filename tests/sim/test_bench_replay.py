"""hippomat-bench replay measures a replay that is one, and judges long runs only."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from hippomat_sim.bench.cli import main
from hippomat_sim.bench.replay_command import LEVELS, measure

GOLDEN = Path(__file__).parents[1] / "golden" / "runs" / "one_slam" / "robot00.mcap"


def test_every_level_is_measured_and_gives_the_same_twice() -> None:
    figures = measure([GOLDEN])
    assert figures.slam
    assert figures.identical
    assert figures.verdict == "reproduced L0 L1 L2"
    assert 5.0 < figures.recorded_s < 30.0
    assert figures.cpu_s.keys() == LEVELS.keys()
    assert all(figures.times_real(name) > 0.0 for name in LEVELS)


def test_a_short_run_is_reported_and_not_judged(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["replay", str(GOLDEN), "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert report["met"]
    assert report["targets"][0]["not_judged"] == "set for runs of 300 s or more"
    assert report["runs"][0]["times_real"]["L2"] > 0.0


def test_a_run_too_short_to_be_recorded_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["replay", "--seconds", "1"]) == 1
    assert "a run needs 5 s at least" in capsys.readouterr().err
