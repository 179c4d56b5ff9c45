"""What a report shows of logs, and what it refuses. In a browser: test_report_in_browser.py."""

from __future__ import annotations

import math
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest
from fused_lab import write_fleet as write_told
from hypothesis import given, settings
from hypothesis import strategies as st
from log_samples import START_NS, WALL_NS
from radio_traffic_lab import YEAR_S, Clock, Robot
from recorded_run import record_run
from report_samples import CONFIRMED, REQUESTED, SERVED_FROM, pose_of, write_fleet

from hippomat_core import messages as m
from hippomat_core.config import Config, RobotConfig
from hippomat_core.errors import HippomatError
from hippomat_logs.cli import main
from hippomat_logs.manifest import run_manifest
from hippomat_logs.reader import read_records
from hippomat_logs.recorder import Recorder
from hippomat_logs.report_html import data as shown
from hippomat_logs.report_html.assembly import HELD_S, MOST_POSES, frames_of, task_lives
from hippomat_logs.report_html.building import build
from hippomat_logs.report_html.data import Body, ClaimEnd, RobotView, TaskSeen, Track
from hippomat_logs.report_html.map_figure import coarser
from hippomat_logs.report_html.page import render
from hippomat_logs.report_html.time_figures import events_figure, time_range

SCRIPT = "<script>window.pwned = true</script>"
HOUR_NS = 3_600_000_000_000


def say(text: str) -> m.AlarmRaised:
    return m.AlarmRaised(m.WARNING, "told", text)


# ---- what is shown ----


def test_a_robot_without_radio_is_shown_by_its_own_clock_while_the_others_are_aligned(tmp_path: Path) -> None:
    deaf = frozenset({(0, 1), (1, 0), (0, 2), (2, 0)})
    at_ns = 30 * YEAR_S * 10**9
    clocks = [Robot(Clock(at_ns)), Robot(Clock(at_ns)), Robot(Clock(2 * at_ns))]  # of the third, wrong
    write_told(tmp_path / "near", clocks, deaf=deaf)
    data, _ = build([tmp_path / "near"])
    assert data.span_s < 10.0
    assert "by the frames" in data.metrics.clocks
    assert any("no radio traffic links robot 0 with the others" in line for line in data.warnings)
    write_told(tmp_path / "far", [Robot(Clock(3 * at_ns)), *clocks[1:]], deaf=deaf)
    with pytest.raises(
        HippomatError, match="links robot 0 with the others, and by its wall clock it did not"
    ):
        build([tmp_path / "far"])


def test_a_robot_is_shown_where_its_log_says_and_doing_what_it_broadcast(tmp_path: Path) -> None:
    write_fleet(tmp_path, robots=3)
    data, whole = build([tmp_path])
    assert whole
    assert [robot.robot for robot in data.robots] == [0, 1, 2]
    assert data.grid is not None
    for k in range(3):
        x_m, y_m, _ = pose_of(k, 3, 2.0)
        at = round(2.0 / data.frames.step_s)
        assert data.frames.x_m[k, at] == pytest.approx(x_m, abs=0.06)
        assert data.frames.y_m[k, at] == pytest.approx(y_m, abs=0.06)
    phases = [span.phase for span in data.robots[1].spans]
    assert phases == [shown.IDLE, shown.REQUESTED, shown.CONFIRMED, shown.SERVING, shown.IDLE]
    begins = [span.begin_s for span in data.robots[1].spans[1:4]]
    assert begins == pytest.approx([REQUESTED / 10, CONFIRMED / 10, SERVED_FROM / 10], abs=0.01)
    done = [task for task in data.tasks if task.completed_by >= 0]
    assert [(task.slot, task.completed_by) for task in done] == [(0, 0), (1, 1), (2, 2)]


def test_peers_without_a_log_are_shown_as_they_were_heard(tmp_path: Path) -> None:
    write_fleet(tmp_path, robots=3)
    data, _ = build([next(tmp_path.glob("robot01*"))])
    assert [(robot.robot, robot.heard_by) for robot in data.robots] == [(0, 1), (1, None), (2, 1)]
    x_m, y_m, _ = pose_of(2, 3, 3.0)
    at = round(3.0 / data.frames.step_s)
    assert data.frames.x_m[2, at] == pytest.approx(x_m, abs=0.1)
    assert data.frames.y_m[2, at] == pytest.approx(y_m, abs=0.1)
    assert data.title == "Robot 1 of fleet 1"


