"""hippomat-logs filter and merge: parts of runs as files of their own, several files as one."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

from rich.console import Console

from hippomat_core.errors import HippomatError
from hippomat_logs.opened_run import OpenedRun, group_runs
from hippomat_logs.outputs import refuse_directory, refuse_existing, refuse_suffix
from hippomat_logs.report import REPRODUCED
from hippomat_logs.selection import Selection, join, time_of_record, write_selection

AROUND_S = 2.0
_FILTER = """Some topics, times or robots of each run, as a new log per run: the messages
as they are, nothing is aligned or renamed. To put several logs into one file:
merge for viewers, fuse for everything else."""
_FILTER_EXAMPLES = """A record number is what hippomat-replay, doctor and explain print as "record N".

examples:
  hippomat-logs filter runs --robots 3 --topics '/odom,/tf*' -o part.mcap
  hippomat-logs filter run.mcap --from 10 --to 60 -o part.mcap
  hippomat-logs filter run.mcap --clip 5000:3 -o around.mcap
  hippomat-logs filter run.mcap --until 5000 -o begin.mcap
  hippomat-replay begin.mcap      # of these only --until leaves what replays
"""
_MERGE = (
    "Several logs side by side in one file, for viewers (Foxglove, PlotJuggler, rerun): each run's topics "
    "get a prefix (/robot03/odom), times stay those of its own clock. Any logs will do. It does not replay, "
    "and metrics, report and explain do not take it: that is what fuse is for. (Parts of one run alone "
    "become one whole log, which replays.)"
)


def add_filter_options(parser: argparse.ArgumentParser) -> None:
    parser.description, parser.epilog = _FILTER, _FILTER_EXAMPLES
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument("paths", nargs="+", type=Path, metavar="LOG", help="logs, or directories of logs")
    add = parser.add_argument
    add(
        "-o",
        "--out",
        type=Path,
        required=True,
        metavar="OUT",
        help="a new .mcap; or a directory for RUN.filtered.mcap of each run",
    )
    add("--topics", type=words, default=(), metavar="T,...", help="only these; patterns with * and ?")
    add("--exclude", type=words, default=(), metavar="T,...", help="all but these")
    add("--from", dest="start_s", type=float, default=0.0, metavar="S", help="seconds since the run's start")
    add("--to", dest="stop_s", type=float, default=float("inf"), metavar="S", help="up to, not including, S")
    add("--robots", type=_numbers, metavar="ID,...", help="only runs of these robots")
    add(
        "--until",
        type=int,
        default=0,
        metavar="RECORD",
        help="all records up to this number, and to the end of its tick; the result replays",
    )
    clip = f"what happened around a record, S seconds to either side (default {AROUND_S:g})"
    add("--clip", type=_clip, metavar="RECORD[:S]", help=clip)


def add_merge_options(parser: argparse.ArgumentParser) -> None:
    parser.description = _MERGE
    parser.add_argument("paths", nargs="+", type=Path, metavar="LOG", help="logs, or directories of logs")
    parser.add_argument("-o", "--out", type=Path, required=True, metavar="OUT.mcap", help="a new file")


def run_filter(options: argparse.Namespace, console: Console) -> int:
    if options.clip and (options.start_s or options.stop_s != float("inf") or options.until):
        raise HippomatError("--clip sets the times itself: leave out --from, --to and --until")
    if not options.start_s < options.stop_s:
        raise HippomatError(f"--from {options.start_s:g} --to {options.stop_s:g}: nothing lies between")
    _refuse_out(options.out)
    runs = group_runs(options.paths)
    if options.robots is not None:
        runs = [run for run in runs if run.robot in options.robots]
        if not runs:
            raise HippomatError(
                f"no run of robot {', '.join(map(str, sorted(options.robots)))} in these logs"
            )
    for run, path in zip(runs, _places(runs, options.out), strict=True):
        kept = write_selection(run, _selection(options, run), path)
        console.print(f"{path}: {kept:,} messages of {run.name}", markup=False)
    return REPRODUCED


def _refuse_out(out: Path) -> None:
    """HippomatError for what is neither a new .mcap nor a directory."""
    if out.is_dir() or not out.suffix:
        refuse_directory(out)
    else:
        refuse_suffix(out, (".mcap",))
        refuse_existing(out)


def _places(runs: list[OpenedRun], out: Path) -> list[Path]:
    """A file for each run; HippomatError where there is one already."""
    if out.suffix == ".mcap" and not out.is_dir():
        if len(runs) > 1:
            raise HippomatError(f"{out}: there are {len(runs)} runs: give a directory for their parts")
        return [out]
    places = [out / f"{run.name}.filtered.mcap" for run in runs]
    for path in places if out.is_dir() else ():
        refuse_existing(path)
    out.mkdir(parents=True, exist_ok=True)
    return places


def _selection(options: argparse.Namespace, run: OpenedRun) -> Selection:
    asked = Selection(options.topics, options.exclude, options.start_s, options.stop_s, options.until)
    if options.clip is None:
        return asked
    record, around_s = options.clip
    at_s = time_of_record(run, record)
    return replace(asked, start_s=max(0.0, at_s - around_s), stop_s=at_s + around_s)


def run_merge(options: argparse.Namespace, console: Console) -> int:
    refuse_suffix(options.out, (".mcap",))
    refuse_existing(options.out)
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
