"""What the facts in a log's metadata must be, so that whoever reads them may take them for numbers.

A checksum says that they are what was written, not that a log of ours was. Knows names of facts, no files.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping

from hippomat_core.errors import LogError
from hippomat_logs.part import END_METADATA, RUN_METADATA, SPAN_METADATA

MAX_PARTS = 1_000_000  # whoever looks for missing parts counts up to the last
_INT64 = range(-(1 << 63), 1 << 63)
_RECORDS = range(1 << 32)
_NUMBERS: dict[str, dict[str, range]] = {
    RUN_METADATA: {
        "robot": range(-1, 1 << 16),
        "part": range(MAX_PARTS),
        "first_record": range(1, 1 << 32),
        "compared_from": _RECORDS,
        "started_ns": _INT64,
        "wall_offset_ns": _INT64,
    },
    END_METADATA: {"last_record": _RECORDS, "worst_sync_ms": _INT64},
    SPAN_METADATA: {"first_ns": _INT64, "last_ns": _INT64},
}
_REQUIRED = {RUN_METADATA: ("wall_offset_ns",), END_METADATA: ("last_record", "final")}
_INTEGER = re.compile(r"-?[0-9]{1,19}")  # as we write them; int() takes more: spaces, other scripts' digits


def check_facts(name: str, facts: Mapping[str, str]) -> None:
    """LogError naming the fact. name: of the metadata, in a fused file with its run's prefix behind it."""
    kind = name.partition("/")[0]
    for key in _REQUIRED.get(kind, ()):
        if key not in facts:
            raise LogError(f"metadata {name} lacks {key}, which every log of ours has")
    for key, allowed in _NUMBERS.get(kind, {}).items():
        text = facts.get(key, str(allowed.start))
        if not _INTEGER.fullmatch(text) or int(text) not in allowed:
            raise LogError(
                f"metadata {name}: {key} is {text[:40]!r}, not a number from {allowed[0]} to {allowed[-1]}"
            )
    if kind == END_METADATA and facts["final"] not in ("yes", "no"):
        raise LogError(f"metadata {name}: final is {facts['final'][:40]!r}, neither yes nor no")
    if kind == RUN_METADATA:
        object_of(facts.get("config", "{}"), f"metadata {name}: config")


def object_of(text: str, what: str) -> dict[str, object]:
    """A JSON object; `what` it is, for the error."""
    try:
        found = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise LogError(f"{what} is no JSON: {error}") from None
    if not isinstance(found, dict):
        raise LogError(f"{what} is {text[:40]!r}, no JSON object")
    return found
