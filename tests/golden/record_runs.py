"""Record the golden runs anew: simulated robots, their logs without what no replay needs.

Wanted where the log's format or what is heard changed, so that old events say nothing any more; for changed
decisions `hippomat-replay tests/golden/runs --update-golden` keeps the events. Run by `make golden`.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from rich.console import Console
from safetensors.numpy import save

from hippomat_core.allocation.paper_network import expected_shapes
from hippomat_core.errors import HippomatError
from hippomat_logs.golden import write_expected
from hippomat_logs.golden_command import blessing_of
from hippomat_logs.reader import open_runs
from hippomat_logs.redecide import write_condensed
from hippomat_sim.lockstep_run import LockstepRun
from hippomat_sim.maps.demo_room import DEMO_ROOM
from hippomat_sim.run_settings import Carried, RunSettings
from hippomat_sim.views import PlainView

HERE = Path(__file__).parent / "runs"
NEAR_SIGHTED = "[lidar]\nmax_range_m = 0.7\n"  # enough for the guard; far walls are most bytes of a log


@dataclass(frozen=True, slots=True)
class WithDaemons:
    """In real time, with the jitter of a computer that is not alone."""

    name: str
    arguments: str


@dataclass(frozen=True, slots=True)
class InLockstep:
    """The same records on every recording. kept: robots whose logs are kept; the others are only heard."""

    name: str
    toml: str
    robots: int
    tasks: int
    seconds: float
    seed: int
    loss: float
    kept: tuple[int, ...]
    leave_s: Mapping[int, float] = field(default_factory=dict)
    carried: tuple[Carried, ...] = ()
    weights: bytes = b""  # as WEIGHTS, which its toml names


WEIGHTS = "golden.safetensors"
DECIDED_BY = "decided_by_"


def decided_by(allocator: str, kept: int, weights: bytes = b"") -> InLockstep:
    """One request or more of one robot, and no more than that: robots listen for 4 s before their first.

    kept: the robot whose decisions are other allocators' least.
    """
    policy = f'policy = "{WEIGHTS}"\n' if weights else ""
    return InLockstep(
        DECIDED_BY + allocator,
        f'[lidar]\nmax_range_m = 0.5\n[fleet]\nallocator = "{allocator}"\n{policy}dwell_s = 0.3\n',
        robots=3, tasks=3, seconds=5.5, seed=4, loss=0.1, kept=(kept,), weights=weights,
    )  # fmt: skip


def drawn_weights(tasks: int) -> bytes:
    """Of the paper's network, trained for nothing: eighths, so that no two logits are nearly equal."""
    drawn = np.random.default_rng(1)
    shapes = expected_shapes(tasks).items()
    return save({key: (drawn.integers(-2, 3, shape) / 8).astype(np.float32) for key, shape in shapes})


