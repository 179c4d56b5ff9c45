"""A real daemon makes a map while somebody moves the robot; loops are closed beside it; all is replayed."""

from __future__ import annotations

import time

import numpy as np
import psutil
import pytest
from sim_rooms import odd_room

from hippomat_core.messages import BASE, Localized, LoopsClosed, LoopsDue, MapDrawn
from hippomat_logs.reader import Run, open_runs
from hippomat_logs.replay import ReplayOptions, replay_run
from hippomat_logs.report import OK
from hippomat_sim.daemons import Daemon, DaemonOrder, kill_all
from hippomat_sim.simulation import Simulation, SimulationSetup
from hippomat_sim.world_clock import WorldClock

pytest.importorskip("gtsam")

START = (1.0, 1.5, 0.0)
PUSHES = [
    (4.0, 0.3, 0.4),
    (4.0, 0.3, -0.5),
    (5.0, 0.3, 0.9),
    (4.0, 0.0, 1.5),
    (5.0, 0.3, 0.8),
    (4.0, 0.2, 1.2),
]


class Mapping(DaemonOrder):
    """A daemon that is given no map."""

    def command(self) -> list[str]:
        words = super().command()
        at = words.index("--map")
        return [*words[:at], *words[at + 2 :], "--slam"]


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """Half a minute of a robot that is pushed about: its base hears no command but ours."""
    folder = tmp_path_factory.mktemp("mapping")
    simulation = Simulation(SimulationSetup(odd_room(), np.array([START])), folder / "ports")
    clock = WorldClock(folder / "ports" / "clock", 1)
    (folder / "hippomat.toml").write_text("[fleet]\nsize = 1\ntask_slots = 2\nallocator = 'greedy'\n")
    order = Mapping(0, folder / "ports", folder / "hippomat.toml", folder, START, folder / "logs", clock.path)
    daemon = Daemon(order, folder)
    robot = simulation.robots[0]
    began_us, real_s = -1, time.monotonic()
    try:
        while time.monotonic() - real_s < 100.0 and not daemon.died:
            now_us = clock.move([0])
            if began_us < 0 and robot.lidar.scanning:
                began_us = now_us
            push = _push((now_us - began_us) / 1e6 if began_us >= 0 else -1.0)
            if push is None:
                break
            robot.base.command = push
            simulation.advance(now_us)
            for number, port in simulation.wait_for_bytes(0.002):
                if port == BASE:
                    simulation.ports[number][port].read()  # the motors are off
                else:
                    simulation.serve([(number, port)], now_us)
        daemon.interrupt()
        until_s = time.monotonic() + 15.0
        while daemon.exit_code is None and time.monotonic() < until_s:
            now_us = clock.move([])
            simulation.advance(now_us)
            simulation.serve(simulation.wait_for_bytes(0.002), now_us)
        assert daemon.exit_code == 0, daemon.last_words()
    finally:
        kill_all([daemon])
        simulation.close()
        clock.close()
    (found,) = open_runs(sorted((folder / "logs").rglob("*.mcap")))
    return found


def _push(at_s: float) -> tuple[float, float] | None:
    if at_s < 0.0:
        return 0.0, 0.0
    for seconds, v_mps, wz_radps in PUSHES:
        if at_s < seconds:
            return v_mps, wz_radps
        at_s -= seconds
    return None


def records(run: Run, kind: type) -> list[object]:
    return [record.message for record in run.records_in_order((kind,))]


def test_every_sweep_goes_into_the_map_and_maps_are_drawn(run: Run) -> None:
    phases = [one.phase for one in records(run, Localized) if isinstance(one, Localized)]
    assert len(phases) > 60
    assert phases.count("mapping") > 0.95 * len(phases)
    last = [one for one in records(run, MapDrawn) if isinstance(one, MapDrawn)][-1]
    assert last.keyframes > 20
    assert (last.cells == 100).sum() > 150


def test_loops_are_closed_by_a_process_beside_the_daemon(run: Run) -> None:
    assert records(run, LoopsDue)
    answers = [one for one in records(run, LoopsClosed) if isinstance(one, LoopsClosed)]
    assert answers
    assert answers[0].text == ""
    assert answers[0].epoch == 1


def test_the_run_is_reproduced_with_the_recorded_answers(run: Run) -> None:
    report = replay_run(run, ReplayOptions(levels=("L0", "L2", "daemon")))
    found = [(one.level, one.status, one.divergence) for one in report.results]
    assert found == [(level, OK, None) for level in ("L0", "L2", "daemon")]


def test_nothing_of_it_is_left_running(run: Run) -> None:
    folder = str(run.paths[0].parent.parent)
    until_s = time.monotonic() + 5.0
    while time.monotonic() < until_s:
        names = [" ".join(process.info["cmdline"] or []) for process in psutil.process_iter(["cmdline"])]
        if not any(folder in name for name in names):
            break
        time.sleep(0.1)
    assert not any(folder in name for name in names)
