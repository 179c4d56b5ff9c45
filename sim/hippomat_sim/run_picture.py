"""The picture of a finished run: what it holds comes from the simulation's truth and the robots' logs."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from hippomat_sim.fleet_run import RunResult
from hippomat_sim.picture import PictureData, draw
from hippomat_sim.run_logs import Completion
from hippomat_sim.run_settings import RunSettings
from hippomat_sim.world import WALL


def draw_run(result: RunResult, completed: Sequence[Completion], settings: RunSettings) -> Path:
    """Write ways.png beside the run's logs."""
    picture = result.out / "ways.png"
    draw(_data(result, completed, settings), picture)
    return picture


def about(settings: RunSettings) -> str:
    """The run in a few words."""
    robots = "one robot" if settings.robots == 1 else f"{settings.robots} robots"
    loss = f"{100 * settings.loss:g} % of frames lost"
    return f"{robots}, {settings.tasks} task slots, {settings.seconds:g} s, {loss}"


def _data(result: RunResult, completed: Sequence[Completion], settings: RunSettings) -> PictureData:
    return PictureData(
        result.grid,
        result.truth,
        [(one.robot, one.x_m, one.y_m) for one in completed],
        _contact_places(result),
        result.config.robot.radius_m,
        f"{len(completed)} tasks completed, {len(result.contacts)} contacts",
        f"{about(settings)}; map {settings.map_yaml.stem}, seed {settings.seed}",
    )


def _contact_places(result: RunResult) -> list[tuple[float, float]]:
    """Where the contacts were: between two robots, or at the robot that touched a wall."""
    places = []
    for contact in result.contacts:
        moment = int(np.searchsorted(result.truth_us, contact.start_s * 1e6))
        poses = result.truth[min(moment, len(result.truth) - 1)]
        touching = [contact.robot] if contact.other == WALL else [contact.robot, contact.other]
        x, y = poses[touching, :2].mean(axis=0).tolist()
        places.append((x, y))
    return places
