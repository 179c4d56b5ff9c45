"""hippomat-train from its command line, in a small world of its own."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from hippomat_core.allocation.policy_file import read_policy
from hippomat_sim.learn.cli import main
from hippomat_sim.learn.train_settings import presets
from hippomat_sim.learn.training_log import read_metrics

SMALL = """\
[network]
kind = "graphsage"
[network.options]
hops = 1
head_steps = 4
[ppo]
advantage = "counterfactual"
value_coefficient = 0.0
epochs = 1
[budget]
agent_steps = 300
threads = 1
evaluate_sizes = [3]
evaluate_episodes = 2
[environment.world]
size_m = [14, 14, 6]
obstacles = 4
obstacle_height_m = [2, 5]
sites = 20
airborne_sites = 4
starts = 16
worlds = 1
[[episodes]]
agents = [3, 4]
edges = 200
"""


@pytest.fixture
def config(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    path = tmp_path / "small.toml"
    path.write_text(SMALL)
    return path


def test_a_run_leaves_policy_curves_and_metrics_behind(
    config: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "run"
    assert main(["--config", str(config), "--seed", "5", "--out", str(out)]) == 0
    names = {path.name for path in out.iterdir()}
    assert names >= {"run.json", "metrics.jsonl", "tensorboard", "checkpoint.pt", "policy.safetensors"}
    assert names >= {"reward.png", "entropy.png", "evaluation.png"}
    assert json.loads((out / "run.json").read_text())["settings"]["seed"] == 5
    assert read_policy((out / "policy.safetensors").read_bytes()).training["seed"] == 5
    assert "learner" in capsys.readouterr().err
    assert main(["export", str(out), "--out", str(tmp_path / "mine.safetensors")]) == 0
    paths = (tmp_path / "mine.safetensors", out / "policy.safetensors")
    first, second = (read_policy(path.read_bytes()) for path in paths)
    assert (first.hash, first.training, first.metrics) == (second.hash, second.training, second.metrics)


def test_steps_agents_and_tasks_can_be_said_on_the_command_line(config: Path, tmp_path: Path) -> None:
    out = tmp_path / "run"
    numbers = ["--steps", "40", "--agents", "2", "--tasks", "5"]
    assert main(["train", "--config", str(config), *numbers, "--out", str(out)]) == 0
    rows = read_metrics(out)
    assert rows[-1]["agent_steps"] >= 40
    assert {row["agents"] for row in rows} == {2}
    assert list(rows[-1]["evaluation"]) == ["2"]


def test_minutes_end_a_run_that_can_go_on(config: Path, tmp_path: Path) -> None:
    out = tmp_path / "run"
    assert main(["--config", str(config), "--minutes", "1e-9", "--out", str(out)]) == 0
    assert main(["--resume", str(out)]) == 0
    assert read_metrics(out)[-1]["agent_steps"] >= 300


def test_worlds_are_prepared_and_described(config: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["prepare", "--config", str(config)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split(":")[0] for line in lines] == ["train", "test"]


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--config", "none"], "there is no such file or preset; presets: default"),
        (["--resume", "nowhere"], "there is no checkpoint.pt"),
        (["--resume", "nowhere", "--seed", "1"], "--seed with --resume"),
        (["--minutes", "0"], "--minutes 0.0: must be above 0"),
        (["--agents", "99"], "99 is outside 1 .. 64"),
        (["export", "nowhere"], "there is no checkpoint.pt"),
    ],
)
def test_wrong_usage_is_one_line(arguments: list[str], said: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(arguments) == 1
    error = capsys.readouterr().err
    assert said in error
    assert error.count("\n") == 1


def test_another_run_is_not_overwritten(
    config: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = str(tmp_path / "run")
    assert main(["--config", str(config), "--steps", "20", "--out", out]) == 0
    assert main(["--config", str(config), "--out", out]) == 1
    assert "a run is there" in capsys.readouterr().err


def test_help_names_the_presets_command_line(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as end:
        main(["--help"])
    assert end.value.code == 0
    assert "hippomat-train --resume" in capsys.readouterr().out
    assert "default" in presets()


def test_ctrl_c_writes_a_checkpoint_and_says_how_to_go_on(config: Path, tmp_path: Path) -> None:
    out = tmp_path / "run"
    command = [sys.executable, "-m", "hippomat_sim.learn.cli", "--config", str(config)]
    process = subprocess.Popen(
        [*command, "--steps", "100000000", "--out", str(out)],
        stderr=subprocess.PIPE,
        text=True,
        env=os.environ,
    )
    ends_s = time.monotonic() + 90.0
    while not read_metrics(out) and time.monotonic() < ends_s:
        time.sleep(0.1)
    process.send_signal(signal.SIGINT)
    _, error = process.communicate(timeout=60)
    assert process.returncode == 130
    assert f"go on with hippomat-train --resume {out}" in error
    assert "Traceback" not in error
    assert (out / "checkpoint.pt").is_file()
