"""Open logs of ours: the records of one run as values, in order, after every check of level L0.

Decides what a whole, lossless log is. Knows parts, record numbers and drop records; refuses what another
version recorded with other definitions.
"""

from __future__ import annotations

import contextlib
import mmap
import struct
import zlib
from collections.abc import Collection, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cache
from itertools import chain
from pathlib import Path
from typing import Any, NamedTuple

from hippomat_core.allocation.policy_file import read_policy
from hippomat_core.config import Config
from hippomat_core.errors import ConfigError, HippomatError, LogError
from hippomat_logs.cdr_encoder import ENCAPSULATION
from hippomat_logs.copies import each_part_once
from hippomat_logs.file_kinds import each_once, refuse_foreign, refuse_selection
from hippomat_logs.losses import Losses
from hippomat_logs.manifest import config_of
from hippomat_logs.part import ChannelSpec
from hippomat_logs.records import DropRecord, SerialRecord
from hippomat_logs.schema import CLASSES, DERIVED, TOPICS, MessageStore, type_name
from hippomat_logs.sink import ACTIVE
from hippomat_logs.strict_walk import fused_runs, walk_strictly
from hippomat_logs.walk import Contents, Inside, RawMessage, counted_inside

DROPPED = TOPICS[DropRecord]
_SERIAL = TOPICS[SerialRecord]
_SERIAL_HEAD = struct.Struct("<4x 11x x I I")  # encapsulation; stamp, port, direction, phase; crc32, length
NAME_KEY = "name"  # in the manifest of a run in a fused file: what its own files were called
CLIP_KEY = "clip"  # of the manifest: what the run was cut out of, and why
COMPARED_FROM_KEY = "compared_from"  # a clip's first record whose effects were kept


class Record(NamedTuple):
    """One numbered record of a run."""

    number: int
    log_time_ns: int
    topic: str
    message: Any


@contextmanager
def mapped(path: Path) -> Iterator[memoryview]:
    """The bytes of a file without reading it whole."""
    try:
        file = path.open("rb")
    except OSError as error:
        raise HippomatError(f"{path}: cannot be opened: {error.strerror}") from None
    with file:
        if path.stat().st_size == 0:
            raise LogError(f"{path}: is empty; nothing was recorded in it")
        map_ = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
        try:
            yield memoryview(map_)
        finally:
            with contextlib.suppress(BufferError):  # slices of it that are left over go with the last of them
                map_.close()


def read_raw(path: Path, contents: Contents, inside: Inside | None = None) -> Iterator[RawMessage]:
    """Messages of one finished part as bytes, strictly checked. inside: see walk_strictly."""
    return chain.from_iterable(_batches(path, contents, inside))


def _batches(path: Path, contents: Contents, inside: Inside | None) -> Iterator[list[RawMessage]]:
    if path.name.endswith(ACTIVE):
        raise LogError(f"{path}: still being recorded, or its daemon died: `hippomat-logs recover {path}`")
    with mapped(path) as data:
        try:
            yield from walk_strictly(data, str(path), contents, inside)
        except LogError as error:
            raise error if str(path) in str(error) else LogError(f"{path}: {error}") from None


@cache
def reading_store() -> MessageStore:
    """One store for all that this process reads."""
    return MessageStore()


