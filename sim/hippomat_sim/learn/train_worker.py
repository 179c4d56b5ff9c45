"""A process that trains one run for another process, and says through a pipe how far it is and how it ended.

Whatever can be read from the pipe asks it to stop after the update under way, with a checkpoint: a word of
the other process, or that it is gone.
"""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from multiprocessing import get_context
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from pathlib import Path

from hippomat_core.errors import HippomatError
from hippomat_sim.learn.interrupt import Interrupt
from hippomat_sim.learn.runs import Run
from hippomat_sim.learn.train_run import finish, training_of
from hippomat_sim.learn.train_settings import TrainSettings
from hippomat_sim.learn.train_view import Row, evaluation_text
from hippomat_sim.learn.world_pool import WorldPool, make_pool


@dataclass(frozen=True, slots=True)
class Finished:
    """The policy is written. minutes: of the whole run. evaluation: the last one."""

    minutes: float
    evaluation: str


@dataclass(frozen=True, slots=True)
class Stopped:
    """The checkpoint is written, or nothing was done yet."""


@dataclass(frozen=True, slots=True)
class Failed:
    """error: what to tell the user."""

    error: HippomatError


LastWord = Finished | Stopped | Failed


@dataclass(frozen=True, slots=True)
class Worker:
    """As the other process has it."""

    run: Run
    process: BaseProcess
    pipe: Connection

    def ask_to_stop(self) -> None:
        with suppress(BrokenPipeError):  # it has ended, which its pipe says too
            self.pipe.send(None)

    def hear(self) -> int | LastWord:
        """Its agent steps so far, or its last word; one that died without has failed."""
        try:
            said: int | LastWord = self.pipe.recv()
        except (EOFError, OSError):
            self.process.join()
            return self._without_a_word()
        return said

    def _without_a_word(self) -> LastWord:
        code = self.process.exitcode or 0
        if code == 0:  # a second Ctrl-C
            return Stopped()
        how = f"by {signal.Signals(-code).name}" if code < 0 else f"with exit code {code}"
        return Failed(
            HippomatError(
                f"training {self.run.name}: its process was ended {how}: start again, it goes on from its "
                "checkpoint; take fewer --jobs if memory ran out"
            )
        )


def start_worker(run: Run, directory: Path, agent_steps: int | None) -> Worker:
    """Begins to train the run in a process of its own."""
    context = get_context("spawn")
    ours, its = context.Pipe()
    process = context.Process(target=_work, args=(run, directory, agent_steps, its), daemon=True)
    with _sigint_ignored():
        process.start()
    its.close()  # so that its death ends the pipe
    return Worker(run, process, ours)


@contextmanager
def _sigint_ignored() -> Iterator[None]:
    """Processes that start inside ignore Ctrl-C, which reaches them too, until they are ready for it."""
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def _work(run: Run, directory: Path, agent_steps: int | None, pipe: Connection) -> None:
    with Interrupt() as interrupt, suppress(KeyboardInterrupt):
        word = _last_word(run, directory, agent_steps, pipe, lambda: interrupt.asked or pipe.poll())
        with suppress(BrokenPipeError):  # nobody is left to be told
            pipe.send(word)


def _last_word(
    run: Run, directory: Path, agent_steps: int | None, pipe: Connection, stop: Callable[[], bool]
) -> LastWord:
    try:
        return _trained(run, directory, agent_steps, pipe, stop)
    except HippomatError as error:
        return Failed(error)
    except Exception as error:
        said = f"training {run.name}: {type(error).__name__}: {error} (--jobs 1 shows where)"
        return Failed(HippomatError(said))


def _trained(
    run: Run, directory: Path, agent_steps: int | None, pipe: Connection, stop: Callable[[], bool]
) -> LastWord:
    if stop():
        return Stopped()

    def pool(settings: TrainSettings) -> WorldPool:
        return make_pool(settings.environment.world, "train")

    def show(row: Row) -> None:
        with suppress(BrokenPipeError):  # stop() says so after the next update
            pipe.send(row["agent_steps"])

    training = training_of(run, directory, agent_steps, pool)
    rows = training.run(show, stop)
    if not training.done:
        return Stopped()
    finish(training, rows)
    spent_s = training.clock.collect_s + training.clock.learn_s
    return Finished(spent_s / 60.0, evaluation_text(training.evaluation))