RUNS = (
    WithDaemons("three_wheels", "--robots 3 --tasks 4 --seconds 15 --loss 0.3 --seed 11 --no-slam"),
    # Pushed aside before it starts; once it has completed a task it is carried to where the room looks alike.
    WithDaemons(
        "one_slam",
        "--robots 1 --tasks 2 --seconds 20 --seed 12 --speed 0.4 "
        "--carry 2.5:0:1.2,-0.45,-1.1 --carry 15:0:-1.2,1.9,0.5",
    ),
    # Fewer tasks than robots, so that somebody waits for each that opens; robot 2 falls silent with a claim.
    InLockstep(
        "scarce_tasks", NEAR_SIGHTED + "[fleet]\ndwell_s = 0.3\n", robots=4, tasks=2, seconds=22.0, seed=21,
        loss=0.3, kept=(1,), leave_s={2: 9.0},
    ),
    # Everybody wants the nearest task, and robot 1 falls silent with one: conflicts, and votes that rest.
    InLockstep(
        "contested_tasks",
        NEAR_SIGHTED + """
[fleet]
allocator = "nearest"
turnover = "on_completion"
dwell_s = 0.3
""",
        robots=5, tasks=3, seconds=22.0, seed=41, loss=0.4, kept=(2, 4), leave_s={1: 8.0},
    ),
    # Robot 0 is put before a wall that its wheels know nothing of, is stuck, and hands its task to robot 1.
    InLockstep(
        "work_orders",
        NEAR_SIGHTED + """
[fleet]
allocator = "look_ahead"
turnover = "on_completion"
handover_gain_s = 1.0
dwell_s = 0.3
[planning]
planner = "window"
[recovery]
stuck_s = 2.0
retry_s = 1.0
wait_s = 1.0
""",
        robots=4, tasks=3, seconds=26.0, seed=31, loss=0.15, kept=(0, 1),
        carried=(Carried(6.0, 0, (2.3, 0.0, 0.0)),),
    ),
    # The allocators of which the runs above have none.
    decided_by("hungarian", kept=0),
    decided_by("greedy", kept=1),
    decided_by("auction", kept=1),
    decided_by("ipso_g", kept=0),
    decided_by("random", kept=2),
    decided_by("fixed_slot", kept=0),
    decided_by("paper_network", kept=1, weights=drawn_weights(tasks=3)),
)  # fmt: skip


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--reason", required=True, help="why they are recorded anew")
    parser.add_argument("names", nargs="*", metavar="NAME", help="of the runs (default: all of them)")
    parser.add_argument("--allow-dirty", action="store_true", help="record with changes not committed")
    options = parser.parse_args()
    try:
        HERE.mkdir(exist_ok=True)
        blessing = blessing_of(HERE, options.reason, options.allow_dirty)
        for run in _chosen(options.names):
            keep(run)
            write_expected(HERE / run.name, blessing)
    except HippomatError as error:
        print(f"record_runs: {error}", file=sys.stderr)
        return 1
    return 0


def _chosen(names: Sequence[str]) -> list[WithDaemons | InLockstep]:
    known = {run.name: run for run in RUNS}
    for name in names:
        if name not in known:
            raise HippomatError(f"{name}: is no golden run; there are {', '.join(known)}")
    return [known[name] for name in names or known]


def keep(run: WithDaemons | InLockstep) -> None:
    """Its logs into HERE/name; what was expected of them keeps its history."""
    with tempfile.TemporaryDirectory(prefix="hippomat-golden-") as made:
        record(run, Path(made))
        kept = run.kept if isinstance(run, InLockstep) else None
        directory = HERE / run.name
        directory.mkdir(exist_ok=True)
        for old in directory.glob("*.mcap"):
            old.unlink()
        for log in open_runs([Path(made) / "run"]):
            if kept is None or log.robot in kept:
                write_condensed(log, directory / f"robot{log.robot:02d}.mcap")


def record(run: WithDaemons | InLockstep, made: Path) -> None:
    """The fleet's logs into made/run."""
    if isinstance(run, WithDaemons):
        command = [sys.executable, "-m", "hippomat_sim", "run", *run.arguments.split()]
        done = subprocess.run([*command, "--map", str(DEMO_ROOM), "--out", str(made / "run")], check=False)
        if done.returncode == 1:
            raise HippomatError(f"{run.name}: hippomat-sim failed")
        return
    config = made / "hippomat.toml"
    config.write_text(run.toml, encoding="utf-8")
    (made / WEIGHTS).write_bytes(run.weights)
    settings = RunSettings(
        DEMO_ROOM, made / "run", run.robots, run.tasks, run.seconds, run.loss, run.seed,
        config=config, slam=False, carried=run.carried,
    )  # fmt: skip
    before = Path.cwd()
    os.chdir(made)  # a log keeps the weights' path as configured: one that is the same on every recording
    try:
        LockstepRun(settings, PlainView(Console()), run.leave_s).execute()
    finally:
        os.chdir(before)


if __name__ == "__main__":
    sys.exit(main())
