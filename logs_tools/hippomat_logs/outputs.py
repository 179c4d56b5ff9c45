"""Where results may go: one rule for every command, asked before its work begins.

Logs, tables and maps are never overwritten; so no command writes onto a log that it reads. Pictures and HTML
pages are replaced: they can be drawn again from the logs. The directory of a file must be there; a directory
that is asked for is made.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

from hippomat_core.errors import HippomatError

RULE = (
    "results: logs, tables and maps are never overwritten, pictures and pages are; the directory of a file "
    "must exist, a directory that is asked for is made"
)


def refuse_existing(path: Path) -> None:
    """HippomatError where a new file or a new bag's directory cannot be made."""
    if os.path.lexists(path):
        raise HippomatError(f"{path} exists already; move it away, or choose another name")
    _refuse_nowhere(path)


def refuse_undrawable(path: Path, suffixes: Iterable[str]) -> None:
    """HippomatError where a picture or a page cannot be written; one that is there is drawn anew."""
    refuse_suffix(path, suffixes)
    if os.path.lexists(path) and not (path.is_file() and os.access(path, os.W_OK)):
        what = "is a directory" if path.is_dir() else "may not be written"
        raise HippomatError(f"{path}: {what}; choose another name")
    _refuse_nowhere(path)


def refuse_suffix(path: Path, suffixes: Iterable[str]) -> None:
    if path.suffix.lower() not in (known := tuple(suffixes)):
        raise HippomatError(f"{path}: give a name that ends in {', '.join(known)}")


def refuse_directory(path: Path) -> None:
    """HippomatError where a directory for results is not there and cannot be made."""
    nearest = next(one for one in (path, *path.absolute().parents) if os.path.lexists(one))
    if not nearest.is_dir():
        raise HippomatError(f"{path}: {nearest} is a file; a directory for the results is needed")
    if not os.access(nearest, os.W_OK | os.X_OK):
        raise HippomatError(f"{path}: nothing may be written in {nearest}; choose another place")


def _refuse_nowhere(path: Path) -> None:
    if not path.parent.is_dir():
        raise HippomatError(f"{path}: there is no directory {path.parent}; make it first")
    if not os.access(path.parent, os.W_OK | os.X_OK):
        raise HippomatError(f"{path}: nothing may be written in {path.parent}; choose another place")


@contextmanager
def appearing(path: Path) -> Iterator[Path]:
    """A file to write to that takes the place of `path` when all of it is written; else nothing changes."""
    beside = path.with_name(f".{path.name}.{os.getpid()}.partial")
    try:
        yield beside
        os.replace(beside, path)
    finally:
        beside.unlink(missing_ok=True)
