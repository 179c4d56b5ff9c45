"""Which files are one run of one fleet, and what is wrong with each: files in, one ReadLog per log out.

Decides what may be shown together. A damaged log is read as far as its checksums hold, and says so: looking
at what is left of a run is no reason to refuse it.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from hippomat_core.errors import HippomatError, LogError
from hippomat_core.messages import Started
from hippomat_logs.copies import each_part_once
from hippomat_logs.file_kinds import Kind, SelectionError, kind_of, refuse_foreign
from hippomat_logs.lenient_walk import walk_leniently
from hippomat_logs.losses import Losses
from hippomat_logs.metrics import KINDS as METRICS_KINDS
from hippomat_logs.metrics import MetricsReading, RobotMetrics
from hippomat_logs.opened_run import distinct_logs
from hippomat_logs.reader import Record, Run, mapped, open_again, reading_store, runs_inside
from hippomat_logs.records import DropRecord
from hippomat_logs.recovery import lenient_contents
from hippomat_logs.report_html.reading import KINDS, LogReading, ViewReader
from hippomat_logs.schema import CLASSES, TOPICS
from hippomat_logs.shortfalls import shortfalls, whose_log
from hippomat_logs.walk import Contents

READ = tuple(dict.fromkeys((Started, *KINDS, *METRICS_KINDS)))
_TOPICS_READ = {TOPICS[kind]: kind for kind in READ}
SHOWN = 6  # faults and names in one line


@dataclass(frozen=True, slots=True)
class FoundLog:
    """The parts of one robot's run, in order, and what they say of themselves."""

    paths: tuple[Path, ...]
    manifest: dict[str, str]
    inside: str = ""  # of a fused file: the prefix of this run's topics

    @property
    def robot(self) -> int:
        """-1: an observer."""
        return int(self.manifest.get("robot", "-1"))

    @property
    def run(self) -> Run:
        return Run(self.paths, self.manifest, inside=self.inside)

    @property
    def who(self) -> str:
        return whose_log(self.robot)


@dataclass(slots=True)
class ReadLog:
    """One log, read. faults: what of it is damaged or lost, for people."""

    log: FoundLog
    reading: LogReading
    metrics: RobotMetrics
    faults: list[str] = field(default_factory=list)
    whole: bool = True  # every byte passed its checks
    weights_lost: bool = False


def find_logs(paths: Sequence[Path]) -> list[FoundLog]:
    """The logs of one run of one fleet, by robot. HippomatError where the files hold anything else."""
    groups: dict[tuple[int, str, str], list[tuple[int, Path, dict[str, str]]]] = {}
    for path in distinct_logs(paths):
        if path not in paths and kind_of(path) not in (Kind.OURS, Kind.EMPTY):
            continue  # somebody else's, which lies beside ours
        refuse_foreign(path)
        for inside in runs_inside(path) or ("",):
            manifest = _manifest(path, inside)
            key = int(manifest.get("robot", "-1")), manifest.get("session_id", ""), inside
            groups.setdefault(key, []).append((int(manifest.get("part", "0")), path, manifest))
    logs: dict[tuple[int, str], FoundLog] = {}
    for robot, session, inside in sorted(groups):  # a run's own files come before a fused one that has it too
        parts = list(each_part_once(groups[robot, session, inside]))
        log = FoundLog(tuple(path for _, path, _ in parts), parts[0][2], inside)
        logs.setdefault((robot, session), log)
    found = list(logs.values())
    if not found:
        raise HippomatError(f"{', '.join(map(str, paths))}: no log of a hippomat daemon is there")
    _check_one_run(found)
    return found


def _manifest(path: Path, inside: str) -> dict[str, str]:
    """Of a whole or a damaged log; there are two copies in a file."""
    contents = _contents(inside)
    with mapped(path) as data:
        for _ in walk_leniently(data, contents):
            if contents.manifest:
                break
    if not contents.manifest:
        raise LogError(f"{path}: nothing of its run manifest is left: whose log it is cannot be told")
    return contents.manifest


def _contents(inside: str) -> Contents:
    """For a walk over one run of a file that may be damaged."""
    return Contents(inside=inside) if inside else lenient_contents(reading_store())


def _check_one_run(logs: Sequence[FoundLog]) -> None:
    seen: dict[int, FoundLog] = {}
    for log in logs:
        other = seen.setdefault(log.robot, log)
        if other is not log:
            names = f"{other.paths[0].name} and {log.paths[0].name}"
            raise HippomatError(
                f"{log.who} has more than one run here ({names}): "
                "a report shows one run of a fleet, name its logs"
            )
    fleets = {log.manifest.get("fleet", "?") for log in logs}
    if len(fleets) > 1:
        raise HippomatError(
            f"these are logs of fleets {', '.join(sorted(fleets))}: a report shows one fleet; name its logs"
        )


def read_log(log: FoundLog, known: Collection[int]) -> ReadLog:
    """Everything that a report shows of one log. known: robots whose own logs are at hand.

    Raises HippomatError only where another version recorded it.
    """
    try:
        run = open_again(log.paths, log.inside)
        found = _fed(log, run.records_in_order(READ), known)
    except (LogError, SelectionError) as error:
        faults: list[str] = [str(error)]
        found = _fed(log, _what_is_left(log, faults), known)
        found.faults, found.whole = faults, False
        return found
    found.faults, found.weights_lost = shortfalls(run), run.weights_lost
    return found


def _fed(log: FoundLog, records: Iterator[Record], known: Collection[int]) -> ReadLog:
    config = log.run.config
    views, metrics = ViewReader(log.robot, config, known), MetricsReading(log.robot, config)
    for record in records:
        views.feed(record)
        metrics.feed(record)
    return ReadLog(log, views.result(), metrics.result())


def _what_is_left(log: FoundLog, faults: list[str]) -> Iterator[Record]:
    """The records whose checksums hold, in all parts; what was passed over goes to `faults`."""
    store, losses, expected, missing = reading_store(), Losses(), 1, 0
    for path in log.paths:
        contents = _contents(log.inside)
        with mapped(path) as data:
            for raw in walk_leniently(data, contents):
                if raw.topic not in CLASSES:
                    continue
                missing += max(raw.number - expected, 0)
                expected = raw.number + 1
                if raw.topic in _TOPICS_READ:
                    try:
                        message = store.decode(_TOPICS_READ[raw.topic], raw.data)
                    except Exception as error:  # rosbags' decoder has no error of its own
                        contents.damage.append(f"record {raw.number} does not decode: {error}")
                        continue
                    if isinstance(message, DropRecord):
                        losses.add(message)
                        missing -= message.last - message.first
                    yield Record(raw.number, raw.log_time_ns, raw.topic, message)
        faults += [f"{path.name}: {line}" for line in contents.damage[:SHOWN]]
    if missing > 0:
        faults.append(f"{missing:,} records are missing")
    faults += losses.lines()
