"""Where maps come from, as a port: files, recordings and running ROS systems behind one method.

Knows what a map is and that there may be several, one after the other; not how any of them is stored.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import Protocol

from hippomat_core.errors import MapError
from hippomat_core.maps.occupancy_grid import OccupancyGrid


class MapSource(Protocol):
    """Maps in the order of their time."""

    name: str  # for messages

    def maps(self) -> Iterator[tuple[int, OccupancyGrid]]:
        """(time on the source's own clock [ns], map), oldest first; a live source waits for the next one.

        Raises MapError where the source cannot be read, or holds a map that we cannot use.
        """
        ...


class MadeMaps:
    """A source that was given its maps: the port's public fake."""

    def __init__(self, maps: Iterable[tuple[int, OccupancyGrid]], name: str = "made maps") -> None:
        self.name = name
        self._maps = tuple(maps)

    def maps(self) -> Iterator[tuple[int, OccupancyGrid]]:
        yield from self._maps


def map_at(source: MapSource, after_s: float | None = None) -> OccupancyGrid:
    """The last map, or the one that held `after_s` after the first. MapError where there is none."""
    held: OccupancyGrid | None = None
    first_ns: int | None = None
    for at_ns, grid in source.maps():
        first_ns = at_ns if first_ns is None else first_ns
        if held is not None and after_s is not None and at_ns - first_ns > after_s * 1e9:
            break
        held = grid
    if held is None:
        raise MapError(f"{source.name} holds no map")
    return held
