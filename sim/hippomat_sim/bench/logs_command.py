"""`hippomat-bench logs`: our reader beside the others', what recording costs, memory of a large log."""

from __future__ import annotations

import argparse
import json
import tempfile
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn
from rich.table import Table

from hippomat_core.errors import ConfigError
from hippomat_sim.bench.core_speed import said
from hippomat_sim.bench.logs_large import LargeFigures, measure_large
from hippomat_sim.bench.logs_readers import READERS, ReaderFigures, measure
from hippomat_sim.bench.logs_recorder import WORK, RecorderFigures, measure_recorder
from hippomat_sim.bench.logs_stream import MESSAGES_PER_S, record
from hippomat_sim.bench.radio_report import verdict
from hippomat_sim.bench.radio_targets import Target

MISSED = 2
MAX_OVER_PEER = 2.5  # 1 % of a core was asked for where mcap's writer takes 0.4 %
MIN_RATIO, MAX_SHARE, MAX_STALL_MS, MAX_MIB = 2.0, 1.0, 1.0, 300.0
LARGE_MIB = 2048


@dataclass(frozen=True, slots=True)
class LogsReport:
    readers: dict[str, list[ReaderFigures]]  # by file
    recorder: RecorderFigures | None
    large: LargeFigures | None
    targets: list[Target]

    @property
    def met(self) -> bool:
        return not any(target.missed for target in self.targets)


