"""Everything that is wrong with one log, named: what doctor knows.

Decides what is damage (bytes are not what was written), loss (records are missing, whether or not that is
explained) and remark. Never stops at the first fault. Knows our logs record by record, others by channel.
"""

from __future__ import annotations

import fcntl
import os
import zlib
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeVar

from hippomat_core.allocation.policy_file import read_policy
from hippomat_core.errors import ConfigError, HippomatError, LogError
from hippomat_core.messages import Tick
from hippomat_logs.column_table import table_of
from hippomat_logs.lenient_walk import walk_leniently
from hippomat_logs.losses import Losses
from hippomat_logs.manifest import config_of
from hippomat_logs.reader import is_as_here, mapped, open_again, reading_store, runs_inside
from hippomat_logs.records import DropRecord, SerialRecord
from hippomat_logs.recovery import lenient_contents
from hippomat_logs.schema import CLASSES, DERIVED, MessageStore
from hippomat_logs.shortfalls import ENDED_EARLY, shortfalls
from hippomat_logs.sink import ACTIVE
from hippomat_logs.sources import Source, open_source
from hippomat_logs.strict_walk import check_frame
from hippomat_logs.walk import Contents, RawMessage

DAMAGE, LOSS, REMARK = "damage", "loss", "remark"
STEP_NS = 1_000_000_000  # log times further apart, or backward, are a clock's step
LATE_NS = 500_000_000  # between two ticks, which come every 50 ms
SLOW_SYNC_MS = 100  # the recorder promises half a second with a disk that is faster
ROWS_AT_ONCE = 20_000
TOLD_EVERY = 1_000  # records
Item = TypeVar("Item")


@dataclass
class Examination:
    """One file's faults, in the order found; equal ones are counted."""

    path: Path
    records: int = 0  # of anybody else's log: messages
    views: int = 0  # messages on standard topics, which the recorder made of records (derived.py)
    robot: str = ""
    session: str = ""
    part: int = 0
    final: bool = True
    faults: dict[tuple[str, str], int] = field(default_factory=dict)  # (kind, text) -> how often

    def add(self, kind: str, text: str) -> None:
        self.faults[kind, text] = self.faults.get((kind, text), 0) + 1

    @property
    def sound(self) -> bool:
        """Nothing is damaged or missing."""
        return all(kind == REMARK for kind, _ in self.faults)


def examine(path: Path, told: Callable[[float], None] = lambda _share: None) -> Examination:
    """Read every byte of a log; never raises for what is in it. told: called with the share done, 0 .. 1."""
    found = Examination(path)
    try:
        if path.name.endswith(ACTIVE):
            found.add(LOSS, _unfinished(path))
        if path.is_file() and path.stat().st_size == 0:
            found.add(LOSS, "is empty: nothing was recorded in it")
        elif path.is_file() and runs_inside(path):
            _examine_fused(path, found)
        elif path.is_file() and _is_ours(path):
            _examine_ours(path, found, told)
        else:
            _examine_other(open_source(path), found, told)
    except (HippomatError, OSError) as error:
        found.add(DAMAGE, str(error).removeprefix(f"{path}: "))
    return found


def _unfinished(path: Path) -> str:
    with path.open("rb") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except BlockingIOError:
            return "is being recorded by a live process"
    return f"was never finished, its daemon died: `hippomat-logs recover {path}`"


def _is_ours(path: Path) -> bool:
    """Does it carry our manifest near its head? A copy that lost it is examined as anybody's log."""
    with path.open("rb") as file:
        return b"hippomat.run" in file.read(1 << 16)


def _examine_fused(path: Path, found: Examination) -> None:
    """Run by run, as a replay would read them: the parts are there to recover from."""
    for inside in runs_inside(path):
        try:
            run = open_again([path], inside)
            found.records += sum(1 for _ in run.records_in_order())
            found.views += run.views
        except LogError as error:
            text = str(error).removeprefix(f"{path}: ")
            found.add(DAMAGE, f"{inside.strip('/')}: {text}; fuse the robots' own logs again")
            continue
        for line in shortfalls(run):
            found.add(LOSS, f"{run.name}: {line}")


