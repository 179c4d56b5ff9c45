"""Every help text fits a terminal of 80 columns."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import pytest

from hippomat_logs.cli import main as logs
from hippomat_logs.cli import parser
from hippomat_logs.replay_cli import main as replay

COMMANDS = next(action.choices for action in parser()._actions if action.choices)


@pytest.mark.parametrize("command", ["", *COMMANDS, "replay"])
def test_help_is_80_columns_wide(
    command: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    main: Callable[[Sequence[str]], int] = replay if command == "replay" else logs
    with pytest.raises(SystemExit) as ended:
        main([*([command] if command not in ("", "replay") else []), "--help"])
    assert ended.value.code == 0
    assert max(map(len, capsys.readouterr().out.splitlines())) <= 80
