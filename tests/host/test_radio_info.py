"""What a radio says of itself: everything but the key, and nothing is changed by asking."""

from __future__ import annotations

import json
import time
from pathlib import Path
from typing import Any

import pytest
from commands_run import refused, run
from host_devices import Base, plugged
from real_radios import KEY, a_dongle, a_fleet, desk
from scripted_radio import VANISH, ScriptedRadio

from hippomat_core.wire.link import (
    FLAG_AGREED,
    FLAG_OPEN,
    FLAG_PASSIVE,
    FLAG_STOPPED,
    FLAG_UNSAFE,
    PEER_ALIVE,
    PEER_BABBLING,
    PEER_DUPLICATE,
    AskPeers,
    PeerReport,
)
from hippomat_host.radio_words import RESET_REASONS, duration
from hippomat_sim.radio import Memory

Capture = pytest.CaptureFixture[str]


def told(text: str) -> dict[str, str]:
    """The rows of the upper table: name -> text."""
    rows: dict[str, str] = {}
    for line in text.split("\n\n")[0].splitlines():
        name = line[:10].strip()
        if name:
            rows[name] = line[10:].strip()
    return rows


def peer(robot: int, flags: int, **changes: Any) -> PeerReport:
    facts = {
        "mac": bytes(range(6)),
        "boot": 9,
        "sequence": 77,
        "rssi_dbm": -61,
        "age_ms": 90,
        "received": 1234,
    }
    return PeerReport(**{"robot": robot, **facts, "loss": 51, "flags": flags, **changes})


def test_a_radio_in_a_sealed_fleet_shows_all_but_its_key(tmp_path: Path, capsys: Capture) -> None:
    memories = [*a_fleet(3, fleet=7, channel=6, key=KEY), a_dongle(fleet=7, channel=6, key=KEY)]
    with desk(tmp_path, memories, robots=[0, 1, 2]) as radios:
        time.sleep(2.0)
        before = radios.radios[3].memory
        ended = run(capsys, "radio-info", "--port", radios.path(3))
        as_json = run(capsys, "radio-info", "--json", "--port", radios.path(3))
        assert radios.radios[3].memory == before
        mac = radios.radios[3].mac.hex(":")
        peer_macs = [radio.mac.hex(":") for radio in radios.radios[:3]]
    assert ended.code == 0, ended
    rows = told(ended.out)
    assert rows["MAC"] == mac
    assert rows["identity"] == "an operator's radio of fleet 7, provisioned"
    assert rows["air"] == "channel 6, 6 Mbit/s"
    assert rows["seal"].startswith("sealed")
    assert "counter 1760000001" in rows["boot"]
    assert rows["fleet time"].endswith("agreed with others")
    assert rows["STOP"].startswith("not latched")
    for robot, peer_mac in enumerate(peer_macs):
        (line,) = [line for line in ended.out.splitlines() if line.startswith(f"robot {robot} ")]
        assert "alive" in line
        assert peer_mac in line
    tree = json.loads(as_json.out)
    assert (tree["robot"], tree["fleet"], tree["channel"], tree["mac"]) == (255, 7, 6, mac)
    assert tree["alive"] == [0, 1, 2]
    assert tree["flags"]["open"] is False
    assert [one["mac"] for one in tree["peers"]] == peer_macs
    assert KEY.hex() not in ended.out + as_json.out
    assert "key" not in tree


def test_a_new_radio_says_open_and_keeps_what_it_is(tmp_path: Path, capsys: Capture) -> None:
    with desk(tmp_path, [Memory(fleet=9, channel=11, slots=17)]) as radios:
        ended = run(capsys, "radio-info", "--port", radios.path(0))
        listed = run(capsys, "ports", radios.path(0))
        memory = radios.radios[0].radio.memory
    rows = told(ended.out)
    assert (
        rows["identity"] == "a new radio (not provisioned) of fleet 9, takes fleet and channel from its host"
    )
    assert rows["seal"].startswith("OPEN")
    assert rows["fleet time"].endswith("not agreed with anybody")
    assert rows["schedule"] == "rounds of 100 ms, 17 slots"
    assert "hears nobody since its boot" in ended.out
    assert (memory.robot, memory.fleet, memory.channel, memory.slots) == (255, 9, 11, 17)
    assert "a new radio (not" in listed.out
    assert "OPEN" in listed.out


