"""A short lockstep run, for the tests that need logs of a fleet whose world is known."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from rich.console import Console
from sim_rooms import box_room

from hippomat_logs.map_files import save_map
from hippomat_sim.lockstep_run import LockstepRun
from hippomat_sim.run_settings import RunSettings
from hippomat_sim.views import PlainView

SECONDS = 8.0  # robots listen for the first four
SEED = 3


def settings(folder: Path, **changes: object) -> RunSettings:
    """Three robots on wheels alone; what decides has no weights, so that tests start fast."""
    save_map(box_room(), folder / "room.yaml")
    (folder / "base.toml").write_text("[fleet]\nallocator = 'hungarian'\n")
    given = {"robots": 3, "tasks": 4, "seconds": SECONDS, "loss": 0.3, "seed": SEED, "slam": False}
    config = folder / "base.toml"
    return RunSettings(folder / "room.yaml", folder / "out", config=config, **{**given, **changes})  # type: ignore[arg-type]


def record(folder: Path, leave_s: Mapping[int, float] | None = None, **changes: object) -> Path:
    """The directory of the logs."""
    run = LockstepRun(settings(folder, **changes), PlainView(Console(quiet=True)), leave_s)
    return run.execute().out / "logs"
