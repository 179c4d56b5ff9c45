"""Golden runs: recorded runs kept with what is expected of them, so no change alters a decision unnoticed.

A golden run is a directory with one log per robot and expected.json: counts, a digest of the decisions, the
verdict of replay, metrics, and the history of what was blessed, and why. The report is made of what is
recorded; whether this machine decides the same is level L2's to say, so the report holds on any CPU.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from hippomat_core import messages as m
from hippomat_core.errors import HippomatError
from hippomat_logs.metrics import clocks_of, fleet_metrics, robot_metrics
from hippomat_logs.metrics.as_json import plain
from hippomat_logs.metrics.figures import figures_of
from hippomat_logs.reader import Run, open_runs
from hippomat_logs.redecide import write_redecided
from hippomat_logs.replay import ReplayOptions, replay_run
from hippomat_logs.report import RunReport
from hippomat_logs.schema import EFFECTS

EXPECTED = "expected.json"
LEVELS = ("L0", "L1", "L2")
TOLERANCE = 1e-6  # of a figure, relative: sums of floats depend on the CPU


@dataclass(frozen=True, slots=True)
class Blessing:
    """Who accepts new decisions: the commit that makes them, the day, and why they are right."""

    commit: str
    date: str
    reason: str


@dataclass(frozen=True, slots=True)
class Change:
    """What one golden run's robot now decides otherwise."""

    run: str
    robot: int
    first: str  # the first divergence
    decisions: int  # that differ
    of_decisions: int

    def __str__(self) -> str:
        return (
            f"{self.run} robot {self.robot}: {self.decisions} of {self.of_decisions} decisions; {self.first}"
        )


def golden_runs(path: Path) -> list[Path]:
    """The directories with an expected report in `path`, however deep; HippomatError where there is none."""
    found = sorted(file.parent for file in path.rglob(EXPECTED))
    if not found:
        raise HippomatError(f"{path}: holds no golden run (no {EXPECTED} in it or below it)")
    return found


def differences(directory: Path) -> list[str]:
    """One line for everything that is not as expected, with the command that accepts it; none: all is."""
    known, runs = _read(directory), open_runs([directory])
    replays = _replays(runs)
    found = report_of(runs, replays)
    lines = list(_differences("", {key: known.get(key) for key in found}, found))
    for one in replays:
        lines += [f"robot {one.robot} {r.level}: {r.divergence}" for r in one.results if r.divergence]
    if lines:
        lines.append(f"if that is meant: hippomat-replay {directory} --update-golden --reason '...'")
    return lines


def report_of(runs: Sequence[Run], replays: Sequence[RunReport]) -> dict[str, Any]:
    """What is expected of these logs, as they are."""
    verdicts = {report.robot: report.verdict for report in replays}
    robots = {f"robot {run.robot}": {"verdict": verdicts[run.robot], **_facts_of(run)} for run in runs}
    metrics = fleet_metrics(runs, [robot_metrics(run) for run in runs], clocks_of(runs, trusted=True))
    figures = plain(figures_of(metrics))
    return {"robots": robots, "figures": {key: value for key, value in figures.items() if value is not None}}


def write_expected(directory: Path, blessing: Blessing, changes: Sequence[Change] = ()) -> None:
    """Write the report of what is there, and `blessing` behind its history."""
    history = _read(directory)["history"] if (directory / EXPECTED).exists() else []
    entry = {
        "date": blessing.date, "commit": blessing.commit, "reason": blessing.reason,
        "changed": [str(change) for change in changes],
    }  # fmt: skip
    runs = open_runs([directory])
    report = {**report_of(runs, _replays(runs)), "history": [*history, entry]}
    (directory / EXPECTED).write_text(json.dumps(report, indent=1) + "\n", encoding="utf-8")


def bless(directory: Path, blessing: Blessing) -> list[Change]:
    """Let the core decide again on the recorded events, and keep that; untouched where nothing changed."""
    changes: list[Change] = []
    for run in open_runs([directory]):
        divergence = _divergence(run)
        if divergence is None:
            continue
        old, new = run.paths[0], run.paths[0].with_suffix(".redecided")
        new.unlink(missing_ok=True)
        write_redecided(run, new)
        count, total = _decisions_changed(run, replace(run, paths=(new,)))
        changes.append(Change(directory.name, run.robot, divergence, count, total))
        new.replace(old)
    if changes:
        write_expected(directory, blessing, changes)
    return changes


def _replays(runs: Sequence[Run]) -> list[RunReport]:
    return [replay_run(run, ReplayOptions(LEVELS)) for run in runs]


def _divergence(run: Run) -> str | None:
    """Of its decisions. What is wrong with its bytes cannot be blessed."""
    if len(run.paths) != 1:
        raise HippomatError(f"{run.name}: a golden run has one file per robot, found {len(run.paths)}")
    (report,) = _replays([run])
    found = next((result.divergence for result in report.results if result.level == "L2"), None)
    if found is None and report.exit_code:
        raise HippomatError(f"{run.paths[0]}: {report.verdict}: this log must be recorded anew (make golden)")
    return None if found is None else str(found)


def _decisions_changed(old: Run, new: Run) -> tuple[int, int]:
    before, after = ({d.round: _decision(d) for d in _decisions(run)} for run in (old, new))
    rounds = before.keys() | after.keys()
    return sum(before.get(number) != after.get(number) for number in rounds), len(rounds)


def _decisions(run: Run) -> Iterator[m.RoundDecided]:
    for record in run.records_in_order((m.RoundDecided,)):
        yield record.message


def _decision(decided: m.RoundDecided) -> tuple[Any, ...]:
    """What of a decision is the same on every machine: all but the logits."""
    rows = (decided.row_available, decided.row_busy, decided.row_slot, decided.costs)
    tasks = (decided.generations, decided.task_states)
    arrays = tuple(array.tobytes() for array in (*rows, *tasks))
    return decided.round, decided.allocator, *arrays, decided.action, decided.reason


def _facts_of(run: Run) -> dict[str, Any]:
    digest, effects, decisions, requests = hashlib.sha256(), Counter[str](), 0, 0
    for record in run.records_in_order(EFFECTS):
        message = record.message
        effects[type(message).__name__] += 1
        if isinstance(message, m.RoundDecided):
            digest.update(repr(_decision(message)).encode())
            decisions, requests = decisions + 1, requests + (message.action > 0)
        elif isinstance(message, m.ClaimChanged):
            claim = (message.what, message.cause, message.slot, message.generation, message.round)
            digest.update(repr(claim).encode())
    counts = dict(sorted(effects.items()))
    return {"decisions": decisions, "requests": requests, "effects": counts, "digest": digest.hexdigest()}


def _read(directory: Path) -> dict[str, Any]:
    try:
        return dict(json.loads((directory / EXPECTED).read_text(encoding="utf-8")))
    except (OSError, ValueError) as error:
        raise HippomatError(f"{directory / EXPECTED}: cannot be read: {error}") from None


def _differences(where: str, expected: Any, found: Any) -> Iterator[str]:
    if isinstance(found, dict) and isinstance(expected, dict):
        for key in sorted(found.keys() | expected.keys()):
            if where == "figures" and key not in expected:
                continue  # a figure that came later
            yield from _differences(f"{where} {key}".strip(), expected.get(key), found.get(key))
    elif isinstance(found, float) and isinstance(expected, (int, float)):
        if not math.isclose(found, expected, rel_tol=TOLERANCE, abs_tol=TOLERANCE):
            yield f"{where}: expected {expected}, found {found}"
    elif found != expected:
        yield f"{where}: expected {expected}, found {found}"
