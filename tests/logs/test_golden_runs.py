"""The golden runs are decided as they were; a change fails until it is blessed, with commit and reason."""

from __future__ import annotations

import dataclasses
import json
import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from changed_log import change_log

from hippomat_core import messages as m
from hippomat_core.allocation.factory import ALLOCATORS, make_allocator
from hippomat_core.allocation.port import NO_LOGITS, Decision
from hippomat_core.fleet import timing
from hippomat_logs.golden import EXPECTED, differences, golden_runs
from hippomat_logs.level2 import is_near_tie
from hippomat_logs.reader import open_runs
from hippomat_logs.replay_cli import main

RUNS = Path(__file__).parents[1] / "golden" / "runs"
NAMES = [path.name for path in golden_runs(RUNS)]
DECIDED_BY = "decided_by_"  # one robot, just long enough for its first request


@pytest.mark.parametrize("name", NAMES)
def test_a_golden_run_is_decided_as_it_was(name: str) -> None:
    found = differences(RUNS / name)
    assert not found, "\n".join(found)


def test_every_longer_golden_run_completes_a_task_and_all_are_small_enough_to_be_kept() -> None:
    longer = [name for name in NAMES if not name.startswith(DECIDED_BY)]
    figures = {name: json.loads((RUNS / name / EXPECTED).read_text())["figures"] for name in longer}
    assert {name for name, of_run in figures.items() if of_run["completed"] < 1} == set()
    # 4 MB for what goes wrong in a fleet, and 0.8 MB for one short log of each allocator that these lack.
    assert sum(path.stat().st_size for path in RUNS.rglob("*.mcap")) < 4_800_000


def test_every_allocator_requests_a_task_in_some_golden_run() -> None:
    requesting = {
        run.config.fleet.allocator
        for run in open_runs([RUNS])
        if any(record.message.action for record in run.records_in_order((m.RoundDecided,)))
    }
    assert requesting == set(ALLOCATORS)


@pytest.mark.parametrize("name", [name for name in NAMES if name.startswith(DECIDED_BY)])
def test_an_allocator_that_asks_for_nothing_is_noticed(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    (run,) = open_runs([RUNS / name])
    decides = type(make_allocator(run.config.fleet.allocator, run.policy or None, 3, 3))
    monkeypatch.setattr(decides, "allocate", lambda *_: Decision(0, NO_LOGITS))
    found = differences(RUNS / name)
    assert any("L2" in line and "RoundDecided" in line for line in found), found


def test_golden_runs_hold_what_goes_wrong_in_a_fleet() -> None:
    """What a run must hold for a change of the rules about it to be noticed."""
    kinds, claims = set[type](), set[str]()
    for run in open_runs([RUNS]):
        for record in run.records_in_order(
            (m.ClaimChanged, m.ConflictSeen, m.PeerClaimSeen, m.RecoveryChanged)
        ):
            kinds.add(type(record.message))
            if isinstance(record.message, (m.ClaimChanged, m.PeerClaimSeen)):
                claims.add(record.message.what)
    assert {m.ConflictSeen, m.RecoveryChanged} <= kinds
    assert {"requested", "confirmed", "unconfirmed", "dropped", "released", "completed", "expired"} <= claims


@pytest.mark.parametrize("name", NAMES)
def test_no_decision_of_a_golden_run_is_a_near_tie_that_another_processor_may_decide_otherwise(
    name: str,
) -> None:
    decisions = [
        record.message
        for run in open_runs([RUNS / name])
        for record in run.records_in_order((m.RoundDecided,))
    ]
    assert decisions
    assert [decided.round for decided in decisions if is_near_tie(decided)] == []


def test_a_change_of_how_long_tasks_settle_is_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(timing, "SETTLE_ROUNDS", timing.SETTLE_ROUNDS + 10)
    assert any("L2" in line for line in differences(RUNS / "scarce_tasks"))


@pytest.fixture
def changed(tmp_path: Path) -> Path:
    """A golden run whose log says of two decisions what this core does not decide; in a repository."""
    directory = tmp_path / "runs" / "one_slam"
    shutil.copytree(RUNS / "one_slam", directory)
    (log,) = directory.glob("*.mcap")
    log.rename(tmp_path / "right.mcap")
    decided = 0

    def change(_: int, message: Any) -> Any:
        nonlocal decided
        if isinstance(message, m.RoundDecided):
            decided += 1
            if decided in (20, 30):
                costs = np.array(message.costs)
                costs[1] ^= 1
                return dataclasses.replace(message, costs=costs)
        return message

    change_log(tmp_path / "right.mcap", log, change)
    git(tmp_path, "init", "-q")
    commit(tmp_path)
    return directory


def git(directory: Path, *arguments: str) -> None:
    identity = ("-c", "user.name=t", "-c", "user.email=t@example.org")
    subprocess.run(["git", "-C", str(directory), *identity, *arguments], check=True, capture_output=True)


def commit(directory: Path) -> None:
    git(directory, "add", "-A")
    git(directory, "commit", "-q", "-m", "x")


def test_a_change_of_a_decision_fails_with_the_divergence_and_the_command_that_accepts_it(
    changed: Path,
) -> None:
    found = differences(changed)
    assert any("robot 0 L2" in line and "RoundDecided.costs[1]: recorded" in line for line in found), found
    assert found[-1].endswith(f"hippomat-replay {changed} --update-golden --reason '...'")
    assert any(line.startswith("robots robot 0 digest: expected") for line in found)


def test_blessing_decides_again_and_keeps_commit_and_reason(
    changed: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = json.loads((changed / EXPECTED).read_text())["history"]
    assert main([str(changed.parent), "--update-golden", "--reason", "costs are right now"]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "blessed: one_slam robot 0: 2 of" in said
    assert "RoundDecided.costs[1]" in said
    report = json.loads((changed / EXPECTED).read_text())
    *old, entry = report["history"]
    assert old == before
    assert entry["reason"] == "costs are right now"
    assert len(entry["commit"]) >= 7
    assert not entry["commit"].endswith("-dirty")
    assert "2 of" in entry["changed"][0]
    assert differences(changed) == []
    assert not list(changed.glob("*.redecided"))
    commit(changed)
    assert main([str(changed), "--update-golden", "--reason", "again"]) == 0
    assert "everything is decided as before" in " ".join(capsys.readouterr().out.split())
    assert json.loads((changed / EXPECTED).read_text()) == report


def test_what_is_not_committed_is_blessed_only_when_told_to(
    changed: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (changed / EXPECTED).write_text((changed / EXPECTED).read_text() + "\n")
    assert main([str(changed), "--update-golden", "--reason", "x"]) == 1
    assert "not committed" in " ".join(capsys.readouterr().err.split())
    assert main([str(changed), "--update-golden", "--reason", "x", "--allow-dirty", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["commit"].endswith("-dirty")
    assert told["changes"][0]["decisions"] == 2


def test_a_directory_without_golden_runs_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([str(tmp_path), "--update-golden", "--reason", "x"]) == 1
    assert "holds no golden run" in " ".join(capsys.readouterr().err.split())
