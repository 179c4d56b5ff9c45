"""STOP and RESUME from a laptop: the firmware's own C on a lossy air, and what can go wrong with a radio."""

from __future__ import annotations

import re
import time
from pathlib import Path
from typing import Any

import pytest
from commands_run import refused, run
from host_devices import Base, Lidar, plugged
from real_radios import KEY, OTHER_KEY, Desk, a_dongle, a_fleet, desk
from scripted_radio import VANISH, ScriptedRadio

from hippomat_core.wire import frames as air
from hippomat_core.wire import jetbot_base, rplidar
from hippomat_core.wire.link import (
    FLAG_UNSAFE,
    Command,
    Hello,
    encode_message,
)
from hippomat_host import following
from hippomat_host.identify import ASK
from hippomat_sim.radio import Memory

Capture = pytest.CaptureFixture[str]
DONGLE = 3


@pytest.fixture
def hurried(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(following, "DEADLINE_S", 1.0)


def settled(radios: Desk) -> None:
    """The fleet has been on the air for a while."""
    time.sleep(1.0)
    assert all(radio.radio.counters.received for radio in radios.radios[:DONGLE])


def stopped_robots(radios: Desk) -> list[bool]:
    return [seat.stopped for seat in radios.seats.values()]


@pytest.mark.parametrize("key", [b"", KEY])
def test_a_fleet_stops_and_goes_on_over_a_lossy_air(tmp_path: Path, capsys: Capture, key: bytes) -> None:
    memories = [*a_fleet(3, fleet=7, key=key), a_dongle(fleet=7, key=key)]
    with desk(tmp_path, memories, robots=[0, 1, 2], loss=0.3) as radios:
        settled(radios)
        before = 0
        for _ in range(2):
            ended = run(capsys, "stop", "--port", radios.path(DONGLE), "--reason", "person")
            assert ended.code == 0, ended
            assert stopped_robots(radios) == [True, True, True]
            (counter,) = {seat.counter for seat in radios.seats.values()}
            assert before < counter <= before + 32  # `stop` may repeat itself, which is another STOP
            before = counter
            assert f"STOP {counter} holds until `hippomat-host resume --port" in ended.out
            assert "done: all robots 0, 1, 2" in ended.out
            assert ("OPEN" in ended.err) == (not key)
            ended = run(capsys, "resume", "--port", radios.path(DONGLE))
            assert ended.code == 0, ended
            assert f"RESUME of STOP {counter}: robots 0, 1, 2 stopped" in ended.out
            assert len(re.findall(r"robot \d goes on", ended.out)) == 3
            assert stopped_robots(radios) == [False, False, False]
        ended = run(capsys, "resume", "--port", radios.path(DONGLE))
        assert ended.code == 0
        assert "nothing to resume: neither robots 0, 1, 2 nor this radio is stopped" in ended.out


def test_a_button_on_one_radio_stops_and_a_laptop_resumes(tmp_path: Path, capsys: Capture) -> None:
    with desk(tmp_path, [*a_fleet(3), a_dongle()], robots=[0, 1, 2], loss=0.3) as radios:
        settled(radios)
        radios.press_button(1)
        time.sleep(0.5)
        assert stopped_robots(radios) == [True, True, True]
        assert run(capsys, "resume", "--port", radios.path(DONGLE)).code == 0
        assert stopped_robots(radios) == [False, False, False]


def test_a_robots_own_radio_stops_the_others(tmp_path: Path, capsys: Capture) -> None:
    with desk(tmp_path, a_fleet(3), robots=[0, 2]) as radios:
        time.sleep(1.0)
        ended = run(capsys, "stop", "--port", radios.path(1))
        assert ended.code == 0, ended
        assert "robot 1 of fleet 1" in ended.out
        assert "done: all robots 0, 2" in ended.out
        assert stopped_robots(radios) == [True, True]
        assert radios.radios[1].memory.slots == 5


def test_a_new_dongle_adopts_fleet_and_channel_for_an_open_fleet(tmp_path: Path, capsys: Capture) -> None:
    with desk(tmp_path, [*a_fleet(3, fleet=7), Memory()], robots=[0, 1, 2]) as radios:
        settled(radios)
        ended = run(capsys, "stop", "--port", radios.path(DONGLE), "--fleet", 7)
        assert ended.code == 0, ended
        assert stopped_robots(radios) == [True, True, True]
        assert "warning: fleet 7 is OPEN" in ended.err


def test_a_dongle_without_the_key_of_a_sealed_fleet_says_so(
    tmp_path: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(following, "DEADLINE_S", 2.0)
    fleet = a_fleet(3, fleet=7, channel=6, key=KEY)
    with desk(tmp_path, [*fleet, Memory(fleet=7, channel=6)], robots=[0, 1, 2]) as radios:
        settled(radios)
        for command in ("stop", "resume"):
            line = refused(capsys, command, "--port", radios.path(DONGLE))
            assert re.search(r"fleet 7 is sealed \(\d+ frames were dropped as dropped_seal\)", line), line
            assert "--operator --fleet 7 --channel 6 --key-file F` gives it the fleet's" in line
        assert stopped_robots(radios) == [False, False, False]


@pytest.mark.parametrize(
    ("dongle", "part"),
    [
        (a_dongle(key=OTHER_KEY), "fleet 1 has another key"),
        (a_dongle(fleet=2, key=KEY), "of fleet 2: `hippomat-host provision --port"),
    ],
)
def test_a_dongle_of_another_key_or_fleet_says_so(
    tmp_path: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch, dongle: Memory, part: str
) -> None:
    monkeypatch.setattr(following, "DEADLINE_S", 2.0)
    with desk(tmp_path, [*a_fleet(3, key=KEY), dongle], robots=[0, 1, 2]) as radios:
        settled(radios)
        assert part in refused(capsys, "stop", "--port", radios.path(DONGLE))
        assert stopped_robots(radios) == [False, False, False]


def test_robots_that_do_not_show_it_are_named_and_the_code_is_2(
    tmp_path: Path, capsys: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(following, "DEADLINE_S", 2.5)
    with desk(tmp_path, [*a_fleet(3), a_dongle()], robots=[0, 1, 2]) as radios:
        settled(radios)
        radios.seats[1].obeys = False
        radios.seats[2].sends = False
        ended = run(capsys, "stop", "--port", radios.path(DONGLE))
        assert ended.code == 2, ended
        assert "robot 0 shows STOP" in ended.out
        assert "robot 1: NOT STOPPED" in ended.out
        silent = r"robot 2: (SILENT for \d.\d s|no STATE of it was heard), but its radio is heard"
        assert re.search(silent, ended.out)
        assert "2 of 3 robots heard did not within 2 s: robots 1, 2" in ended.out
        radios.seats[1].obeys = radios.seats[2].sends = True
        time.sleep(1.2)
        radios.seats[1].obeys = False  # stays stopped
        ended = run(capsys, "resume", "--port", radios.path(DONGLE))
        assert ended.code == 2, ended
        assert re.search(r"robot 1: STOPPED by STOP \d+", ended.out)


@pytest.mark.usefixtures("hurried")
def test_nobody_there_is_an_error_after_the_deadline(tmp_path: Path, capsys: Capture) -> None:
    with desk(tmp_path, [a_dongle(channel=6)]) as radios:
        line = refused(capsys, "stop", "--port", radios.path(0))
        assert "sent, but no robot is heard: nobody sends on channel 6" in line
        assert "goes on sending it for a minute" in line
        assert "no robot is heard" in refused(capsys, "resume", "--port", radios.path(0))
        assert "nothing to resume is heard" in refused(capsys, "resume", "--port", radios.path(0))


# ---- scripted -----------------------------------------------------------------------------------


@pytest.mark.usefixtures("hurried")
def test_stop_is_the_first_thing_that_is_said_and_asks_nobody(tmp_path: Path, capsys: Capture) -> None:
    radio = ScriptedRadio(tmp_path / "radio")
    with plugged(radio):
        begun_s = time.monotonic()
        refused(capsys, "stop", "--port", radio.link, "--reason", 77)
        (first, *_) = [message for message in radio.told if not isinstance(message, Hello)]
        said_s = next(at_s for at_s, data in radio.received if encode_message(first) in data)
    assert first == Command(air.STOP, 0, 77)
    assert said_s - begun_s < 0.3
    assert all(message == ASK for message in radio.told_of(Hello))


@pytest.mark.usefixtures("hurried")
def test_a_stop_that_the_radio_did_not_obey_is_said_again(tmp_path: Path, capsys: Capture) -> None:
    lost: list[Command] = []

    def loses_the_first(command: Command) -> list[Any]:
        if not lost:
            lost.append(command)
        else:
            radio.stop_counter = 1
        return []

    radio = ScriptedRadio(tmp_path / "radio", {Command: loses_the_first})
    with plugged(radio):
        refused(capsys, "stop", "--port", radio.link)
    assert radio.stop_counter == 1


@pytest.mark.usefixtures("hurried")
def test_a_radio_that_never_obeys_is_named(tmp_path: Path, capsys: Capture) -> None:
    radio = ScriptedRadio(tmp_path / "radio", {Command: lambda _: []})
    with plugged(radio):
        line = refused(capsys, "stop", "--port", radio.link)
    assert "does not obey" in line
    assert line.endswith("holding the BOOT button of any radio for 1 s stops the fleet, too")


def test_a_radio_that_goes_away_is_named_with_another_way(tmp_path: Path, capsys: Capture) -> None:
    radio = ScriptedRadio(tmp_path / "radio", {Command: lambda _: [VANISH]})
    with plugged(radio):
        line = refused(capsys, "stop", "--port", radio.link)
    assert "went away" in line
    assert "BOOT button" in line


def test_a_radio_that_must_stay_silent_is_refused(tmp_path: Path, capsys: Capture) -> None:
    radio = ScriptedRadio(tmp_path / "radio", flags=FLAG_UNSAFE)
    with plugged(radio):
        assert "stays silent" in refused(capsys, "stop", "--port", radio.link)


def test_a_provisioned_radio_keeps_its_fleet(tmp_path: Path, capsys: Capture) -> None:
    with desk(tmp_path, [a_dongle(fleet=7, channel=6)]) as radios:
        line = refused(capsys, "stop", "--port", radios.path(0), "--fleet", 3)
        assert "stays an operator's radio of fleet 7, channel 6" in line
        assert radios.radios[0].memory.stop_counter == 0


def test_the_last_stop_cannot_be_resumed(tmp_path: Path, capsys: Capture) -> None:
    radio = ScriptedRadio(tmp_path / "radio")
    radio.stop_counter = 65_535
    with plugged(radio):
        line = refused(capsys, "resume", "--port", radio.link)
    assert "STOP 65535 is the last there is and is never resumed" in line
    assert radio.told_of(Command) == []


@pytest.mark.parametrize(
    ("arguments", "parts"),
    [
        (["--reason", "boredom"], ("'boredom'", "person, collision", "0 .. 255")),
        (["--reason", "256"], ("'256'",)),
        (["--fleet", "x"], ("--fleet", "'x'")),
        (["--channel", "0"], ("--channel", "'0'", "1 to 13")),
        ([], ("/dev/ttyUSB99 does not exist",)),
    ],
)
def test_wrong_input_is_one_line(capsys: Capture, arguments: list[str], parts: tuple[str, ...]) -> None:
    for command in ("stop", "resume"):
        line = refused(capsys, command, "--port", "/dev/ttyUSB99", *arguments)
        for part in parts:
            assert part in line


def test_what_is_said_at_once_means_nothing_to_a_base_or_a_lidar(tmp_path: Path, capsys: Capture) -> None:
    for reason in range(256):
        said = b"\0" + encode_message(ASK) + encode_message(Command(air.STOP, 0, reason))
        assert list(jetbot_base.Decoder().feed(said)) == []
        assert list(rplidar.RequestDecoder().feed(said)) == []
    base, lidar = Base(tmp_path / "b"), Lidar(tmp_path / "l")
    with plugged(base, lidar):
        assert "is the base, not a radio" in refused(capsys, "stop", "--port", base.link)
        assert "is the lidar, not a radio" in refused(capsys, "stop", "--port", lidar.link)
        assert base.velocities == []


@pytest.mark.usefixtures("hurried")
def test_a_robot_of_which_there_are_two_is_named_as_such(tmp_path: Path, capsys: Capture) -> None:
    radio = ScriptedRadio(tmp_path / "radio")
    radio.counts = {"alive": 0b10000, "duplicate": 0b10000}
    with plugged(radio):
        ended = run(capsys, "stop", "--port", radio.link)
    assert ended.code == 2
    assert "robot 4: two radios send under its id: provision one of them anew" in ended.out