# ---- our logs ----


def _examine_ours(path: Path, found: Examination, told: Callable[[float], None]) -> None:
    store = reading_store()
    contents = lenient_contents(store)
    with mapped(path) as data:
        if not path.name.endswith(ACTIVE):
            try:
                check_frame(data, str(path))
            except LogError as error:
                found.add(DAMAGE, str(error).removeprefix(f"{path}: "))
        raws = _telling(walk_leniently(data, contents), lambda: contents.complete_bytes / len(data), told)
        _examine_records(raws, contents, store, found)
    for line in contents.damage:
        found.add(DAMAGE, line)
    _examine_facts(path, contents, found)


def _telling(
    items: Iterator[Item], share: Callable[[], float], told: Callable[[float], None]
) -> Iterator[Item]:
    """The same items; says every so often how far it is."""
    for number, item in enumerate(items):
        if number % TOLD_EVERY == 0:
            told(share())
        yield item


def _examine_records(
    raws: Iterator[RawMessage], contents: Contents, store: MessageStore, found: Examination
) -> None:
    expected: int | None = None
    losses, clock = Losses(), _Clock()
    for raw in raws:
        if expected is None:
            expected = int(contents.manifest.get("first_record", "1"))
        if raw.topic not in CLASSES:
            if raw.topic in DERIVED:
                found.views += 1
            else:
                found.add(LOSS, f"record {raw.number} is on {raw.topic}, which this version does not know")
            continue
        found.records += 1
        try:
            message = store.decode(CLASSES[raw.topic], raw.data)
        except Exception as error:  # rosbags' decoder has no error of its own
            found.add(DAMAGE, f"record {raw.number} on {raw.topic} does not decode: {error}")
            expected = raw.number + 1
            continue
        first = message.first if isinstance(message, DropRecord) else raw.number
        if contents.manifest.get("selection"):
            pass  # says itself that it is not all
        elif first > expected:
            found.add(LOSS, f"records {expected}..{first - 1} are missing, and no drop record explains it")
        elif first < expected:
            found.add(DAMAGE, f"record {raw.number} stands behind record {expected - 1}")
        expected = raw.number + 1
        if isinstance(message, DropRecord):
            losses.add(message)
        elif isinstance(message, SerialRecord) and zlib.crc32(message.data) != message.crc32:
            found.add(DAMAGE, f"record {raw.number}: serial bytes do not match the checksum taken with them")
        clock.look(raw, message, found)
    for line in losses.lines():
        found.add(LOSS, line)
    last = contents.end.get("last_record")
    if last is not None and expected is not None and int(last) != expected - 1:
        found.add(LOSS, f"ends at record {expected - 1}, but record {last} was written")


class _Clock:
    """Steps of the log's clock and stalls of the daemon's loop."""

    def __init__(self) -> None:
        self._time_ns = self._tick_ns = 0

    def look(self, raw: RawMessage, message: object, found: Examination) -> None:
        if isinstance(message, DropRecord):
            return
        moved_ns = raw.log_time_ns - self._time_ns
        if self._time_ns and moved_ns < 0:
            found.add(REMARK, f"record {raw.number}: log time goes back by {-moved_ns / 1e9:.3f} s")
        elif self._tick_ns and moved_ns > STEP_NS:
            found.add(REMARK, f"record {raw.number}: {moved_ns / 1e9:.3f} s without a record before it")
        self._time_ns = raw.log_time_ns
        if isinstance(message, Tick):
            late_ns = message.stamp_ns - self._tick_ns
            if self._tick_ns and late_ns > LATE_NS:
                found.add(REMARK, f"record {raw.number}: the loop stood still for {late_ns / 1e9:.2f} s")
            self._tick_ns = message.stamp_ns


