"""`hippomat-host`: the first and last word. Every error that a user can cause is one line and a code.

Loads nothing before Ctrl-C is taken care of.
"""

from __future__ import annotations

import errno
import os
import sys
from collections.abc import Callable, Sequence


def main(argv: Sequence[str] | None = None) -> int:
    """The exit code."""
    arguments = list(sys.argv[1:] if argv is None else argv)
    try:
        return _run(arguments)
    except KeyboardInterrupt:
        if not arguments or arguments[0].startswith("-"):
            return 0  # the daemon, before it had begun
        print(f"hippomat-host {arguments[0]}: interrupted", file=sys.stderr)
        return 1


def _run(arguments: list[str]) -> int:
    from hippomat_core.errors import HippomatError
    from hippomat_host.commands import COMMANDS

    try:
        if arguments and arguments[0] in COMMANDS:
            return _command(COMMANDS[arguments[0]], arguments[1:])
        return _daemon(arguments)
    except HippomatError as error:
        print(f"hippomat-host: {error}", file=sys.stderr)
        return error.exit_code


def _daemon(arguments: list[str]) -> int:
    from hippomat_host.options import config_of, given_of, parser, start_joined

    args = parser().parse_args(start_joined(arguments))
    config = config_of(args)
    given = given_of(args, config)
    from hippomat_logs.numba_cache import ensure_numba_cache

    note = ensure_numba_cache()
    from hippomat_host.startup import run  # --help must not wait for NumPy, OpenCV and the log

    if note:
        print(note, flush=True)
    return run(config, given, args.lockstep)


def _command(command: Callable[[list[str]], int], arguments: list[str]) -> int:
    from hippomat_core.errors import HippomatError

    try:
        code = command(arguments)
        sys.stdout.flush()
        return code
    except HippomatError:
        raise
    except BrokenPipeError:  # nobody reads any more, e.g. `| head`; what was to be done is done
        _say_no_more()
        return 1
    except OSError as error:
        if error.errno != errno.ENOSPC:
            return _fault(error)
        _say_no_more()
        raise HippomatError(
            "standard output cannot be written: no space is left; the command may have been carried out: "
            "make room, and see"
        ) from None
    except Exception as fault:
        return _fault(fault)


def _say_no_more() -> None:
    """What still waits to be printed must not fail again at exit."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _fault(fault: Exception) -> int:
    from hippomat_host.faults import as_error

    raise as_error(fault) from None


if __name__ == "__main__":
    sys.exit(main())