def add_options(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("files", nargs="*", type=Path, metavar="FILE", help=".mcap files to read (default: a made-up run)")
    add("--seconds", type=int, default=60, metavar="S", help="length of the made-up run (default 60)")
    add(
        "--recorder-seconds",
        type=int,
        default=10,
        metavar="S",
        help="real time of recording (default 10; 0: none)",
    )
    large = f"also: the memory that a summary of a log of so many MiB takes (without a number {LARGE_MIB})"
    add("--large", type=int, nargs="?", const=LARGE_MIB, metavar="MIB", help=large)
    add("--json", action="store_true", help="one JSON object instead of tables")


def run(options: argparse.Namespace) -> int:
    """The exit code: MISSED when a target was."""
    for path in options.files:
        if not path.is_file():
            raise ConfigError(f"{path}: no such file")
    if options.seconds < 1 or options.recorder_seconds < 0 or (options.large or 1) < 1:
        raise ConfigError("--seconds and --large begin at 1, --recorder-seconds at 0")
    columns = (TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn())
    screen = Console(stderr=True)
    # no refreshing thread: it would disturb what is measured
    with Progress(*columns, console=screen, transient=True, auto_refresh=False) as bar:
        report = _measure(options, bar)
    if options.json:
        print(json.dumps(_as_json(report)))
    else:
        _show(report, Console(highlight=False))
    return 0 if report.met else MISSED


def _measure(options: argparse.Namespace, bar: Progress) -> LogsReport:
    with tempfile.TemporaryDirectory(prefix="hippomat-bench-") as directory:
        files = options.files
        if not files:
            task = bar.add_task("making a run", total=None)
            bar.refresh()
            files = [record(Path(directory), options.seconds)]
            bar.remove_task(task)
        task = bar.add_task("reading", total=len(files) * len(READERS))
        readers: dict[str, list[ReaderFigures]] = {}
        for path in files:
            for reader in READERS:
                readers.setdefault(path.name, []).append(measure(reader, path))
                bar.advance(task)
                bar.refresh()
    recorder = large = None
    if options.recorder_seconds:
        task = bar.add_task("recording", total=5 * options.recorder_seconds)
        recorder = measure_recorder(
            options.recorder_seconds,
            MESSAGES_PER_S,
            lambda done: bar.update(task, completed=done, refresh=True),
        )
    if options.large:
        task = bar.add_task("a large log", total=1.0)
        large = measure_large(options.large, lambda done: bar.update(task, completed=done, refresh=True))
    return LogsReport(readers, recorder, large, list(_targets(readers, recorder, large)))


def _targets(
    readers: dict[str, list[ReaderFigures]], recorder: RecorderFigures | None, large: LargeFigures | None
) -> Iterator[Target]:
    for name, figures in readers.items():
        ours, _, rosbags, *_ = figures
        ratio = ours.per_s / rosbags.per_s if rosbags.per_s else float("nan")
        why_not = "AnyReader refuses the file" if rosbags.refused else ""
        yield Target(f"decoded messages/s, ours over AnyReader, {name}", ratio, MIN_RATIO, True, "x", why_not)
    if recorder is not None:
        share = f"recording {recorder.messages_per_s:.0f} messages/s, share of a core"
        yield Target(share, recorder.percent, MAX_SHARE, False, "%")
        cost = "recording, over mcap's writer given the bytes"
        yield Target(cost, recorder.over_mcap_writer, MAX_OVER_PEER, False, "x")
        alone_ms, why_not = recorder.longest_without_ms, ""
        if recorder.stall_ms > MAX_STALL_MS < alone_ms:
            why_not = f"without recorder the loop was held up too, for {alone_ms:.1f} ms"
        yield Target("worst stall of the control loop", recorder.stall_ms, MAX_STALL_MS, False, "ms", why_not)
    if large is not None:
        why_not = "" if large.mib >= LARGE_MIB * 0.98 else f"set for a log of {LARGE_MIB} MiB"
        yield Target("memory of info", large.info_mib, MAX_MIB, False, "MiB", why_not)
        yield Target("memory of doctor", large.doctor_mib, MAX_MIB, False, "MiB", why_not)


def _as_json(report: LogsReport) -> dict[str, Any]:
    readers = {name: [asdict(one) for one in figures] for name, figures in report.readers.items()}
    recorder = report.recorder and {
        **asdict(report.recorder),
        "percent": report.recorder.percent,
        "over_mcap_writer": report.recorder.over_mcap_writer,
    }  # fmt: skip
    targets = [
        asdict(target) | {"value": None if target.value != target.value else target.value, "met": target.met}
        for target in report.targets
    ]
    large = report.large and asdict(report.large)
    return {"readers": readers, "recorder": recorder, "large": large, "targets": targets, "met": report.met}


def _show(report: LogsReport, console: Console) -> None:
    for name, figures in report.readers.items():
        table = Table(title=f"reading {name}", box=SIMPLE_HEAD, title_justify="left")
        for column in ("reader", "messages", "messages/s", "first pass", "peak memory"):
            table.add_column(column, justify="left" if column == "reader" else "right")
        for one in figures:
            if one.refused:
                table.add_row(one.reader, "refused", "", "", "")
                continue
            rates = (f"{one.per_s:,.0f}", f"{one.first_per_s:,.0f}")
            table.add_row(one.reader, f"{one.messages:,}", *rates, f"{one.peak_mib:.0f} MiB")
        console.print(table)
        for one in figures:
            if one.refused:
                console.print(f"{one.reader} refused: {one.refused}", markup=False)
    if report.recorder is not None:
        _show_recorder(report.recorder, console)
    for target in report.targets:
        state = "not judged" if target.not_judged else ("met" if target.met else "MISSED")
        sign = ">=" if target.at_least else "<="
        line = f"{state:10} {target.name}: {target.value:.2f} {target.unit} ({sign} {target.bound:g})"
        console.print(line, markup=False, style="red" if state == "MISSED" else "")
    console.print(verdict(report.targets), style="bold green" if report.met else "bold red", markup=False)


def _show_recorder(figures: RecorderFigures, console: Console) -> None:
    console.print(
        f"recording {figures.messages_per_s:.0f} messages/s for {figures.seconds:.0f} s: writer thread "
        f"{figures.writer_percent:.2f} % of a core, calls {figures.calls_percent:.2f} %; it held the loop "
        f"up for {figures.stall_ms:.2f} ms at worst. A call and work of {figures.work_ms:.2f} ms took up to "
        f"{figures.longest_ms:.2f} ms, without recorder {figures.longest_without_ms:.2f} ms; "
        f"{figures.lost} records lost{'' if figures.is_alone else '; other processes disturbed it'}. "
        f"mcap's writer, given the bytes, took {figures.mcap_writer_percent:.2f} %, so the recorder takes "
        f"{figures.over_mcap_writer:.1f} x as much. {said(WORK / figures.work_ms / 1e3)}"
    )
