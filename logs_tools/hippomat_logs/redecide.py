"""What the core of today makes of the events of an old run: the same log with other effects.

Decides which records a run needs to be replayed: events, effects and the bytes on the ports. What only tells
of that one moment on that one machine (times of the loop, views for other tools) is left out.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

from hippomat_core.step import initial_state, step
from hippomat_logs.manifest import core_hash, fingerprint
from hippomat_logs.new_log import NewRecord, write_log
from hippomat_logs.part import POLICY_ATTACHMENT, package_version
from hippomat_logs.reader import Run
from hippomat_logs.records import SerialRecord
from hippomat_logs.schema import EFFECT_TOPICS, EVENT_TOPICS, TOPICS

NEEDED = EVENT_TOPICS | EFFECT_TOPICS | {TOPICS[SerialRecord]}


def write_condensed(run: Run, path: Path) -> int:
    """`run` as recorded, without what a replay does not need; the number of records."""
    records = (
        NewRecord(raw.log_time_ns, raw.topic, raw.data)
        for _, raw in run.raw_in_order()
        if raw.topic in NEEDED
    )
    return write_log(path, run.manifest, attachments_of(run), records, run.store)


def write_redecided(run: Run, path: Path) -> int:
    """The same with the effects that this version of the core computes on this machine."""
    manifest = {
        **run.manifest,
        "hippomat": package_version(),
        "core_hash": core_hash(),
        "fingerprint": json.dumps(fingerprint(), sort_keys=True),
    }
    return write_log(path, manifest, attachments_of(run), redecided(run), run.store)


def redecided(run: Run) -> Iterator[NewRecord]:
    """Recorded events, each with its effects of today behind it, and the recorded bytes on the ports."""
    state = initial_state(run.config, run.policy or None)
    for path, raw in run.raw_in_order():
        if raw.topic not in NEEDED or raw.topic in EFFECT_TOPICS:
            continue
        yield NewRecord(raw.log_time_ns, raw.topic, raw.data)
        if raw.topic in EVENT_TOPICS:
            state, effects = step(state, run.decoded(path, raw).message)
            for effect in effects:
                yield NewRecord(raw.log_time_ns, TOPICS[type(effect)], run.store.encode(effect))


def attachments_of(run: Run) -> dict[str, bytes]:
    return {POLICY_ATTACHMENT: run.policy} if run.policy else {}
