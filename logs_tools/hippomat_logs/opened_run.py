"""`open_run(path)`: a run as lazily read, typed tables, one per topic; several parts of a run are one.

Decides what belongs together. Any log will do: ours, anybody's .mcap, a ROS 1 or ROS 2 bag. Every checksum is
checked as its chunk is read; whether a run is complete is `hippomat-logs doctor`'s question.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from hippomat_core.errors import HippomatError, LogError
from hippomat_logs.column_table import Table, table_of
from hippomat_logs.copies import each_part_once
from hippomat_logs.file_kinds import LOG_SUFFIXES, each_once, refuse_missing
from hippomat_logs.mcap_file import RawRow
from hippomat_logs.part import RUN_METADATA
from hippomat_logs.reader import NAME_KEY
from hippomat_logs.schema import LATCHED
from hippomat_logs.sink import ACTIVE
from hippomat_logs.sources import FOREVER, FusedSource, McapSource, Source, Stream, opened_sources

BATCH_ROWS = 50_000


@dataclass(frozen=True, slots=True)
class Topic:
    """What a run says on one topic. count: None where its files do not say before they are read."""

    name: str
    type_name: str
    count: int | None
    definition: str


class OpenedRun:
    """run["/odom"] is a Table; run.topics says what there is; batches() are for what memory cannot hold."""

    def __init__(self, sources: Sequence[Source]) -> None:
        """sources: the parts of one run, in their order."""
        self.sources = tuple(sources)
        self.manifest = manifest_of(self.sources[0])
        self.left_out: dict[str, str] = {}  # topic -> why it cannot be read
        self.topics: dict[str, Topic] = {}
        for source in self.sources:
            self.left_out.update(source.left_out)
            for stream in source.streams.values():
                self._add(stream)

    def _add(self, stream: Stream) -> None:
        known = self.topics.get(stream.topic)
        if known and known.definition != stream.definition:
            self.left_out[stream.topic] = "has different definitions in one run"
            return
        count = stream.count
        if known is not None:
            count = None if count is None or known.count is None else known.count + count
        self.topics[stream.topic] = Topic(stream.topic, stream.type_name, count, stream.definition)

    @property
    def name(self) -> str:
        if isinstance(self.sources[0], FusedSource):
            return self.manifest.get(NAME_KEY, self.sources[0].inside.strip("/"))
        first = self.sources[0].path.name.removesuffix(".mcap")
        return first.rsplit("_", 1)[0] if self.manifest else first

    @property
    def robot(self) -> int:
        """Its id; -1 for an observer, and for what no robot of ours recorded."""
        return int(self.manifest.get("robot", "-1"))

    @property
    def span_ns(self) -> tuple[int, int]:
        """Log times of the first and the last message; equal where there are none."""
        spans = [source.span_ns for source in self.sources if source.span_ns != (0, 0)]
        return (min(a for a, _ in spans), max(b for _, b in spans)) if spans else (0, 0)

    def __getitem__(self, topic: str) -> Table:
        return self.table(topic)

    def table(self, topic: str, start_s: float = 0.0, stop_s: float = float("inf")) -> Table:
        """All messages of a topic; seconds since the run's first message bound it."""
        rows = list(self._rows(topic, *self._limits(start_s, stop_s)))
        return _as_table(topic, self._stream(topic), rows)

    def batches(
        self, topic: str, rows: int = BATCH_ROWS, start_s: float = 0.0, stop_s: float = float("inf")
    ) -> Iterator[Table]:
        """The same in tables of at most `rows` messages, in bounded memory."""
        held: list[RawRow] = []
        for row in self._rows(topic, *self._limits(start_s, stop_s)):
            held.append(row)
            if len(held) == rows:
                yield _as_table(topic, self._stream(topic), held)
                held = []
        if held:
            yield _as_table(topic, self._stream(topic), held)

    def tables(self, topics: Iterable[str] | None = None) -> dict[str, Table]:
        """Several topics, or all, in one pass over the files."""
        wanted = set(self.topics if topics is None else topics)
        held: dict[str, list[RawRow]] = {topic: [] for topic in wanted}
        for topic in wanted:
            self._stream(topic)
        for source, first in self._parts():
            names = {number: s.topic for number, s in source.streams.items() if s.topic in wanted}
            latched = {number for number, topic in names.items() if topic in LATCHED}
            sinks = {number: held[topic].append for number, topic in names.items()}
            for row in source.rows(names):
                if row.channel in latched and row.sequence < first:
                    continue
                sinks[row.channel](row)
        return {topic: _as_table(topic, self._stream(topic), rows) for topic, rows in held.items()}

    def _rows(self, topic: str, start_ns: int, end_ns: int) -> Iterator[RawRow]:
        self._stream(topic)
        for source, first in self._parts():
            numbers = [number for number, stream in source.streams.items() if stream.topic == topic]
            for row in source.rows(numbers, start_ns, end_ns):
                if topic not in LATCHED or row.sequence >= first:
                    yield row

    def _parts(self) -> Iterator[tuple[Source, int]]:
        """Sources, and the first record of each that is not a repeated latched message."""
        for index, source in enumerate(self.sources):
            first = manifest_of(source).get("first_record", "0") if index else "0"
            yield source, int(first)

    def _stream(self, topic: str) -> Stream:
        if topic in self.left_out:
            raise LogError(f"{self.sources[0].path}: channel {topic}: {self.left_out[topic]}")
        for source in self.sources:
            for stream in source.streams.values():
                if stream.topic == topic:
                    return stream
        raise HippomatError(
            f"{self.sources[0].path}: has no topic {topic!r}; it has {', '.join(sorted(self.topics))}"
        )

    def _limits(self, start_s: float, stop_s: float) -> tuple[int, int]:
        begun_ns, _ = self.span_ns
        end_ns = FOREVER if stop_s == float("inf") else begun_ns + round(stop_s * 1e9)
        return begun_ns + round(start_s * 1e9) if start_s else 0, end_ns


