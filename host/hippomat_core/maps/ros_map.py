"""The rules of ROS's map_server: YAML text and pixels to an occupancy grid and back. Opens no file.

Source: nav2_map_server (map_io.cpp) and ROS 1 map_server. Image rows run from the top, grid rows from the
bottom.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError

from hippomat_core.errors import MapError
from hippomat_core.maps.occupancy_grid import FREE, OCCUPIED, UNKNOWN, OccupancyGrid

MODES = ("trinary", "scale", "raw")
PIXEL_FREE, PIXEL_UNKNOWN, PIXEL_OCCUPIED = 254, 205, 0
REQUIRED = ("image", "resolution", "origin", "occupied_thresh", "free_thresh")


@dataclass(frozen=True, slots=True)
class MapMeta:
    """What a map's YAML file says; `name` is used in error messages."""

    image: str
    resolution_m: float
    origin_x_m: float
    origin_y_m: float
    negate: bool
    occupied_thresh: float
    free_thresh: float
    mode: str
    name: str


def parse_map_yaml(text: str, name: str = "map.yaml") -> MapMeta:
    """The map's description; raises MapError naming `name`, the key and the value found."""
    try:
        tree = YAML(typ="safe", pure=True).load(text)
    except YAMLError as error:
        raise MapError(f"map {name}: not valid YAML: {' '.join(str(error).split())}") from None
    if not isinstance(tree, dict):
        raise MapError(f"map {name}: expected keys such as image and resolution, found {_short(tree)}")
    missing = [key for key in REQUIRED if key not in tree]
    if missing:
        raise MapError(f"map {name}: key {missing[0]!r} is missing; a map needs {', '.join(REQUIRED)}")
    return _meta(tree, name)


def _short(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 40 else f"{text[:40]}..."


def _meta(tree: dict[str, Any], name: str) -> MapMeta:
    image, mode, negate = tree["image"], tree.get("mode", "trinary"), tree.get("negate", 0)
    if not isinstance(image, str) or not image:
        raise MapError(f"map {name}: image = {image!r} must be the name of an image file")
    if mode not in MODES:
        raise MapError(f"map {name}: mode = {mode!r} is not one of {', '.join(MODES)}")
    if negate not in (0, 1):
        raise MapError(f"map {name}: negate = {negate!r} must be 0 or 1")
    resolution_m = _number(tree["resolution"], "resolution", name)
    if resolution_m <= 0.0:
        raise MapError(f"map {name}: resolution = {resolution_m!r} must be greater than 0 [m per cell]")
    origin = tree["origin"]
    if not isinstance(origin, list) or len(origin) != 3:
        raise MapError(f"map {name}: origin = {origin!r} must be [x, y, yaw]")
    x_m, y_m, yaw_rad = (_number(value, "origin", name) for value in origin)
    if yaw_rad != 0.0:
        raise MapError(
            f"map {name}: origin yaw = {yaw_rad!r} is not supported; rotate the image so that it is 0"
        )
    free, occupied = (_number(tree[key], key, name) for key in ("free_thresh", "occupied_thresh"))
    if not 0.0 <= free < occupied <= 1.0:
        raise MapError(
            f"map {name}: need 0 <= free_thresh < occupied_thresh <= 1, found {free!r} and {occupied!r}"
        )
    return MapMeta(image, resolution_m, x_m, y_m, bool(negate), occupied, free, mode, name)


def _number(value: Any, key: str, name: str) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not math.isfinite(value):
        raise MapError(f"map {name}: {key} has {value!r}; a finite number is needed")
    return float(value)


def grid_from_image(
    pixels: NDArray[np.uint8] | NDArray[np.float64], meta: MapMeta, alpha: NDArray[np.uint8] | None = None
) -> OccupancyGrid:
    """The grid that map_server would publish.

    pixels: (H, W), top row first, 0 black .. 255 white, the mean of the colour channels
    alpha: (H, W), 255 opaque, if the image has it. As in map_server it counts as one more channel of four in
    trinary mode, makes what is not opaque unknown in scale mode, and says nothing in raw mode.
    """
    shade = pixels.astype(np.float64) / 255.0
    if meta.mode == "trinary" and alpha is not None:
        shade = (3.0 * shade + alpha / 255.0) / 4.0
    occupancy = shade if meta.negate else 1.0 - shade
    cells = np.full(pixels.shape, UNKNOWN, np.int8)
    if meta.mode == "raw":
        percent = np.floor(pixels + 0.5)
        np.copyto(cells, percent.astype(np.int8), where=percent <= 100, casting="unsafe")
    else:
        if meta.mode == "scale":
            span = meta.occupied_thresh - meta.free_thresh
            scaled = np.rint(100.0 * (occupancy - meta.free_thresh) / span)
            cells[:] = np.clip(scaled, 0, 100).astype(np.int8)
        cells[occupancy > meta.occupied_thresh] = OCCUPIED
        cells[occupancy < meta.free_thresh] = FREE
        if meta.mode == "scale" and alpha is not None:
            cells[alpha < 255] = UNKNOWN
    return OccupancyGrid(
        np.ascontiguousarray(cells[::-1]), meta.resolution_m, meta.origin_x_m, meta.origin_y_m
    )


def image_from_grid(grid: OccupancyGrid) -> tuple[NDArray[np.uint8], str]:
    """Pixels (H, W), top row first, and the mode that reads them back to the same cells."""
    cells = grid.cells[::-1]
    if np.isin(cells, (UNKNOWN, FREE, OCCUPIED)).all():
        pixels = np.full(cells.shape, PIXEL_UNKNOWN, np.uint8)
        pixels[cells == FREE] = PIXEL_FREE
        pixels[cells == OCCUPIED] = PIXEL_OCCUPIED
        return pixels, "trinary"
    return np.where(cells < 0, 255, cells).astype(np.uint8), "raw"


def map_yaml(grid: OccupancyGrid, image: str, mode: str) -> str:
    """The YAML text that belongs to image_from_grid; numbers are written so that they read back equal."""
    quoted = image.replace("'", "''")
    return (
        f"image: '{quoted}'\nmode: {mode}\nresolution: {float(grid.resolution_m)!r}\n"
        f"origin: [{float(grid.origin_x_m)!r}, {float(grid.origin_y_m)!r}, 0.0]\n"
        "negate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )
