"""hippomat-train, the command line: train, export, prepare. Exit codes: see --help."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import NoReturn

from hippomat_core.errors import HippomatError
from hippomat_sim.entry import guarded
from hippomat_sim.learn.ray_session import LOCAL

COMMANDS = ("train", "export", "prepare")
_EPILOG = """\
exit codes: 0 done; 1 wrong usage, nothing was run; 130 interrupted, a checkpoint was written

examples:
  hippomat-train                                      our policy; `train` may be left out
  hippomat-train --config paper --agents 10 --tasks 30
  hippomat-train --config mine.toml --seed 3 --minutes 10 --out runs/mine
  hippomat-train --resume runs/mine
  hippomat-train --ray --runners 8                    through Ray RLlib; --ray 10.0.0.7:6379: on a cluster
  hippomat-train export runs/mine --out policy.safetensors
  hippomat-train prepare
"""


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        self.exit(1, f"{self.prog}: {message} (see {self.prog} --help)\n")


def main(arguments: Sequence[str] | None = None) -> int:
    """The command line; returns the exit code."""
    return guarded("hippomat-train", lambda: _main(sys.argv[1:] if arguments is None else list(arguments)))


def _main(arguments: list[str]) -> int:
    from hippomat_sim.learn import train_command  # here: guarded() names a package that is missing

    helps = arguments[:1] in (["-h"], ["--help"])
    if not helps and (not arguments or arguments[0] not in COMMANDS):
        arguments = ["train", *arguments]
    options = _parser().parse_args(arguments)
    run = {"train": train_command.train, "export": train_command.export, "prepare": train_command.prepare}
    try:
        return run[options.command](options)
    except HippomatError as error:
        print(f"hippomat-train: {error}", file=sys.stderr)
        return error.exit_code


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(
        prog="hippomat-train",
        description="Train the policies that allocate tasks, and write them as files that robots read.",
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    commands = parser.add_subparsers(dest="command", required=True, metavar=" | ".join(COMMANDS))
    _add_train(commands.add_parser("train", help="train a policy, or go on with a run"))
    export = commands.add_parser("export", help="write the policy of a run as safetensors with its manifest")
    export.add_argument("run", type=Path, metavar="DIR", help="directory of a training run")
    export.add_argument(
        "--out", type=Path, metavar="FILE", help="default: policy.safetensors in the directory of the run"
    )
    prepare = commands.add_parser("prepare", help="make the worlds now; training finds them on the disk")
    prepare.add_argument("--config", default="default", metavar="PRESET|FILE", help="whose worlds (default)")
    return parser


def _add_train(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("--config", metavar="PRESET|FILE", help="a packaged preset or a TOML file (default: default)")
    add("--resume", type=Path, metavar="DIR", help="go on with the run in this directory")
    add("--out", type=Path, metavar="DIR", help="where everything goes (default runs/train-PRESET-TIME)")
    add(
        "--seed",
        type=_from_zero,
        metavar="N",
        help="of weights, worlds' draws and actions (default: preset's)",
    )
    add("--device", choices=("auto", "cpu", "cuda"), default="auto", help="auto: a GPU where there is one")
    add("--steps", type=_positive, metavar="N", help="agent steps in all (default: the preset's)")
    add("--minutes", type=float, metavar="X", help="stop after so long; the run can be resumed")
    add("--agents", type=_positive, metavar="N", help="train for this fleet size alone")
    add("--tasks", type=_positive, metavar="M", help="train for this many tasks alone")
    add(
        "--ray",
        nargs="?",
        const=LOCAL,
        metavar="ADDRESS",
        help="through Ray RLlib (pip install 'hippomat[ray]'), preset rllib; on a cluster where one is named",
    )
    add("--runners", type=_positive, metavar="N", help="with --ray: processes that play (none: one does all)")


def _positive(text: str) -> int:
    value = int(text)
    if value < 1:
        raise argparse.ArgumentTypeError(f"{value} is not above 0")
    return value


def _from_zero(text: str) -> int:
    value = int(text)
    if not 0 <= value < 2**31:
        raise argparse.ArgumentTypeError(f"{value} is not in 0 .. {2**31 - 1}")
    return value


if __name__ == "__main__":
    sys.exit(main())
