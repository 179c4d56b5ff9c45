"""hippomat-logs filter and merge: parts of runs as files of their own, several files as one."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

from rich.console import Console

from hippomat_core.errors import HippomatError
from hippomat_logs.opened_run import OpenedRun, group_runs
from hippomat_logs.report import REPRODUCED
from hippomat_logs.selection import Selection, join, time_of_record, write_selection

AROUND_S = 2.0


def add_filter_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("paths", nargs="+", type=Path, metavar="LOG", help="logs, or directories of logs")
    add = parser.add_argument
    add(
        "-o",
        "--out",
        type=Path,
        required=True,
        metavar="OUT",
        help="a new .mcap; for several runs a directory",
    )
    add("--topics", type=words, default=(), metavar="T,...", help="only these; patterns with * and ?")
    add("--exclude", type=words, default=(), metavar="T,...", help="all but these")
    add("--from", dest="start_s", type=float, default=0.0, metavar="S", help="seconds since the run's start")
    add("--to", dest="stop_s", type=float, default=float("inf"), metavar="S", help="until these seconds")
    add("--robots", type=_numbers, metavar="ID,...", help="only runs of these robots")
    add(
        "--until",
        type=int,
        default=0,
        metavar="RECORD",
        help="up to the tick of this record: can still be replayed",
    )
    clip = f"what happened around a record, S seconds to either side (default {AROUND_S:g})"
    add("--clip", type=_clip, metavar="RECORD[:S]", help=clip)


def add_merge_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("paths", nargs="+", type=Path, metavar="LOG", help="logs, or directories of logs")
    parser.add_argument("-o", "--out", type=Path, required=True, metavar="OUT.mcap", help="a new file")


def run_filter(options: argparse.Namespace, console: Console) -> int:
    if options.clip and (options.start_s or options.stop_s != float("inf") or options.until):
        raise HippomatError("--clip sets the times itself: leave out --from, --to and --until")
    if not options.start_s < options.stop_s:
        raise HippomatError(f"--from {options.start_s:g} --to {options.stop_s:g}: nothing lies between")
    runs = group_runs(options.paths)
    if options.robots is not None:
        runs = [run for run in runs if run.robot in options.robots]
        if not runs:
            raise HippomatError(
                f"no run of robot {', '.join(map(str, sorted(options.robots)))} in these logs"
            )
    if len(runs) > 1:
        options.out.mkdir(parents=True, exist_ok=True)
    for run in runs:
        path = options.out / f"{run.name}.filtered.mcap" if len(runs) > 1 else options.out
        kept = write_selection(run, _selection(options, run), path)
        console.print(f"{path}: {kept:,} messages of {run.name}", markup=False)
    return REPRODUCED


def _selection(options: argparse.Namespace, run: OpenedRun) -> Selection:
    asked = Selection(options.topics, options.exclude, options.start_s, options.stop_s, options.until)
    if options.clip is None:
        return asked
    record, around_s = options.clip
    at_s = time_of_record(run, record)
    return replace(asked, start_s=max(0.0, at_s - around_s), stop_s=at_s + around_s)


def run_merge(options: argparse.Namespace, console: Console) -> int:
    runs = group_runs(options.paths)
    kept = join(runs, options.out)
    parts = sum(len(run.sources) for run in runs)
    what = f"{parts} parts of {runs[0].name}" if len(runs) == 1 else f"{len(runs)} runs"
    console.print(f"{options.out}: {kept:,} messages of {what}", markup=False)
    return REPRODUCED


def words(text: str) -> tuple[str, ...]:
    return tuple(word.strip() for word in text.split(",") if word.strip())


def _numbers(text: str) -> frozenset[int]:
    try:
        return frozenset(int(word) for word in text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is no list of robot ids such as 0,3") from None


def _clip(text: str) -> tuple[int, float]:
    record, _, around = text.partition(":")
    try:
        return int(record), float(around) if around else AROUND_S
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is no record number, or RECORD:SECONDS") from None
