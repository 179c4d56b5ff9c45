"""Read and write ROS map files (YAML plus image). The rules are in hippomat_core.maps.ros_map."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from hippomat_core.errors import MapError
from hippomat_core.maps.occupancy_grid import OccupancyGrid
from hippomat_core.maps.ros_map import grid_from_image, image_from_grid, map_yaml, parse_map_yaml


def load_map(path: str | Path) -> OccupancyGrid:
    """The occupancy grid of a map's YAML file; MapError with one clear line otherwise."""
    path = Path(path)
    try:
        text = path.read_text(encoding="utf-8")
    except OSError as error:
        how = f"`hippomat-logs map LOG -o {path}` makes one"
        raise MapError(f"map {path}: cannot be read: {error.strerror or error}; {how}") from None
    except UnicodeDecodeError:
        raise MapError(f"map {path}: is not text; give the map's .yaml file, not its image") from None
    meta = parse_map_yaml(text, str(path))
    image = path.parent / meta.image
    if not image.is_file():
        raise MapError(f"map {path} names image {meta.image}, which does not exist")
    try:
        pixels, alpha = _decode(image.read_bytes())
    except OSError as error:
        raise MapError(f"map {path}: image {meta.image} cannot be read: {error.strerror or error}") from None
    except ValueError as error:
        raise MapError(f"map {path}: image {meta.image} {error}") from None
    return grid_from_image(pixels, meta, alpha)


def save_map(grid: OccupancyGrid, path: str | Path) -> None:
    """Write NAME.yaml and NAME.pgm beside it; load_map(path) gives an equal grid."""
    path = Path(path)
    pixels, mode = image_from_grid(grid)
    image = path.with_suffix(".pgm")
    head = f"P5\n{grid.width} {grid.height}\n255\n".encode()
    image.write_bytes(head + np.ascontiguousarray(pixels).tobytes())
    path.write_text(map_yaml(grid, image.name, mode), encoding="utf-8")


def map_attachments(grid: OccupancyGrid) -> dict[str, bytes]:
    """The same map as files that a log carries: map.yaml and map.png, by name."""
    pixels, mode = image_from_grid(grid)
    _, png = cv2.imencode(".png", np.ascontiguousarray(pixels))
    return {"map.yaml": map_yaml(grid, "map.png", mode).encode(), "map.png": png.tobytes()}


def _decode(data: bytes) -> tuple[NDArray[np.float64], NDArray[np.uint8] | None]:
    """Grey values (H, W), the mean of the colours, and the alpha channel if there is one."""
    try:
        image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED) if data else None
    except cv2.error:
        image = None
    if image is None:
        raise ValueError("is not an image that OpenCV can read (pgm, png, bmp ...)")
    if image.dtype != np.uint8:
        raise ValueError(f"has {image.dtype} pixels; save it with 8 bits per channel")
    if image.ndim == 2:
        return image.astype(np.float64), None
    grey = image[:, :, :3].mean(axis=2)  # map_server averages the channels
    return grey, np.asarray(image[:, :, 3], np.uint8) if image.shape[2] == 4 else None
