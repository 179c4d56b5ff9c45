"""The maps of `hippomat-bench motion`: drawn ones of 50 x 50 cells by name, and anybody's from a file.

True cells are free. Knows no robots.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hippomat_core.errors import ConfigError, MapError
from hippomat_core.motion.graph import largest_part, motion_graph
from hippomat_core.planning.costmap import OCCUPIED_FROM
from hippomat_logs.map_files import load_map

SIDE = 50
LAYERS = 12  # with --uav
_BLOCK = 6  # between two corridors
_SHELF, _AISLE = (10, 2), 1
_MOVINGAI_FREE = b".GS"

Free = NDArray[np.bool_]  # (Z, Y, X) [iz, iy, ix]


def make_map(name: str, seed: int, uav: bool) -> Free:
    """The largest connected part of a map, in LAYERS layers with uav. ConfigError, MapError by name."""
    if name == "warehouse":
        flat = _warehouse()
    elif name == "corridors":
        flat = _corridors()
    elif name.partition(":")[0] == "random":
        flat = _random(name, seed)
    else:
        flat = _from_file(Path(name))
    free = _piled_up(flat, seed) if uav else flat[None]
    if not free.any():
        raise MapError(f"map {name} has no free cell")
    graph = motion_graph(free)
    cells = graph.cells[largest_part(graph)]
    connected = np.zeros_like(free)
    connected[cells[:, 2], cells[:, 1], cells[:, 0]] = True
    return connected


def _random(name: str, seed: int) -> NDArray[np.bool_]:
    _, _, share = name.partition(":")
    try:
        occupied = float(share or "0.2")
    except ValueError:
        occupied = -1.0
    if not 0.0 <= occupied <= 0.5:
        raise ConfigError(f"--map {name}: write random:P with the share of occupied cells, 0 .. 0.5")
    return np.random.default_rng([seed, 1]).random((SIDE, SIDE)) >= occupied


def _warehouse() -> NDArray[np.bool_]:
    """Rows of shelves with aisles of one cell between them, and room on both sides."""
    free = np.ones((SIDE, SIDE), np.bool_)
    (length, depth), pitch = _SHELF, _SHELF[0] + _AISLE
    for y in range(2, SIDE - depth - 1, depth + _AISLE):
        for x in range(4, SIDE - length - 2, pitch):
            free[y : y + depth, x : x + length] = False
    return free


def _corridors() -> NDArray[np.bool_]:
    """Corridors of one cell that cross each other every _BLOCK + 1 cells; nobody can pass within one."""
    line = np.arange(SIDE) % (_BLOCK + 1) == 0
    return np.asarray(line[:, None] | line, np.bool_)


def _piled_up(flat: NDArray[np.bool_], seed: int) -> Free:
    """Every occupied cell as a column of random height, so that there are ways over most of them."""
    heights = np.random.default_rng([seed, 2]).integers(1, LAYERS + 1, flat.shape)
    above: Free = np.arange(LAYERS)[:, None, None] >= heights
    return above | flat


def _from_file(path: Path) -> NDArray[np.bool_]:
    """A ROS map, one cell of the benchmark for each of its cells, or a MovingAI .map."""
    if path.suffix in (".yaml", ".yml"):
        grid = load_map(path)
        return np.asarray((grid.cells >= 0) & (grid.cells < OCCUPIED_FROM), np.bool_)
    if path.suffix != ".map":
        raise ConfigError(
            f"--map {path}: give warehouse, corridors, random:P, a ROS map's .yaml or a MovingAI .map"
        )
    try:
        lines = path.read_bytes().splitlines()
    except OSError as error:
        raise MapError(f"map {path}: cannot be read: {error.strerror or error}") from None
    begin = lines.index(b"map") + 1 if b"map" in lines else 0
    head = dict(line.split(maxsplit=1) for line in lines[: begin - 1] if line.count(b" ") == 1)
    height, width = (
        int(value) if value.isdigit() else 0 for value in (head.get(b"height", b""), head.get(b"width", b""))
    )
    rows = lines[begin : begin + height]
    if not (begin and height and width and len(rows) == height and {len(row) for row in rows} == {width}):
        raise MapError(
            f"map {path}: is no MovingAI map: height and width, 'map', then so many rows must follow"
        )
    return np.array([[cell in _MOVINGAI_FREE for cell in row] for row in rows], np.bool_)
