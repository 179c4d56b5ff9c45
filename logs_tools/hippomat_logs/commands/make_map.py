"""hippomat-logs map: the map of a place from the log of a robot that drove, or was pushed, through it."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from itertools import chain
from pathlib import Path

from rich.console import Console

from hippomat_core.errors import HippomatError, MapError
from hippomat_core.mapping import mapper_settings
from hippomat_core.slam.mapper_warm_up import warm_up_mapper
from hippomat_core.slam.offline import FinishedMap, Sweep, finished_map
from hippomat_logs.each_file import progress_bar
from hippomat_logs.map_files import save_map
from hippomat_logs.map_from_log import SweepCount, sweeps_of
from hippomat_logs.outputs import refuse_existing
from hippomat_logs.pictures import refuse_no_picture
from hippomat_logs.reader import Run, open_runs
from hippomat_logs.report import DAMAGED, REPRODUCED

SPLIT_SHARE = 0.2  # of the sweeps without a match: what comes out is hardly a map


def add_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "paths", nargs="+", type=Path, metavar="LOG", help="the log of one run, all its parts"
    )
    parser.add_argument(
        "-o", "--out", type=Path, required=True, metavar="YAML", help="the map; its .pgm goes beside it"
    )
    parser.add_argument("--picture", type=Path, metavar="PNG", help="map and driven way as a picture")


def run(options: argparse.Namespace, console: Console) -> int:
    if options.out.suffix not in (".yaml", ".yml"):
        raise MapError(f"{options.out}: a map's name must end in .yaml; the image goes beside it")
    for path in (options.out, options.out.with_suffix(".pgm")):  # robots may know a map by its hash
        refuse_existing(path)
    if options.picture is not None:
        refuse_no_picture(options.picture)
    recorded = _one_run(options.paths)
    count = SweepCount()
    made = _mapped(recorded, count)
    grid = made.evidence.grid().cropped()
    save_map(grid, options.out)
    size = f"{grid.width * grid.resolution_m:.1f} x {grid.height * grid.resolution_m:.1f} m"
    console.print(
        f"{options.out}: {size}, {count.taken} sweeps, {len(made.graph)} keyframes, "
        f"{len(made.graph.loops)} links, map {grid.hash().hex()[:16]}",
        markup=False,
    )
    if options.picture is not None:
        from hippomat_logs.map_picture import draw  # matplotlib loads slowly

        draw(grid, made.final, recorded.name, options.picture)
        console.print(f"{options.picture}: the map and the way", markup=False)
    if made.unmatched > SPLIT_SHARE * count.taken:
        text = (
            f"{made.unmatched} of {count.taken} sweeps fitted nothing before them: look at the map before use"
        )
        console.print(text, style="yellow", markup=False)
    for line in recorded.lost:
        console.print(f"lost: {line}", style="yellow", markup=False)
    return DAMAGED if recorded.lost else REPRODUCED


def _one_run(paths: list[Path]) -> Run:
    runs = open_runs(paths)
    if len(runs) != 1:
        names = ", ".join(run.name for run in runs)
        raise HippomatError(f"a map is made of one run, here are {len(runs)} ({names}): choose one")
    return runs[0]


def _mapped(recorded: Run, count: SweepCount) -> FinishedMap:
    warm_up_mapper()
    with progress_bar() as bar:
        task = bar.add_task("mapping", total=None)

        def sweeps() -> Iterator[Sweep]:
            for sweep in sweeps_of(recorded, count):
                yield sweep
                bar.update(task, completed=count.taken)

        def final(done: int, of: int) -> None:
            bar.update(task, description="final pass", completed=done, total=of)

        taken = sweeps()
        first = next(taken)
        start = first[1]  # the odometry begins at the start pose: so does the map
        return finished_map(chain([first], taken), mapper_settings(recorded.config), start, final)
