"""`hippomat-replay RUN --clip OUT.mcap`: the smallest log that shows the first divergence; --at: a window.

Runs the core in a process of its own that computes with as many threads as the daemon did.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console

from hippomat_core.errors import HippomatError
from hippomat_logs.clip import find_divergence, write_clip
from hippomat_logs.each_file import progress_bar
from hippomat_logs.opened_run import group_runs
from hippomat_logs.outputs import refuse_existing
from hippomat_logs.reader import Run, open_again
from hippomat_logs.replay import same_fingerprint
from hippomat_logs.replay_pool import in_a_process
from hippomat_logs.report import DIVERGED, REPRODUCED
from hippomat_logs.selection import Selection, write_selection

AROUND_S = 2.0


def clip(runs: Sequence[Run], out: Path, as_json: bool, console: Console) -> int:
    """Of the first run that diverges. The exit code is replay's: DIVERGED, or REPRODUCED and no clip."""
    refuse_existing(out)
    for run in runs:
        told = in_a_process(run, clip_of, run.paths, run.inside, out)
        if told:
            if as_json:
                print(json.dumps({"clip": str(out), "run": run.name, "shows": told}))
            else:
                console.print(f"{out}: {told}", markup=False)
            return DIVERGED
    if as_json:
        print(json.dumps({"clip": None}))
        return REPRODUCED
    names = ", ".join(run.name for run in runs)
    told = "there is no divergence to clip (--at S cuts a window to look at)"
    console.print(f"{names}: reproduced; {told}", markup=False)
    return REPRODUCED


def clip_of(paths: tuple[Path, ...], inside: str, out: Path) -> str:
    """Write the clip; what it shows, empty where nothing diverges."""
    run = open_again(paths, inside)
    if run.clip:
        raise HippomatError(f"{run.paths[0]}: is a clip already, of {run.clip}")
    exact = same_fingerprint(run)
    found = find_divergence(run, exact)
    if found is None:
        return ""
    with progress_bar() as bar:
        task = bar.add_task("leaving events out", total=1)
        kept = write_clip(found, out, exact, lambda done, of: bar.update(task, completed=done, total=of))
    size_kib = out.stat().st_size / 1024
    return f"{kept:,} of {len(found.events):,} events, {size_kib:.0f} KiB, show {found.divergence}"


def cut_window(logs: Sequence[Path], out: Path, at_s: float, console: Console) -> int:
    """Everything around one moment of one run: for looking, it cannot be replayed."""
    runs = group_runs(logs)
    if len(runs) != 1:
        raise HippomatError(f"--at cuts a window out of one run; {len(runs)} were given")
    begin_s, end_s = max(0.0, at_s - AROUND_S), at_s + AROUND_S
    count = write_selection(runs[0], Selection(start_s=begin_s, stop_s=end_s), out)
    window = f"seconds {begin_s:g} to {end_s:g} of {runs[0].name}"
    console.print(f"{out}: {count:,} messages, {window}; for looking at only", markup=False)
    return REPRODUCED
