"""Writing a radio: the firmware's own C behind a pseudo-terminal, and what can go wrong with one."""

from __future__ import annotations

import re
import time
from pathlib import Path
from typing import Any

import pytest
from commands_run import refused, run
from host_devices import Base, Lidar, Silent, plugged
from real_radios import KEY, OTHER_KEY, a_fleet, desk
from scripted_radio import BACK, VANISH, ScriptedRadio

from hippomat_core.wire.link import FLAG_OPEN, FLAG_PROVISIONED, FLAG_UNSAFE, Hello, Provision, Provisioned
from hippomat_host import provision as module
from hippomat_sim.radio import Memory

Capture = pytest.CaptureFixture[str]
WANTED = ("--fleet", 7, "--robot", 3, "--channel", 6)


@pytest.fixture
def key_file(tmp_path: Path) -> Path:
    path = tmp_path / "fleet.key"
    path.write_text(KEY.hex())
    path.chmod(0o600)
    return path


def test_a_new_radio_becomes_a_robots_with_a_key(tmp_path: Path, capsys: Capture, key_file: Path) -> None:
    with desk(tmp_path, [Memory()]) as radios:
        ended = run(capsys, "provision", "--port", radios.path(0), *WANTED, "--key-file", key_file)
        memory = radios.radios[0].memory
    assert ended.code == 0, ended
    assert (memory.robot, memory.fleet, memory.channel, memory.rate_mbps) == (3, 7, 6, 6)
    assert memory.key == KEY
    assert memory.provisioned
    assert abs(memory.boot_counter - time.time()) < 60
    assert "it was: a new radio (not provisioned) of fleet 1, channel 1, 6 Mbit/s, OPEN" in ended.out
    assert "written: robot 3 of fleet 7, channel 6, 6 Mbit/s, sealed with the key of fingerprint" in ended.out
    assert "restarted, and says: robot 3 of fleet 7, channel 6, 6 Mbit/s, sealed" in ended.out
    assert ended.err == ""
    assert KEY.hex() not in ended.out


def test_a_radio_that_was_another_is_written_anew_and_says_what_it_was(
    tmp_path: Path, capsys: Capture
) -> None:
    before = Memory(12, 9, 11, provisioned=True, key=OTHER_KEY, rate_mbps=24, boot_counter=1_900_000_000)
    wanted = ("--fleet", 1, "--operator", "--channel", 13, "--open", "--rate", 12)
    with desk(tmp_path, [before]) as radios:
        ended = run(capsys, "provision", "--port", radios.path(0), *wanted)
        memory = radios.radios[0].memory
    assert ended.code == 0, ended
    assert "it was: robot 12 of fleet 9, channel 11, 24 Mbit/s, sealed" in ended.out
    assert "says: an operator's radio of fleet 1, channel 13, 12 Mbit/s, OPEN" in ended.out
    assert "warning: fleet 1 is OPEN" in ended.err
    assert "warning: channel 13: ESP-IDF's default region allows 1 .. 11" in ended.err
    assert memory.key == b""
    assert memory.boot_counter > 1_900_000_000  # never goes back


def test_a_port_that_goes_away_while_the_radio_restarts_is_waited_for(
    tmp_path: Path, capsys: Capture
) -> None:
    def vanish(radios: Any) -> None:
        radios.restarts_vanish.add(0)

    with desk(tmp_path, [Memory()], change=vanish) as radios:
        ended = run(capsys, "provision", "--port", radios.path(0), *WANTED, "--open")
        assert radios.radios[0].memory.robot == 3
    assert ended.code == 0, ended
    assert "restarted, and says: robot 3" in ended.out


def test_an_id_that_is_on_the_air_already_is_warned_about(tmp_path: Path, capsys: Capture) -> None:
    with desk(tmp_path, [*a_fleet(2, fleet=7, channel=6), Memory()], robots=[0, 1]) as radios:
        wanted = ("--fleet", 7, "--channel", 6, "--open")
        doubled = run(capsys, "provision", "--port", radios.path(2), "--robot", 1, *wanted)
        own = run(capsys, "provision", "--port", radios.path(2), "--robot", 2, *wanted)
    assert doubled.code == own.code == 0
    assert "warning: another radio sends as robot 1: give every robot its own id" in doubled.err
    assert "another radio" not in own.err


