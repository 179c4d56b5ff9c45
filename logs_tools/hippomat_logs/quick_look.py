"""A quick look at a run as one PNG: where it drove, how fast, the battery, the rounds; and what a sensor saw.

Decides what is drawn where. Knows tables and matplotlib (extra `viz`); what the run achieved is metrics.py's.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hippomat_core.errors import HippomatError
from hippomat_core.messages import NEVER_HEARD_MS
from hippomat_logs.column_table import TIME
from hippomat_logs.exports import trajectory, trajectory_topics
from hippomat_logs.opened_run import OpenedRun
from hippomat_logs.pictures import new_figure
from hippomat_logs.points import point_topics, points_of

CORE_POSE, DRIVE, DECIDED = (
    "/hippo/effect/pose_estimated",
    "/hippo/effect/drive",
    "/hippo/effect/round_decided",
)
MAP, BATTERY = "nav_msgs/msg/OccupancyGrid", "sensor_msgs/msg/BatteryState"
INCHES, DPI = (11.0, 7.0), 110
MARGIN = 0.03  # around the path and the known cells, of the longer side
MOST_DRAWN = 300_000  # points; more only make the picture slow


def draw(run: OpenedRun, path: Path, topic: str = "") -> str:
    """Write the picture; what is on it, for people. topic: of a laser or a cloud: its points from above."""
    if topic:
        figure, said = _draw_points(run, topic)
    elif panels := _panels(run):
        figure, said = _draw_panels(run, panels)
    elif topics := point_topics(run):
        figure, said = _draw_points(run, topics[0])
    else:
        raise HippomatError(f"{run.name}: holds no pose, speed, battery, round or scan that could be drawn")
    figure.savefig(path, dpi=DPI)
    return said


# ---- a run ----


def _panels(run: OpenedRun) -> list[tuple[str, Any]]:
    """(name, what draws it) of what the run has, the path first."""
    has = {name for name, topic in run.topics.items() if topic.count != 0}
    poses = CORE_POSE if CORE_POSE in has else next(iter(trajectory_topics(run)), "")
    battery = next((t.name for t in run.topics.values() if t.type_name == BATTERY and t.name in has), "")
    panels: list[tuple[str, Any]] = []
    if poses:
        panels.append(("path", lambda axes: _path(axes, run, poses)))
        panels.append(("speed", lambda axes: _speed(axes, run, poses)))
    if battery:
        panels.append(("battery", lambda axes: _battery(axes, run, battery)))
    if DECIDED in has:
        panels.append(("rounds", lambda axes: _rounds(axes, run)))
    return panels


def _draw_panels(run: OpenedRun, panels: list[tuple[str, Any]]) -> tuple[Any, str]:
    figure = new_figure(INCHES, layout="constrained")
    figure.suptitle(run.name)
    rows = max(1, len(panels) - 1)
    grid = figure.add_gridspec(rows, 2, width_ratios=(1.15, 1.0))
    for index, (_, draw_panel) in enumerate(panels):
        wide = index == 0 and panels[0][0] == "path"
        draw_panel(figure.add_subplot(grid[:, 0] if wide else grid[index - 1 if index else 0, 1]))
    return figure, ", ".join(name for name, _ in panels)


def _seconds(run: OpenedRun, times_ns: NDArray[Any]) -> NDArray[np.float64]:
    return np.asarray((times_ns - run.span_ns[0]) / 1e9, np.float64)


def _path(axes: Any, run: OpenedRun, topic: str) -> None:
    """The poses on the map, as far as its known cells and the poses go."""
    poses = trajectory(run, topic)
    shown_m = poses[:, 1:3]
    for name, kind in run.topics.items():
        if kind.type_name == MAP and kind.count != 0:
            shown_m = np.concatenate([shown_m, _map(axes, run, name)])
            break
    axes.plot(poses[:, 1], poses[:, 2], color="tab:blue", linewidth=1.4, label=topic)
    axes.plot(*poses[0, 1:3], "o", color="tab:green", label="start")
    axes.plot(*poses[-1, 1:3], "s", color="tab:red", label="end")
    axes.set(xlabel="x [m]", ylabel="y [m]", aspect="equal", title="path")
    if len(shown_m := shown_m[np.isfinite(shown_m).all(axis=1)]):
        low_m, high_m = shown_m.min(axis=0), shown_m.max(axis=0)
        margin_m = MARGIN * max(1.0, *(high_m - low_m))
        (left, low), (right, top) = low_m - margin_m, high_m + margin_m
        axes.set(xlim=(left, right), ylim=(low, top))
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.1), ncol=3, frameon=False, fontsize="small")


def _map(axes: Any, run: OpenedRun, topic: str) -> NDArray[np.float64]:
    """The last grid that was there: occupied dark, unknown grey. (n, 2) [m]: corners of what it knows."""
    table = run.table(topic)
    width, height = int(table["info.width"][-1]), int(table["info.height"][-1])
    if width * height == 0 or len(table["data"][-1]) != width * height:
        return np.empty((0, 2))
    cells = table["data"][-1].reshape(height, width).astype(np.float64)
    shade = np.where(cells < 0, 0.75, 1.0 - np.clip(cells, 0, 100) / 100 * 0.85)
    left, low = table["info.origin.position.x"][-1], table["info.origin.position.y"][-1]
    resolution = float(table["info.resolution"][-1])
    extent = (left, left + width * resolution, low, low + height * resolution)
    axes.imshow(shade, cmap="gray", vmin=0, vmax=1, origin="lower", extent=extent, interpolation="nearest")
    known = np.argwhere(cells >= 0)[:, ::-1]  # (n, 2) ix, iy
    if not len(known):
        return np.empty((0, 2))
    corners = np.stack([known.min(axis=0), known.max(axis=0) + 1])
    return np.asarray((left, low) + resolution * corners, np.float64)


def _speed(axes: Any, run: OpenedRun, topic: str) -> None:
    poses = trajectory(run, topic)
    elapsed_s = np.diff(poses[:, 0])
    moved_m = np.hypot(np.diff(poses[:, 1]), np.diff(poses[:, 2]))
    good = elapsed_s > 0
    if not good.any():
        axes.set(title="speed: too few poses")
        return
    window = max(1, min(5, good.sum()))
    speed_mps = np.convolve(moved_m[good] / elapsed_s[good], np.ones(window) / window, mode="same")
    times_s = poses[1:, 0][good] - run.span_ns[0] / 1e9
    axes.plot(times_s, speed_mps, color="tab:blue", linewidth=0.9, label="driven, from poses")
    if DRIVE in run.topics and run.topics[DRIVE].count:
        table = run.table(DRIVE)
        seconds = _seconds(run, table[TIME])
        axes.plot(seconds, table["v_mps"], color="tab:orange", linewidth=0.8, alpha=0.8, label="commanded")
    axes.set(xlabel="time [s]", ylabel="speed [m/s]", title="speed")
    axes.legend(loc="upper right", fontsize="small")


def _battery(axes: Any, run: OpenedRun, topic: str) -> None:
    table = run.table(topic)
    axes.plot(_seconds(run, table[TIME]), table["voltage"], color="tab:green")
    axes.set(xlabel="time [s]", ylabel="voltage [V]", title="battery")


def _rounds(axes: Any, run: OpenedRun) -> None:
    """Which slot was asked for, and how old the oldest row was that was known."""
    table = run.table(DECIDED)
    seconds = _seconds(run, table[TIME])
    action = table["action"].astype(np.int64)
    asked = action > 0
    axes.plot(seconds[asked], action[asked] - 1, ".", color="tab:blue", markersize=4, label="slot requested")
    axes.set(xlabel="time [s]", ylabel="task slot", title=f"rounds: {len(table)}, requests: {asked.sum()}")
    axes.set(xlim=(0.0, max(1e-3, float(seconds[-1]))), ylim=(-0.5, max(1, action.max(initial=0)) - 0.5))
    heard = (ages[ages < NEVER_HEARD_MS] for ages in table["row_age_ms"])
    oldest_s = [ages.max() / 1e3 if len(ages) else np.nan for ages in heard]
    axes.yaxis.get_major_locator().set_params(integer=True)
    age = axes.twinx()
    age.plot(seconds, oldest_s, color="tab:gray", linewidth=0.7, alpha=0.8)
    age.set_ylabel("oldest row [s]", color="tab:gray")
    axes.legend(loc="upper right", fontsize="small")


# ---- points ----


def _draw_points(run: OpenedRun, topic: str) -> tuple[Any, str]:
    if topic not in point_topics(run):
        known = ", ".join(point_topics(run)) or "none"
        raise HippomatError(f"{run.name}: {topic} holds no scans or clouds; topics that do: {known}")
    points, frame = points_of(run, topic)
    drawn = points[:: max(1, -(-len(points) // MOST_DRAWN))]
    drawn = drawn[np.argsort(drawn[:, 2])]  # the higher ones on top
    edge = np.quantile(drawn[:, :2], [0.002, 0.998], axis=0)
    wide_m, high_m = np.maximum(edge[1] - edge[0], 1e-3)
    shape = float(np.clip(high_m / wide_m, 0.4, 2.0))
    inches = 8.0 / max(1.0, shape) + 2.0, 8.0 * min(1.0, shape)
    figure = new_figure(inches, layout="constrained")
    axes = figure.subplots()
    low, high = np.quantile(drawn[:, 2], [0.02, 0.98])
    flat = high - low < 1e-6
    shade = {"c": "black"} if flat else {"c": drawn[:, 2], "cmap": "viridis", "vmin": low, "vmax": high}
    dots = axes.scatter(drawn[:, 0], drawn[:, 1], s=0.6, linewidths=0, **shade)
    if not flat:
        figure.colorbar(dots, ax=axes, label="z [m]", shrink=0.8)
    margin = 0.05 * max(wide_m, high_m)
    axes.set(xlim=(edge[0, 0] - margin, edge[1, 0] + margin), ylim=(edge[0, 1] - margin, edge[1, 1] + margin))
    axes.set(xlabel="x [m]", ylabel="y [m]", aspect="equal")
    axes.set_title(f"{run.name} {topic}: {len(points):,} points in frame {frame!r}, from above")
    return figure, f"{len(points):,} points of {topic} in frame {frame!r}"
