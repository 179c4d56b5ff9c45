"""hippomat-logs plot: one picture of each run."""

from __future__ import annotations

import argparse
from pathlib import Path

from rich.console import Console

from hippomat_core.errors import HippomatError
from hippomat_logs.opened_run import OpenedRun, group_runs
from hippomat_logs.outputs import refuse_directory
from hippomat_logs.pictures import refuse_no_picture, require_matplotlib
from hippomat_logs.quick_look import draw
from hippomat_logs.report import REPRODUCED


def add_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("paths", nargs="+", type=Path, metavar="LOG", help="logs, or directories of logs")
    out = "the picture (.png, .pdf, .svg), or a directory for RUN.png of each run (default: here)"
    parser.add_argument("-o", "--out", type=Path, metavar="OUT", help=out)
    points = "the points of a LaserScan or PointCloud topic from above, in its fixed frame"
    parser.add_argument("--topic", default="", metavar="T", help=points)


def run(options: argparse.Namespace, console: Console) -> int:
    require_matplotlib()
    runs = group_runs(options.paths)
    for opened, path in zip(runs, _places(runs, options.out or Path()), strict=True):
        console.print(f"{path}: {draw(opened, path, options.topic)}", markup=False)
    return REPRODUCED


def _places(runs: list[OpenedRun], out: Path) -> list[Path]:
    """A picture for each run; HippomatError where they cannot be written there."""
    if len(runs) == 1 and out.suffix and not out.is_dir():
        refuse_no_picture(out)
        return [out]
    if out.suffix and not out.is_dir():
        raise HippomatError(f"{out}: there are {len(runs)} runs: give a directory for their pictures")
    refuse_directory(out)
    out.mkdir(parents=True, exist_ok=True)
    places = [out / f"{opened.name}.png" for opened in runs]
    for path in places:
        refuse_no_picture(path)
    return places
