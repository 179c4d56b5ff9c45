"""hippomat-logs export: a run's topics as CSV or Parquet, its trajectories for evo, the files it carries."""

from __future__ import annotations

import argparse
from fnmatch import fnmatchcase
from pathlib import Path

from rich.console import Console
from rich.markup import escape

from hippomat_core.errors import HippomatError, LogError
from hippomat_logs.commands.select import words
from hippomat_logs.each_file import progress_bar
from hippomat_logs.exports import (
    export_attachments,
    export_csv,
    export_parquet,
    export_tum,
    file_word,
    trajectory_topics,
)
from hippomat_logs.opened_run import OpenedRun, group_runs
from hippomat_logs.outputs import refuse_directory, refuse_existing
from hippomat_logs.report import DAMAGED, REPRODUCED

FORMATS = ("csv", "parquet", "tum", "files")


def add_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("paths", nargs="+", type=Path, metavar="LOG", help="logs, or directories of logs")
    add = parser.add_argument
    add(
        "-o",
        "--out",
        type=Path,
        required=True,
        metavar="DIR",
        help="a directory for new files",
    )
    formats = "csv (default), parquet (needs hippomat[tables]), tum for evo, files: what the log carries"
    add("--format", choices=FORMATS, default="csv", help=formats)
    add("--topics", type=words, default=(), metavar="T,...", help="only these; patterns with * and ?")


def run(options: argparse.Namespace, console: Console) -> int:
    refuse_directory(options.out)
    runs = group_runs(options.paths)
    directories = [options.out / opened.name if len(runs) > 1 else options.out for opened in runs]
    for opened, directory in zip(runs, directories, strict=True):
        _refuse_existing(opened, options, directory)
    code = REPRODUCED
    for opened, directory in zip(runs, directories, strict=True):
        directory.mkdir(parents=True, exist_ok=True)
        for topic, why in opened.left_out.items():
            console.print(f"left out: {topic}: {why}", markup=False, style="yellow")
            code = DAMAGED
        code = max(code, _export(opened, options, directory, console))
    return code


def _refuse_existing(opened: OpenedRun, options: argparse.Namespace, directory: Path) -> None:
    """HippomatError where a table is there already: better before the first than behind the tenth."""
    if not directory.exists() or options.format == "files":
        return
    for topic in _topics(opened, options):
        name = f"{opened.name}_{file_word(topic)}" if options.format == "tum" else file_word(topic)
        refuse_existing(directory / f"{name}.{options.format}")


def _export(opened: OpenedRun, options: argparse.Namespace, directory: Path, console: Console) -> int:
    if options.format == "files":
        written = list(map(str, export_attachments(opened, directory)))
        for line in written or [f"{opened.name} carries no files"]:
            console.print(line, markup=False)
        return REPRODUCED
    topics = _topics(opened, options)
    code = REPRODUCED
    with progress_bar() as bar:
        for topic in bar.track(topics, description=escape(opened.name)):
            try:
                paths = _export_topic(opened, topic, options.format, directory)
            except LogError as error:
                console.print(f"left out: {error}", markup=False, style="yellow")
                code = DAMAGED
                continue
            for path in paths:
                console.print(str(path), markup=False)
    return code


def _topics(opened: OpenedRun, options: argparse.Namespace) -> list[str]:
    candidates = trajectory_topics(opened) if options.format == "tum" else list(opened.topics)
    kept = [
        topic
        for topic in sorted(candidates)
        if opened.topics[topic].count != 0
        and (not options.topics or any(fnmatchcase(topic, pattern) for pattern in options.topics))
    ]
    if not kept:
        what = "no topic that holds poses" if options.format == "tum" else "no topic"
        raise HippomatError(f"{opened.name}: {what} matches; hippomat-logs info shows what there is")
    return kept


def _export_topic(opened: OpenedRun, topic: str, kind: str, directory: Path) -> list[Path]:
    if kind == "csv":
        return export_csv(opened, topic, directory)
    if kind == "parquet":
        return export_parquet(opened, topic, directory)
    path = directory / f"{opened.name}_{file_word(topic)}.tum"
    export_tum(opened, topic, path)
    return [path]
