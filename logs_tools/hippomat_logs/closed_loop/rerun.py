"""Run a plan again, seed by seed, in processes beside each other; what comes back are figures.

The simulator is found through the entry-point group of level L3; this file never imports it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from importlib.metadata import entry_points

from hippomat_core.errors import HippomatError
from hippomat_logs.closed_loop.figures import Values, values_of
from hippomat_logs.closed_loop.plan import FleetPlan, FleetWorld
from hippomat_logs.each_file import WORTH_A_PROCESS_BYTES, each_item
from hippomat_logs.level3 import GROUP
from hippomat_logs.metrics import FleetMetrics, MetricsReading
from hippomat_logs.metrics.robot import Stamped


def fleet_world() -> FleetWorld:
    """The installed simulator's; HippomatError says what to install where there is none."""
    problem = "no simulator is installed"
    for kind in entry_points(group=GROUP):
        try:
            world: FleetWorld | None = getattr(kind.load(), "closed_loop", None)
        except (ImportError, AttributeError) as error:
            problem = f"{kind.value} cannot be loaded: {error}"
            continue
        if world is not None:
            return world
        problem = f"{kind.value} runs no whole fleets"
    raise HippomatError(f"a closed loop needs a simulator, but {problem}: pip install 'hippomat[sim]'")


def rerun(plan: FleetPlan, seed: int) -> Values:
    """One re-run's figures."""
    return values_of(rerun_metrics(plan, seed))


def rerun_metrics(plan: FleetPlan, seed: int) -> FleetMetrics:
    """The same with everything that metrics have; all robots share one clock."""
    readings = {
        robot.config.robot.id: MetricsReading(robot.config.robot.id, robot.config) for robot in plan.robots
    }

    def sink(robot: int, record: Stamped) -> None:
        readings[robot].feed(record)

    fleet_world()(plan, seed, sink)
    return FleetMetrics([reading.result() for reading in readings.values()])


@dataclass(frozen=True, slots=True)
class _Job:
    plan: int
    seed: int


def rerun_all(plans: Sequence[FleetPlan], seeds: Sequence[int], label: str) -> list[list[Values]]:
    """Figures by plan and seed; a progress bar on the terminal."""
    jobs = [_Job(plan, seed) for seed in seeds for plan in range(len(plans))]
    size = WORTH_A_PROCESS_BYTES if len(jobs) > 1 else 0
    found = dict(zip(jobs, each_item(jobs, partial(_do, tuple(plans)), label, size), strict=True))
    return [[found[_Job(plan, seed)] for seed in seeds] for plan in range(len(plans))]


def _do(plans: tuple[FleetPlan, ...], job: _Job) -> Values:
    return rerun(plans[job.plan], job.seed)
