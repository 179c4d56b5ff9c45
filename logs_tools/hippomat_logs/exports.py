"""Tables of a run as files that other tools read: CSV, Parquet, and trajectories in TUM's format for evo.

Decides file names and which topics are trajectories. One file per topic and per sequence inside its messages;
long runs go through in batches. TUM: timestamp x y z qx qy qz qw (https://github.com/MichaelGrupp/evo/wiki).
"""

from __future__ import annotations

import csv
import json
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hippomat_core.errors import HippomatError
from hippomat_logs.column_table import ROW, TIME, Table
from hippomat_logs.opened_run import BATCH_ROWS, OpenedRun
from hippomat_logs.outputs import refuse_existing

# message type -> where its pose and, where it has one, its own stamp are
POSES = {
    "nav_msgs/msg/Odometry": "pose.pose.",
    "geometry_msgs/msg/PoseStamped": "pose.",
    "geometry_msgs/msg/PoseWithCovarianceStamped": "pose.pose.",
    "geometry_msgs/msg/Pose": "",
    "hippomat_msgs/msg/PoseEstimated": "",
}


def file_word(topic: str) -> str:
    """/hippo/effect/drive -> hippo_effect_drive."""
    return topic.strip("/").replace("/", "_") or "topic"


# ---- CSV and Parquet ----


def export_csv(run: OpenedRun, topic: str, directory: Path, rows: int = BATCH_ROWS) -> list[Path]:
    """One file per table; arrays are JSON lists in their cells. rows: messages in memory at once."""
    writers: dict[str, Any] = {}
    paths: list[Path] = []
    files: list[Any] = []
    try:
        for table, first_row in _flat(run, topic, rows):
            if table.name not in writers:
                path = directory / f"{file_word(table.name)}.csv"
                refuse_existing(path)
                files.append(path.open("w", newline="", encoding="utf-8"))
                writers[table.name] = csv.writer(files[-1])
                writers[table.name].writerow(table.columns)
                paths.append(path)
            columns = [_cells(name, column, first_row) for name, column in table.columns.items()]
            writers[table.name].writerows(zip(*columns, strict=True))
    finally:
        for file in files:
            file.close()
    return paths


def _cells(name: str, column: NDArray[Any], first_row: int) -> list[Any]:
    if name == ROW:
        rows: list[Any] = (column + first_row).tolist()
        return rows
    if column.dtype == object:
        return [json.dumps(_plain(value)) if not isinstance(value, str) else value for value in column]
    cells: list[Any] = column.tolist()
    return cells


def _plain(value: Any) -> Any:
    return value.tolist() if isinstance(value, np.ndarray) else value


def export_parquet(run: OpenedRun, topic: str, directory: Path, rows: int = BATCH_ROWS) -> list[Path]:
    """One file per table; arrays stay lists. Needs pyarrow, of the extra `tables`."""
    try:
        import pyarrow as arrow
        import pyarrow.parquet as parquet
    except ModuleNotFoundError:
        raise HippomatError("pyarrow is not installed: pip install 'hippomat[tables]'") from None
    writers: dict[str, Any] = {}
    paths: list[Path] = []
    try:
        for table, first_row in _flat(run, topic, rows):
            columns = dict(table.columns)
            if ROW in columns:
                columns[ROW] = columns[ROW] + first_row
            schema = writers[table.name].schema if table.name in writers else None
            batch = arrow.table(
                {name: _arrow(arrow, column) for name, column in columns.items()}, schema=schema
            )
            if table.name not in writers:
                path = directory / f"{file_word(table.name)}.parquet"
                refuse_existing(path)
                writers[table.name] = parquet.ParquetWriter(path, batch.schema)
                paths.append(path)
            writers[table.name].write_table(batch)
    finally:
        for writer in writers.values():
            writer.close()
    return paths


def _arrow(arrow: Any, column: NDArray[Any]) -> Any:
    """Lists of one element type for a column of arrays, whatever its first cell holds."""
    if column.dtype != object or not len(column) or isinstance(column[0], str):
        return arrow.array(column)
    if isinstance(column[0], list):
        return arrow.array(list(column), type=arrow.list_(arrow.string()))
    return arrow.array(list(column), type=arrow.list_(arrow.from_numpy_dtype(column[0].dtype)))


def _flat(run: OpenedRun, topic: str, rows: int) -> Iterator[tuple[Table, int]]:
    """All tables of a topic, batch by batch; with each the rows that its outer table had before."""
    done: Counter[str] = Counter()
    for batch in run.batches(topic, rows):
        yield batch, 0
        yield from _below(batch, done)
        done.update({table.name: len(table) for table in batch.tables()})


def _below(outer: Table, done: Counter[str]) -> Iterator[tuple[Table, int]]:
    for child in outer.children.values():
        yield child, done[outer.name]
        yield from _below(child, done)


# ---- trajectories ----


def trajectory_topics(run: OpenedRun) -> list[str]:
    """Topics that hold poses, of those with messages."""
    return [t.name for t in run.topics.values() if t.type_name in POSES and t.count != 0]


def trajectory(run: OpenedRun, topic: str) -> NDArray[np.float64]:
    """(n, 8): seconds, x, y, z [m], quaternion x, y, z, w; seconds of the message's stamp if it has one."""
    kind = run.topics[topic].type_name if topic in run.topics else ""
    if kind not in POSES:
        known = ", ".join(trajectory_topics(run)) or "none"
        raise HippomatError(f"{run.name}: {topic} holds no poses; topics that do: {known}")
    table = run.table(topic)
    if "yaw_rad" in table.columns:
        yaw, zero = table["yaw_rad"], np.zeros(len(table))
        turn = [zero, zero, np.sin(yaw / 2), np.cos(yaw / 2)]
        place = [table["x_m"], table["y_m"], zero]
    else:
        prefix = POSES[kind]
        place = [table[f"{prefix}position.{axis}"] for axis in "xyz"]
        turn = [table[f"{prefix}orientation.{axis}"] for axis in "xyzw"]
    return np.column_stack([stamps_s(table), *place, *turn]).astype(np.float64)


def stamps_s(table: Table) -> NDArray[np.float64]:
    """The header's stamp [s]; the log time of messages that have none."""
    if "header.stamp.sec" in table.columns:
        return np.asarray(table["header.stamp.sec"] + table["header.stamp.nanosec"] / 1e9, np.float64)
    return np.asarray(table[TIME] / 1e9, np.float64)


def export_tum(run: OpenedRun, topic: str, path: Path) -> int:
    """The number of poses written."""
    poses = trajectory(run, topic)
    refuse_existing(path)
    np.savetxt(path, poses, fmt=["%.9f", *7 * ["%.6f"]])
    return len(poses)


def export_attachments(run: OpenedRun, directory: Path) -> list[Path]:
    """The files that the run carries: weights, map ..."""
    paths: list[Path] = []
    for source in run.sources[:1]:
        for name in getattr(getattr(source, "file", None), "attachments", ()):
            path = directory / Path(name).name
            refuse_existing(path)
            path.write_bytes(source.file.attachment(name))  # type: ignore[attr-defined]
            paths.append(path)
    return paths
