"""Whole logs of a made-up fleet on disk: radio traffic, a map and poses, under wrong clocks."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from radio_traffic_lab import YEAR_S, Air, Clock, Robot, ToldRun, fleet

from hippomat_core import messages as m
from hippomat_core.config import Config, FleetConfig, RobotConfig
from hippomat_logs.manifest import run_manifest
from hippomat_logs.part import END_METADATA, RECOVERY_METADATA, PartWriter, our_channels
from hippomat_logs.reader import reading_store
from hippomat_logs.records import DropRecord
from hippomat_logs.schema import TOPICS
from hippomat_logs.sink import file_sinks
from hippomat_logs.walk import RawMessage

ROBOTS = [
    Robot(Clock(30 * YEAR_S * 10**9, 40.0)),
    Robot(Clock(40 * YEAR_S * 10**9, -50.0)),
    Robot(Clock(50 * YEAR_S * 10**9, 20.0), reboots_s=(4.0,)),
]
ROOM = m.MapReceived(0, 1, 4, 3, 0.5, 0.0, 0.0, np.zeros(12, np.int8))


def write_fleet(directory: Path, robots: Sequence[Robot] = ROBOTS, seconds: float = 8.0, **air: Any) -> None:
    """One log per robot in `directory`."""
    for run in fleet(robots, seconds, 1, Air(**air)):
        write_log(directory, with_views(run), run.robot)


def with_views(run: ToldRun) -> list[RawMessage]:
    """A map at first, and a pose behind every tenth radio record; numbered anew."""
    store, made = reading_store(), [(run.told[0].log_time_ns, TOPICS[m.MapReceived], ROOM)]
    rows: list[tuple[int, str, bytes]] = [(at, topic, store.encode(room)) for at, topic, room in made]
    for k, raw in enumerate(run.told):
        rows.append((raw.log_time_ns, raw.topic, raw.data))
        if k % 10 == 0:
            pose = m.PoseEstimated(0.01 * k, 0.5 * run.robot, 0.1, 0.0, 0.0, "odometry")
            rows.append((raw.log_time_ns, TOPICS[m.PoseEstimated], store.encode(pose)))
    return [RawMessage(number, *row) for number, row in enumerate(rows, 1)]


def dropping(messages: Sequence[RawMessage], first: int, last: int) -> list[RawMessage]:
    """The same with a drop record in the place of records first..last."""
    drop = reading_store().encode(DropRecord(first, last, "queue full"))
    kept = [raw for raw in messages if not first <= raw.number <= last]
    kept.append(RawMessage(last, messages[last - 1].log_time_ns, TOPICS[DropRecord], drop))
    return sorted(kept, key=lambda raw: raw.number)


def write_log(
    directory: Path, messages: Sequence[RawMessage], robot: int, session: str = "", recovered: bool = False
) -> Path:
    directory.mkdir(parents=True, exist_ok=True)
    config = Config(fleet=FleetConfig(size=5, task_slots=4), robot=RobotConfig(id=robot))
    session = session or f"5e5510{robot % 100:02d}"
    manifest = run_manifest(config, session_id=session)
    manifest |= {"wall_offset_ns": "0", "started_ns": str(messages[0].log_time_ns), "first_record": "1"}
    manifest |= {"recovered": "yes"} if recovered else {}
    name = f"robot{robot:02d}_{session}_000.mcap"
    writer = PartWriter(
        file_sinks(directory)(name), manifest, our_channels(reading_store()), {"map.yaml": b"x"}
    )
    for raw in messages:
        writer.add(raw.topic, raw.number, raw.log_time_ns, raw.data)
    if recovered:
        writer.finish(RECOVERY_METADATA, {"damage": "cut"})
    else:
        writer.finish(END_METADATA, {"last_record": str(messages[-1].number), "final": "yes"})
    return directory / name


def moved(robots: Sequence[Robot], **changes: Any) -> list[Robot]:
    return [dataclasses.replace(robot, **changes) for robot in robots]