@dataclass(slots=True)
class Run:
    """The parts of one robot's run, in order, and what L0 found out about them."""

    paths: tuple[Path, ...]
    manifest: dict[str, str]
    policy: bytes = b""  # the weights that decided, as safetensors; empty where the allocator has none
    lost: list[str] = field(default_factory=list)  # one line per explained loss
    records: int = 0
    views: int = 0  # messages on standard topics that were passed over
    recovered: bool = False  # its end is missing
    inside: str = ""  # of a fused file: the prefix of this run's topics
    store: MessageStore = field(default_factory=reading_store)

    @property
    def name(self) -> str:
        if self.inside:
            return self.manifest.get(NAME_KEY, self.inside.strip("/"))
        return (
            self.paths[0].name.removesuffix(".mcap").rsplit("_", 1)[0]
            if self.manifest
            else str(self.paths[0])
        )

    @property
    def robot(self) -> int:
        return int(self.manifest.get("robot", "-1"))

    @property
    def clip(self) -> str:
        """What this log was cut out of to show a divergence; empty: it is a whole run."""
        return self.manifest.get(CLIP_KEY, "")

    @property
    def compared_from(self) -> int:
        """The first record whose effects are in the log: all but a clip have them from 0 on."""
        return int(self.manifest.get(COMPARED_FROM_KEY, "0"))

    @property
    def config(self) -> Config:
        return config_of(self.manifest, str(self.paths[0]))

    @property
    def weights_lost(self) -> bool:
        """The manifest names weights that decided, and no part holds them any more."""
        return not self.policy and bool(self.manifest.get("policy_hash"))

    @property
    def wall_offset_ns(self) -> int:
        return int(self.manifest["wall_offset_ns"])

    def records_in_order(self, kinds: Collection[type] = ()) -> Iterator[Record]:
        """Every numbered record, checked as it is read. Counts and losses are complete at the end.

        kinds: give out (and decode) only records of these classes; a checked log is read faster that way.
        """
        wanted = {TOPICS[kind] for kind in kinds} if kinds else CLASSES
        for path, raw in self.raw_in_order():
            if raw.topic in wanted:
                yield self.decoded(path, raw)

    def raw_in_order(self) -> Iterator[tuple[Path, RawMessage]]:
        """The same before anything is decoded, with the part that holds it."""
        self.records, self.views, expected = 0, 0, 1
        self.lost, losses = [], Losses()
        for index, path in enumerate(self.paths):
            contents = Contents(inside=self.inside)
            for raw in read_raw(path, contents):
                number, topic = raw.number, raw.topic
                if topic in DERIVED:
                    self.views += 1
                    continue
                drop = self.decoded(path, raw).message if topic == DROPPED else None
                first = drop.first if drop else number
                if topic not in CLASSES:
                    class_of(path, raw)  # raises
                if first != expected:
                    raise LogError(f"{path}: record {expected} is missing: {_gap(expected, first)}")
                if drop:
                    losses.add(drop)
                    self.lost = losses.lines()
                expected = number + 1
                self.records += 1
                yield path, raw
            self._check_end(path, contents, expected, index == len(self.paths) - 1)

    def raw_messages(self, topics: Collection[str]) -> Iterator[RawMessage]:
        """Messages on these topics as bytes, checksums checked; whether all are there is not."""
        for path in self.paths:
            for raw in read_raw(path, Contents(inside=self.inside)):
                if raw.topic in topics:
                    yield raw

    def decoded(self, path: Path, raw: RawMessage) -> Record:
        """One message as a value; raises LogError where it does not decode or its bytes have changed."""
        kind = CLASSES.get(raw.topic) or class_of(path, raw)
        try:
            message = self.store.decode(kind, raw.data)
        except Exception as error:
            raise LogError(f"{path}: record {raw.number} on {raw.topic} cannot be decoded: {error}") from None
        if isinstance(message, SerialRecord) and zlib.crc32(message.data) != message.crc32:
            raise LogError(
                f"{path}: record {raw.number}: serial bytes do not match the checksum taken with them"
            )
        return Record(raw.number, raw.log_time_ns, raw.topic, message)

    def check(self, path: Path, raw: RawMessage) -> None:
        """The same checks for a record that nobody needs: half of a log is serial bytes."""
        if raw.topic == _SERIAL and len(raw.data) >= _SERIAL_HEAD.size:
            crc32, length = _SERIAL_HEAD.unpack_from(raw.data)
            data = raw.data[_SERIAL_HEAD.size :]
            if len(data) == length and zlib.crc32(data) == crc32 and raw.data[:2] == ENCAPSULATION[:2]:
                return
        self.decoded(path, raw)

    def _check_end(self, path: Path, contents: Contents, expected: int, is_last: bool) -> None:
        if not contents.end:
            if not contents.manifest.get("recovered"):
                raise LogError(f"{path}: has no end mark, and no recovery accounts for it")
            self.recovered = self.recovered or is_last
            return
        last, final = int(contents.end["last_record"]), contents.end["final"] == "yes"
        if last != expected - 1:
            raise LogError(f"{path}: ends at record {expected - 1}, but record {last} was written")
        if is_last and not final:
            raise LogError(f"{path}: is not the last part of its run: give the later parts too")


def class_of(path: Path, raw: RawMessage) -> type:
    """What a numbered record is; LogError for a topic of another version."""
    kind = CLASSES.get(raw.topic)
    if kind is None:
        raise LogError(f"{path}: record {raw.number} is on {raw.topic}, which this version does not know")
    return kind


def _gap(expected: int, found: int) -> str:
    if expected == 1:
        return f"the first is {found}; give the earlier parts of this run too"
    return f"behind {expected - 1} comes {found}, and no drop record explains it"


def open_runs(paths: Sequence[Path]) -> list[Run]:
    """Group files into runs (one per robot and session), parts in order.

    A run that is there both as its own files and in a fused one is given once, as its own files.
    """
    files = each_once(_expanded(paths))
    for path in files:
        refuse_foreign(path)
    return _opened([(path, inside) for path in files for inside in runs_inside(path) or ("",)])


