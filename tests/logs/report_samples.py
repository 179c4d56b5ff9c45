"""Logs of robots that drive in circles and serve tasks: what a report can show, without a simulator."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
from log_samples import START_NS, WALL_NS
from recorded_run import room

from hippomat_core import messages as m
from hippomat_core.config import Config, FleetConfig, RobotConfig
from hippomat_core.wire import frames
from hippomat_logs.manifest import run_manifest
from hippomat_logs.recorder import Recorder

SLOTS, SITE_CM = 6, 100
REQUESTED, CONFIRMED, SERVED_FROM, COMPLETED = 10, 13, 30, 35  # rounds of every robot's one claim
CHANGES = {REQUESTED: "requested", CONFIRMED: "confirmed", COMPLETED: "completed"}
Extra = Callable[[Recorder, int], None]  # at the end of a log; recorder and stamp [ns]


def write_fleet(
    directory: Path,
    robots: int = 3,
    seconds: float = 6.0,
    *,
    with_map: bool = True,
    with_tasks: bool = True,
    host: str = "jetson",
    extra: Extra | None = None,
    wall_ns: int = WALL_NS,
    fleet: int = 1,
) -> None:
    """A log per robot in `directory`: poses and STATEs ten times a second; each hears all the others."""
    for robot in range(robots):
        config = Config(
            fleet=FleetConfig(id=fleet, size=max(robots, 3), task_slots=SLOTS, c_max_s=20.0),
            robot=RobotConfig(id=robot),
        )
        manifest = run_manifest(config, session_id=f"{wall_ns % 10**4:04d}{robot:04d}", extra={"host": host})
        recorder = Recorder(
            directory, manifest, config=config, wall_ns=wall_ns, stamp_ns=START_NS, lossless=True
        )
        recorder.put(START_NS, m.Started(START_NS))
        if with_map:
            recorder.put(START_NS, room())
        for round_ in range(round(seconds * 10)):
            _record_round(recorder, robot, robots, round_, with_tasks)
        if extra is not None:
            extra(recorder, START_NS + round(seconds * 1e9))
        recorder.close()


def pose_of(robot: int, robots: int, at_s: float) -> tuple[float, float, float]:
    """x, y [m], yaw [rad]: all robots on one circle, a turn in 20 s."""
    angle = 2 * math.pi * (robot / robots + at_s / 20)
    return 2.5 + 1.5 * math.cos(angle), 2.5 + 1.5 * math.sin(angle), angle + math.pi / 2


def _record_round(recorder: Recorder, robot: int, robots: int, round_: int, with_tasks: bool) -> None:
    stamp_ns = START_NS + round_ * 100_000_000
    x_m, y_m, yaw_rad = pose_of(robot, robots, round_ / 10)
    recorder.put(stamp_ns, m.RoundEnded(stamp_ns, round_, round_ * 100_000, round_ * 100_000, 0, agreed=True))
    recorder.put(stamp_ns, m.Tick(stamp_ns))
    if with_tasks and round_ == 0:
        for slot in range(SLOTS):
            turned = m.TaskTurned(slot, 0, SITE_CM + 50 * slot, SITE_CM, 0, "start")
            recorder.put(stamp_ns, turned)
    recorder.put(stamp_ns, m.PoseEstimated(x_m, y_m, yaw_rad, 0.2, 0.0, "odometry"))
    claim = _claim(robot, round_) if with_tasks else frames.NO_CLAIM
    if with_tasks and robot < SLOTS and round_ in CHANGES:
        place_m = (SITE_CM + 50 * robot) / 100, SITE_CM / 100, 0.0
        changed = m.ClaimChanged(CHANGES[round_], "as told", robot, 0, 1, 50, round_, *place_m)
        recorder.put(stamp_ns, changed)
    recorder.put(stamp_ns, m.SendState(state_of(robot, robots, round_, claim)))
    for peer in range(robots):
        if peer != robot and (peer + round_) % 5:  # a fifth is lost
            header = frames.Header(frames.STATE, False, 1, peer, 1, round_, round_ * 100_000)
            at_us = round_ * 100_000 + 300
            frame = state_of(peer, robots, round_, frames.NO_CLAIM)
            recorder.put(
                stamp_ns + 300_000, m.StateHeard(stamp_ns + 300_000, at_us, at_us, -50, header, frame)
            )


def _claim(robot: int, round_: int) -> frames.AirClaim:
    """Robot k asks for slot k after 1 s, has it after 1.3 s, serves it from 3 s to 3.5 s."""
    if robot >= SLOTS or not REQUESTED <= round_ < COMPLETED:
        return frames.NO_CLAIM
    place_cm = SITE_CM + 50 * robot
    return frames.AirClaim(robot, 0, 50, REQUESTED, round_ >= CONFIRMED, 1, place_cm, SITE_CM, 0, 0)


def state_of(robot: int, robots: int, round_: int, claim: frames.AirClaim) -> frames.StateFrame:
    x_m, y_m, yaw_rad = pose_of(robot, robots, round_ / 10)
    status = frames.IDLE
    if claim.slot != frames.NO_SLOT:
        status = frames.SERVING if round_ >= SERVED_FROM else frames.ASSIGNED
    blank = np.zeros(SLOTS, np.uint8)
    return frames.StateFrame(
        status, frames.FLAG_LOCALIZED, round(100 * x_m), round(100 * y_m), 0,
        round(yaw_rad / math.tau * 256) % 256, 10, claim, blank, blank + frames.WAITING, 0, 0, 0, blank[:0],
        0, np.zeros(max(robots, 3), np.uint8), 1, 1, 0,
    )  # fmt: skip
