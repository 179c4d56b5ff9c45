"""`hippomat-replay` and `hippomat-logs` before anything heavy is loaded: Ctrl-C is always one line, and a
reader that stops reading (`| head`) ends them without a word."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable


def replay() -> int:
    """hippomat-replay's exit code."""

    def main() -> int:
        from hippomat_logs.numba_cache import ensure_numba_cache

        ensure_numba_cache()
        from hippomat_logs.replay_cli import main

        return main()

    return _to_the_end("hippomat-replay", main)


def logs() -> int:
    """hippomat-logs' exit code."""

    def main() -> int:
        from hippomat_logs.cli import main

        return main()

    return _to_the_end("hippomat-logs", main)


def _to_the_end(name: str, main: Callable[[], int]) -> int:
    try:
        try:
            return main()
        finally:  # --help too
            sys.stdout.flush()
    except BrokenPipeError:
        from hippomat_logs.terminal import PIPE_CLOSED

        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # Python flushes once more at its end
        return PIPE_CLOSED
    except KeyboardInterrupt:
        print(f"{name}: interrupted", file=sys.stderr)
        return 1
