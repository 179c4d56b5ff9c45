"""Run a command of hippomat-host in this process, as `main` would."""

from __future__ import annotations

from dataclasses import dataclass

import pytest

from hippomat_host.cli import main


@dataclass(frozen=True, slots=True)
class Ended:
    """What a user saw."""

    code: int
    out: str
    err: str


def run(capsys: pytest.CaptureFixture[str], *arguments: object) -> Ended:
    capsys.readouterr()
    code = main([str(argument) for argument in arguments])
    said = capsys.readouterr()
    return Ended(code, said.out, said.err)


def refused(capsys: pytest.CaptureFixture[str], *arguments: object) -> str:
    """The one line on stderr of a run that ends with exit code 1."""
    ended = run(capsys, *arguments)
    lines = [line for line in ended.err.splitlines() if not line.startswith("warning: ")]
    assert ended.code == 1, ended
    assert len(lines) == 1, ended.err
    assert lines[0].startswith("hippomat-host: ")
    return lines[0].removeprefix("hippomat-host: ")
