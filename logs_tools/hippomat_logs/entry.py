"""`hippomat-replay` and `hippomat-logs` before anything heavy is loaded: Ctrl-C is always one line."""

from __future__ import annotations

import sys


def replay() -> int:
    """hippomat-replay's exit code."""
    try:
        from hippomat_logs.numba_cache import ensure_numba_cache

        ensure_numba_cache()
        from hippomat_logs.replay_cli import main

        return main()
    except KeyboardInterrupt:
        return _interrupted("hippomat-replay")


def logs() -> int:
    """hippomat-logs' exit code."""
    try:
        from hippomat_logs.cli import main

        return main()
    except KeyboardInterrupt:
        return _interrupted("hippomat-logs")


def _interrupted(name: str) -> int:
    print(f"{name}: interrupted", file=sys.stderr)
    return 1
