"""`hippomat-bench slam`: its options, and what it does with them."""

from __future__ import annotations

import argparse
import json
import sys
from importlib import import_module
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from hippomat_core.errors import ConfigError
from hippomat_core.slam.mapper_warm_up import warm_up_mapper
from hippomat_logs.map_files import save_map
from hippomat_sim.bench.radio_command import MISSED, check_plot
from hippomat_sim.bench.slam_relations import Relations, at_scans, read_relations, relation_errors
from hippomat_sim.bench.slam_report import SlamReport, as_json, show
from hippomat_sim.bench.slam_run import SlamRun, run_slam
from hippomat_sim.bench.slam_targets import Errors, targets_of
from hippomat_sim.bench.slam_trajectory import Trajectory, trajectory_of, with_odometry_between
from hippomat_sim.maps.carmen import CarmenLog, read_carmen


def add_options(parser: argparse.ArgumentParser) -> None:
    """What run() reads."""
    add = parser.add_argument
    add("log", type=Path, metavar="LOG", help="a lidar log in CARMEN's format, .log or .log.gz")
    add("--relations", type=Path, metavar="FILE", help="measured pose differences: t1 t2 dx dy dz r p y")
    add("--between", type=Path, metavar="LOG", help="a log of the same run with odometry between the scans")
    offset = (
        "what to add to stamps of --between, or of LOG with --poses-from-log, to get the relations' clock"
    )
    add("--time-offset", type=float, default=0.0, metavar="S", help=offset)
    add("--no-odometry", action="store_true", help="do not look at the poses in LOG, only at its scans")
    add("--poses-from-log", action="store_true", help="map nothing: judge the poses that LOG has itself")
    add("--map", type=Path, metavar="OUT.yaml", help="save the map (map_server's yaml and pgm)")
    add("--picture", type=Path, metavar="OUT.png", help="draw map and path: png, pdf, svg")
    add("--json", action="store_true", help="one JSON object instead of tables")


def run(options: argparse.Namespace) -> int:
    """The exit code: MISSED when a target was."""
    _check(options)
    log = read_carmen(options.log)
    relations = read_relations(options.relations) if options.relations else None
    between = read_carmen(options.between) if options.between else None
    if options.poses_from_log:
        report = _of_the_log(options, log, relations)
    else:
        report = _of_our_map(options, log, relations, between)
    if options.json:
        print(json.dumps(as_json(report)))
    else:
        show(report, Console(highlight=False))
    return 0 if report.met else MISSED


def _check(options: argparse.Namespace) -> None:
    """ConfigError where the options do not go together or nothing could be written; before the work."""
    if options.poses_from_log and (options.map or options.picture or options.between or options.no_odometry):
        raise ConfigError(
            "--poses-from-log maps nothing: only --relations, --time-offset and --json go with it"
        )
    if options.between and not options.relations:
        raise ConfigError(
            "--between only says where the robot was at the times in --relations FILE: give both"
        )
    if options.picture is not None:
        check_plot(options.picture, "--picture")
    if options.map is not None:
        if options.map.suffix not in (".yaml", ".yml"):
            raise ConfigError(f"--map {options.map}: the name must end in .yaml; the image goes beside it")
        if not options.map.parent.is_dir():
            raise ConfigError(f"--map {options.map}: there is no directory {options.map.parent}")


def _of_the_log(options: argparse.Namespace, log: CarmenLog, relations: Relations | None) -> SlamReport:
    stamps_s = log.stamps_s + options.time_offset
    scans = trajectory_of(stamps_s[log.of_scan], log.poses[log.of_scan])
    everything = trajectory_of(stamps_s, log.poses)
    errors = {"as in the log": _errors(relations, scans, everything)} if relations else {}
    return SlamReport(options.log.name, len(log.scans), errors, None, ())


def _of_our_map(
    options: argparse.Namespace, log: CarmenLog, relations: Relations | None, between: CarmenLog | None
) -> SlamReport:
    import_module("gtsam")  # guarded() says how to install it, before the work
    slam = _mapped(log, not options.no_odometry)
    stamps_s = np.array([scan.stamp_s for scan in log.scans])
    errors = {}
    if relations:
        for name, poses in (("final", slam.map.final), ("online", slam.map.online)):
            scans = trajectory_of(stamps_s, poses)
            whole = with_odometry_between(scans, between, options.time_offset) if between else None
            errors[name] = _errors(relations, scans, whole)
    _write(options, slam)
    count = len(relations.motions) if relations else 0
    targets = targets_of(slam.costs, len(log.scans), count, errors.get("final"), not options.no_odometry)
    return SlamReport(options.log.name, len(log.scans), errors, slam, targets)


def _errors(relations: Relations, scans: Trajectory, whole: Trajectory | None) -> Errors:
    return Errors(
        relation_errors(at_scans(relations, scans.stamps_s), scans),
        relation_errors(relations, scans),
        relation_errors(relations, whole) if whole else None,
    )


def _mapped(log: CarmenLog, with_odometry: bool) -> SlamRun:
    warm_up_mapper()
    columns = (TextColumn("{task.description}"), BarColumn(), TimeRemainingColumn())
    with Progress(*columns, console=Console(file=sys.stderr), transient=True) as bar:
        task = bar.add_task("mapping")

        def progress(what: str, done: int, of: int) -> None:
            bar.update(task, description=what, completed=done, total=of)

        return run_slam(log.scans, with_odometry, progress)


def _write(options: argparse.Namespace, slam: SlamRun) -> None:
    grid = slam.map.evidence.grid()
    if options.map is not None:
        save_map(grid, options.map)
    if options.picture is not None:
        from hippomat_logs.map_picture import draw  # here, because matplotlib loads slowly

        draw(grid, slam.map.final, options.log.name, options.picture)
    for path in (options.map, options.picture):
        if path is not None:
            print(f"written: {path}", file=sys.stderr if options.json else sys.stdout)
