"""Trains the runs that the tables miss, one after another; each goes on where it was interrupted."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from rich.console import Console

from hippomat_sim.learn.checkpoint import FILE_NAME
from hippomat_sim.learn.curves import draw_curves
from hippomat_sim.learn.export import exported_policy, write_policy
from hippomat_sim.learn.interrupt import Interrupt
from hippomat_sim.learn.pool_bar import make_pool_shown
from hippomat_sim.learn.runs import POLICY_NAME, Run
from hippomat_sim.learn.train_command import device_of
from hippomat_sim.learn.train_settings import TrainSettings
from hippomat_sim.learn.train_view import TrainView
from hippomat_sim.learn.training import Training
from hippomat_sim.learn.world_pool import WorldPool


def train_missing(runs: Sequence[Run], directory: Path, agent_steps: int | None, console: Console) -> None:
    """Writes every run's policy and curves; KeyboardInterrupt after Ctrl-C, with a checkpoint written.

    agent_steps: of each run, instead of its preset's.
    """

    def pool(settings: TrainSettings) -> WorldPool:
        return make_pool_shown(settings.environment.world, "train", console)

    for number, run in enumerate(runs, start=1):
        console.print(f"training {number} of {len(runs)}: {run.name}", markup=False, highlight=False)
        folder, device = directory / run.name, device_of("auto")
        if (folder / FILE_NAME).is_file():
            training = Training.resumed(folder, pool, device)
        else:
            settings = run.settings(agent_steps)
            training = Training(settings, pool(settings), folder, device)
        _train(training, console)


def _train(training: Training, console: Console) -> None:
    budget, clock = training.settings.budget, training.clock
    with Interrupt() as interrupt, TrainView(console, budget.agent_steps, clock.agent_steps) as view:
        rows = training.run(view.show, lambda: interrupt.asked)
    if interrupt.asked:
        raise KeyboardInterrupt
    draw_curves(training.folder, rows)
    write_policy(exported_policy(training.folder), training.folder / POLICY_NAME)