def test_a_fused_file_shows_what_its_logs_show(tmp_path: Path) -> None:
    logs, fused = tmp_path / "logs", tmp_path / "fused.mcap"
    write_fleet(logs, robots=2)
    assert main(["fuse", str(logs), "-o", str(fused), "--trust-clocks"]) == 0
    apart, _ = build([logs])
    together, whole = build([fused])
    assert whole
    assert [robot.robot for robot in together.robots] == [0, 1]
    assert np.array_equal(together.frames.x_m, apart.frames.x_m, equal_nan=True)
    assert [robot.spans for robot in together.robots] == [robot.spans for robot in apart.robots]
    both, _ = build([logs, fused])
    assert [log.robot for log in both.robots] == [0, 1]


def test_an_observers_log_alone_shows_whom_it_heard(tmp_path: Path) -> None:
    config, heard = Config(), tmp_path / "robots"
    write_fleet(heard, robots=3)
    recorder = Recorder(
        tmp_path,
        run_manifest(config, session_id="0b5e7e55"),
        config=config,
        wall_ns=WALL_NS,
        stamp_ns=START_NS,
        lossless=True,
    )
    for _, _, _, message in read_records(next(heard.glob("robot01*"))):
        if isinstance(message, m.StateHeard):
            recorder.put(message.stamp_ns, message)
    recorder.close()
    data, whole = build([next(tmp_path.glob("*.mcap"))])
    assert whole
    assert [(robot.robot, robot.heard_by) for robot in data.robots] == [(0, -1), (2, -1)]
    assert data.title == "Fleet 1, as an observer heard it"
    assert next(fact.text for fact in data.facts if fact.name == "Logs").startswith("the observer (")
    assert "Only a robot&#39;s own log tells." in render(data, "0")


def test_a_run_of_the_core_with_all_its_devices_becomes_a_report(tmp_path: Path) -> None:
    record_run(tmp_path, ticks=60)
    out = tmp_path / "run.html"
    assert main(["report", str(tmp_path), "-o", str(out)]) == 0
    text = out.read_text("utf-8")
    assert "Robot 0 of fleet 1" in text
    assert 'http-equiv="Content-Security-Policy" content="default-src \'none\'' in text