def test_a_key_file_that_others_read_is_warned_about(tmp_path: Path, capsys: Capture, key_file: Path) -> None:
    key_file.chmod(0o644)
    with desk(tmp_path, [Memory()]) as radios:
        ended = run(capsys, "provision", "--port", radios.path(0), *WANTED, "--key-file", key_file)
    assert ended.code == 0
    assert f"warning: {key_file} can be read by others (mode 0644): `chmod 600 {key_file}`" in ended.err


def test_nothing_but_questions_is_written_before_the_radio_is_known(tmp_path: Path, capsys: Capture) -> None:
    radio = ScriptedRadio(tmp_path / "radio")
    with plugged(radio):
        assert run(capsys, "provision", "--port", radio.link, *WANTED, "--open").code == 0
        kinds = [type(message) for message in radio.told]
        hellos = radio.told_of(Hello)
    assert kinds.count(Provision) == 1
    assert {type(message) for message in radio.told[: kinds.index(Provision)]} == {Hello}
    assert {hello.link_version for hello in hellos} == {0}  # a version that no radio obeys


def failing(
    tmp_path: Path, capsys: Capture, answers: dict[type, Any], *more: object, **facts: Any
) -> tuple[str, ScriptedRadio]:
    radio = ScriptedRadio(tmp_path / "radio", answers, **facts)
    with plugged(radio):
        line = refused(capsys, "provision", "--port", radio.link, *WANTED, "--open", *more)
    return line, radio


def test_a_radio_that_cannot_store_says_so(tmp_path: Path, capsys: Capture) -> None:
    line, _ = failing(tmp_path, capsys, {Provision: lambda _: [Provisioned(False, 0)]})
    assert "could not store it (its flash is full or damaged)" in line


def test_a_radio_that_does_not_answer_is_named(
    tmp_path: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "STORE_S", 0.3)
    line, _ = failing(tmp_path, capsys, {Provision: lambda _: []})
    assert re.search(r"the radio on \S+ did not say within .* that it stored anything: repeat", line)


def test_an_answer_that_is_lost_with_the_port_is_made_up_for_by_what_the_radio_says_afterwards(
    tmp_path: Path, capsys: Capture
) -> None:
    def stores(wanted: Provision) -> list[Any]:
        radio.provisioned(wanted)
        return [VANISH, BACK]

    radio = ScriptedRadio(tmp_path / "radio", {Provision: stores})
    with plugged(radio):
        ended = run(capsys, "provision", "--port", radio.link, *WANTED, "--open")
    assert ended.code == 0, ended
    assert "sent, and the port went away: robot 3 of fleet 7" in ended.out

    def forgets(_: Provision) -> list[Any]:
        radio.restart()
        return [VANISH, BACK]

    radio = ScriptedRadio(tmp_path / "radio", {Provision: forgets})
    with plugged(radio):
        line = refused(capsys, "provision", "--port", radio.link, *WANTED, "--open")
    assert "restarted as robot 2 of fleet 1" in line
    assert "not as written" in line


def test_a_radio_that_does_not_come_back_is_named(
    tmp_path: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "RESTART_S", 0.5)
    line, _ = failing(tmp_path, capsys, {Provision: lambda _: [Provisioned(True, 9), VANISH]})
    assert "the radio did not come back within" in line
    (tmp_path / "b").mkdir()
    line, _ = failing(tmp_path / "b", capsys, {Provision: lambda _: [Provisioned(True, 9)]})
    assert "the radio did not come back within" in line


def test_a_radio_that_comes_back_as_something_else_is_named(tmp_path: Path, capsys: Capture) -> None:
    def other_channel(wanted: Provision) -> list[Any]:
        radio.restart(robot=3, fleet=7, channel=11, flags=FLAG_PROVISIONED | FLAG_OPEN)
        return [Provisioned(True, wanted.unix_s), VANISH, BACK]

    radio = ScriptedRadio(tmp_path / "radio", {Provision: other_channel})
    with plugged(radio):
        line = refused(capsys, "provision", "--port", radio.link, *WANTED, "--open")
    assert "restarted as robot 3 of fleet 7, channel 11" in line
    assert "not as written" in line


