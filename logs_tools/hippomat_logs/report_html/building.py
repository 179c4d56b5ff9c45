"""Logs -> ReportData, with a process for every log and one time base for all.

Decides how times of different robots are compared: by their radio traffic where that is possible, by their
wall clocks where it is not, which the report then says.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hippomat_core.errors import HippomatError
from hippomat_logs.alignment import Alignment, align_runs, how_sure
from hippomat_logs.each_file import each_item, progress_bar
from hippomat_logs.fleet_story.conflicts import Conflict, conflicts_of
from hippomat_logs.reader import Run
from hippomat_logs.report_html.assembly import assemble
from hippomat_logs.report_html.data import ReportData
from hippomat_logs.report_html.logs import ReadLog, find_logs, read_log


def build(paths: Sequence[Path], trust_clocks: bool = False) -> tuple[ReportData, bool]:
    """What a report of these logs shows, and whether all of them are whole.

    Raises HippomatError where they are not of one run of one fleet.
    """
    logs = find_logs(paths)
    known = frozenset(log.robot for log in logs)
    size = sum(path.stat().st_size for log in logs for path in log.paths)
    read = list(each_item(logs, partial(read_log, known=known), "reading", size))
    base = _time_base(read, trust_clocks)
    for one in read:
        one.metrics.on_fleet_clock = not base.alignment.is_stranger(one.log.run)
    common = [partial(_common_ns, base.alignment, one.log.run) for one in read]
    return assemble(read, common, _conflicts(read), base.clocks, base.doubt), not any(
        one.faults for one in read
    )


def _common_ns(alignment: Alignment, run: Run, times_ns: NDArray[np.int64]) -> NDArray[np.int64]:
    return alignment.common_ns_array(run, times_ns)


@dataclass(frozen=True, slots=True)
class _TimeBase:
    """How the logs' clocks were made one. doubt: why that may be wrong, "" = it is not."""

    alignment: Alignment
    clocks: str = ""
    doubt: str = ""


def _time_base(read: Sequence[ReadLog], trust_clocks: bool) -> _TimeBase:
    runs = [one.log.run for one in read]
    trusting, clocks = Alignment.trusting(runs), "the robots' wall clocks, trusted"
    if len(runs) < 2:
        return _TimeBase(trusting)
    if trust_clocks:
        return _TimeBase(trusting, clocks)
    if not all(one.whole for one in read):
        doubt = "a log is damaged, so times of different robots are those of their own wall clocks"
        return _TimeBase(trusting, clocks, doubt)
    try:
        with progress_bar() as bar:
            task = bar.add_task("aligning clocks", total=len(runs))
            alignment = align_runs(runs, strangers=True, progress=lambda _: bar.advance(task))
    except HippomatError as error:
        if not _overlap(read, trusting):
            raise
        why = str(error).partition(",")[0]
        return _TimeBase(trusting, clocks, f"{why}: times of different robots are those of their wall clocks")
    clocks, doubt = f"one, by the frames that robots heard of each other, {how_sure(alignment)}", ""
    if alignment.strangers:
        who = ", ".join(one.log.who for one in read if alignment.is_stranger(one.log.run))
        if not _overlap(read, alignment):
            raise HippomatError(
                f"no radio traffic links {who} with the others, and by its wall clock it did not run with "
                "them: leave its log out, or give --trust-clocks"
            )
        doubt = f"no radio traffic links {who} with the others: its times are those of its own wall clock"
    return _TimeBase(alignment, clocks, doubt)


def _overlap(read: Sequence[ReadLog], alignment: Alignment) -> bool:
    """Whether there was a moment when all of them recorded."""
    begun_ns = np.array([one.reading.first_ns for one in read])
    ended_ns = begun_ns + [round(one.reading.last_s * 1e9) for one in read]
    moved = [
        alignment.common_ns_array(one.log.run, np.array(span))
        for one, span in zip(read, np.stack([begun_ns, ended_ns], axis=1), strict=True)
    ]
    return bool(max(span[0] for span in moved) < min(span[1] for span in moved))


def _conflicts(read: Sequence[ReadLog]) -> list[Conflict] | None:
    """Of the whole fleet, where the logs can tell; None: they cannot."""
    runs = [one.log.run for one in read if one.log.robot >= 0]
    if len(runs) < 2 or not all(one.whole for one in read):
        return None
    return conflicts_of(runs)
