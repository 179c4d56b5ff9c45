"""One of the named runs: begun or gone on with, and what is left behind when it has ended."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from hippomat_sim.learn.checkpoint import FILE_NAME
from hippomat_sim.learn.curves import draw_curves
from hippomat_sim.learn.export import exported_policy, write_policy
from hippomat_sim.learn.runs import POLICY_NAME, Run
from hippomat_sim.learn.train_command import device_of
from hippomat_sim.learn.train_settings import TrainSettings
from hippomat_sim.learn.training import Training
from hippomat_sim.learn.world_pool import WorldPool


def training_of(
    run: Run, directory: Path, agent_steps: int | None, pool: Callable[[TrainSettings], WorldPool]
) -> Training:
    """Where its checkpoint left it, where there is one. agent_steps: instead of its preset's."""
    folder, device = directory / run.name, device_of("auto")
    if (folder / FILE_NAME).is_file():
        return Training.resumed(folder, pool, device)
    settings = run.settings(agent_steps)
    return Training(settings, pool(settings), folder, device)


def finish(training: Training, rows: Sequence[dict[str, Any]]) -> None:
    """Writes curves and policy. rows: all of the run's."""
    draw_curves(training.folder, rows)
    write_policy(exported_policy(training.folder), training.folder / POLICY_NAME)