def test_a_run_in_which_nothing_happened_says_so(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    write_fleet(tmp_path, robots=2, seconds=1.0)
    data, _ = build([tmp_path], trust_clocks=True)
    assert events_figure(data, time_range(data)) is None
    assert "nobody stuck" in render(data, "0")
    assert caplog.messages == []  # Bokeh complains of figures with nothing in them


def test_that_the_core_has_changed_since_is_no_alarm(tmp_path: Path) -> None:
    config = Config(robot=RobotConfig(id=0))
    manifest = {**run_manifest(config, session_id="5e551011"), "core_hash": "0" * 16}
    recorder = Recorder(tmp_path, manifest, config=config, wall_ns=WALL_NS, stamp_ns=START_NS)
    recorder.put(START_NS, m.Started(START_NS))
    recorder.close()
    data, _ = build([tmp_path])
    (replay,) = [fact for fact in data.facts if fact.name == "Replay"]
    assert not replay.bad
    assert replay.text.startswith("whole, with its weights: hippomat-replay tells")
    assert data.warnings == []


def test_texts_of_a_log_are_never_html(tmp_path: Path) -> None:
    def extra(recorder: Recorder, stamp_ns: int) -> None:
        recorder.put(stamp_ns, say(SCRIPT))
        recorder.put(stamp_ns, m.ConflictSeen(1, 0, 2, True, SCRIPT))

    write_fleet(tmp_path, robots=1, host=SCRIPT, extra=extra)
    out = tmp_path / "run.html"
    assert main(["report", str(tmp_path), "-o", str(out)]) == 0
    text = out.read_text("utf-8")
    assert SCRIPT not in text
    assert text.count("&lt;script&gt;window.pwned = true&lt;/script&gt;") >= 2


# ---- laws ----


@given(
    st.lists(st.integers(0, 20_000), min_size=1, max_size=40, unique=True).map(sorted),
    st.floats(0.1, 20.0),
)
def test_a_frame_shows_the_last_pose_or_none_that_is_old(times_ms: list[int], span_s: float) -> None:
    at_s = np.array(times_ms) / 1e3
    track = Track(at_s, np.arange(len(at_s)) * 1.0, -np.arange(len(at_s)) * 1.0, np.zeros(len(at_s)))
    frames = frames_of([RobotView(0, Body(0.1), track)], span_s)
    assert frames.x_m.shape[1] * frames.step_s >= span_s
    for k, x_m in enumerate(frames.x_m[0].tolist()):
        now_s = k * frames.step_s
        before = [n for n, then_s in enumerate(at_s.tolist()) if then_s <= now_s]
        if before and now_s - at_s[before[-1]] <= HELD_S:
            assert x_m == before[-1]
        else:
            assert math.isnan(x_m)


@given(st.integers(1, 30), st.floats(1.0, 36_000.0))
@settings(max_examples=20)
def test_a_long_run_has_no_more_poses_than_can_be_mailed(robots: int, span_s: float) -> None:
    nowhere = Track(*(np.empty(0) for _ in range(4)))
    frames = frames_of([RobotView(k, Body(0.1), nowhere) for k in range(robots)], span_s)
    assert frames.x_m.size <= MOST_POSES + 2 * robots


seen = st.builds(
    TaskSeen,
    at_s=st.floats(0, 100),
    slot=st.integers(0, 2),
    generation=st.integers(0, 3),
    x_m=st.just(1.0),
    y_m=st.just(2.0),
    closed=st.booleans(),
)


@given(st.lists(seen, max_size=20), st.randoms(use_true_random=False))
def test_a_slot_has_one_open_task_at_a_time_whoever_tells_first(told: list[TaskSeen], random: object) -> None:
    lives = task_lives(told, [])
    shuffled = list(told)
    random.shuffle(shuffled)  # type: ignore[attr-defined]
    times = [(one.slot, one.generation, one.seen_s, one.closed_s) for one in lives]
    if len({one.at_s for one in told}) == len(told):
        assert times == [
            (one.slot, one.generation, one.seen_s, one.closed_s) for one in task_lives(shuffled, [])
        ]
    for one in lives:
        assert one.closed_s >= one.seen_s
        for other in lives:
            if one.slot == other.slot and one.generation < other.generation:
                assert one.closed_s <= max(other.seen_s, one.seen_s)


def test_a_served_task_says_when_and_by_whom() -> None:
    robot = RobotView(4, Body(0.1), Track(*(np.empty(0) for _ in range(4))))
    robot.ends = [ClaimEnd(5.0, 1, 0, "dropped", "loss"), ClaimEnd(9.0, 1, 0, "completed", "served")]
    (life,) = task_lives([TaskSeen(1.0, 1, 0, 0.0, 0.0)], [robot])
    assert (life.completed_s, life.completed_by) == (9.0, 4)


@given(st.integers(0, 2**32 - 1), st.integers(1, 30), st.integers(1, 30), st.integers(1, 7))
def test_a_coarser_map_loses_no_wall(seed: int, high: int, wide: int, factor: int) -> None:
    kinds = np.random.default_rng(seed).integers(0, 3, (high, wide)).astype(np.uint8)
    blocks, more_y, more_x = coarser(kinds, factor)
    assert (blocks.shape[0] * factor, blocks.shape[1] * factor) == (high + more_y, wide + more_x)
    for iy, ix in zip(*np.nonzero(kinds == 2), strict=True):
        assert blocks[iy // factor, ix // factor] == 2


# ---- what is wrong with logs ----


@pytest.mark.parametrize("fault", ["bit", "cut"])
def test_a_damaged_log_is_shown_as_far_as_it_can_be_read_and_says_so(tmp_path: Path, fault: str) -> None:
    write_fleet(tmp_path, robots=2, seconds=30.0)
    path = next(tmp_path.glob("robot01*"))
    held = bytearray(path.read_bytes())
    if fault == "bit":
        held[len(held) // 3] ^= 16
    else:
        del held[2 * len(held) // 3 :]
    path.write_bytes(held)
    out = tmp_path / "run.html"
    assert main(["report", str(tmp_path), "-o", str(out)]) == 3
    text = out.read_text("utf-8")
    assert "not of damaged logs: robot 1" in text
    assert 'role="alert">log of robot 1 is not whole:' in text
    data, whole = build([tmp_path])
    assert not whole
    assert [robot.robot for robot in data.robots] == [0, 1]
    assert np.isfinite(data.frames.x_m[1]).any()


def test_a_selection_of_a_run_is_shown_as_what_it_is(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_fleet(tmp_path, robots=1, seconds=10.0)
    part, out = tmp_path / "part.mcap", tmp_path / "run.html"
    (log,) = tmp_path.glob("robot*")
    assert main(["filter", str(log), "--from", "2", "--to", "5", "-o", str(part)]) == 0
    assert main(["report", str(part), "-o", str(out)]) == 3
    assert "is a selection of a run" in capsys.readouterr().out.replace("\n", " ")


def test_two_runs_of_one_robot_are_no_report(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_fleet(tmp_path, robots=1, seconds=1.0)
    write_fleet(tmp_path, robots=1, seconds=1.0, wall_ns=WALL_NS + HOUR_NS + 1)
    assert main(["report", str(tmp_path), "-o", str(tmp_path / "run.html")]) == 1
    said = capsys.readouterr().err.replace("\n", " ")
    assert "robot 0 has more than one run here" in said
    assert not (tmp_path / "run.html").exists()


def test_robots_that_never_met_are_no_report(tmp_path: Path) -> None:
    for robot, wall_ns in ((0, WALL_NS), (1, WALL_NS + HOUR_NS)):
        whole = tmp_path / f"all{robot}"
        write_fleet(whole, robots=2, seconds=1.0, wall_ns=wall_ns)
        (tmp_path / "some").mkdir(exist_ok=True)
        log = next(whole.glob(f"robot{robot:02d}*"))
        shutil.copy(log, tmp_path / "some" / log.name)
    with pytest.raises(HippomatError, match="no radio traffic"):
        build([tmp_path / "some"])


def test_two_fleets_are_no_report(tmp_path: Path) -> None:
    write_fleet(tmp_path / "a", robots=1, seconds=1.0)
    write_fleet(tmp_path / "b", robots=2, seconds=1.0, fleet=2)
    logs = [*(tmp_path / "a").glob("*"), next((tmp_path / "b").glob("robot01*"))]
    with pytest.raises(HippomatError, match="fleets 1, 2"):
        build(logs)


@pytest.mark.parametrize(
    ("arguments", "code", "said"),
    [
        (["report"], 1, "LOG"),
        (["report", "{tmp}/none.mcap", "-o", "{tmp}/run.html"], 1, "none.mcap"),
        (["report", "{tmp}", "-o", "{tmp}/run.html"], 1, "holds no log"),
        (["report", "{tmp}", "-o", "{tmp}/run.pdf"], 1, "ends in .html"),
        (["report", "{tmp}", "-o", "{tmp}/none/run.html"], 1, "there is no directory"),
        (["report", "{tmp}/other.mcap", "-o", "{tmp}/run.html"], 1, "is no log of a hippomat daemon"),
    ],
)
def test_every_refusal_is_one_clear_line(
    tmp_path: Path, arguments: list[str], code: int, said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    if "other" in str(arguments):
        (tmp_path / "other.mcap").write_bytes(b"\x89MCAP0\r\n" + bytes(64))
    try:
        answer: object = main([argument.format(tmp=tmp_path) for argument in arguments])
    except SystemExit as error:
        answer = error.code
    captured = capsys.readouterr()
    assert answer == code
    assert said in (captured.out + captured.err).replace("\n", " ")


def test_without_bokeh_the_error_names_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    write_fleet(tmp_path, robots=1, seconds=1.0)
    monkeypatch.setitem(sys.modules, "bokeh", None)
    assert main(["report", str(tmp_path), "-o", str(tmp_path / "run.html")]) == 1
    assert "pip install 'hippomat[report]'" in capsys.readouterr().err.replace("\n", " ")
