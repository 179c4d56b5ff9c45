"""hippomat-logs report: a fleet's run as one HTML file that opens offline."""

from __future__ import annotations

import argparse
import webbrowser
from pathlib import Path

from rich.console import Console

from hippomat_logs.outputs import appearing, refuse_undrawable
from hippomat_logs.part import package_version
from hippomat_logs.report import DAMAGED, REPRODUCED
from hippomat_logs.report_html.building import build
from hippomat_logs.report_html.page import needs_bokeh, render

DEFAULT_OUT = Path("report.html")


def add_options(parser: argparse.ArgumentParser) -> None:
    parser.description = (
        "One HTML file that opens in any browser without a network: the run animated on its map, what every "
        "robot did, conflicts, radio, alarms, metrics. Of logs of one run of one fleet; one robot's will do."
    )
    parser.add_argument("paths", nargs="+", type=Path, metavar="LOG", help="logs, or directories of logs")
    out = "the file to write (default: report.html here)"
    parser.add_argument("-o", "--out", type=Path, default=DEFAULT_OUT, metavar="HTML", help=out)
    trust = "the robots' wall clocks are one: do not align them"
    parser.add_argument("--trust-clocks", action="store_true", help=trust)
    parser.add_argument("--open", action="store_true", help="open it in the browser")


def run(options: argparse.Namespace, console: Console) -> int:
    out: Path = options.out
    refuse_undrawable(out, (".html", ".htm"))
    needs_bokeh()
    data, whole = build(options.paths, options.trust_clocks)
    text = render(data, package_version())
    with appearing(out) as beside:
        beside.write_text(text, encoding="utf-8")
    size = f"{len(text.encode()) / 2**20:.1f} MiB"
    console.print(f"{out}: {data.title}, {data.span_s:.1f} s, {size}", markup=False)
    for line in data.warnings:
        console.print(f"warning: {line}", style="yellow", markup=False)
    if options.open:
        webbrowser.open(out.resolve().as_uri())
    return REPRODUCED if whole else DAMAGED
