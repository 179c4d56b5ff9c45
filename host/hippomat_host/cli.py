"""`hippomat-host`: the first and last word. Every error that a user can cause is one line and a code."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from hippomat_core.errors import HippomatError
from hippomat_host.options import Parser, config_of, given_of, parser


def main(argv: Sequence[str] | None = None) -> int:
    """The exit code."""
    arguments = list(sys.argv[1:] if argv is None else argv)
    try:
        if arguments[:1] == ["ports"]:
            return _ports(arguments[1:])
        args = parser().parse_args(arguments)
        config = config_of(args)
        given = given_of(args, config)
        from hippomat_host.startup import run  # --help must not wait for NumPy, OpenCV and the log

        return run(config, given, args.lockstep)
    except HippomatError as error:
        print(f"hippomat-host: {error}", file=sys.stderr)
        return error.exit_code
    except KeyboardInterrupt:
        return 0


def _ports(arguments: list[str]) -> int:
    options = Parser(prog="hippomat-host ports", description="List serial ports and what is behind each.")
    options.add_argument("devices", metavar="DEV", nargs="*", help="look at these only")
    args = options.parse_args(arguments)
    from hippomat_host.ports import list_ports

    return list_ports(args.devices)


if __name__ == "__main__":
    sys.exit(main())
