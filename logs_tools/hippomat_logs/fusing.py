"""Several robots' logs as one file: every record once, in causal order, at common time.

Decides topics and frames. A run's records are under its prefix (/robot03/hippo/...) with their own numbers; a
message's publish time is its own log time, so that each run can be read back as it was (reader.open_runs).
The standard topics are drawn anew at common time: all robots share one map, one /tf and one /rosout, their
frames carry their names. Each run is checked as a replay checks it.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from itertools import islice
from pathlib import Path

import numpy as np

from hippomat_core.errors import HippomatError
from hippomat_logs.alignment import Alignment
from hippomat_logs.alignment_report import as_json
from hippomat_logs.causal_order import Held, Placed, Stamped, causes_of, in_causal_order
from hippomat_logs.derived import DerivedTopics
from hippomat_logs.log_writer import LogWriter, writing
from hippomat_logs.part import (
    CHANNELS_KEY,
    END_METADATA,
    FUSED_METADATA,
    RECOVERY_METADATA,
    RUN_METADATA,
    SPAN_METADATA,
    our_channels,
)
from hippomat_logs.reader import NAME_KEY, Run, read_raw
from hippomat_logs.schema import CLASSES, DERIVED
from hippomat_logs.walk import Contents, RawMessage, counted_inside

ALIGNMENT_ATTACHMENT = "alignment.json"
BATCH = 2000  # records whose common times are computed at once
MAP_CONTENT_AT = 16  # of a MapReceived's bytes: behind its stamp and its epoch
SHARED = ("/tf", "/tf_static", "/rosout")  # topics that all robots write; /map: whoever has that map first
Numbered = tuple[Path, RawMessage]


def fuse(
    runs: Sequence[Run], alignment: Alignment, path: Path, progress: Callable[[int], None] = lambda _: None
) -> Held:
    """Write `path`; progress gets the number of records so far. What had to be held back for its cause.

    Raises LogError for a damaged run, HippomatError where `path` exists.
    """
    runs = alignment.in_order(runs)
    names, held = prefixes(runs), Held()
    with writing(path) as writer:
        writer.facts(FUSED_METADATA, {"runs": " ".join(names), "reference": alignment.reference})
        writer.attach(ALIGNMENT_ATTACHMENT, json.dumps(as_json(alignment), indent=1).encode())
        ends = [_write_head(writer, run, name) for run, name in zip(runs, names, strict=True)]
        feeds = [_stamped(run, alignment) for run in runs]
        placing = _Placing(writer, runs, names)
        for placed in in_causal_order(feeds, causes_of(alignment.links, len(runs)), held):
            placing.write(placed)
            if writer.messages % BATCH == 0:
                progress(placing.records)
        for name, marks, span_ns in zip(names, ends, placing.spans_ns, strict=True):
            for kind, facts in marks.items():
                writer.facts(kind + name, facts)
            writer.facts(SPAN_METADATA + name, {"first_ns": str(span_ns[0]), "last_ns": str(span_ns[1])})
        writer.finish()
    return held


def prefixes(runs: Sequence[Run]) -> list[str]:
    """/robot03, /observer; a number behind what would be there twice."""
    made: list[str] = []
    for run in runs:
        plain = f"/robot{run.robot:02d}" if run.robot >= 0 else "/observer"
        name, count = plain, 2
        while name in made:
            name, count = f"{plain}_{count}", count + 1
        made.append(name)
    return made


def _write_head(writer: LogWriter, run: Run, name: str) -> dict[str, dict[str, str]]:
    """Manifest and attachments; the marks that the run shall end with, by their names."""
    parts = [_facts(path, run.inside) for path in run.paths]
    last = parts[-1]
    manifest = {**run.manifest, NAME_KEY: run.name}
    manifest.pop(CHANNELS_KEY, None)
    if not last.end:
        manifest["recovered"] = "yes"
    writer.facts(RUN_METADATA + name, manifest)
    attachments = {key: data for part in reversed(parts) for key, data in part.attachments.items()}
    for key, data in attachments.items():
        writer.attach(f"{name.strip('/')}/{key}", data)
    marks = {RECOVERY_METADATA: last.recovery, END_METADATA: last.end}
    return {kind: facts for kind, facts in marks.items() if facts}


def _facts(path: Path, inside: str) -> Contents:
    """What a part says beside its messages."""
    contents = Contents(inside=inside)
    for _ in read_raw(path, contents, counted_inside):
        pass
    return contents


def _stamped(run: Run, alignment: Alignment) -> Iterator[Stamped[Numbered]]:
    map_, records = alignment.map_of(run), run.raw_in_order()
    while batch := list(islice(records, BATCH)):
        own_ns = np.array([raw.log_time_ns for _, raw in batch], np.int64)
        for (path, raw), common_ns in zip(batch, map_(own_ns).tolist(), strict=True):
            if common_ns < 0:
                raise HippomatError(
                    f"{run.name}: common time would begin before 1970, which MCAP cannot say: "
                    "name another --reference"
                )
            yield Stamped(raw.number, common_ns, (path, raw))


class _Placing:
    """Records and what is drawn of them go to their channels."""

    def __init__(self, writer: LogWriter, runs: Sequence[Run], names: Sequence[str]) -> None:
        self._writer, self._runs, self._names = writer, runs, names
        self._specs = {spec.topic: spec for spec in our_channels(runs[0].store)}
        self._channels: dict[str, int] = {}
        self._views = [
            DerivedTopics(run.store, run.config, name.strip("/") + "/")
            for run, name in zip(runs, names, strict=True)
        ]
        self.spans_ns = [(0, 0)] * len(runs)  # own log times
        self._begun: set[int] = set()
        self._map = b""  # of whoever had one first: shared
        self.records = 0

    def write(self, placed: Placed[Numbered]) -> None:
        run, at_ns, (number, _, (path, raw)) = placed
        if run not in self._begun:
            self._begun.add(run)
            self.spans_ns[run] = raw.log_time_ns, raw.log_time_ns
            for topic, data in self._views[run].static():
                self._add(run, topic, number, at_ns, raw.log_time_ns, data)
        self.spans_ns[run] = self.spans_ns[run][0], max(raw.log_time_ns, self.spans_ns[run][1])
        channel = self._channel(raw.topic, self._names[run] + raw.topic)
        self._writer.add(channel, number, at_ns, raw.log_time_ns, raw.data)
        self.records += 1
        if CLASSES[raw.topic] in self._views[run].kinds:
            message = self._runs[run].decoded(path, raw).message
            for topic, data in self._views[run].of(message, at_ns):
                if topic != "/map" or not self._has_map(raw):
                    self._add(run, topic, number, at_ns, raw.log_time_ns, data)

    def _has_map(self, raw: RawMessage) -> bool:
        """Has the shared map come already? Another one is shown under its robot's name."""
        content = raw.data[MAP_CONTENT_AT:]
        known, self._map = self._map == content, self._map or content
        return known

    def _add(self, run: int, topic: str, number: int, at_ns: int, own_ns: int, data: bytes) -> None:
        shared = topic in SHARED or (topic == "/map" and "/map" not in self._channels)
        name = topic if shared else self._names[run] + topic
        self._writer.add(self._channel(topic, name), number, at_ns, own_ns, data)

    def _channel(self, topic: str, name: str) -> int:
        if name not in self._channels:
            self._channels[name] = self._writer.channel(self._specs[topic], name)
        return self._channels[name]


assert set(SHARED) < set(DERIVED)
