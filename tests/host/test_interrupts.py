"""Ctrl-C and a reader that leaves: the commands end with one line, never with a traceback."""

from __future__ import annotations

import signal
import subprocess
from pathlib import Path

import pytest
from host_devices import plugged, wait_until
from host_process import DAEMON
from scripted_radio import ScriptedRadio

from hippomat_core.wire.link import Command, Hello, Provision


def started(*arguments: object) -> subprocess.Popen[str]:
    command = [*DAEMON, *map(str, arguments)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


@pytest.mark.parametrize(
    ("arguments", "until"),
    [
        (("stop",), Command),
        (("resume",), Hello),
        (("provision", "--fleet", 7, "--robot", 3, "--channel", 6, "--open"), Provision),
        (("radio-info",), Hello),
    ],
)
def test_ctrl_c_is_one_line_and_exit_code_1(
    tmp_path: Path, arguments: tuple[object, ...], until: type
) -> None:
    radio = ScriptedRadio(tmp_path / "radio", {until: lambda _: []} if until is Provision else {})
    with plugged(radio):
        process = started(*arguments, "--port", radio.link)
        assert wait_until(lambda: bool(radio.told_of(until)))
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=10.0)
    assert process.returncode == 1
    lines = [line for line in err.splitlines() if not line.startswith("warning: ")]
    assert lines == [f"hippomat-host {arguments[0]}: interrupted"]
    if arguments[0] == "stop":
        assert "the radio goes on sending what it was told" in out
    assert "Traceback" not in out + err


@pytest.mark.parametrize("command", ["stop", "resume"])
def test_what_was_interrupted_before_it_was_sent_is_said_not_to_be_sent(tmp_path: Path, command: str) -> None:
    radio = ScriptedRadio(tmp_path / "radio", {Hello: lambda _: []})
    with plugged(radio):
        process = started(command, "--port", radio.link)
        assert wait_until(lambda: bool(radio.told_of(Hello)))
        process.send_signal(signal.SIGINT)
        out, _ = process.communicate(timeout=10.0)
    assert process.returncode == 1
    assert f"{command.upper()} was NOT sent" in out
    assert radio.told_of(Command) == []


def test_a_full_disk_behind_standard_output_is_one_line(tmp_path: Path) -> None:
    with open("/dev/full", "w", encoding="ascii") as full:
        command = [*DAEMON, "make-key", str(tmp_path / "key")]
        ended = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True, check=False)
    assert ended.returncode == 1
    assert ended.stderr.startswith("hippomat-host: standard output cannot be written: no space is left")
    assert ended.stderr.count("\n") == 1


def test_a_reader_that_leaves_is_no_traceback(tmp_path: Path) -> None:
    radio = ScriptedRadio(tmp_path / "radio")
    with plugged(radio):
        process = started("radio-info", "--port", radio.link)
        assert process.stdout is not None
        assert process.stderr is not None
        process.stdout.close()
        assert process.wait(10.0) in (0, 1)
        assert process.stderr.read() == ""
        process.stderr.close()
