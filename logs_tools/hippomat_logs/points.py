"""What a run's sensors saw as points in one fixed frame: LaserScan, PointCloud and PointCloud2.

Decides which returns count. Knows messages and frames, not pictures.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from hippomat_core.errors import HippomatError
from hippomat_logs.column_table import Table
from hippomat_logs.exports import stamps_s
from hippomat_logs.frames import FrameTree
from hippomat_logs.opened_run import OpenedRun

SCAN, CLOUD, CLOUD2 = "sensor_msgs/msg/LaserScan", "sensor_msgs/msg/PointCloud", "sensor_msgs/msg/PointCloud2"
MAX_POINTS = 2_000_000
FLOAT32 = 7  # PointField's code
Points = NDArray[np.float64]  # (n, 3) [m]


def point_topics(run: OpenedRun) -> list[str]:
    kinds = (SCAN, CLOUD, CLOUD2)
    return [topic.name for topic in run.topics.values() if topic.type_name in kinds and topic.count != 0]


def points_of(run: OpenedRun, topic: str) -> tuple[Points, str]:
    """All points of a topic in the frame that its sensor hangs on in the end, and that frame's name."""
    tree = FrameTree(run)
    found: list[Points] = []
    frame, total = "", 0
    for table in run.batches(topic, rows=500):
        frame = str(table["header.frame_id"][0])
        links = tree.matrices(frame, stamps_s(table))
        for link, points in zip(links, _points(table, run.topics[topic].type_name), strict=True):
            found.append(points @ link[:3, :3].T + link[:3, 3])
            total += len(points)
        if total > MAX_POINTS:
            break
    if not total:
        raise HippomatError(f"{run.name}: {topic} holds no point within its sensor's range")
    return np.concatenate(found), tree.root_of(frame)


def _points(table: Table, kind: str) -> Iterator[Points]:
    """(n, 3) in the sensor's frame, message by message."""
    if kind == SCAN:
        yield from _scan_points(table)
    elif kind == CLOUD:
        child = table.child("points")
        places = np.column_stack([child[axis] for axis in "xyz"]).astype(np.float64)
        for row in range(len(table)):
            yield places[child["row"] == row]
    else:
        yield from _cloud2_points(table)


def _scan_points(table: Table) -> Iterator[Points]:
    names = ("angle_min", "angle_increment", "range_min", "range_max")
    limits = np.column_stack([table[name] for name in names]).astype(np.float64)
    for ranges, (start, step, low, high) in zip(table["ranges"], limits, strict=True):
        angle = start + step * np.arange(len(ranges))
        hit = np.isfinite(ranges) & (ranges > low) & (ranges < high)
        distance, angle = ranges[hit].astype(np.float64), angle[hit]
        yield np.column_stack([distance * np.cos(angle), distance * np.sin(angle), np.zeros(len(angle))])


def _cloud2_points(table: Table) -> Iterator[Points]:
    fields = table.child("fields")
    for row in range(len(table)):
        mine = np.flatnonzero(fields["row"] == row)
        offsets = {fields["name"][k]: fields["offset"][k] for k in mine if fields["datatype"][k] == FLOAT32}
        data, step = np.ascontiguousarray(table["data"][row]), int(table["point_step"][row])
        if not {"x", "y", "z"} <= offsets.keys() or step <= 0 or len(data) < step:
            yield np.empty((0, 3))
            continue
        order = ">" if table["is_bigendian"][row] else "<"
        rows = data[: len(data) // step * step].reshape(-1, step)
        columns = [
            np.ascontiguousarray(rows[:, offsets[axis] : offsets[axis] + 4]).view(order + "f4")[:, 0]
            for axis in "xyz"
        ]
        points = np.column_stack(columns).astype(np.float64)
        yield points[np.isfinite(points).all(axis=1)]
