"""The same part of a run given twice: a copy counts once, and another version of it is refused."""

from __future__ import annotations

import filecmp
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import TypeVar

from hippomat_core.errors import HippomatError

T = TypeVar("T")


def each_part_once(parts: Iterable[tuple[int, Path, T]]) -> Iterator[tuple[int, Path, T]]:
    """Parts of one run by number, copies left out; HippomatError where two of one number differ."""
    first: dict[int, Path] = {}
    for number, path, rest in sorted(parts, key=lambda part: (part[0], str(part[1]))):
        if number not in first:
            first[number] = path
            yield number, path, rest
        else:
            refuse_other_version(path, first[number])


def refuse_other_version(path: Path, other: Path) -> None:
    """Of two files of one part; equal ones are copies."""
    if not filecmp.cmp(path, other, shallow=False):
        raise HippomatError(f"{other} and {path} are the same part of one run, and differ: give one of them")