def open_again(paths: Sequence[Path], inside: str) -> Run:
    """The one run that Run.paths and Run.inside name, e.g. in another process."""
    (run,) = _opened([(path, inside) for path in paths])
    return run


def _opened(places: Sequence[tuple[Path, str]]) -> list[Run]:
    """The runs at these places: files, and which run inside a fused one."""
    groups: dict[tuple[str, str, str], list[tuple[int, Path, tuple[Contents, int]]]] = {}
    store = reading_store()
    for path, inside in dict.fromkeys(places):
        contents, messages = read_contents(path, store, inside)
        manifest = contents.manifest
        whole = str(path) if inside else ""  # a run in a fused file has no further parts
        session = manifest.get("session_id", "") + manifest.get(CLIP_KEY, "")  # a clip is no part of its run
        key = manifest.get("robot", ""), session, whole
        groups.setdefault(key, []).append((int(manifest.get("part", "0")), path, (contents, messages)))
    runs = []
    known: set[tuple[str, ...]] = set()
    for key in sorted(groups, key=lambda one: bool(one[2])):  # own files first
        if key[2] and key[:2] in known:
            continue
        known.add(key[:2])
        parts = list(each_part_once(groups[key]))
        paths_in_order = tuple(path for _, path, _ in parts)
        contents_in_order = [contents for *_, (contents, _) in parts]
        total, first = sum(messages for *_, (_, messages) in parts), contents_in_order[0]
        policy = next((contents.policy for contents in contents_in_order if contents.policy), b"")
        run = Run(paths_in_order, first.manifest, policy, records=total, store=store, inside=first.inside)
        last = contents_in_order[-1]
        run.recovered = not last.end and bool(last.manifest.get("recovered"))
        runs.append(run)
    return sorted(runs, key=lambda run: (run.robot, run.manifest.get("started_ns", "")))


def runs_inside(path: Path) -> tuple[str, ...]:
    """The prefixes of the runs in a fused file; none in any other."""
    with mapped(path) as data:
        return fused_runs(data)


def _expanded(paths: Sequence[Path]) -> Iterator[Path]:
    for path in paths:
        if not path.is_dir():
            yield path
            continue
        found = sorted(path.rglob("*.mcap"))
        if not found and next(path.rglob(f"*{ACTIVE}"), None) is not None:
            raise LogError(f"{path}: holds unfinished logs only: `hippomat-logs recover {path}`")
        if not found:
            raise HippomatError(f"{path}: holds no .mcap file; give a robot's log or a directory of them")
        yield from found


def read_contents(path: Path, store: MessageStore, inside: str = "") -> tuple[Contents, int]:
    """What a part holds beside its records, and how many those are.

    After a check of all its bytes, of its message definitions, and that the policy is the manifest's.
    """
    contents = Contents(inside=inside)
    for _ in read_raw(path, contents, counted_inside):
        pass
    channels = contents.channels
    records = sum(
        n for key, n in contents.counts.items() if key in channels and channels[key].topic in CLASSES
    )
    refuse_selection(path, contents.manifest)
    for channel in contents.channels.values():
        if not is_as_here(channel, store):
            raise HippomatError(
                f"{path}: {channel.type_name} has other fields in this log, recorded by hippomat "
                f"{contents.manifest.get('hippomat', '?')}: read it with that version"
            )
    _check_policy(path, contents)
    return contents, records


def is_as_here(channel: ChannelSpec, store: MessageStore) -> bool:
    """Are its records what this version would have written? What it does not know is no record of a run."""
    if channel.topic not in CLASSES:
        return True
    name = type_name(CLASSES[channel.topic])
    return (channel.type_name, channel.definition) == (name, store.schema_text(name))


def _check_policy(path: Path, contents: Contents) -> None:
    """A recovered part may have lost its weights; the other parts of the run have them too."""
    try:
        found = read_policy(contents.policy).hash if contents.policy else ""
    except ConfigError as error:
        raise LogError(f"{path}: the weights in it cannot be used: {error}") from None
    lost = not found and contents.manifest.get("recovered")
    if not lost and found != contents.manifest.get("policy_hash", ""):
        raise LogError(f"{path}: holds another policy than its manifest names, or none")


def read_records(path: Path | str) -> Iterator[tuple[int, int, str, Any]]:
    """(record number, log time [ns], topic, message) of every numbered record of one part."""
    contents, run = Contents(), Run((Path(path),), {})
    for raw in read_raw(Path(path), contents):
        if raw.topic not in DERIVED:
            yield run.decoded(Path(path), raw)
