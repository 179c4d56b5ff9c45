"""Reproduce one recorded run, level by level. Decides what each level may conclude from the one before.

L0 integrity, L1 bytes, L2 decisions in this process; then the real daemon in lockstep, and L3 in a world
where one is installed. Knows logs, not terminals.
"""

from __future__ import annotations

import gc
import importlib.util
import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from hippomat_core.errors import HippomatError, LogError
from hippomat_core.step import initial_state
from hippomat_logs.level1 import ByteCheck
from hippomat_logs.level2 import DecisionReplay
from hippomat_logs.level3 import check_motion
from hippomat_logs.lockstep import replay_in_daemon
from hippomat_logs.manifest import core_hash, fingerprint
from hippomat_logs.reader import Run
from hippomat_logs.report import FAILED, FAULT, LOSSY, NOT_RUN, NOT_WHOLE, OK, LevelResult, RunReport
from hippomat_logs.schema import EFFECT_TOPICS, EVENT_TOPICS
from hippomat_logs.shortfalls import shortfalls

LEVELS = ("L0", "L1", "L2", "daemon", "L3")
Progress = Callable[[str, int], None]  # (level, records done)
PROGRESS_STEP = 1000
_NO_BYTES = "a clip keeps the events that matter, no bytes and no drive"
_NO_WEIGHTS = "the weights that decided are lost: give another part of this run too"
FED_TOPICS = EVENT_TOPICS | EFFECT_TOPICS


@dataclass(frozen=True, slots=True)
class ReplayOptions:
    levels: tuple[str, ...] = LEVELS
    strict: bool = False
    plots: Path | None = None  # a directory for pictures of L3


def replay_run(run: Run, options: ReplayOptions, progress: Progress = lambda *_: None) -> RunReport:
    """All wanted levels on one run; never raises for what a log holds."""
    report = RunReport(run.name, run.robot, file=str(run.paths[0]))
    decisions: DecisionReplay | None = None
    try:
        if "L2" in options.levels and not run.weights_lost:
            decisions = _decision_replay(run)
    except LogError as error:
        report.results.append(LevelResult("L0", LOSSY, detail=str(error)))
        return report
    except HippomatError as error:
        report.results.append(LevelResult("L2", FAULT, detail=str(error)))
    with _rare_collections():
        whole = _offline_levels(run, options, decisions, report, progress)
    if whole:
        _live_levels(run, options, report, progress)
    return report


@contextmanager
def _rare_collections() -> Iterator[None]:
    """The core makes values, which have no cycles: looking for some costs an eighth of a replay."""
    before = gc.get_threshold()
    gc.set_threshold(200_000, *before[1:])
    try:
        yield
    finally:
        gc.set_threshold(*before)


def _offline_levels(
    run: Run, options: ReplayOptions, decisions: DecisionReplay | None, report: RunReport, progress: Progress
) -> bool:
    """L0, L1 and L2 in one pass; True if the log was whole."""
    started_ns = int(run.manifest.get("started_ns", "0"))
    bytes_check = None
    if "L1" in options.levels and not run.clip:
        bytes_check = ByteCheck(run.robot, run.store, started_ns, run.wall_offset_ns)
    try:
        for path, raw in run.raw_in_order():
            if run.records % PROGRESS_STEP == 0:
                progress("L0-L2", run.records)
            if run.lost:  # what follows depends on what is missing
                run.check(path, raw)
                continue
            if decisions is not None and raw.topic in EFFECT_TOPICS and decisions.takes(raw):
                continue
            fed = decisions is not None and raw.topic in FED_TOPICS
            if bytes_check is None and not fed:
                run.check(path, raw)
                continue
            record = run.decoded(path, raw)
            if bytes_check is not None:
                bytes_check.feed(record)
            if decisions is not None and fed:
                decisions.feed(record)
    except LogError as error:
        report.results.append(LevelResult("L0", LOSSY, run.records, "records", str(error)))
        return False
    report.results.insert(0, _integrity(run))
    may_be_cut = run.recovered or bool(run.lost)
    if bytes_check is not None:
        report.results.append(_up_to_loss(run, bytes_check.result(may_be_cut)))
    elif "L1" in options.levels:
        report.results.append(LevelResult("L1", NOT_RUN, detail=_NO_BYTES))
    if decisions is not None:
        report.results.append(_with_reason(run, _up_to_loss(run, decisions.result(may_be_cut))))
    elif "L2" in options.levels and run.weights_lost:
        report.results.append(LevelResult("L2", NOT_RUN, detail=_NO_WEIGHTS))
    return True


def _integrity(run: Run) -> LevelResult:
    """L0 of a run that was read to its end without damage."""
    lacks = shortfalls(run) + ([_NO_WEIGHTS] if run.weights_lost else [])
    notes = [f"a clip of {run.clip}"] if run.clip else []
    if lacks:
        return LevelResult("L0", NOT_WHOLE, run.records, "records", lacks[0], lacks[1:] + notes)
    detail = f"{len(run.paths)} file{'s' * (len(run.paths) > 1)}, checksums and record numbers whole"
    return LevelResult("L0", OK, run.records, "records", detail, notes)


def _up_to_loss(run: Run, result: LevelResult) -> LevelResult:
    """Says how far it goes; that nothing came before a loss is no divergence."""
    if result.divergence is None and result.status in (FAILED, NOT_RUN) and (run.lost or run.recovered):
        detail = "nothing to compare before the log ends, or first lacks records"
        return LevelResult(result.level, NOT_RUN, detail=detail)
    if run.lost:
        result.notes.append("compared up to the first lost record")
    return result


def _with_reason(run: Run, result: LevelResult) -> LevelResult:
    if result.divergence is not None and run.manifest.get("core_hash") != core_hash():
        result.notes.append("recorded by another version of hippomat_core: its decisions may well differ")
    return result


def _live_levels(run: Run, options: ReplayOptions, report: RunReport, progress: Progress) -> None:
    unable = _NO_BYTES if run.clip else "records are missing in its course" if run.lost else ""
    if unable:
        live = [level for level in ("daemon", "L3") if level in options.levels]
        report.results += [LevelResult(level, NOT_RUN, detail=unable) for level in live]
        return
    if "daemon" in options.levels:
        report.results.append(_guarded("daemon", lambda: _in_daemon(run, progress)))
    if "L3" in options.levels:
        report.results.append(_guarded("L3", lambda: check_motion(run, options.strict, options.plots)))


def _in_daemon(run: Run, progress: Progress) -> LevelResult:
    if importlib.util.find_spec("hippomat_host") is None:
        return LevelResult("daemon", NOT_RUN, detail="hippomat_host is not installed")
    if run.weights_lost:
        return LevelResult("daemon", NOT_RUN, detail=_NO_WEIGHTS)
    return replay_in_daemon(run, same_fingerprint(run), progress)


def _guarded(level: str, check: Callable[[], LevelResult]) -> LevelResult:
    try:
        return check()
    except HippomatError as error:
        return LevelResult(level, FAULT, detail=str(error))


def _decision_replay(run: Run) -> DecisionReplay:
    return DecisionReplay(run, initial_state(run.config, run.policy or None), same_fingerprint(run))


def same_fingerprint(run: Run) -> bool:
    """Was the run recorded on a machine that computes like this one?"""
    try:
        return bool(json.loads(run.manifest.get("fingerprint", "{}")) == fingerprint())
    except ValueError:
        return False
