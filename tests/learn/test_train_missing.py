"""The runs of `hippomat-bench tables --train`: one after another, several at once, interrupted, failed."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from io import StringIO
from pathlib import Path

import pytest
from env_lab import small_pool
from rich.console import Console
from training_lab import SmallRun

from hippomat_core.allocation.policy_file import read_policy
from hippomat_core.errors import ConfigError, HippomatError
from hippomat_sim.learn.train_missing import train_missing
from hippomat_sim.learn.train_run import training_of
from hippomat_sim.learn.training_log import read_metrics

STARTED_S = 90.0  # a process loads torch and compiles


@pytest.fixture(autouse=True)
def _own_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))


def hash_of(run: SmallRun, directory: Path) -> str:
    return read_policy(run.policy(directory).read_bytes()).hash


def test_two_processes_train_the_weights_of_one(tmp_path: Path) -> None:
    runs, said = [SmallRun("paper"), SmallRun("ours")], StringIO()
    train_missing(runs, tmp_path / "one", 300, Console(file=StringIO()), jobs=1)
    train_missing(runs, tmp_path / "two", 300, Console(file=said), jobs=2)
    for run in runs:
        assert hash_of(run, tmp_path / "one") == hash_of(run, tmp_path / "two")
        assert (tmp_path / "two" / run.name / "reward.png").is_file()
    lines = [line for line in said.getvalue().splitlines() if "minutes" in line]
    assert {line.partition(":")[0] for line in lines} == {"trained paper", "trained ours"}
    assert all("minutes, CF1/gap %: N=3" in line for line in lines)


@pytest.mark.parametrize(
    ("preset", "said"),
    [
        ("impossible", "network 'paper_network' is built for one number of agents"),
        ("buggy", r"training buggy: IndexError: a bug \(--jobs 1 shows where\)"),
        ("killed", "training killed: its process was ended by SIGKILL: start again"),
    ],
)
def test_what_goes_wrong_in_a_process_is_one_line(
    preset: str, said: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    runs = [SmallRun(preset), SmallRun("paper")]
    with pytest.raises(HippomatError, match=said) as caught:
        train_missing(runs, tmp_path, 100_000_000, Console(file=StringIO()), jobs=2)
    assert "\n" not in str(caught.value)
    assert isinstance(caught.value, ConfigError) == (preset == "impossible")
    assert "Traceback" not in capfd.readouterr().err
    assert not runs[1].policy(tmp_path).exists()  # it was stopped, not waited for


SCRIPT = """\
import sys
from pathlib import Path

from rich.console import Console
from training_lab import SmallRun

from hippomat_sim.entry import guarded
from hippomat_sim.learn.train_missing import train_missing


def train():
    runs = [SmallRun("paper"), SmallRun("ours")]
    train_missing(runs, Path(sys.argv[1]), 100_000_000, Console(stderr=True), jobs=2)
    return 0


if __name__ == "__main__":
    sys.exit(guarded("hippomat-bench", train))
"""


@pytest.mark.timeout(180)
def test_ctrl_c_leaves_checkpoints_from_which_a_second_start_goes_on(tmp_path: Path) -> None:
    script, directory = tmp_path / "script.py", tmp_path / "runs"
    script.write_text(SCRIPT, encoding="utf-8")
    runs = [SmallRun("paper"), SmallRun("ours")]
    process = subprocess.Popen(
        [sys.executable, str(script), str(directory)],
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(filter(None, sys.path))},
        start_new_session=True,
    )
    ends_s = time.monotonic() + STARTED_S
    while not all(read_metrics(directory / run.name) for run in runs) and time.monotonic() < ends_s:
        time.sleep(0.1)
    os.killpg(process.pid, signal.SIGINT)  # as a terminal does: the workers hear it too
    _, error = process.communicate(timeout=60)
    assert process.returncode == 1
    assert error.strip().endswith("hippomat-bench: interrupted")
    assert "Traceback" not in error
    for run in runs:
        training = training_of(run, directory, None, lambda _settings: small_pool())
        assert training.clock.update == len(read_metrics(training.folder)) > 0
        assert training.settings.budget.agent_steps == 100_000_000
