"""Several training runs at once, each in a process of its own, which changes no weights (on a CPU)."""

from __future__ import annotations

from collections.abc import Sequence
from multiprocessing.connection import Connection, wait
from pathlib import Path

from rich.console import Console
from rich.progress import TextColumn

from hippomat_core.errors import HippomatError
from hippomat_sim.learn.checkpoint import FILE_NAME
from hippomat_sim.learn.interrupt import Interrupt
from hippomat_sim.learn.pool_bar import make_pool_shown
from hippomat_sim.learn.runs import Run
from hippomat_sim.learn.train_view import StepsBar
from hippomat_sim.learn.train_worker import Failed, Finished, LastWord, Worker, start_worker
from hippomat_sim.learn.training_log import read_metrics

_LOOK_S = 0.2  # how often Ctrl-C is looked for
_END_S = 30.0  # after its last word


def train_several(
    runs: Sequence[Run], directory: Path, agent_steps: int | None, console: Console, jobs: int
) -> None:
    """Trains at most `jobs` runs at a time, the longest first; see train_missing.

    When one fails the others stop with a checkpoint, and then its error is raised.
    """
    settings = {run: run.settings(agent_steps) for run in runs}
    for world in dict.fromkeys(one.environment.world for one in settings.values()):
        make_pool_shown(world, "train", console)  # once, instead of in every process at the same time
    totals = {run: one.budget.agent_steps for run, one in settings.items()}
    with Interrupt() as interrupt, _View(console, totals, directory) as view:
        crew = _Crew(directory, agent_steps, view, jobs)
        crew.train(sorted(runs, key=lambda run: -totals[run]), interrupt)
    if crew.error is not None:
        raise crew.error
    if crew.stopping or interrupt.asked:
        raise KeyboardInterrupt


class _Crew:
    """The workers of now. error: the first one. stopping: nobody begins any more."""

    def __init__(self, directory: Path, agent_steps: int | None, view: _View, jobs: int) -> None:
        self._directory, self._agent_steps, self._view, self._jobs = directory, agent_steps, view, jobs
        self._workers: dict[Connection, Worker] = {}
        self.error: HippomatError | None = None
        self.stopping = False

    def train(self, runs: Sequence[Run], interrupt: Interrupt) -> None:
        """Until all have ended, or those that were under way have stopped."""
        waiting = list(runs)
        try:
            while self._workers or (waiting and not self.stopping):
                while waiting and not self.stopping and len(self._workers) < self._jobs:
                    worker = start_worker(waiting.pop(0), self._directory, self._agent_steps)
                    self._workers[worker.pipe] = worker
                for pipe in wait(list(self._workers), _LOOK_S):
                    self._hear(self._workers[pipe])  # type: ignore[index]
                if interrupt.asked:
                    self._stop()
        finally:  # a second Ctrl-C waits for nobody
            for worker in self._workers.values():
                worker.process.kill()

    def _hear(self, worker: Worker) -> None:
        said = worker.hear()
        if isinstance(said, int):
            self._view.show(worker.run, said)
            return
        del self._workers[worker.pipe]
        worker.process.join(_END_S)
        worker.process.kill()  # one that hangs on its way out holds nobody up
        worker.pipe.close()
        self._ended(worker.run, said)

    def _ended(self, run: Run, word: LastWord) -> None:
        if isinstance(word, Finished):
            self._view.finished(run, word)
            return
        if isinstance(word, Failed):
            self.error = self.error or word.error
        self._stop()

    def _stop(self) -> None:
        if not self.stopping:
            self.stopping = True
            for worker in self._workers.values():
                worker.ask_to_stop()


class _View(StepsBar):
    """Of all runs together. totals: the agent steps of each."""

    def __init__(self, console: Console, totals: dict[Run, int], directory: Path) -> None:
        super().__init__(console, sum(totals.values()), TextColumn("{task.description}"))
        self._totals, self._ended = totals, 0
        self._steps = {run: _steps_of(directory / run.name) for run in totals}
        self._update()

    def show(self, run: Run, agent_steps: int) -> None:
        self._steps[run] = agent_steps
        self._update()

    def finished(self, run: Run, word: Finished) -> None:
        self._steps[run] = self._totals[run]
        self._ended += 1
        self._say(f"trained {run.name}: {word.minutes:.1f} minutes, {word.evaluation}")
        self._update()

    def _update(self) -> None:
        done = sum(min(steps, self._totals[run]) for run, steps in self._steps.items())
        self._progress.update(
            self._task,
            completed=done,
            description=f"trained {self._ended} of {len(self._totals)} runs",
            figures=f"{done:,} agent steps",
        )


def _steps_of(folder: Path) -> int:
    """Of a run that was interrupted, before its process has said so; else 0."""
    rows = read_metrics(folder) if (folder / FILE_NAME).is_file() else []
    return int(rows[-1]["agent_steps"]) if rows else 0
