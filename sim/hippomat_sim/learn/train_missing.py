"""Trains the runs that the tables miss, one after another or several at once.

Each goes on where it was interrupted.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from rich.console import Console

from hippomat_sim.learn.interrupt import Interrupt
from hippomat_sim.learn.pool_bar import make_pool_shown
from hippomat_sim.learn.runs import Run
from hippomat_sim.learn.train_run import finish, training_of
from hippomat_sim.learn.train_settings import TrainSettings
from hippomat_sim.learn.train_several import train_several
from hippomat_sim.learn.train_view import TrainView
from hippomat_sim.learn.training import Training
from hippomat_sim.learn.world_pool import WorldPool


def train_missing(
    runs: Sequence[Run], directory: Path, agent_steps: int | None, console: Console, jobs: int = 1
) -> None:
    """Writes every run's policy and curves; KeyboardInterrupt after Ctrl-C, with a checkpoint written.

    agent_steps: of each run, instead of its preset's. jobs: processes, one run each; 1: none but this one.
    """
    if min(jobs, len(runs)) > 1:
        train_several(runs, directory, agent_steps, console, jobs)
        return

    def pool(settings: TrainSettings) -> WorldPool:
        return make_pool_shown(settings.environment.world, "train", console)

    for number, run in enumerate(runs, start=1):
        console.print(f"training {number} of {len(runs)}: {run.name}", markup=False, highlight=False)
        _train(training_of(run, directory, agent_steps, pool), console)


def _train(training: Training, console: Console) -> None:
    budget, clock = training.settings.budget, training.clock
    with Interrupt() as interrupt, TrainView(console, budget.agent_steps, clock.agent_steps) as view:
        rows = training.run(view.show, lambda: interrupt.asked)
    if interrupt.asked:
        raise KeyboardInterrupt
    finish(training, rows)
