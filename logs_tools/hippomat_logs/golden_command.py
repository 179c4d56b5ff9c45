"""`hippomat-replay DIR --update-golden --reason TEXT`: accept what the core decides now on golden runs.

Decides what a blessing needs: a reason, and a commit that can be looked up later.
"""

from __future__ import annotations

import json
import subprocess
from collections.abc import Sequence
from dataclasses import asdict
from datetime import datetime, timezone
from pathlib import Path

from rich.console import Console

from hippomat_core.errors import HippomatError
from hippomat_logs.golden import Blessing, Change, bless, golden_runs
from hippomat_logs.report import REPRODUCED


def update_golden(
    paths: Sequence[Path], reason: str, allow_dirty: bool, as_json: bool, console: Console
) -> int:
    """Bless all golden runs in `paths`, and say what changed."""
    if not reason.strip():
        raise HippomatError("--update-golden needs --reason: why are the new decisions right?")
    directories = [directory for path in paths for directory in golden_runs(path)]
    blessing = blessing_of(directories[0], reason, allow_dirty)
    changes = [change for directory in directories for change in bless(directory, blessing)]
    if as_json:
        print(json.dumps({**asdict(blessing), "changes": [asdict(change) for change in changes]}, indent=2))
    else:
        _show(changes, directories, blessing, console)
    return REPRODUCED


def blessing_of(directory: Path, reason: str, allow_dirty: bool) -> Blessing:
    """With the commit that is checked out; HippomatError where its decisions could not be found again."""
    commit = _described(directory)
    if not allow_dirty and (not commit or commit.endswith("-dirty")):
        state = (
            f"the work tree is not committed ({commit})" if commit else f"{directory} is in no git work tree"
        )
        raise HippomatError(
            f"{state}: nobody could find again what decided; commit first, or give --allow-dirty"
        )
    date = datetime.now(timezone.utc).strftime("%Y-%m-%d")
    return Blessing(commit or "unknown", date, reason.strip())


def _described(directory: Path) -> str:
    command = ["git", "-C", str(directory), "describe", "--always", "--dirty", "--tags"]
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=False)
    except OSError:
        return ""
    return done.stdout.strip() if done.returncode == 0 else ""


def _show(
    changes: Sequence[Change], directories: Sequence[Path], blessing: Blessing, console: Console
) -> None:
    for change in changes:
        console.print(f"blessed: {change}", markup=False)
    if changes:
        console.print(f"{blessing.commit}, {blessing.date}: {blessing.reason}", markup=False)
    else:
        names = ", ".join(directory.name for directory in directories)
        console.print(f"{names}: everything is decided as before; nothing was changed", markup=False)