def test_a_radio_that_cannot_keep_its_boot_counter_is_named(tmp_path: Path, capsys: Capture) -> None:
    def unsafe(wanted: Provision) -> list[Any]:
        done = radio.provisioned(wanted)
        radio.facts["flags"] |= FLAG_UNSAFE
        return list(done)

    radio = ScriptedRadio(tmp_path / "radio", {Provision: unsafe})
    with plugged(radio):
        line = refused(capsys, "provision", "--port", radio.link, *WANTED, "--open")
    assert "cannot store its boot counter and stays silent" in line


def test_garbage_around_every_answer_does_not_matter(tmp_path: Path, capsys: Capture) -> None:
    radio = ScriptedRadio(tmp_path / "radio")
    radio.speaks = [b"\x00ESP-ROM:esp32s3-20210327\r\n", bytes(range(1, 200)), b"\x02\x01\x00"]
    with plugged(radio):
        assert run(capsys, "provision", "--port", radio.link, *WANTED, "--open").code == 0


def test_what_is_no_radio_is_named_and_nothing_is_written_to_it(tmp_path: Path, capsys: Capture) -> None:
    base, lidar, silent = Base(tmp_path / "b"), Lidar(tmp_path / "l"), Silent(tmp_path / "s")
    with plugged(base, lidar, silent):
        for device, part in ((base, "is the base"), (lidar, "is the lidar"), (silent, "found: silent")):
            line = refused(capsys, "provision", "--port", device.link, *WANTED, "--open")
            assert part in line
        assert base.received == []


def test_old_firmware_is_named_with_its_remedy(tmp_path: Path, capsys: Capture) -> None:
    status_of_link_1 = b"\x82" + bytes(57)
    radio = ScriptedRadio(tmp_path / "radio", {Hello: lambda _: []})
    from hippomat_core.wire.cobs import encode

    radio.speaks = [encode(status_of_link_1)]
    with plugged(radio):
        line = refused(capsys, "provision", "--port", radio.link, *WANTED, "--open")
    assert "speaks another link version, this host protocol 2 (link 2): run `pio run -t upload`" in line


@pytest.mark.parametrize("year_s", [0.0, 1_700_000_000.0, -5.0, 5e9, 1e20])
def test_a_clock_that_is_obviously_wrong_is_refused(
    tmp_path: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch, year_s: float
) -> None:
    monkeypatch.setattr(time, "time", lambda: year_s)
    line = refused(capsys, "provision", "--port", tmp_path / "none", *WANTED, "--open")
    assert "clock says" in line
    assert "timedatectl" in line


@pytest.mark.parametrize(
    ("arguments", "parts"),
    [
        ([], ("the following arguments are required: --fleet, --channel",)),
        (["--fleet", 256, "--robot", 3, "--channel", 6, "--open"], ("--fleet", "'256'", "0 to 255")),
        (["--fleet", 7, "--robot", 64, "--channel", 6, "--open"], ("--robot", "'64'", "0 to 63")),
        (["--fleet", 7, "--robot", "-1", "--channel", 6, "--open"], ("--robot",)),
        (["--fleet", 7, "--robot", 3, "--channel", 14, "--open"], ("--channel", "'14'", "1 to 13")),
        (["--fleet", 7, "--robot", "٣", "--channel", 6, "--open"], ("--robot", "whole number")),
        ([*WANTED, "--open", "--rate", 11], ("--rate", "choose from", "24")),
        ([*WANTED], ("one of the arguments --key-file --open is required",)),
        ([*WANTED, "--open", "--key-file", "x"], ("not allowed with",)),
        ([*WANTED, "--operator", "--open"], ("not allowed with",)),
        (["--fleet", 7, "--channel", 6, "--open"], ("one of the arguments --robot --operator is required",)),
        ([*WANTED, "--key-file", "no.key"], ("no.key", "No such file", "make-key")),
        ([*WANTED, "--open"], ("/dev/ttyUSB99 does not exist",)),
    ],
)
def test_wrong_input_is_one_line(capsys: Capture, arguments: list[object], parts: tuple[str, ...]) -> None:
    line = refused(capsys, "provision", "--port", "/dev/ttyUSB99", *arguments)
    for part in parts:
        assert part in line


def test_a_busy_port_is_named(tmp_path: Path, capsys: Capture) -> None:
    from hippomat_host.serial_port import open_port

    silent = Silent(tmp_path / "s")
    with plugged(silent):
        open_port(str(silent.link))
        assert "is in use by" in refused(capsys, "provision", "--port", silent.link, *WANTED, "--open")
