"""`hippomat-sim`, before anything else is loaded: a robot's install has no simulator and says so."""

from __future__ import annotations

import sys

SIM_PACKAGES = ("pybullet", "cffi", "matplotlib", "platformdirs")


def main() -> int:
    """The exit code."""
    try:
        from hippomat_sim.cli import main as run

        return run()
    except ModuleNotFoundError as error:
        if error.name not in SIM_PACKAGES:
            raise
        print(
            f"hippomat-sim: the package {error.name} is not installed: pip install 'hippomat[sim]'",
            file=sys.stderr,
        )
        return 1
    except KeyboardInterrupt:
        print("hippomat-sim: interrupted", file=sys.stderr)
        return 1
    except OSError as error:
        print(f"hippomat-sim: {error}", file=sys.stderr)
        return 1