def test_every_trouble_is_named_with_the_robots(tmp_path: Path, capsys: Capture) -> None:
    flags = FLAG_OPEN | FLAG_AGREED | FLAG_PASSIVE | FLAG_UNSAFE
    radio = ScriptedRadio(tmp_path / "radio", flags=flags, reset_reason=9)
    radio.stop_counter = 4
    radio.counts = {"duplicate": 0b10100, "babbling": 0b1000, "rebooted": 1 << 63, "dropped_forged": 12}
    radio.peers = [
        peer(0, PEER_ALIVE),
        peer(3, PEER_ALIVE | PEER_BABBLING, rssi_dbm=-90),
        peer(4, PEER_DUPLICATE, age_ms=70_000),
        peer(63, 0, age_ms=2**32 - 1),
        peer(255, PEER_ALIVE),
    ]
    with plugged(radio):
        ended = run(capsys, "radio-info", "--port", radio.link)
    out = " ".join(ended.out.split())
    for part in (
        "reset by: brownout: check the supply",
        "LATCHED, counter 4: `hippomat-host resume --port",
        "12 forged: the tag is wrong",
        "another radio sends as robot 2",
        "boot counter cannot be stored",
        "two radios send under one id: robot 4",  # 2 is our own
        "sends far too many frames: robot 3",
        "restarted within the last second: robot 63",
        "robot 0 alive 0.1 s ago -61 20% 1234 00:01:02:03:04:05 9",
        "robot 3 BABBLING",
        "robot 4 DUPLICATE id 1 min 10 s ago",
        "robot 63 silent 49 d 17 h ago",
        "operator alive",
    ):
        assert part in out, (part, ended.out)


def test_ports_tells_what_holds_in_a_radio(tmp_path: Path, capsys: Capture) -> None:
    flags = FLAG_AGREED | FLAG_PASSIVE | FLAG_UNSAFE | FLAG_STOPPED
    radio = ScriptedRadio(tmp_path / "radio", flags=flags)
    with plugged(radio):
        out = " ".join(run(capsys, "ports", radio.link).out.split())
    for part in ("sealed", "fleet time agreed", "STOP latched", "silent: another radio", "store its boot"):
        assert part in out


def test_garbage_between_the_answers_does_not_matter(tmp_path: Path, capsys: Capture) -> None:
    radio = ScriptedRadio(tmp_path / "radio")
    radio.speaks = [b"\x00boot:0x8 (SPI)\r\n\x00", b"\x03\x83\x01\x00"]
    radio.peers = [peer(1, PEER_ALIVE)]
    with plugged(radio):
        ended = run(capsys, "radio-info", "--port", radio.link)
    assert ended.code == 0
    assert "robot 1" in ended.out


def test_a_radio_that_falls_silent_or_goes_away_is_named(tmp_path: Path, capsys: Capture) -> None:
    radio = ScriptedRadio(tmp_path / "r", {AskPeers: lambda _: [peer(1, 0)]})
    with plugged(radio):
        assert "does not tell its status" in refused(capsys, "radio-info", "--port", radio.link)
    radio = ScriptedRadio(tmp_path / "r", {AskPeers: lambda _: [VANISH]})
    with plugged(radio):
        assert "went away" in refused(capsys, "radio-info", "--port", radio.link)


def test_what_is_no_radio_is_named(tmp_path: Path, capsys: Capture) -> None:
    base = Base(tmp_path / "b")
    with plugged(base):
        line = refused(capsys, "radio-info", "--port", base.link)
    assert f"{base.link} is the base, not a radio: give the radio's port with --port" in line
    assert "--port is missing" in refused(capsys, "radio-info")


@pytest.mark.parametrize(
    ("seconds", "text"),
    [(0.04, "0.0 s"), (59.96, "60.0 s"), (60, "1 min 0 s"), (7385, "2 h 3 min"), (90_000, "1 d 1 h")],
)
def test_durations_read_well(seconds: float, text: str) -> None:
    assert duration(seconds) == text


def test_every_reset_reason_of_esp_idf_has_a_name() -> None:
    assert len(RESET_REASONS) == 16
