"""What the logs of a finished run say: where tasks were completed, and what replay reproduced."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from hippomat_core.errors import HippomatError
from hippomat_core.messages import ClaimChanged
from hippomat_logs.reader import open_runs, read_raw
from hippomat_logs.recovery import recover_directory
from hippomat_logs.schema import TOPICS
from hippomat_logs.walk import Contents


@dataclass(frozen=True, slots=True)
class Completion:
    """One task completed, by the robot's own log."""

    robot: int
    slot: int
    generation: int
    x_m: float
    y_m: float


@dataclass(frozen=True, slots=True)
class Verdict:
    """What hippomat-replay found out about one robot's log."""

    robot: int
    text: str  # "reproduced L0 L1 L2 ..."
    exit_code: int
    findings: tuple[str, ...] = ()  # what was not reproduced


def log_files(directories: Sequence[Path]) -> list[Path]:
    """All logs, those of killed daemons recovered first; HippomatError where no robot has left any."""
    for directory in directories:
        recover_directory(directory)
    files = [path for directory in directories for path in sorted(directory.rglob("*.mcap"))]
    if not files:
        raise HippomatError(f"no robot left a log in {directories[0].parent}; see the daemons' .err files")
    return files


def completions(logs: Sequence[Path]) -> list[Completion]:
    """All completed tasks of all robots. Decodes the claims alone: replay checks the rest."""
    topic, found = TOPICS[ClaimChanged], []
    for run in open_runs(logs):
        raw_records = ((path, raw) for path in run.paths for raw in read_raw(path, Contents()))
        for path, raw in raw_records:
            if raw.topic != topic:
                continue
            claim = run.decoded(path, raw).message
            if claim.what == "completed":
                found.append(Completion(run.robot, claim.slot, claim.generation, claim.x_m, claim.y_m))
    return found


def replay(logs: Sequence[Path]) -> list[Verdict]:
    """Run hippomat-replay on all logs; it uses the processors on its own."""
    command = [sys.executable, "-m", "hippomat_logs.replay_cli", "--json", *map(str, logs)]
    done = subprocess.run(command, stdout=subprocess.PIPE, check=False)
    try:
        reports = json.loads(done.stdout)
    except ValueError:
        raise HippomatError(f"hippomat-replay ended with exit code {done.returncode} and no report") from None
    return [_verdict(report) for report in reports]


def _verdict(report: dict[str, object]) -> Verdict:
    results = report["results"]
    findings = []
    if isinstance(results, list):
        for one in results:
            if one["status"] not in ("reproduced", "not run", "missed"):
                findings.append(f"{one['level']} {one['status']}: {one['detail'] or one['divergence']}")
    return Verdict(
        int(str(report["robot"])), str(report["verdict"]), int(str(report["exit_code"])), tuple(findings)
    )
