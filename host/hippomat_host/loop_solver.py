"""Loops of a map in the making are closed in a process of its own: it may take seconds, the robot goes on.

Takes snapshots, gives events; decides nothing about the map. The process ends when its pipe does, so a daemon
that was killed leaves none behind.
"""

from __future__ import annotations

import contextlib
import os
import signal
from multiprocessing import get_context
from multiprocessing.connection import Connection

from hippomat_core.errors import HippomatError
from hippomat_core.mapping import Charting, answer_of, failed_answer
from hippomat_core.messages import LoopsClosed
from hippomat_core.slam.loop_closing import close_loops
from hippomat_core.slam.mapper import MapperSettings
from hippomat_core.slam.pose_graph import PoseGraph
from hippomat_core.slam.solution import Solution

END_S = 1.0
Question = tuple[PoseGraph, int, MapperSettings]
Answer = tuple[Solution | None, str]


class LoopSolver:
    """One question at a time; close() when done."""

    def __init__(self) -> None:
        self._asked = False
        self._begin()

    @property
    def pid(self) -> int:
        """Of the process; another one after it ended."""
        assert self._process.pid is not None
        return self._process.pid

    def ask(self, charting: Charting) -> None:
        """Close the loops of this map."""
        if not self._process.is_alive():
            self.close()
            self._begin()
        mapper = charting.mapper
        self._asked = True
        with contextlib.suppress(OSError):  # it died just now: answer() says so
            self._pipe.send((mapper.graph, mapper.epoch, mapper.settings))

    def answer(self, now_ns: int) -> LoopsClosed | None:
        """The answer, once it is there; that there will be none, too."""
        if not self._asked:
            return None
        try:
            if not self._pipe.poll():
                return None
            solution, text = self._pipe.recv()
        except (OSError, EOFError):
            self._process.join(END_S)
            solution, text = None, f"the solver ended (exit code {self._process.exitcode})"
        self._asked = False
        return failed_answer(text, now_ns) if solution is None else answer_of(solution, now_ns)

    def close(self) -> None:
        """End the process."""
        self._pipe.close()
        self._process.join(END_S)
        if self._process.is_alive():
            self._process.terminate()

    def _begin(self) -> None:
        context = get_context("spawn")
        self._pipe, theirs = context.Pipe()
        self._process = context.Process(target=_serve, args=(theirs,), name="hippomat loops", daemon=True)
        self._process.start()
        theirs.close()


def _serve(pipe: Connection) -> None:
    """The process: question in, answer out, until nobody asks any more."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is the daemon's to hear
    with contextlib.suppress(OSError):
        os.nice(10)  # the robot's loop goes first
    with contextlib.suppress(EOFError, OSError):
        while True:
            question: Question = pipe.recv()
            pipe.send(answered(*question))


def answered(graph: PoseGraph, epoch: int, settings: MapperSettings) -> Answer:
    """Loops closed, or why not: the mapping goes on either way."""
    try:
        return close_loops(graph, epoch, settings), ""
    except HippomatError as error:
        return None, str(error)
    except Exception as error:  # GTSAM raises RuntimeError for what it cannot solve, and more
        return None, f"{type(error).__name__}: {error}"
