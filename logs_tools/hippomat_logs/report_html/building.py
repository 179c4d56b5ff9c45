"""Logs -> ReportData, with a process for every log and one time base for all.

Decides how times of different robots are compared: by their radio traffic where that is possible, by their
wall clocks where it is not, which the report then says.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hippomat_core.errors import HippomatError
from hippomat_logs.alignment import Alignment, align_runs
from hippomat_logs.each_file import each_file, progress_bar
from hippomat_logs.fleet_story.conflicts import Conflict, conflicts_of
from hippomat_logs.reader import Run
from hippomat_logs.report_html.assembly import assemble
from hippomat_logs.report_html.data import ReportData
from hippomat_logs.report_html.logs import FoundLog, ReadLog, find_logs, read_log


def build(paths: Sequence[Path]) -> tuple[ReportData, bool]:
    """What a report of these logs shows, and whether all of them are whole.

    Raises HippomatError where they are not of one run of one fleet.
    """
    logs = {log.paths[0]: log for log in find_logs(paths)}
    known = frozenset(log.robot for log in logs.values())
    work = partial(_read_one, logs, known)
    read = [found for _, found in each_file(list(logs), work, "reading")]
    alignment, warnings = _aligned(read)
    common = [partial(_common_ns, alignment, one.log.run) for one in read]
    data = assemble(read, common, _conflicts(read), warnings)
    return data, not any(one.faults for one in read)


def _read_one(logs: dict[Path, FoundLog], known: frozenset[int], path: Path) -> ReadLog:
    return read_log(logs[path], known)


def _common_ns(alignment: Alignment, run: Run, times_ns: NDArray[np.int64]) -> NDArray[np.int64]:
    return alignment.common_ns_array(run, times_ns)


def _aligned(read: Sequence[ReadLog]) -> tuple[Alignment, list[str]]:
    """The time base, and what is doubtful about it."""
    runs = [one.log.run for one in read]
    trusting = Alignment.trusting(runs)
    if len(runs) < 2:
        return trusting, []
    if not all(one.whole for one in read):
        return trusting, ["a log is damaged, so times of different robots are those of their own wall clocks"]
    try:
        with progress_bar() as bar:
            task = bar.add_task("aligning clocks", total=len(runs))
            return align_runs(runs, progress=lambda _: bar.advance(task)), []
    except HippomatError as error:
        if not _overlap(read):
            raise
        text = str(error).partition(":")[0]
        return trusting, [f"{text}: times of different robots are those of their own wall clocks"]


def _overlap(read: Sequence[ReadLog]) -> bool:
    """Whether, by the wall clocks, there was a moment when all of them recorded."""
    begun_ns = [one.reading.first_ns for one in read]
    ended_ns = [one.reading.first_ns + round(one.reading.last_s * 1e9) for one in read]
    return max(begun_ns) < min(ended_ns)


def _conflicts(read: Sequence[ReadLog]) -> list[Conflict] | None:
    """Of the whole fleet, where the logs can tell; None: they cannot."""
    runs = [one.log.run for one in read if one.log.robot >= 0]
    if len(runs) < 2 or not all(one.whole for one in read):
        return None
    return conflicts_of(runs)
