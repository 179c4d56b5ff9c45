"""hippomat-logs plot: one picture of each run."""

from __future__ import annotations

import argparse
from pathlib import Path

from rich.console import Console

from hippomat_core.errors import HippomatError
from hippomat_logs.opened_run import group_runs
from hippomat_logs.pictures import PICTURES
from hippomat_logs.quick_look import draw
from hippomat_logs.report import REPRODUCED


def add_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("paths", nargs="+", type=Path, metavar="LOG", help="logs, or directories of logs")
    out = "the picture (.png); for several runs a directory (default: RUN.png here)"
    parser.add_argument("-o", "--out", type=Path, metavar="OUT", help=out)
    points = "the points of a LaserScan or PointCloud topic from above, in its fixed frame"
    parser.add_argument("--topic", default="", metavar="T", help=points)


def run(options: argparse.Namespace, console: Console) -> int:
    runs = group_runs(options.paths)
    out: Path | None = options.out
    if len(runs) > 1:
        out = out or Path()
        if out.suffix:
            raise HippomatError(f"{out}: there are {len(runs)} runs: give a directory for their pictures")
        out.mkdir(parents=True, exist_ok=True)
    for opened in runs:
        path = out if out is not None and len(runs) == 1 else (out or Path()) / f"{opened.name}.png"
        if path.suffix.lower() not in PICTURES:
            raise HippomatError(f"{path}: give a name that ends in .png, .pdf or .svg")
        console.print(f"{path}: {draw(opened, path, options.topic)}", markup=False)
    return REPRODUCED
