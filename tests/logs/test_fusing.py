"""A fused file: causal, at common time, and every run in it as its own log was."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from fused_lab import ROBOTS, dropping, with_views, write_fleet, write_log
from hypothesis import given
from hypothesis import strategies as st
from mcap.reader import make_reader
from radio_traffic_lab import fleet
from rosbags.highlevel import AnyReader

from hippomat_core import messages as m
from hippomat_logs.causal_order import Causes, Held, Placed, Stamped, in_causal_order
from hippomat_logs.cli import main
from hippomat_logs.opened_run import group_runs
from hippomat_logs.reader import open_runs
from hippomat_logs.schema import CLASSES, TOPICS

Event = tuple[int, int, int | None]  # run, time, index of its cause among all events


@st.composite
def histories(draw: st.DrawFn) -> list[Event]:
    """Events of up to four runs in an order that could have been, with times that are wrong."""
    made: list[Event] = []
    for index in range(draw(st.integers(0, 30))):
        run, time = draw(st.integers(0, 3)), draw(st.integers(0, 50))
        others = [k for k in range(index) if made[k][0] != run]
        cause = draw(st.sampled_from([None, *others]))
        made.append((run, time, cause))
    return made


def numbered(history: list[Event]) -> dict[int, tuple[int, int]]:
    """Index of an event -> its run and its number there."""
    counts, found = [0] * 4, {}
    for index, (run, _, _) in enumerate(history):
        counts[run] += 1
        found[index] = run, counts[run]
    return found


def ordered(history: list[Event], held: Held) -> list[Placed[int]]:
    places = numbered(history)

    def feed(run: int) -> Iterator[Stamped[int]]:
        for index, (of, time, _) in enumerate(history):
            if of == run:
                yield Stamped(places[index][1], time, index)

    causes = []
    for run in range(4):
        rows = [
            (places[k][1], *places[e[2]]) for k, e in enumerate(history) if e[0] == run and e[2] is not None
        ]
        table = np.array(rows, np.int64).reshape(-1, 3)
        causes.append(Causes(table[:, 0], table[:, 1], table[:, 2]))
    return list(in_causal_order([feed(run) for run in range(4)], causes, held))


@given(histories())
def test_an_order_keeps_every_record_its_run_s_order_and_its_causes(history: list[Event]) -> None:
    held = Held()
    placed = ordered(history, held)
    where = {one.stamped.record: k for k, one in enumerate(placed)}
    assert sorted(where) == list(range(len(history)))
    for run in range(4):
        own = [one.stamped.number for one in placed if one.run == run]
        assert own == sorted(own)
    for index, (_, time, cause) in enumerate(history):
        assert cause is None or where[cause] < where[index]
        assert placed[where[index]].at_ns >= time
    times = [one.at_ns for one in placed]
    assert times == sorted(times)
    assert held.broken == 0


def test_records_that_wait_for_each_other_are_placed_and_counted() -> None:
    feeds = [
        iter([Stamped(1, 10, "a"), Stamped(2, 11, "b")]),
        iter([Stamped(1, 12, "c"), Stamped(2, 13, "d")]),
    ]
    ring = [Causes(*(np.array([k]) for k in (1, 1, 2))), Causes(*(np.array([k]) for k in (1, 0, 2)))]
    held = Held()
    assert [one.stamped.record for one in in_causal_order(feeds, ring, held)] == ["a", "b", "c", "d"]
    assert held.broken == 1


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    directory = tmp_path_factory.mktemp("fleet") / "logs"
    write_fleet(directory)
    return directory


@pytest.fixture(scope="module")
def fused(logs: Path) -> Path:
    path = logs.parent / "fused.mcap"
    assert main(["fuse", str(logs), "-o", str(path)]) == 0
    return path


def assert_same_runs(one: Path, other: Path) -> None:
    for a, b in zip(open_runs([one]), open_runs([other]), strict=True):
        assert (a.name, a.robot, a.records) == (b.name, b.robot, b.records)
        assert [raw for _, raw in a.raw_in_order()] == [raw for _, raw in b.raw_in_order()]
        assert (a.lost, a.recovered) == (b.lost, b.recovered)


def test_every_run_in_it_is_read_as_its_own_log_is(logs: Path, fused: Path) -> None:
    assert_same_runs(logs, fused)


def test_its_runs_can_be_taken_out_again(logs: Path, fused: Path, tmp_path: Path) -> None:
    assert main(["filter", str(fused), "-o", str(tmp_path)]) == 0
    for a, b in zip(open_runs([logs]), open_runs([tmp_path]), strict=True):
        assert [raw for _, raw in a.raw_in_order()] == [raw for _, raw in b.raw_in_order()]


def test_no_reception_stands_before_its_sending_and_time_never_goes_back(fused: Path) -> None:
    sent: set[tuple[int, int, int]] = set()
    store, last_ns, receptions = open_runs([fused])[0].store, 0, 0
    boots = {0: 1, 1: 1, 2: 1}
    with fused.open("rb") as file:
        for _, channel, message in make_reader(file).iter_messages(log_time_order=False):
            assert message.log_time >= last_ns
            last_ns = message.log_time
            robot, _, topic = channel.topic[1:].partition("/")
            kind = CLASSES.get(f"/{topic}")
            if kind is m.FrameSent:
                frame, id_ = store.decode(kind, message.data), int(robot[5:])
                boots[id_] += id_ == 2 and frame.sequence == 1 and (2, 1, 1) in sent
                sent.add((id_, boots[id_], frame.sequence))
            elif kind is m.StopHeard:
                header = store.decode(kind, message.data).header
                assert (header.sender, header.boot, header.sequence) in sent
                receptions += 1
    assert receptions > 300


def test_other_tools_read_it_and_see_one_fleet_in_one_map(fused: Path) -> None:
    with AnyReader([fused]) as reader:
        topics = {connection.topic for connection in reader.connections}
        assert {"/map", "/tf", "/tf_static", "/robot00/odom", "/robot02/odom"} <= topics
        assert "/robot01/map" not in topics
        frames, maps = set(), 0
        for connection, time_ns, data in reader.messages():
            maps += connection.topic == "/map"
            if connection.topic == "/tf":
                for link in reader.deserialize(data, connection.msgtype).transforms:
                    frames.add((link.header.frame_id, link.child_frame_id))
                    assert link.header.stamp.sec == time_ns // 10**9
    assert maps == 1
    robots = [f"robot{k:02d}" for k in range(3)]
    assert frames == {("map", f"{r}/odom") for r in robots} | {
        (f"{r}/odom", f"{r}/base_link") for r in robots
    }


def test_its_tables_are_those_of_the_parts(logs: Path, fused: Path) -> None:
    topic = TOPICS[m.PoseEstimated]
    for a, b in zip(group_runs(logs), group_runs(fused), strict=True):
        assert (a.name, a.robot) == (b.name, b.robot)
        for column in ("log_time_ns", "record", "x_m"):
            assert (a[topic][column] == b[topic][column]).all()
        assert len(b.table(topic, 1.0, 2.0)) == len(a.table(topic, 1.0, 2.0)) > 0


def test_a_run_that_is_there_twice_is_given_once_as_its_own_files(logs: Path, fused: Path) -> None:
    assert fused.parent == logs.parent
    assert [run.inside for run in open_runs([logs.parent])] == ["", "", ""]
    assert len(group_runs(logs.parent)) == 3
    assert len(open_runs([fused, fused.parent])) == 3


def test_a_fused_file_can_be_fused_again(fused: Path, tmp_path: Path) -> None:
    assert main(["fuse", str(fused), "-o", str(tmp_path / "again.mcap")]) == 0
    assert_same_runs(fused, tmp_path / "again.mcap")


def test_info_and_doctor_say_what_it_is(fused: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["info", str(fused)]) == 0
    assert "one of the runs fused in this file, at /robot02" in capsys.readouterr().out
    assert main(["doctor", str(fused)]) == 0
    assert "sound" in capsys.readouterr().out


def test_a_flipped_bit_in_it_is_found(
    fused: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    data = bytearray(fused.read_bytes())
    data[len(data) // 2] ^= 1
    broken = tmp_path / "broken.mcap"
    broken.write_bytes(data)
    assert main(["doctor", str(broken)]) == 3
    assert "fuse the robots' own logs again" in " ".join(capsys.readouterr().out.split())
    assert main(["metrics", str(broken)]) == 3


def test_losses_and_a_missing_end_are_fused_as_they_are(tmp_path: Path) -> None:
    one, two, three = (with_views(run) for run in fleet(ROBOTS, 5.0, 1))
    logs = tmp_path / "logs"
    write_log(logs, dropping(one, 20, 30), 0)
    write_log(logs, two[:-40], 1, recovered=True)
    write_log(logs, three, 2)
    assert main(["fuse", str(logs), "-o", str(tmp_path / "fused.mcap")]) == 3
    assert_same_runs(logs, tmp_path / "fused.mcap")
    assert main(["doctor", str(tmp_path / "fused.mcap")]) == 3


def test_two_sessions_of_a_robot_and_an_observer_have_topics_of_their_own(tmp_path: Path) -> None:
    zero, one, listener = (with_views(run) for run in fleet(ROBOTS, 6.0, 2))
    logs = tmp_path / "logs"
    write_log(logs, zero, 0)
    middle = len(one) // 2
    write_log(logs, one[:middle], 1, session="aaaaaaaa")
    again = [raw._replace(number=k) for k, raw in enumerate(one[middle:], 1)]
    write_log(logs, again, 1, session="bbbbbbbb")
    write_log(logs, listener, -1)
    assert main(["fuse", str(logs), "-o", str(tmp_path / "fused.mcap")]) == 0
    insides = {(run.robot, run.inside) for run in open_runs([tmp_path / "fused.mcap"])}
    assert insides == {(0, "/robot00"), (1, "/robot01"), (1, "/robot01_2"), (-1, "/observer")}
    assert_same_runs(logs, tmp_path / "fused.mcap")


def test_what_cannot_be_aligned_is_refused_unless_clocks_are_trusted(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    logs, out = tmp_path / "logs", tmp_path / "fused.mcap"
    write_fleet(logs, seconds=3.0, deaf=frozenset({(2, 0), (2, 1), (0, 2), (1, 2)}))
    assert main(["fuse", str(logs), "-o", str(out)]) == 1
    said = " ".join(capsys.readouterr().err.split())
    assert "no radio traffic links robot02_5e551002 with robot00_5e551000" in said
    assert not out.exists()
    assert main(["fuse", str(logs), "-o", str(out), "--trust-clocks", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["trusted"]
    assert [run["offset_ns"] for run in told["runs"]] == [0, 0, 0]
    assert told["runs"][0]["residual_ns"]["median"] > 9 * 365 * 86_400e9
    assert_same_runs(logs, out)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["-o", "fused.bag"], "fused.bag: give a name that ends in .mcap"),
        (["--plot", "fused.gif"], "fused.gif: give a name that ends in .png"),
        (["--reference", "7"], "there is no run of robot 7: there are those of 0, 1, 2"),
        (["--reference", "1", "--trust-clocks"], "--trust-clocks needs no --reference"),
    ],
)
def test_wrong_usage_is_said_in_one_line(
    logs: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], said: str
) -> None:
    assert main(["fuse", str(logs), *arguments]) == 1
    assert said in " ".join(capsys.readouterr().err.split())


def test_nothing_is_overwritten(logs: Path, fused: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["fuse", str(logs), "-o", str(fused)]) == 1
    assert "exists already" in " ".join(capsys.readouterr().err.split())


def test_a_picture_shows_how_late_frames_were(logs: Path, tmp_path: Path) -> None:
    picture = tmp_path / "late.png"
    assert main(["fuse", str(logs), "--plot", str(picture)]) == 0
    assert picture.read_bytes().startswith(b"\x89PNG")
