"""The world's clock: never faster than real time, never far ahead of a daemon, refused by real devices."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import pytest

from hippomat_core.errors import HippomatError
from hippomat_host import clock as daemons_clock
from hippomat_sim import clock_errors
from hippomat_sim.clock_errors import draw_clock_errors
from hippomat_sim.world_clock import AHEAD_US, STEP_US, VARIABLE, WORDS, WorldClock


@pytest.fixture
def clock(tmp_path: Path) -> WorldClock:
    return WorldClock(tmp_path / "clock", 2)


def moved(clock: WorldClock, robots: list[int], times: int) -> int:
    for _ in range(times):
        time.sleep(0.002)
        clock.move(robots)
    return clock.now_us


def test_time_goes_on_and_is_never_ahead_of_real_time(clock: WorldClock) -> None:
    before = clock.now_us
    now_us = moved(clock, [], 20)
    assert before < now_us <= clock.real_s * 1e6


def test_a_world_that_slept_moves_one_step_and_does_not_jump(clock: WorldClock) -> None:
    clock.move([])
    time.sleep(0.2)
    before = clock.now_us
    assert clock.move([]) - before <= STEP_US


def test_the_world_waits_for_the_slowest_daemon_and_goes_on_with_it(
    clock: WorldClock, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(VARIABLE, str(clock.path))
    monkeypatch.setattr(daemons_clock, "_words", None)
    pseudo_terminal = "/dev/pts/0"
    assert daemons_clock.adopt([pseudo_terminal])
    start_ns = daemons_clock.now()
    daemons_clock.acted(0, start_ns)
    daemons_clock.acted(1, start_ns + 10**9)
    stuck_us = moved(clock, [0, 1], 120)
    assert stuck_us <= AHEAD_US + STEP_US
    assert daemons_clock.now() == clock.start_ns + stuck_us * 1000
    daemons_clock.acted(0, start_ns + 10**9)
    assert moved(clock, [0, 1], 20) > stuck_us
    assert moved(clock, [1], 1) >= stuck_us


def test_a_robot_with_a_real_device_refuses_a_simulators_clock(
    clock: WorldClock, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(VARIABLE, str(clock.path))
    with pytest.raises(HippomatError, match="/dev/ttyACM0 is no simulated device"):
        daemons_clock.adopt(["/dev/pts/0", "/dev/ttyACM0"])


def test_what_is_no_clock_is_refused_by_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(VARIABLE, str(tmp_path / "nothing"))
    with pytest.raises(HippomatError, match=VARIABLE):
        daemons_clock.adopt(["/dev/pts/0"])


def test_without_a_simulator_the_clock_is_the_machines(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(VARIABLE, raising=False)
    monkeypatch.setattr(daemons_clock, "_words", None)
    assert not daemons_clock.adopt(["/dev/ttyACM0"])
    before_ns = time.monotonic_ns()
    assert before_ns <= daemons_clock.now() <= time.monotonic_ns()


def test_simulator_and_daemon_agree_on_the_file() -> None:
    assert (VARIABLE, WORDS) == (daemons_clock.VARIABLE, daemons_clock.WORDS)
    assert clock_errors.VARIABLE == daemons_clock.ERROR_VARIABLE


def test_a_daemon_with_a_wrong_clock_sees_the_time_that_the_simulator_says_it_does(
    clock: WorldClock, monkeypatch: pytest.MonkeyPatch
) -> None:
    (error, other) = draw_clock_errors(2, years=10, ppm=50, seed=3)
    monkeypatch.setenv(VARIABLE, str(clock.path))
    monkeypatch.setenv(daemons_clock.ERROR_VARIABLE, error.text)
    for name in ("_words", "_ahead_ns", "_drift_ppb", "_wall_ahead_ns"):
        monkeypatch.setattr(daemons_clock, name, getattr(daemons_clock, name))
    assert daemons_clock.adopt(["/dev/pts/0"])
    now_ns = daemons_clock.now()
    assert (
        now_ns == error.own_ns(np.array([clock.start_ns]))[0] != other.own_ns(np.array([clock.start_ns]))[0]
    )
    assert abs(daemons_clock.wall_ns() - time.time_ns() - error.wall_ahead_ns) < 10**9
    daemons_clock.acted(0, now_ns)
    assert abs(clock._words[1] - clock.start_ns) <= 1


def test_a_clock_error_that_is_none_is_refused_by_name(
    clock: WorldClock, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(VARIABLE, str(clock.path))
    monkeypatch.setenv(daemons_clock.ERROR_VARIABLE, "50 ppm")
    monkeypatch.setattr(daemons_clock, "_words", None)
    with pytest.raises(HippomatError, match="HIPPOMAT_CLOCK_ERROR=50 ppm: is not AHEAD_NS"):
        daemons_clock.adopt(["/dev/pts/0"])
