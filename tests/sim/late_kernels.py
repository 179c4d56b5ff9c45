"""Script, wheels, slam or a planner: warm up as the daemon does, run a fleet, tell what is compiled late."""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

from lockstep_lab import settings
from numba.core.registry import CPUDispatcher
from rich.console import Console

from hippomat_core.config import Config, FleetConfig, PlanningConfig
from hippomat_host import warm_up
from hippomat_logs.derived import DerivedTopics
from hippomat_logs.schema import MessageStore
from hippomat_sim.lockstep_run import LockstepRun
from hippomat_sim.views import PlainView


def signatures() -> set[str]:
    """Functions of what a robot runs, with the types that they are compiled for."""
    return {
        f"{one.__module__}.{one.__name__}{types}"
        for name, module in list(sys.modules.items())
        if name.startswith(("hippomat_core", "hippomat_logs"))
        for one in vars(module).values()
        if isinstance(one, CPUDispatcher)
        for types in one.signatures
    }


def main(what: str) -> None:
    has_slam, planner = what == "slam", "replan" if what in ("wheels", "slam") else what
    config = Config(
        fleet=FleetConfig(size=3, task_slots=4, allocator="hungarian"),
        planning=PlanningConfig(planner=planner),
    )
    warm_up.prepare_allocator(config.fleet, None, print)
    warm_up.prepare_control(config, print)
    warm_up.prepare_planner(config.planning, print)
    if has_slam:
        warm_up.prepare_localizer(print)
    DerivedTopics(MessageStore(), config)  # the recorder's
    before = signatures()
    with tempfile.TemporaryDirectory() as folder:
        given = settings(Path(folder), slam=has_slam)
        with (Path(folder) / "base.toml").open("a") as file:
            file.write(f"[planning]\nplanner = '{planner}'\n")
        LockstepRun(given, PlainView(Console(quiet=True))).execute()
    print(*sorted(signatures() - before), sep="\n", file=sys.stderr)


if __name__ == "__main__":
    main(sys.argv[1])
