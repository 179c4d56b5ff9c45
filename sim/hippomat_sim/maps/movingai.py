"""Grid maps and scenarios of the MovingAI benchmarks (Sturtevant 2012): text to free cells and queries.

A map file has a head (type octile, height, width, map) and a character per cell, first row first; that
order is kept, so iy counts from the top. Terrain: `.` and `G` are free, and so is `S` (swamp, which costs
no more in the scenarios); `@`, `O`, `T` and `W` are not. What follows the last row is ignored.

A scenario file says `version 1`, then a query per line: bucket, map, its width and height, start x y, goal
x y, length of a shortest path (8-connected, no corner cutting, sqrt(2)). A line that begins with `/` ends
them.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hippomat_core.errors import MapError

FREE, BLOCKED = ".GS", "@OTW"


@dataclass(frozen=True, slots=True)
class Query:
    """A start, a goal, and how long a shortest path is [cells]."""

    bucket: int  # queries of about the same length
    start: tuple[int, int]  # (ix, iy)
    goal: tuple[int, int]
    length: float
    rounding: float  # of the length as printed: 3.41 may be anything from 3.405 to 3.415


@dataclass(frozen=True, slots=True, eq=False)
class Scenario:
    """A map and queries on it."""

    name: str
    free: NDArray[np.bool_]  # (H, W) [iy, ix]
    queries: list[Query]


def load_scenario(path: Path) -> Scenario:
    """The queries of a .scen file and its map, which lies beside it or where the file says."""
    lines = _text(path).splitlines()
    words = lines[0].split() if lines else []
    if len(words) != 2 or words[0] != "version" or _float_or(words[1], -1.0) != 1.0:
        found = lines[0][:40] if lines else ""
        raise MapError(f"scenario {path}: expected `version 1` in line 1, found {found!r}")
    queries, maps, sizes = [], set(), set()
    for number, line in enumerate(lines[1:], start=2):
        if line.startswith("/"):
            break
        if not line.strip():
            continue
        query, name, size = _query(line, f"scenario {path}, line {number}")
        queries.append(query)
        maps.add(name)
        sizes.add(size)
    if len(maps) != 1 or len(sizes) != 1:
        raise MapError(f"scenario {path}: expected queries on one map of one size, found {len(maps)} maps")
    free = load_map(_map_file(path, maps.pop()))
    height, width = free.shape
    if sizes != {(width, height)}:
        raise MapError(
            f"scenario {path} is for a map scaled to {sizes.pop()}, its map has {(width, height)}: "
            "scaled scenarios cannot be used"
        )
    for query in queries:
        for ix, iy in (query.start, query.goal):
            if not (0 <= ix < width and 0 <= iy < height and free[iy, ix]):
                raise MapError(f"scenario {path}: cell {(ix, iy)} of a query is not free in its map")
    return Scenario(path.name, free, queries)


def load_map(path: Path) -> NDArray[np.bool_]:
    """(H, W) [iy, ix] the free cells of a .map file."""
    lines = _text(path).splitlines()
    head = dict(line.split(maxsplit=1) for line in lines[:3] if len(line.split()) == 2)
    if head.get("type") != "octile" or lines[3:4] != ["map"]:
        raise MapError(f"map {path}: expected the lines type octile, height, width and map at the beginning")
    height, width = (int(_float_or(head.get(side, ""), 0.0)) for side in ("height", "width"))
    rows = lines[4 : 4 + height]
    if height < 1 or width < 1 or len(rows) < height or any(len(row) < width for row in rows):
        raise MapError(f"map {path}: fewer cells than height {head.get('height')}, width {head.get('width')}")
    terrain = np.array([list(row[:width]) for row in rows])
    unknown = ~np.isin(terrain, list(FREE + BLOCKED))
    if unknown.any():
        iy, ix = np.argwhere(unknown)[0]
        raise MapError(f"map {path}: {str(terrain[iy, ix])!r} in row {iy} is no terrain ({FREE}{BLOCKED})")
    free: NDArray[np.bool_] = np.isin(terrain, list(FREE))
    return free


def _query(line: str, where: str) -> tuple[Query, str, tuple[int, int]]:
    """The query, the name of its map, the map's (width, height)."""
    parts = line.split("\t") if "\t" in line else line.split()
    try:
        bucket, name = int(parts[0]), " ".join(parts[1:-7])
        width, height, start_x, start_y, goal_x, goal_y = (int(part) for part in parts[-7:-1])
        length = float(parts[-1])
    except (ValueError, IndexError):
        raise MapError(
            f"{where}: expected bucket, map, width, height, start x y, goal x y, length, found {line!r}"
        ) from None
    digits = len(parts[-1].strip().partition(".")[2])
    query = Query(bucket, (start_x, start_y), (goal_x, goal_y), length, 0.5 * 10.0**-digits)
    return query, name, (width, height)


def _map_file(path: Path, name: str) -> Path:
    beside = [path.with_suffix(""), path.parent / name, path.parent / Path(name).name]
    found = next((file for file in beside if file.is_file() and file.suffix == ".map"), None)
    if found is None:
        raise MapError(f"scenario {path} is for the map {name}, which is not beside it")
    return found


def _text(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8")
    except OSError as error:
        raise MapError(f"{path}: cannot be read: {error.strerror or error}") from None
    except UnicodeDecodeError:
        raise MapError(f"{path}: is not text") from None


def _float_or(text: str, otherwise: float) -> float:
    """The number that the text says, or `otherwise`."""
    try:
        return float(text)
    except ValueError:
        return otherwise
