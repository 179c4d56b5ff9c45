"""The process that closes loops: whatever becomes of it, the map in the making gets an answer."""

from __future__ import annotations

import os
import signal
import sys
import time

import pytest

from hippomat_core.config import Config, SlamConfig
from hippomat_core.errors import ConfigError
from hippomat_core.mapping import first_charting
from hippomat_host.advice import Given
from hippomat_host.loop_solver import LoopSolver, answered
from hippomat_host.startup import run

CHARTING = first_charting(Config(slam=SlamConfig(mode="map")))
PATIENCE_S = 60.0


@pytest.fixture
def solver():
    solver = LoopSolver()
    yield solver
    solver.close()


def answer(solver):
    until_s = time.monotonic() + PATIENCE_S
    while time.monotonic() < until_s:
        told = solver.answer(7)
        if told is not None:
            return told
        time.sleep(0.02)
    raise AssertionError(f"no answer in {PATIENCE_S:g} s")


def test_a_solver_that_ended_says_so_once_and_the_next_question_finds_a_new_one(solver):
    first = solver.pid
    os.kill(first, signal.SIGSTOP)  # so that it cannot answer
    solver.ask(CHARTING)
    os.kill(first, signal.SIGKILL)
    told = answer(solver)
    assert "the solver ended" in told.text
    assert not len(told.poses)
    assert solver.answer(8) is None
    solver.ask(CHARTING)
    assert solver.pid != first
    assert "the solver ended" not in answer(solver).text


def test_a_solver_that_ended_before_it_was_asked_is_replaced_unnoticed(solver):
    first = solver.pid
    os.kill(first, signal.SIGKILL)
    os.waitid(os.P_PID, first, os.WEXITED | os.WNOWAIT)
    assert solver.answer(7) is None
    solver.ask(CHARTING)
    assert "the solver ended" not in answer(solver).text


def test_whatever_goes_wrong_while_loops_are_closed_is_an_answer():
    broken = CHARTING.mapper.graph
    solution, text = answered(broken, 0, None)  # type: ignore[arg-type]
    assert solution is None
    assert "Error" in text


def test_mapping_without_gtsam_is_refused_at_the_start_with_the_command_that_installs_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "gtsam", None)
    given = Given(radio="/dev/none")
    with pytest.raises(ConfigError, match=r"pip install 'hippomat\[slam\]'"):
        run(Config(slam=SlamConfig(mode="map")), given, None)