def _examine_facts(path: Path, contents: Contents, found: Examination) -> None:
    manifest, end = contents.manifest, contents.end
    found.robot, found.session = manifest.get("robot", ""), manifest.get("session_id", "")
    found.part, found.final = int(manifest.get("part", "0")), end.get("final", "yes") == "yes"
    if not manifest:
        found.add(DAMAGE, "the run manifest is missing: both copies are damaged")
        return
    whole = not manifest.get("recovered") and not manifest.get("selection")
    if not end and whole and not path.name.endswith(ACTIVE):
        found.add(LOSS, "has no end mark, and no recovery accounts for it")
    if manifest.get("recovered") and not end:
        found.add(LOSS, ENDED_EARLY)
    if damage := contents.recovery.get("damage"):  # where there is an end mark, drop records say what is lost
        found.add(REMARK if end else LOSS, f"when it was recovered: {damage}")
    if manifest.get("selection"):
        found.add(REMARK, f"a selection of a run: {manifest['selection']}")
    if int(end.get("worst_sync_ms", "0")) > SLOW_SYNC_MS:
        found.add(
            REMARK, f"a sync took {end['worst_sync_ms']} ms: a pulled plug would have cost so much more"
        )
    _examine_settings(path, contents, found)


def _examine_settings(path: Path, contents: Contents, found: Examination) -> None:
    manifest, store = contents.manifest, reading_store()
    try:
        config_of(manifest, path.name)
    except (ConfigError, LogError) as error:
        found.add(DAMAGE, str(error))
    wanted = manifest.get("policy_hash", "")
    try:
        has = read_policy(contents.policy).hash if contents.policy else ""
        if has != wanted:
            found.add(LOSS, "the weights that decided are not in it" if not has else "holds other weights")
    except ConfigError as error:
        found.add(DAMAGE, f"the weights in it cannot be used: {error}")
    for channel in contents.channels.values():
        if not is_as_here(channel, store):
            version = manifest.get("hippomat", "?")
            found.add(REMARK, f"{channel.topic} has other fields than in this version; recorded by {version}")


# ---- anybody's logs ----


def _examine_other(source: Source, found: Examination, told: Callable[[float], None]) -> None:
    for topic, why in source.left_out.items():
        found.add(LOSS, f"channel {topic} cannot be read: {why}")
    held: dict[int, list[tuple[int, bytes]]] = {number: [] for number in source.streams}
    unreadable: set[int] = set()
    last_ns, back = 0, Counter[str]()
    total = sum(stream.count or 0 for stream in source.streams.values())
    for row in _telling(source.rows(), lambda: found.records / max(1, total), told):
        found.records += 1
        back["log times go back"] += row.log_time_ns < last_ns
        last_ns = row.log_time_ns
        rows = held[row.channel]
        rows.append((row.log_time_ns, row.data))
        if len(rows) >= ROWS_AT_ONCE:
            _decode(source, row.channel, rows, unreadable, found)
    for number, rows in held.items():
        _decode(source, number, rows, unreadable, found)
    for text, count in back.items():
        if count:
            found.add(REMARK, f"{text} {count:,} times: messages are not in the order of their times")


def _decode(
    source: Source, number: int, rows: list[tuple[int, bytes]], unreadable: set[int], found: Examination
) -> None:
    stream = source.streams[number]
    try:
        if rows and number not in unreadable:
            times, data = zip(*rows, strict=True)
            table_of(stream.topic, stream.fields, times, [0] * len(rows), data)
    except LogError as error:
        unreadable.add(number)
        found.add(LOSS, str(error) if "channel" in str(error) else f"channel {stream.topic}: {error}")
    rows.clear()


def between_parts(examined: list[Examination]) -> list[str]:
    """Parts of runs that are not there."""
    runs: dict[tuple[str, str], list[Examination]] = {}
    for one in examined:
        if one.session:
            runs.setdefault((one.robot, one.session), []).append(one)
    lines = []
    for (robot, session), parts in runs.items():
        have = sorted(part.part for part in parts)
        missing = sorted(set(range(have[-1] + 1)) - set(have))
        who = f"robot {robot}, session {session}"
        if missing:
            lines.append(f"{who}: part {', '.join(map(str, missing))} is missing")
        last = max(parts, key=lambda part: part.part)
        if not last.final:
            lines.append(f"{who}: the parts behind {os.path.basename(last.path)} are missing")
    return lines
