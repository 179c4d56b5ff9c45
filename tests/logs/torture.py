"""`make torture`: a thousand cut files and flipped bits, fifty kills, a hundred pulled plugs, a full disk.

Prints what was kept and lost; exit code 2 if anything was lost or invented that must not be.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from torture_lab import (
    Outcome,
    Victim,
    flipped,
    full_disk,
    make_victim,
    seconds_lost_by_kill,
    seconds_lost_by_power_cut,
    strict_reader_notices,
    table_reader_is_right,
    truncated,
    whole_file,
)

MAX_LOST_S = 0.5
MISSED = 2


def main() -> int:
    parser = argparse.ArgumentParser(prog="make torture", description=__doc__)
    parser.add_argument("--cases", type=int, default=1000, help="truncations, and bit flips (default 1000)")
    parser.add_argument("--kills", type=int, default=50, help="processes killed (default 50)")
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    console = Console(highlight=False, soft_wrap=True)
    with tempfile.TemporaryDirectory() as directory, Progress(*columns, console=Console(stderr=True)) as bar:
        good = torture(Path(directory), options, console, bar)
    console.print("all held" if good else "NOT all held", style="bold green" if good else "bold red")
    return 0 if good else MISSED


def torture(directory: Path, options: argparse.Namespace, console: Console, bar: Progress) -> bool:
    rng = np.random.default_rng(options.seed)
    victim = make_victim(_made(directory / "victim"))
    bytes_, bits = len(victim.data), 8 * len(victim.data)
    console.print(
        f"the victim: {bytes_:,} bytes, {len(victim.chunks)} chunks, {len(victim.messages):,} messages"
    )
    damages: list[tuple[str, Callable[[Victim, int, Path], Outcome], Iterable[int]]] = [
        ("cut files", truncated, rng.integers(0, bytes_, options.cases)),
        ("flipped bits", flipped, rng.integers(0, bits, options.cases)),
    ]
    good = True
    work = _made(directory / "work")
    for name, damage, places in damages:
        outcomes = [damage(victim, int(at), work) for at in bar.track(list(places), description=name)]
        good &= _report(name, outcomes, console)
    whole = whole_file(directory / "whole")
    places = rng.integers(0, 8 * len(whole), options.cases).tolist()
    unnoticed = sum(
        not strict_reader_notices(whole, bit, work) for bit in bar.track(places, description="readers")
    )
    wrong = sum(
        not table_reader_is_right(whole, bit, work) for bit in bar.track(places[::10], description="tables")
    )
    console.print(
        f"flipped bits of a finished log: {unnoticed} of {len(places)} not noticed by the strict reader; "
        f"{wrong} of {len(places[::10])} made open_run() give out something else"
    )
    kills = [
        seconds_lost_by_kill(_made(directory / f"kill{seed}"), seed)
        for seed in bar.track(range(options.kills), description="kill -9")
    ]
    cuts = seconds_lost_by_power_cut(_made(directory / "plug"), options.seed, cuts=2 * options.kills)
    for name, lost_s in (("kill -9", kills), ("pulled plugs", cuts)):
        console.print(
            f"{name}: {len(lost_s)}, seconds lost: median {np.median(lost_s):.2f}, worst {max(lost_s):.2f}"
        )
        good &= max(lost_s) <= MAX_LOST_S
    said = full_disk(_made(directory / "disk"))
    console.print(f"full disk: {said}")
    return good and not unnoticed and not wrong


def _report(name: str, outcomes: list[Outcome], console: Console) -> bool:
    lost, invented = sum(o.lost_whole for o in outcomes), sum(o.invented for o in outcomes)
    kept, possible = sum(o.kept for o in outcomes), sum(o.possible for o in outcomes)
    console.print(
        f"{name}: {len(outcomes)}; messages in whole chunks {possible:,}, of those lost {lost}; kept in all "
        f"{kept:,}; never recorded but given out {invented}"
    )
    return lost == 0 and invented == 0


def _made(directory: Path) -> Path:
    directory.mkdir()
    return directory


if __name__ == "__main__":
    sys.exit(main())
