"""`hippomat-bench radio`: its options, and what it does with them."""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
from importlib import import_module
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from hippomat_core.errors import ConfigError
from hippomat_sim.bench.radio_plain import HABITS, LONGEST_S, run_plain
from hippomat_sim.bench.radio_report import RadioReport, as_json, show
from hippomat_sim.bench.radio_run import OurFigures, RadioRun, Traffic
from hippomat_sim.bench.radio_settings import RadioSettings, checked, ranges_of, shown
from hippomat_sim.bench.radio_targets import targets_of

MISSED = 2
PLOT_SUFFIXES = (".png", ".pdf", ".svg")


def run(options: argparse.Namespace) -> int:
    """The exit code: MISSED when a target was."""
    settings = checked(_settings(options))
    if options.plot is not None:
        check_plot(options.plot)
    ours, plain = _measure(settings, options.plain)
    report = RadioReport(settings, ours, plain, targets_of(settings, ours))
    if options.json:
        print(json.dumps(as_json(report)))
    else:
        show(report, Console(highlight=False))
    if options.plot is not None:
        from hippomat_sim.bench.radio_plot import draw  # here, because matplotlib loads slowly

        draw(settings, ours, options.plot)
        print(f"written: {options.plot}", file=sys.stderr if options.json else sys.stdout)
    return 0 if report.met else MISSED


def check_plot(path: Path, option: str = "--plot") -> None:
    """ConfigError where draw() could not write there; before a run of an hour, not after it."""
    if path.suffix.lower() not in PLOT_SUFFIXES:
        raise ConfigError(f"{option} {path}: the name must end in {', '.join(PLOT_SUFFIXES)}")
    if not path.parent.is_dir():
        raise ConfigError(f"{option} {path}: there is no directory {path.parent}")
    if path.is_dir() or (path.exists() and not os.access(path, os.W_OK)):
        raise ConfigError(f"{option} {path}: cannot be overwritten")
    import_module("matplotlib")  # guarded() says how to install it
    try:
        tempfile.TemporaryFile(dir=path.parent).close()
    except OSError as error:
        raise ConfigError(f"{option} {path}: cannot write into {path.parent}: {error.strerror}") from error


def _measure(settings: RadioSettings, with_plain: bool) -> tuple[OurFigures, dict[str, Traffic]]:
    columns = (TextColumn("{task.description}"), BarColumn(), TimeRemainingColumn())
    with Progress(*columns, console=Console(file=sys.stderr), transient=True) as bar:
        task = bar.add_task("our schedule", total=settings.seconds)
        ours = RadioRun(settings, lambda done_s: bar.update(task, completed=done_s)).execute()
        plain: dict[str, Traffic] = {}
        for habit in HABITS if with_plain else ():
            bar.reset(task, description=habit, total=min(settings.seconds, LONGEST_S))
            plain[habit] = run_plain(settings, ours, habit, lambda done_s: bar.update(task, completed=done_s))
    return ours, plain


def add_options(parser: argparse.ArgumentParser) -> None:
    """What _settings() reads."""
    default = RadioSettings()
    ranges = ranges_of(default)
    numbers: tuple[tuple[str, type, float | None, str, str], ...] = (
        ("--nodes", int, default.nodes, "N", "radios"),
        ("--rate", float, default.rate_hz, "HZ", "rounds a second"),
        ("--tasks", int, default.tasks, "M", "task slots in a STATE"),
        ("--seconds", float, default.seconds, "S", "simulated time that counts"),
        ("--loss", float, default.loss, "P", "probability that a receiver misses a frame"),
        ("--burst-s", float, default.burst_s, "S", "mean length of a burst"),
        ("--hidden", float, default.hidden, "P", "share of the pairs that cannot hear each other"),
        ("--late", float, None, "P", "share of the receptions that are up to 5 ms late"),
        ("--drift", float, default.drift_ppm, "PPM", "clocks are off by up to this"),
        ("--answer-ms", float, default.answer_ms, "MS", "a host answers a round after 1 ms to this"),
        ("--deaths", int, default.deaths, "K", "robots that die for good during the run"),
        ("--reboots", int, default.reboots, "K", "reboots during the run"),
        (
            "--partitions",
            int,
            default.partitions,
            "K",
            "times that the fleet falls apart, half of the run in all",
        ),
        ("--stops", int, default.stops, "K", "STOPs raised, and resumed, after the run"),
        ("--seed", int, default.seed, "N", "of clocks, losses, hidden pairs and faults"),
    )
    for option, of_type, value, metavar, text in numbers:
        _, allowed = ranges[option]
        line = f"{text}, {allowed.shown} (default {shown(value or 0)})"
        parser.add_argument(option, type=of_type, default=value, metavar=metavar, help=line)
    add = parser.add_argument
    choices = ("none", "link", "receiver")
    add("--bursts", choices=choices, default="none", help="lose frames in bursts, of a link or of a receiver")
    script = "every minute a death with return, a reboot and a partition of 10 s; --late 0.1 unless given"
    add("--faults", action="store_true", help=script)
    add("--no-plain", dest="plain", action="store_false", help="our schedule only")
    add("--plot", type=Path, metavar="FILE", help="draw how well the fleet times agreed: png, pdf, svg")
    add("--json", action="store_true", help="one JSON object instead of tables")


def _settings(options: argparse.Namespace) -> RadioSettings:
    late = options.late if options.late is not None else (0.1 if options.faults else 0.0)
    return RadioSettings(
        nodes=options.nodes,
        rate_hz=options.rate,
        tasks=options.tasks,
        seconds=options.seconds,
        loss=options.loss,
        bursts=options.bursts,
        burst_s=options.burst_s,
        hidden=options.hidden,
        late=late,
        drift_ppm=options.drift,
        answer_ms=options.answer_ms,
        deaths=options.deaths,
        reboots=options.reboots,
        partitions=options.partitions,
        script=options.faults,
        stops=options.stops,
        seed=options.seed,
    )