def _as_table(topic: str, stream: Stream, rows: Sequence[RawRow]) -> Table:
    times, numbers = [row.log_time_ns for row in rows], [row.sequence for row in rows]
    try:
        return table_of(topic, stream.fields, times, numbers, [row.data for row in rows])
    except LogError as error:
        raise LogError(f"channel {topic}: {error}") from None


def manifest_of(source: Source) -> dict[str, str]:
    """What our recorder says of the run; empty for anybody else's file."""
    return source.file.metadata.get(RUN_METADATA, {}) if isinstance(source, McapSource) else {}


def open_run(paths: Path | str | Sequence[Path | str]) -> OpenedRun:
    """The one run in a file, a directory, or several parts.

    Raises HippomatError where there is none or more than one, LogError where a file is damaged.
    """
    runs = group_runs(paths)
    if len(runs) != 1:
        names = ", ".join(run.name for run in runs[:6])
        raise HippomatError(f"{paths}: holds {len(runs)} runs ({names}): name one, or use group_runs()")
    return runs[0]


def group_runs(paths: Path | str | Sequence[Path | str]) -> list[OpenedRun]:
    """All runs in these files and directories: our parts by robot and session, any other file alone."""
    given = [paths] if isinstance(paths, (str, Path)) else paths
    files = distinct_logs([Path(one) for one in given])
    return group_opened([source for path in files for source in opened_sources(path)])


def group_opened(opened: Iterable[Source]) -> list[OpenedRun]:
    """The same of sources that are open."""
    groups: dict[tuple[str, ...], list[Source]] = {}
    for source in opened:
        manifest = manifest_of(source)
        session = manifest.get("session_id")
        key = (manifest.get("robot", ""), session) if session else (str(source.path),)
        if isinstance(source, FusedSource):  # whole, even where its own parts are given too
            key = *key, str(source.path)
        groups.setdefault(key, []).append(source)
    for sources in groups.values():
        parts = [(int(manifest_of(source).get("part", "0")), source.path, source) for source in sources]
        sources[:] = [source for *_, source in each_part_once(parts)]
    own = {key for key in groups if len(key) == 2}
    runs = [OpenedRun(sources) for key, sources in groups.items() if len(key) < 3 or key[:2] not in own]
    return sorted(runs, key=lambda run: (run.robot, run.span_ns, run.name))


def distinct_logs(paths: Iterable[Path]) -> list[Path]:
    """All logs in these files and directories, each once."""
    return each_once(file for path in paths for file in log_files(path))


def log_files(path: Path) -> Iterator[Path]:
    """The logs in a directory, however deep, each ROS 2 bag's directory as one; or the file itself.

    HippomatError where there is none.
    """
    refuse_missing(path)
    if not path.is_dir() or (path / "metadata.yaml").exists():
        yield path
        return
    found = False
    bags = {one.parent for one in path.rglob("metadata.yaml")}
    yield from sorted(bags)
    for file in sorted(file for suffix in LOG_SUFFIXES for file in path.rglob(f"*{suffix}")):
        if file.parent not in bags:
            found = True
            yield file
    if not found and not bags:
        if next(path.rglob(f"*{ACTIVE}"), None) is not None:
            raise LogError(f"{path}: holds unfinished logs only: `hippomat-logs recover {path}`")
        raise HippomatError(f"{path}: holds no log (.mcap, .bag, .db3); give a log or a directory of logs")
