"""A log with valid checksums and other contents, as any MCAP tool could write it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from hippomat_logs.new_log import NewRecord, write_log
from hippomat_logs.reader import open_runs
from hippomat_logs.redecide import attachments_of
from hippomat_logs.schema import TOPICS


def change_log(source: Path, target: Path, change: Callable[[int, Any], Any]) -> None:
    """change(record number, message): the message to write instead, None: none."""
    (run,) = open_runs([source])
    records = []
    for record in run.records_in_order():
        changed = change(record.number, record.message)
        if changed is not None:
            data = run.store.encode(changed)
            records.append(NewRecord(record.log_time_ns, TOPICS[type(changed)], data))
    write_log(target, run.manifest, attachments_of(run), records, run.store)
