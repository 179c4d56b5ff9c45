"""hippomat-logs convert: one log as another kind of log. Exit code 3 if a channel had to be left out."""

from __future__ import annotations

import argparse
from pathlib import Path

from rich.console import Console

from hippomat_logs.conversion import STORAGES, convert, refuse_target
from hippomat_logs.each_file import progress_bar
from hippomat_logs.report import DAMAGED, REPRODUCED
from hippomat_logs.sources import open_source

SHOW_EVERY = 500


def add_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "source", type=Path, metavar="LOG", help=".mcap, .bag, .db3 or a ROS 2 bag's directory"
    )
    kinds = "a new .mcap or .bag; a name without suffix makes a ROS 2 bag"
    parser.add_argument("target", type=Path, metavar="OUT", help=kinds)
    parser.add_argument(
        "--storage", choices=STORAGES, default="sqlite3", help="of a ROS 2 bag (default sqlite3)"
    )


def run(options: argparse.Namespace, console: Console) -> int:
    refuse_target(options.target)
    source = open_source(options.source)
    total = sum(stream.count or 0 for stream in source.streams.values())
    with progress_bar() as bar:
        task = bar.add_task("converting", total=total or None)

        def progress(done: int) -> None:
            if done % SHOW_EVERY == 0:
                bar.update(task, completed=done)

        done, left_out = convert(source, options.target, options.storage, progress)
    console.print(f"{options.target}: {done:,} messages", markup=False)
    for topic, why in left_out.items():
        console.print(f"left out: {topic}: {why}", markup=False, style="yellow")
    return DAMAGED if left_out else REPRODUCED
