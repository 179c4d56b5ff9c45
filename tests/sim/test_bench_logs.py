"""hippomat-bench logs: every reader reads the same messages, and figures come with their targets."""

from __future__ import annotations

import json
import os
import sys
import time
from pathlib import Path
from typing import Any

import pytest
from recorded_data import data_folder

from hippomat_logs.recorder import Recorder
from hippomat_sim.bench import logs_recorder
from hippomat_sim.bench.cli import main
from hippomat_sim.bench.logs_stream import MESSAGES_PER_S, Call, Step, Stream, call_of, record


def test_the_made_up_second_has_as_many_messages_as_it_says(tmp_path: Path) -> None:
    from hippomat_logs import open_run

    run = open_run(record(tmp_path, seconds=1))
    views = {"/tf_static"}  # once per run
    assert sum(len(table) for topic, table in run.tables().items() if topic not in views) == MESSAGES_PER_S
    assert [step[0] for step in Stream().steps(0)] == sorted(step[0] for step in Stream().steps(0))


def test_all_readers_read_the_same_messages(capsys: pytest.CaptureFixture[str]) -> None:
    answer: Any = main(["logs", "--seconds", "2", "--recorder-seconds", "1", "--large", "4", "--json"])
    report = json.loads(capsys.readouterr().out)
    assert answer in (0, 2)  # what a busy machine achieves is not the point here
    (figures,) = report["readers"].values()
    assert {one["messages"] for one in figures} == {2 * MESSAGES_PER_S + 1}
    assert all(one["peak_mib"] > 1 and one["per_s"] > 0 for one in figures)
    assert report["recorder"]["lost"] == 0
    assert report["large"]["mib"] > 3.9
    names = [target["name"] for target in report["targets"]]
    assert any("AnyReader" in name for name in names)
    assert "worst stall of the control loop" in names
    assert "memory of doctor" in names


def test_a_recorder_that_makes_the_loop_wait_is_found_out(monkeypatch: pytest.MonkeyPatch) -> None:
    calls, wait_s = 0, 0.03

    def slow_now_and_then(recorder: Recorder, step: Step) -> Call:
        nonlocal calls
        calls += 1
        due_ns, call, arguments = call_of(recorder, step)

        def waiting(*given: Any) -> None:
            time.sleep(wait_s)
            call(*given)

        return due_ns, waiting if calls % 200 == 0 else call, arguments

    monkeypatch.setattr(logs_recorder, "call_of", slow_now_and_then)
    before = sys.getswitchinterval(), os.sched_getscheduler(0)
    figures = logs_recorder.measure_recorder(1, MESSAGES_PER_S, lambda _: None)
    assert figures.stall_ms >= 1e3 * wait_s
    assert (sys.getswitchinterval(), os.sched_getscheduler(0)) == before


def test_a_file_that_another_reader_refuses_is_not_judged(capsys: pytest.CaptureFixture[str]) -> None:
    path = data_folder() / "bags" / "topics_and_services.mcap"
    assert main(["logs", str(path), "--recorder-seconds", "0"]) == 0
    said = capsys.readouterr().out.replace("\n", " ")
    assert "rosbags AnyReader refused" in said
    assert "not judged" in said


@pytest.mark.parametrize(
    ("arguments", "said"), [(["/nowhere.mcap"], "no such file"), (["--seconds", "0"], "begin at 1")]
)
def test_wrong_usage_is_one_line(arguments: list[str], said: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["logs", *arguments]) == 1
    assert said in capsys.readouterr().err
