"""Make readable logs of what a dead daemon left behind. Loses nothing that can be read, and says what cannot.

A part belongs to a live process while that process holds its lock; such parts are left alone.
"""

from __future__ import annotations

import fcntl
import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import chain, count
from pathlib import Path

from hippomat_core.errors import HippomatError, LogError
from hippomat_logs.file_kinds import refuse_foreign, refuse_missing
from hippomat_logs.lenient_walk import walk_leniently
from hippomat_logs.named_gaps import NamedGaps
from hippomat_logs.part import END_METADATA, RECOVERY_METADATA, PartWriter, our_channels
from hippomat_logs.reader import mapped, read_raw, reading_store, runs_inside
from hippomat_logs.schema import CLASSES, MessageStore
from hippomat_logs.sink import ACTIVE, FileSink, sync_directory
from hippomat_logs.walk import Contents, counted_inside

RECOVERING = ".recovering"
DAMAGED = ".damaged"
SHOWN = 5  # places of damage that are named


@dataclass(frozen=True, slots=True)
class Outcome:
    """What came of one log, for people; stays_damaged: no readable log was made of it."""

    line: str
    stays_damaged: bool = False


def recover_directory(directory: Path | str) -> list[str]:
    """Recover every NAME.mcap.active in `directory` that no live process owns; one line for each."""
    return [outcome.line for outcome in _recover_unfinished(Path(directory))]


def _recover_unfinished(directory: Path) -> Iterator[Outcome]:
    for path in sorted(directory.glob(f"*.mcap{ACTIVE}")):
        try:
            yield recover_active(path, reading_store())
        except OSError as error:
            yield _not_recovered(path.name, error)


def _not_recovered(name: str, error: OSError) -> Outcome:
    return Outcome(f"{name}: not recovered: {error.strerror or error}", stays_damaged=True)


def recover(path: Path | str) -> list[Outcome]:
    """`hippomat-logs recover`: a directory, a NAME.mcap.active, or a damaged NAME.mcap."""
    path = Path(path)
    refuse_missing(path)
    if path.is_dir():  # however deep: wherever the other commands look for logs
        directories = sorted({path, *(left.parent for left in path.rglob(f"*.mcap{ACTIVE}"))})
        unfinished_ones = [one for directory in directories for one in _recover_unfinished(directory)]
        return unfinished_ones + list(_recover_damaged(path))
    refuse_foreign(path)
    if path.name.endswith(ACTIVE):
        return [recover_active(path, reading_store())]
    return [_recover_finished(path, reading_store())]


def _recover_damaged(directory: Path) -> Iterator[Outcome]:
    """The finished logs in it that are ours and not whole; whole ones are not worth a line."""
    for path in sorted(directory.rglob("*.mcap")):
        try:
            refuse_foreign(path)
        except HippomatError:
            continue  # somebody else's
        try:
            if not _is_whole(path):
                yield _replaced(path, reading_store())
        except OSError as error:
            yield _not_recovered(str(path), error)
        except HippomatError as error:  # nothing was made of it: the line says why
            yield Outcome(str(error), stays_damaged=True)


def unfinished(paths: Iterable[Path]) -> list[str]:
    """A line for each log in these directories that was never finished: no other command reads it."""
    lines: list[str] = []
    for left in sorted({left for path in paths if path.is_dir() for left in path.rglob(f"*.mcap{ACTIVE}")}):
        with _owned(left) as fd:
            state = "is being recorded" if fd is None else "was never finished"
        remedy = "" if fd is None else f": `hippomat-logs recover {left.parent}` makes a log of it"
        lines.append(f"{left} {state}, and is left out{remedy}")
    return lines


def recover_active(path: Path, store: MessageStore) -> Outcome:
    """Rewrite one part that was never finished."""
    with _owned(path) as fd:
        if fd is None:
            return Outcome(f"{path.name}: being recorded by a live process, left alone")
        name = path.name.removesuffix(ACTIVE)
        if os.fstat(fd).st_size == 0:
            path.unlink()
            return Outcome(f"{path.name}: empty, removed")
        if (path.parent / name).exists():
            target = _set_aside(path)
            return Outcome(f"{path.name}: {name} exists already; kept as {target}", stays_damaged=True)
        kept, contents = _rewrite(path, name, store)
        if not contents.manifest:
            what = f"its run manifest cannot be read, so nothing was made of it; kept as {_set_aside(path)}"
            return Outcome(f"{path.name}: {what}", stays_damaged=True)
        if contents.damage:
            what = f"{_shown(contents)}; original in {_set_aside(path)}"
            return Outcome(f"{name}: recovered, {kept} records kept; {what}")
        path.unlink()
        sync_directory(path.parent)
        return Outcome(f"{name}: recovered, {kept} records kept")


