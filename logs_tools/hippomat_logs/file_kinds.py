"""What a path is, by its bytes and not by its name: one rule for what no command, or not this one, can use.

What is missing, no log, or no log of ours (or only a selection of one) where a robot's own records are
needed is a usage error: HippomatError, exit code 1. A log that is damaged is a LogError, exit code 3, of
whoever reads it. Knows heads and tails of files.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from enum import Enum
from pathlib import Path

from hippomat_core.errors import HippomatError
from hippomat_logs.mcap_writer import MAGIC
from hippomat_logs.part import END_METADATA, FUSED_METADATA, MERGED_METADATA, RUN_METADATA
from hippomat_logs.sink import ACTIVE

LOG_SUFFIXES = (".mcap", ".bag", ".db3")
LOOK_BYTES = 1 << 16  # at either end
_TEXT_BYTES = 512
_HEADER_BYTES = 64  # MCAP's magic bytes and its first record, which names the library that wrote the file
_MAGIC_ENOUGH = 4  # bytes of the magic that a file cut within it must hold: 0x89 alone begins many a file
_OURS = tuple(name.encode() for name in (RUN_METADATA, FUSED_METADATA, END_METADATA))
_TAKE_IT = "`hippomat-logs info`, plot, export and convert take it"


class SelectionError(HippomatError):
    """A selection (`hippomat-logs filter`) where a whole run is needed. Nothing in it is damaged."""


class Kind(Enum):
    """What the bytes say; the value is for people."""

    OURS = "the log of a hippomat daemon"  # or several, fused; damaged or not
    MERGED = "several logs merged for viewers"
    MCAP = "an .mcap that something else wrote"
    BAG = "a ROS 1 bag"
    DB3 = "the database of a ROS 2 bag"
    ROS2_BAG = "the directory of a ROS 2 bag"
    EMPTY = "an empty file"
    TEXT = "a text file"
    OTHER = "a file of unknown kind"


_LOGS = (Kind.OURS, Kind.MERGED, Kind.MCAP, Kind.BAG, Kind.DB3, Kind.ROS2_BAG)


def kind_of(path: Path) -> Kind:
    """Raises HippomatError for what cannot be looked into, and for a directory that is no log itself."""
    if path.is_dir():
        if (path / "metadata.yaml").exists():
            return Kind.ROS2_BAG
        raise HippomatError(f"{path}: is a directory and no ROS 2 bag (it has no metadata.yaml); give a file")
    refuse_missing(path)
    if not path.is_file():
        raise HippomatError(
            f"{path}: is no file but a pipe or a device; a log is read here and there: copy it"
        )
    try:
        with path.open("rb") as file:
            head = file.read(LOOK_BYTES)
            file.seek(max(0, path.stat().st_size - LOOK_BYTES))
            tail = file.read()
    except OSError as error:
        raise HippomatError(f"{path}: cannot be opened: {error.strerror}") from None
    return _kind_of_bytes(head, tail, path.name)


def _kind_of_bytes(head: bytes, tail: bytes, name: str) -> Kind:
    if name.endswith(f".mcap{ACTIVE}"):
        return Kind.OURS  # nobody else has such names
    if not head:
        return Kind.EMPTY
    if head.startswith(b"#ROSBAG V"):
        return Kind.BAG
    if head.startswith(b"SQLite format 3\0"):
        return Kind.DB3
    if _is_beginning_of_ours(head, tail):
        return Kind.OURS
    if _is_text(head[:_TEXT_BYTES]):
        return Kind.TEXT
    if any(mark in head or mark in tail for mark in _OURS):
        return Kind.OURS  # one end will do: the other may be damaged
    if head.startswith(MAGIC) or tail.endswith(MAGIC):
        return Kind.MERGED if MERGED_METADATA.encode() in head else Kind.MCAP
    return Kind.OTHER


def _is_beginning_of_ours(head: bytes, tail: bytes) -> bool:
    """Cut before its manifest: the header names who wrote it, and less than that is held to be ours."""
    begins = MAGIC.startswith(head[: len(MAGIC)])
    if len(head) < _HEADER_BYTES:
        return begins and len(head) >= _MAGIC_ENOUGH
    return begins and not tail.endswith(MAGIC) and b"hippomat" in head[:_HEADER_BYTES]


def _is_text(head: bytes) -> bool:
    text = head.decode("utf-8", "replace").rstrip("\ufffd")  # the last letter may be cut
    return (
        bool(text)
        and all(letter.isprintable() or letter in "\t\n\r\f" for letter in text)
        and "\ufffd" not in text
    )


def refuse_missing(path: Path) -> None:
    if not path.exists():
        raise HippomatError(f"{path}: no such file or directory")


def refuse_no_log(path: Path) -> Kind:
    """HippomatError for what is no log of anybody's. An empty file that is named like one passes."""
    kind = kind_of(path)
    if kind in (Kind.BAG, Kind.DB3) and path.suffix != (suffix := f".{kind.name.lower()}"):
        raise HippomatError(f"{path}: is {kind.value}: give it a name that ends in {suffix}")
    if kind in _LOGS or (kind is Kind.EMPTY and path.suffix in LOG_SUFFIXES):
        return kind
    raise HippomatError(
        f"{path}: is {kind.value}, no log: give an .mcap, a .bag, a .db3 or a ROS 2 bag's directory"
    )


def refuse_foreign(path: Path) -> None:
    """HippomatError for what no daemon of ours recorded, for all that needs a robot's own records."""
    kind = refuse_no_log(path)
    if kind is Kind.OURS or (kind is Kind.EMPTY and path.suffix == ".mcap"):
        return
    if kind is Kind.MERGED:
        remedy = "here the robots' own logs are needed, or what `hippomat-logs fuse` makes of them"
    else:
        remedy = _TAKE_IT if kind in _LOGS else "give a robot's own log"
    raise HippomatError(f"{path}: is no log of a hippomat daemon, but {kind.value}; {remedy}")


def refuse_selection(path: Path, manifest: Mapping[str, str]) -> None:
    """SelectionError for what was taken out of a log and is no run any more."""
    if selection := manifest.get("selection"):
        raise SelectionError(
            f"{path}: is a selection of a run ({selection}): give the log that it was taken from; "
            "`hippomat-replay LOG --clip` makes a small one that replays"
        )


def logs_among(paths: Iterable[Path]) -> tuple[list[Path], list[str]]:
    """Logs, and a line for each other file; HippomatError where there is no log at all."""
    logs, foreign = list[Path](), list[str]()
    for path in paths:
        try:
            refuse_no_log(path)
        except HippomatError as error:
            foreign.append(str(error))
        else:
            logs.append(path)
    if not logs:
        raise HippomatError("; ".join(foreign))
    return logs, foreign


def each_once(paths: Iterable[Path]) -> list[Path]:
    """Each file once, by the first path that leads to it: a file may be given twice, or through a link."""
    found: dict[object, Path] = {}
    for path in paths:
        found.setdefault(_identity(path), path)
    return list(found.values())


def _identity(path: Path) -> object:
    try:
        stat = os.stat(path)
    except OSError:
        return path
    return stat.st_dev, stat.st_ino
