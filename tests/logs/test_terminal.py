"""What a terminal and a pipe get to see: brackets as they are, errors apart, a quiet end behind `| head`."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from fused_lab import write_fleet
from recorded_run import recorded_log

from hippomat_logs import cli
from hippomat_logs.alignment import align_runs
from hippomat_logs.alignment_report import alignment_table
from hippomat_logs.reader import open_runs
from hippomat_logs.replay_cli import main as replay
from hippomat_logs.terminal import Terminal

RUN = "import sys; from hippomat_logs import entry; sys.exit(entry.{}())"


@pytest.fixture(scope="module")
def bracketed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run whose name holds what rich would take for markup."""
    made = tmp_path_factory.mktemp("odd")
    log = recorded_log(made / "run", ticks=10)
    return log.rename(made / "run[bold]x[1]_000.mcap")


def test_units_stay_in_the_table_of_clocks(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_fleet(tmp_path, seconds=2.0)
    Terminal().print(alignment_table(align_runs(open_runs([tmp_path]))))
    out = capsys.readouterr().out
    assert [out.count(unit) for unit in ("[ppm]", "[us]", "[ms]")] == [1, 2, 1]


@pytest.mark.parametrize(
    "command", ["info", "doctor", "metrics", "filter", "export", "fuse", "damaged", "replay"]
)
def test_brackets_in_a_name_are_shown_as_they_are(
    bracketed: Path, tmp_path: Path, command: str, capsys: pytest.CaptureFixture[str]
) -> None:
    out = {"filter": ["-o", str(tmp_path / "x[red].mcap")], "export": ["-o", str(tmp_path / "x[red]")]}
    if command == "damaged":
        bracketed.with_name("x[red].mcap").write_bytes(bracketed.read_bytes()[:-40])
        assert cli.main(["info", str(bracketed.with_name("x[red].mcap"))]) == 3
        bracketed.with_name("x[red].mcap").unlink()
    elif command == "replay":
        assert replay(["--levels", "L0", str(bracketed)]) == 0
    else:
        assert cli.main([command, str(bracketed), *out.get(command, [])]) == 0
    said = capsys.readouterr().out
    if command in ("filter", "export", "damaged"):
        assert "x[red]" in said
    elif command not in ("metrics", "fuse"):  # which name robots
        assert "run[bold]x[1]" in said


def test_errors_do_not_go_into_the_file_that_takes_the_output(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["metrics", "nowhere", "--csv"]) == 1
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.startswith("error: nowhere: no such file")


@pytest.mark.parametrize(
    ("entry", "arguments"),
    [
        ("logs", ["info", "{log}"]),
        ("replay", ["--levels", "L0", "{log}"]),
    ],
)
def test_a_reader_that_stops_ends_a_command_without_a_word(
    bracketed: Path, entry: str, arguments: list[str]
) -> None:
    words = [word.format(log=bracketed) for word in arguments]
    read, write = os.pipe()
    os.close(read)
    program = [sys.executable, "-c", RUN.format(entry), *words]
    done = subprocess.run(program, stdout=write, stderr=subprocess.PIPE, text=True, timeout=60, check=False)
    os.close(write)
    assert (done.returncode, done.stderr) == (141, "")
