"""A part of a run as a file of its own, and several files as one.

Decides whether what is kept is still a run that can be replayed (everything up to some record, or all parts
joined) or a selection, which says so in its manifest. Bytes of messages are copied, never decoded.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path

from hippomat_core.errors import HippomatError
from hippomat_core.messages import Tick
from hippomat_logs.log_writer import LogWriter, writing
from hippomat_logs.mcap_file import RawRow
from hippomat_logs.opened_run import OpenedRun, manifest_of
from hippomat_logs.part import (
    CHANNELS_KEY,
    END_METADATA,
    MERGED_METADATA,
    RECOVERY_METADATA,
    RUN_METADATA,
)
from hippomat_logs.schema import CLASSES, LATCHED, TOPICS
from hippomat_logs.sources import FOREVER, McapSource, Source, merged

TICK = TOPICS[Tick]


@dataclass(frozen=True, slots=True)
class Selection:
    """What to keep. topics and exclude are patterns (* and ?); times are seconds since the run's start."""

    topics: tuple[str, ...] = ()  # none: all
    exclude: tuple[str, ...] = ()
    start_s: float = 0.0
    stop_s: float = float("inf")
    until: int = 0  # a record number: everything up to the end of its tick; 0: all

    def keeps(self, topic: str) -> bool:
        chosen = not self.topics or any(fnmatchcase(topic, pattern) for pattern in self.topics)
        return chosen and not any(fnmatchcase(topic, pattern) for pattern in self.exclude)

    def __str__(self) -> str:
        said = [f"topics {', '.join(self.topics)}"] if self.topics else []
        said += [f"without {', '.join(self.exclude)}"] if self.exclude else []
        if self.start_s or self.stop_s != float("inf"):
            said.append(f"seconds {self.start_s:g} to {self.stop_s:g}")
        said += [f"records to {self.until}"] if self.until else []
        return "; ".join(said) or "everything"


def write_selection(run: OpenedRun, selection: Selection, path: Path) -> int:
    """How many messages were kept. Raises HippomatError where none would be."""
    numbered = [topic for topic in CLASSES if topic in run.topics]
    replayable = not selection.start_s and selection.stop_s == float("inf")
    replayable = replayable and all(map(selection.keeps, numbered)) and bool(run.manifest)
    begun_ns, _ = run.span_ns
    start_ns = begun_ns + round(selection.start_s * 1e9) if selection.start_s else 0
    stop_ns = FOREVER if selection.stop_s == float("inf") else begun_ns + round(selection.stop_s * 1e9)
    with writing(path) as writer:
        if run.manifest:
            mark = {} if replayable else {"selection": str(selection)}
            _write_head(writer, run, mark)
        last = 0
        for source, row in _rows_of(run, selection, start_ns, stop_ns):
            topic = source.streams[row.channel].topic
            if selection.until and topic == TICK and row.sequence > selection.until:
                break  # here nothing is halfway: what was read is decided, and what was decided is written
            last = row.sequence if topic in CLASSES else last
            writer.write(source, row)
        if not writer.messages:
            raise HippomatError(
                f"{run.name}: nothing matches ({selection}); hippomat-logs info shows what there is"
            )
        if replayable:
            _write_end(writer, run, last, cut=bool(selection.until))
        writer.finish()
        return writer.messages


def join(runs: Sequence[OpenedRun], path: Path) -> int:
    """One file of several: parts of one run stay a run; several runs get a prefix each (/robot03/odom)."""
    if len(runs) == 1:
        return write_selection(runs[0], Selection(), path)
    names = prefixes(runs)
    owner = {id(source): name for run, name in zip(runs, names, strict=True) for source in run.sources}
    with writing(path) as writer:
        files = {
            name.strip("/"): ", ".join(source.path.name for source in run.sources)
            for run, name in zip(runs, names, strict=True)
        }
        writer.facts(MERGED_METADATA, files)
        for source, row in merged([source for run in runs for source in run.sources]):
            writer.write(source, row, owner[id(source)])
        writer.finish()
        return writer.messages


def prefixes(runs: Sequence[OpenedRun]) -> list[str]:
    """/robot03 for a robot of ours, /NAME for other files; a number behind what would be there twice."""
    made: list[str] = []
    for run in runs:
        plain = f"/robot{run.robot:02d}" if run.robot >= 0 else "/" + _topic_word(run.name)
        name, count = plain, 2
        while name in made:
            name, count = f"{plain}_{count}", count + 1
        made.append(name)
    return made


def _topic_word(name: str) -> str:
    """A file's name as a word that ROS takes in a topic."""
    word = "".join(letter if letter.isalnum() and letter.isascii() else "_" for letter in name)
    return word if word[:1].isalpha() else f"log_{word}"


def time_of_record(run: OpenedRun, number: int) -> float:
    """Seconds since the run's start; HippomatError where there is no such record."""
    for source in run.sources:
        numbered = [key for key, stream in source.streams.items() if stream.topic in CLASSES]
        for row in source.rows(numbered):
            if row.sequence == number:
                return (row.log_time_ns - run.span_ns[0]) / 1e9
    raise HippomatError(f"{run.name}: has no record {number}")


def _rows_of(
    run: OpenedRun, selection: Selection, start_ns: int, stop_ns: int
) -> Iterator[tuple[Source, RawRow]]:
    """Kept messages in the order of the parts, latched repetitions in later parts left out."""
    for index, source in enumerate(run.sources):
        kept: Collection[int] = [n for n, stream in source.streams.items() if selection.keeps(stream.topic)]
        first = int(manifest_of(source).get("first_record", "0")) if index else 0
        for row in source.rows(kept, start_ns, stop_ns):
            if row.sequence >= first or source.streams[row.channel].topic not in LATCHED:
                yield source, row


def _write_head(writer: LogWriter, run: OpenedRun, mark: dict[str, str]) -> None:
    recovered = any(manifest_of(source).get("recovered") for source in run.sources)
    facts = {**run.manifest, **mark, **({"recovered": "yes"} if recovered else {})}
    facts.pop(CHANNELS_KEY, None)  # channels are numbered anew
    writer.facts(RUN_METADATA, facts)
    for source in run.sources:
        if isinstance(source, McapSource) and source.file.attachments:
            for name in source.file.attachments:
                writer.attach(name, source.file.attachment(name))
            return


def _write_end(writer: LogWriter, run: OpenedRun, last: int, cut: bool) -> None:
    """The end mark of a run, or of its beginning; one whose end a crash took has none."""
    final = run.sources[-1]
    ends = final.file.metadata if isinstance(final, McapSource) else {}
    if cut:
        writer.facts(END_METADATA, {"last_record": str(last), "final": "yes"})
        return
    for name in (RECOVERY_METADATA, END_METADATA):
        if name in ends:
            writer.facts(name, ends[name])
