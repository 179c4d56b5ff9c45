"""hippomat-logs fuse: the logs of a fleet as one causal run, whatever their clocks say."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from rich.console import Console

from hippomat_core.errors import HippomatError
from hippomat_logs.alignment import Alignment, align_runs
from hippomat_logs.alignment_report import alignment_lines, alignment_table, as_json, draw_alignment
from hippomat_logs.causal_order import Held
from hippomat_logs.each_file import progress_bar
from hippomat_logs.fusing import fuse
from hippomat_logs.outputs import refuse_existing, refuse_suffix
from hippomat_logs.pictures import refuse_no_picture
from hippomat_logs.reader import Run, open_runs
from hippomat_logs.report import DAMAGED, REPRODUCED

_WHAT = (
    "A fleet's logs as one causal run: the clocks are aligned by the frames that robots heard of each other, "
    "and nothing stands before its cause. hippomat-replay, metrics, report and explain take the result as "
    "they take the logs. Without -o it only says how the clocks differ. To look at logs of any kind "
    "side by side: merge."
)


def add_options(parser: argparse.ArgumentParser) -> None:
    parser.description = _WHAT
    parser.add_argument(
        "paths", nargs="+", type=Path, metavar="LOG", help="logs of one fleet, or directories"
    )
    add = parser.add_argument
    add("-o", "--out", type=Path, metavar="OUT.mcap", help="a new file; without it clocks are compared only")
    add("--plot", type=Path, metavar="OUT.png", help="a picture of how late every frame was heard")
    add(
        "--reference", type=int, metavar="ID", help="the robot whose log time is common time (default: first)"
    )
    add("--trust-clocks", action="store_true", help="leave the wall clocks of all logs as they are")
    add("--json", action="store_true", help="print JSON")


def run(options: argparse.Namespace, console: Console) -> int:
    if options.reference is not None and options.trust_clocks:
        raise HippomatError("--trust-clocks needs no --reference: every clock is left as it is")
    if options.out is not None:
        refuse_suffix(options.out, (".mcap",))
        refuse_existing(options.out)
    if options.plot is not None:
        refuse_no_picture(options.plot)
    with progress_bar() as bar:
        task = bar.add_task("opening", total=None)
        runs = open_runs(options.paths)
        bar.update(task, description="comparing clocks", total=len(runs))
        told = lambda _: bar.advance(task)  # noqa: E731
        alignment = align_runs(
            runs, reference=options.reference, trust_clocks=options.trust_clocks, progress=told
        )
        held = Held()
        if options.out is not None:
            bar.update(task, description="fusing", total=sum(run.records for run in runs), completed=0)
            held = fuse(runs, alignment, options.out, lambda done: bar.update(task, completed=done))
    drawn = False
    if options.plot is not None:
        drawn = draw_alignment(alignment, options.plot)
    lost = [f"{run.name}: {line}" for run in runs for line in run.lost]
    if options.json:
        facts = {**as_json(alignment), "held_back": held.count, "held_back_most_ns": held.longest_ns}
        print(json.dumps({**facts, "without_cause": held.broken, "lost": lost}, indent=2))
    else:
        _show(options, runs, alignment, held, lost, drawn, console)
    return DAMAGED if lost else REPRODUCED


def _show(
    options: argparse.Namespace,
    runs: list[Run],
    alignment: Alignment,
    held: Held,
    lost: list[str],
    drawn: bool,
    console: Console,
) -> None:
    def line(text: str, style: str = "") -> None:
        console.print(text, markup=False, style=style)

    console.print(alignment_table(alignment))
    for text in alignment_lines(alignment):
        line(text)
    if options.out is not None:
        total = sum(run.records for run in runs)
        size_mib = options.out.stat().st_size / 2**20
        line(f"{options.out}: {total:,} records of {len(runs)} runs, {size_mib:.1f} MiB")
        if held.count:
            line(
                f"{held.count:,} records stand up to {held.longest_ns / 1e6:.1f} ms late: their daemon noted "
                "a frame before its sender's did"
            )
        if held.broken:
            line(f"{held.broken} receptions stand before their sending: see docs/fuse.md", "yellow")
    if options.plot is not None:
        line(
            f"picture: {options.plot}"
            if drawn
            else "no picture: no robot's log says what it heard of another"
        )
    for text in lost:
        line(text, "yellow")
