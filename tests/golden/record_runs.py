"""Record the golden runs anew: simulated robots with real daemons, their logs without what no replay needs.

Wanted where the log's format or what is heard changed, so that old events say nothing any more; for changed
decisions `hippomat-replay tests/golden/runs --update-golden` keeps the events. Run by `make golden`.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
from pathlib import Path

from hippomat_core.errors import HippomatError
from hippomat_logs.golden import write_expected
from hippomat_logs.golden_command import blessing_of
from hippomat_logs.reader import open_runs
from hippomat_logs.redecide import write_condensed
from hippomat_sim.maps.demo_room import DEMO_ROOM

HERE = Path(__file__).parent / "runs"
RUNS = {
    "three_wheels": "--robots 3 --tasks 4 --seconds 15 --loss 0.3 --seed 11 --no-slam",
    "one_slam": "--robots 1 --tasks 2 --seconds 8 --seed 12",
}


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--reason", required=True, help="why they are recorded anew")
    parser.add_argument("--allow-dirty", action="store_true", help="record with changes not committed")
    options = parser.parse_args()
    try:
        HERE.mkdir(exist_ok=True)
        blessing = blessing_of(HERE, options.reason, options.allow_dirty)
        for name, arguments in RUNS.items():
            record(name, arguments.split())
            write_expected(HERE / name, blessing)
    except HippomatError as error:
        print(f"record_runs: {error}", file=sys.stderr)
        return 1
    return 0


def record(name: str, arguments: list[str]) -> None:
    """One fleet into HERE/name; what was expected of it keeps its history."""
    with tempfile.TemporaryDirectory(prefix="hippomat-golden-") as made:
        command = [sys.executable, "-m", "hippomat_sim", "run", *arguments]
        command += ["--map", str(DEMO_ROOM), "--out", f"{made}/run"]
        done = subprocess.run(command, check=False)
        if done.returncode == 1:
            raise HippomatError(f"{name}: hippomat-sim failed")
        directory = HERE / name
        directory.mkdir(exist_ok=True)
        for old in directory.glob("*.mcap"):
            old.unlink()
        for run in open_runs([Path(made) / "run"]):
            write_condensed(run, directory / f"robot{run.robot:02d}.mcap")


if __name__ == "__main__":
    sys.exit(main())
