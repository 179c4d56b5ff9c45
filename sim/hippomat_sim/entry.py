"""`hippomat-sim`, before anything else is loaded: a robot's install has no simulator and says so."""

from __future__ import annotations

import sys
from collections.abc import Callable

SIM_PACKAGES = ("pybullet", "cffi", "cryptography", "matplotlib", "platformdirs")
TRAIN_PACKAGES = ("torch", "tensorboard", "pettingzoo", "gymnasium")
EXTRA_OF = {
    **dict.fromkeys(SIM_PACKAGES, "sim"),
    **dict.fromkeys(TRAIN_PACKAGES, "train"),
    "ray": "ray",
    "gtsam": "slam",
}


def main() -> int:
    """The exit code."""
    return guarded("hippomat-sim", _run)


def _run() -> int:
    from hippomat_sim.cli import main as run

    return run()


def guarded(command: str, run: Callable[[], int]) -> int:
    """The exit code of run(), which loads what it needs; a missing package or Ctrl-C is one line."""
    try:
        from hippomat_logs.numba_cache import ensure_numba_cache

        ensure_numba_cache()
        return run()
    except ModuleNotFoundError as error:
        extra = EXTRA_OF.get(error.name or "")
        if extra is None:
            raise
        print(
            f"{command}: the package {error.name} is not installed: pip install 'hippomat[{extra}]'",
            file=sys.stderr,
        )
        return 1
    except KeyboardInterrupt:
        print(f"{command}: interrupted", file=sys.stderr)
        return 1
    except OSError as error:
        print(f"{command}: {error}", file=sys.stderr)
        return 1
