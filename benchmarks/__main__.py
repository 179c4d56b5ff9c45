"""`make bench`: what the robot's hot paths cost, each beside a named peer in the same run.

Prints medians and ratios. Absolute times depend on the machine and its load; quote the ratios.
"""

from __future__ import annotations

import argparse
import json
import sys

from rich.console import Console
from rich.table import Table

from benchmarks import cases, learning
from benchmarks.measure import Result

CASES = cases.CASES | learning.CASES


def main() -> int:
    parser = argparse.ArgumentParser(prog="make bench", description=__doc__)
    parser.add_argument("--json", action="store_true", help="print one JSON object per line")
    parser.add_argument("names", nargs="*", help="only these cases (default: all)")
    options = parser.parse_args()
    unknown = set(options.names) - set(CASES)
    if unknown:
        print(f"unknown case {sorted(unknown)[0]!r}; known: {', '.join(CASES)}", file=sys.stderr)
        return 1
    results = [CASES[name]() for name in options.names or CASES]
    show(results, options.json)
    return 0


def show(results: list[Result], as_json: bool) -> None:
    if as_json:
        for result in results:
            print(json.dumps(result.as_dict()))
        return
    table = Table(title="hippomat benchmarks (medians; ratio > 1: ours is faster)")
    for column in ("case", "ours", "peer", "peer's time", "ratio"):
        table.add_column(column, justify="left" if column in ("case", "peer") else "right")
    for r in results:
        table.add_row(r.case, f"{r.ours_us:,.1f} us", r.peer, f"{r.peer_us:,.1f} us", f"{r.ratio:.2f}")
    Console().print(table)


if __name__ == "__main__":
    sys.exit(main())