def _recover_finished(path: Path, store: MessageStore) -> Outcome:
    """Of a damaged log the recovered one takes the name, so that all that reads the directory finds it."""
    if not runs_inside(path) and _is_whole(path):
        return Outcome(f"{path.name}: whole, nothing to do")
    return _replaced(path, store)


def _is_whole(path: Path) -> bool:
    inside = next(iter(runs_inside(path)), "")
    try:
        for _ in read_raw(path, Contents(inside=inside), counted_inside):
            pass
    except LogError:
        return False
    return True


def _replaced(path: Path, store: MessageStore) -> Outcome:
    if runs_inside(path):
        raise HippomatError(f"{path}: is a fused file: recover the robots' own logs, and fuse them again")
    original = path.with_name(path.name + DAMAGED)
    recovered = path.with_name(path.name.removesuffix(".mcap") + ".recovered.mcap")
    for one in (original, recovered):
        if one.exists():
            raise LogError(
                f"{path}: is damaged and was not recovered: {one} exists already; move it away first"
            )
    kept, contents = _rewrite(path, recovered.name, store)
    if not contents.manifest:
        raise LogError(f"{path}: holds no run manifest of ours that can be read, so nothing was made of it")
    path.rename(original)
    recovered.rename(path)
    sync_directory(path.parent)
    what = _shown(contents) or "all chunks whole"
    return Outcome(f"{path.name}: recovered, {kept} records kept; {what}; original in {original.name}")


@contextmanager
def _owned(path: Path) -> Iterator[int | None]:
    """The file's descriptor while we hold its lock; None if a live process holds it."""
    fd = os.open(path, os.O_RDWR)
    try:
        try:
            fcntl.flock(fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            yield None
            return
        yield fd if os.fstat(fd).st_nlink else None
    finally:
        os.close(fd)


def _set_aside(path: Path) -> str:
    """The name that the original has now: one that nothing else has."""
    name = path.name.removesuffix(ACTIVE) + DAMAGED
    names = chain([name], (f"{name}.{number}" for number in count(2)))
    target = next(one for one in map(path.with_name, names) if not one.exists())
    path.rename(target)
    sync_directory(path.parent)
    return target.name


def _rewrite(path: Path, name: str, store: MessageStore) -> tuple[int, Contents]:
    """Write what `path` holds into a finished `name` beside it."""
    recovering = path.parent / (name + RECOVERING)
    recovering.unlink(missing_ok=True)  # of a recovery that was itself killed
    contents, kept = lenient_contents(store), 0
    gaps = NamedGaps(contents, store)
    writer: PartWriter | None = None
    topics: set[str] = set()

    def opened() -> PartWriter:
        facts = {**contents.manifest, "recovered": "yes"}
        sink = FileSink(path.parent, name, RECOVERING)
        channels = list(contents.channels.values())
        known = {channel.topic for channel in channels}  # others may be described later in the file
        channels += [one for one in our_channels(store) if one.topic not in known]
        topics.update(channel.topic for channel in channels)
        return PartWriter(sink, facts, channels, contents.attachments)

    with mapped(path) as data:
        try:
            for raw in gaps.filled(walk_leniently(data, contents)):
                if not contents.manifest:  # it stands before all records: nobody could say whose these are
                    break
                writer = writer or opened()
                if raw.topic not in topics:
                    contents.damage.append(
                        f"message {raw.number} is on {raw.topic}, which no log of ours has"
                    )
                    continue
                writer.add(raw.topic, raw.number, raw.log_time_ns, raw.data)
                kept += raw.topic in CLASSES
            if writer is None and contents.manifest:
                writer = opened()
            if writer is not None:
                unverified = {"unverified": str(contents.unverified)} if contents.unverified else {}
                told = {"damage": _shown(contents), **unverified}
                if gaps.end:
                    writer.add_facts(RECOVERY_METADATA, told)
                    writer.finish(END_METADATA, gaps.end)
                else:
                    writer.finish(RECOVERY_METADATA, told)
        except OSError:
            if writer is not None:
                writer.sink.abandon()
            recovering.unlink(missing_ok=True)  # no room for it; the original stays
            raise
    return kept - gaps.made, contents


def lenient_contents(store: MessageStore) -> Contents:
    """For a walk over what may have lost the description of its channels."""
    return Contents(expected=dict(enumerate(our_channels(store), start=1)))


def _shown(contents: Contents) -> str:
    """What was passed over, in one line."""
    shown, more = contents.damage[:SHOWN], len(contents.damage) - SHOWN
    if contents.unverified:
        shown.append(f"its last {contents.unverified} messages were saved without a checksum")
    return "; ".join([*shown, *([f"and {more} more"] if more > 0 else [])])
