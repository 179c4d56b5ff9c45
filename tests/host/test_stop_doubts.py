"""STOP and RESUME from a radio that has a twin, or whose answers come late."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from commands_run import refused, run
from host_devices import plugged
from radio_samples import reply_of
from scripted_radio import ScriptedRadio

from hippomat_core.wire.link import FLAG_PASSIVE, FLAG_PROVISIONED, Command, Hello
from hippomat_host import following

Capture = pytest.CaptureFixture[str]


@pytest.fixture(autouse=True)
def _hurried(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(following, "DEADLINE_S", 1.0)


@pytest.mark.parametrize("others", [0, 0b10])
def test_another_radio_under_the_radios_own_id_is_named_and_nobody_calls_it_stopped(
    tmp_path: Path, capsys: Capture, others: int
) -> None:
    radio = ScriptedRadio(tmp_path / "radio", robot=4, flags=FLAG_PASSIVE | FLAG_PROVISIONED)
    radio.counts = {"alive": 0b10000 | others}
    with plugged(radio):
        stopped = run(capsys, "stop", "--port", radio.link)
        resumed = run(capsys, "resume", "--port", radio.link)
        again = run(capsys, "resume", "--port", radio.link)
    assert stopped.code == resumed.code == again.code == 2
    assert "another radio sends as robot 4: whether it stopped is not known" in stopped.out
    assert "another radio sends as robot 4: whether it goes on is not known" in resumed.out
    assert "another radio sends as robot 4, and whether it is stopped is not known" in again.out
    assert "done" not in stopped.out + resumed.out


def test_an_answer_to_an_earlier_question_is_no_refusal(tmp_path: Path, capsys: Capture) -> None:
    def late(hello: Hello) -> list[Any]:
        stale = reply_of(**radio.facts)
        if hello.link_version:
            radio.facts |= {"fleet": hello.fleet, "channel": hello.channel}
        return [stale, reply_of(**radio.facts)]

    radio = ScriptedRadio(tmp_path / "radio", {Hello: late}, robot=255)
    with plugged(radio):
        line = refused(capsys, "stop", "--port", radio.link, "--fleet", 7, "--channel", 6)
    assert "nobody sends on channel 6" in line
    assert len(radio.told_of(Command)) == 1
