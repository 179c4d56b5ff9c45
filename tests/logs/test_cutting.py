"""filter, merge, convert, export: nothing changes on the way, and what cannot go along is named."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from recorded_data import data_folder
from recorded_run import recorded_log
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

from hippomat_core.errors import HippomatError
from hippomat_logs import open_run
from hippomat_logs.cli import main
from hippomat_logs.conversion import convert
from hippomat_logs.exports import export_csv, export_parquet
from hippomat_logs.frames import FrameTree
from hippomat_logs.points import points_of
from hippomat_logs.reader import open_runs
from hippomat_logs.replay import ReplayOptions, replay_run
from hippomat_logs.sources import Source, open_source

BAGS = (
    "tilt_laser.bag",
    "example-lz4.bag",
    "talker.mcap",
    "cdr_test_0.mcap",
    "ros2_94_topics.mcap",
    "topics_and_services.mcap",
)
SERVICES = {"/add_two_ints/_service_event", "/add_two_ints2/_service_event"}


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return recorded_log(tmp_path_factory.mktemp("run"), ticks=40)


def messages_of(source: Source, topics: frozenset[str] = frozenset()) -> list[tuple[str, int, str, str]]:
    """Topic, time, type and content of all messages, decoded by rosbags and sorted."""
    types = get_typestore(Stores.EMPTY)
    for stream in source.streams.values():
        if not topics or stream.topic in topics:
            types.register(stream.types)
    found = []
    for row in source.rows():
        stream = source.streams[row.channel]
        if not topics or stream.topic in topics:
            message: Any = types.deserialize_cdr(row.data, stream.type_name)
            found.append((stream.topic, row.log_time_ns, stream.type_name, repr(message)))
    return sorted(found)


WAYS = (("x.bag", "sqlite3"), ("x", "sqlite3"))
MORE_WAYS = (("x.mcap", "sqlite3"), ("x", "mcap"))  # for the small ones
CASES = [(name, *way) for name in BAGS for way in WAYS]
CASES += [(name, *way) for name in ("talker.mcap", "cdr_test_0.mcap") for way in MORE_WAYS]


@pytest.mark.parametrize(("name", "target", "storage"), CASES)
def test_messages_are_equal_there_and_back(tmp_path: Path, name: str, target: str, storage: str) -> None:
    source = open_source(data_folder() / "bags" / name)
    written, left_out = convert(source, tmp_path / target, storage, lambda _: None)
    assert set(left_out) == (SERVICES if "services" in name else set())
    there = open_source(tmp_path / target)
    convert(there, tmp_path / "back.mcap", "sqlite3", lambda _: None)
    back = open_source(tmp_path / "back.mcap")
    few = {
        s.topic for s in source.streams.values() if (s.count or 0) < 500
    }  # the larger ones take their time
    wanted = messages_of(source, frozenset(few))
    assert len(wanted) > 0
    assert messages_of(back, frozenset(few)) == wanted
    assert sum(1 for _ in back.rows()) == written == sum(1 for _ in source.rows())
    with AnyReader([tmp_path / "back.mcap"]) as reader:
        assert reader.message_count == written


def test_a_converted_run_of_ours_can_still_be_replayed(run: Path, tmp_path: Path) -> None:
    convert(open_source(run), tmp_path / "copy.mcap", "sqlite3", lambda _: None)
    assert verdict(tmp_path / "copy.mcap") == "reproduced L0 L1 L2"
    convert(open_source(run), tmp_path / "run.bag", "sqlite3", lambda _: None)
    convert(open_source(tmp_path / "run.bag"), tmp_path / "back.mcap", "sqlite3", lambda _: None)
    assert messages_of(open_source(tmp_path / "back.mcap")) == messages_of(open_source(run))


def verdict(path: Path) -> str:
    (opened,) = open_runs([path])
    return replay_run(opened, ReplayOptions(levels=("L0", "L1", "L2"))).verdict


def test_an_empty_bag_is_refused_in_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    empty = data_folder() / "bags" / "empty-file.bag"
    assert main(["convert", str(empty), str(tmp_path / "x.mcap")]) == 3
    said = capsys.readouterr().err
    assert "empty-file.bag: is empty; nothing was recorded in it" in said.replace("\n", " ")
    assert said.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("arguments", "code", "said"),
    [
        (["convert", "{run}", "{tmp}/x.txt"], 1, "ends in .mcap or .bag"),
        (["convert", "{run}", "{run}"], 1, "exists already"),
        (["convert", "{run}", "{tmp}/no/x.mcap"], 1, "there is no directory"),
        (["convert", "{tmp}/none.bag", "{tmp}/x.mcap"], 1, "no such file"),
        (["filter", "{run}", "-o", "{tmp}/x.mcap", "--topics", "/nothing"], 1, "nothing matches"),
        (["filter", "{run}", "-o", "{tmp}/x.mcap", "--robots", "7"], 1, "no run of robot 7"),
        (["filter", "{run}", "-o", "{tmp}/x.mcap", "--from", "3", "--to", "2"], 1, "nothing lies between"),
        (["filter", "{run}", "-o", "{tmp}/x.mcap", "--clip", "99999999"], 1, "has no record 99999999"),
        (["filter", "{run}", "-o", "{tmp}/x.mcap", "--clip", "a"], 1, "no record number"),
        (["export", "{run}", "-o", "{tmp}/e", "--topics", "/nothing"], 1, "no topic matches"),
        (["plot", "{run}", "-o", "{tmp}/x.txt"], 1, "ends in .png"),
        (["plot", "{run}", "-o", "{tmp}/x.png", "--topic", "/odom"], 1, "holds no scans or clouds"),
    ],
)
def test_what_cannot_be_done_is_one_clear_line_and_leaves_nothing(
    run: Path, tmp_path: Path, arguments: list[str], code: int, said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    try:
        answer: object = main([argument.format(run=run, tmp=tmp_path) for argument in arguments])
    except SystemExit as error:
        answer = error.code
    captured = capsys.readouterr()
    assert answer == code
    assert said in (captured.out + captured.err).replace("\n", " ")
    assert not [path for path in tmp_path.rglob("*") if path.is_file()]


def test_everything_up_to_a_record_can_still_be_replayed(run: Path, tmp_path: Path) -> None:
    assert main(["filter", str(run), "--until", "300", "-o", str(tmp_path / "start.mcap")]) == 0
    (opened,) = open_runs([tmp_path / "start.mcap"])
    numbers = [record.number for record in opened.records_in_order()]
    assert numbers == list(range(1, len(numbers) + 1))
    assert 300 <= len(numbers) < 330  # to the end of its tick
    assert verdict(tmp_path / "start.mcap") == "reproduced L0 L1 L2"


def test_a_clip_holds_what_happened_around_a_record_and_says_that_it_is_one(
    run: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    clip = tmp_path / "clip.mcap"
    assert main(["filter", str(run), "--clip", "300:0.2", "-o", str(clip)]) == 0
    opened = open_run(clip)
    begun_ns, ended_ns = opened.span_ns
    assert (ended_ns - begun_ns) / 1e9 <= 0.4
    assert 300 in opened["/hippo/serial"]["record"].tolist() + opened["/hippo/event/tick"][
        "record"
    ].tolist() or any(300 in opened[topic]["record"] for topic in opened.topics)
    assert main(["doctor", str(clip)]) == 0
    assert main(["metrics", str(clip)]) == 1
    assert "is a selection of a run" in capsys.readouterr().err.replace("\n", " ")


def test_topics_and_times_are_kept_as_asked(run: Path, tmp_path: Path) -> None:
    arguments = ["--topics", "/odom,/tf*", "--exclude", "/tf_static", "--from", "0.5", "--to", "1.5"]
    assert main(["filter", str(run), *arguments, "-o", str(tmp_path / "x.mcap")]) == 0
    kept, whole = open_run(tmp_path / "x.mcap"), open_run(run)
    assert set(kept.topics) == {"/odom", "/tf"}
    wanted = whole.table("/odom", start_s=0.5, stop_s=1.5)
    assert kept["/odom"]["log_time_ns"].tolist() == wanted["log_time_ns"].tolist()


def test_several_runs_become_one_log_with_a_prefix_each(run: Path, tmp_path: Path) -> None:
    other = recorded_log(tmp_path / "other", ticks=10)
    bag = data_folder() / "bags" / "talker.mcap"
    assert main(["merge", str(run), str(bag), "-o", str(tmp_path / "all.mcap")]) == 0
    merged = open_run(tmp_path / "all.mcap")
    assert {"/robot00/odom", "/talker/topic"} <= set(merged.topics)
    assert len(merged["/robot00/odom"]) == len(open_run(run)["/odom"])
    assert main(["merge", str(other), "-o", str(tmp_path / "same.mcap")]) == 0
    assert verdict(tmp_path / "same.mcap") == "reproduced L0 L1 L2"


def test_tables_are_exported_as_they_are(run: Path, tmp_path: Path) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    for kind in ("csv", "parquet"):
        topics = "/odom,/tf,/hippo/event/scan_received"
        assert main(["export", str(run), "--format", kind, "--topics", topics, "-o", str(tmp_path)]) == 0
    opened = open_run(run)
    odom = parquet.read_table(tmp_path / "odom.parquet").to_pydict()
    assert odom["pose.pose.position.x"] == opened["/odom"]["pose.pose.position.x"].tolist()
    scans = parquet.read_table(tmp_path / "hippo_event_scan_received.parquet").to_pydict()
    assert scans["angle_q6"][3] == opened["/hippo/event/scan_received"]["angle_q6"][3].tolist()
    with (tmp_path / "tf.transforms.csv").open() as file:
        rows = list(csv.DictReader(file))
    child = opened["/tf"].child("transforms")
    assert [int(row["row"]) for row in rows] == child["row"].tolist()
    assert [float(row["transform.translation.x"]) for row in rows] == child[
        "transform.translation.x"
    ].tolist()


def test_rows_of_inner_tables_go_on_over_batches(run: Path, tmp_path: Path) -> None:
    parquet = pytest.importorskip("pyarrow.parquet")
    opened = open_run(run)
    wanted = opened["/tf"].child("transforms")["row"].tolist()
    export_csv(opened, "/tf", tmp_path, rows=7)
    with (tmp_path / "tf.transforms.csv").open() as file:
        assert [int(row["row"]) for row in csv.DictReader(file)] == wanted
    export_parquet(opened, "/tf", tmp_path, rows=7)
    assert parquet.read_table(tmp_path / "tf.transforms.parquet").to_pydict()["row"] == wanted


def test_trajectories_go_to_evo(run: Path, tmp_path: Path) -> None:
    assert main(["export", str(run), "--format", "tum", "-o", str(tmp_path)]) == 0
    (path,) = tmp_path.glob("*pose_estimated.tum")
    poses = np.loadtxt(path)
    table = open_run(run)["/hippo/effect/pose_estimated"]
    assert poses.shape == (len(table), 8)
    assert np.allclose(poses[:, 1], table["x_m"], atol=1e-6)
    assert np.allclose(np.hypot(poses[:, 6], poses[:, 7]), 1.0, atol=1e-5)
    assert np.all(np.diff(poses[:, 0]) > 0)


def test_a_tilting_laser_becomes_points_in_its_base(tmp_path: Path) -> None:
    opened = open_run(data_folder() / "bags" / "tilt_laser.bag")
    points, frame = points_of(opened, "/scan")
    assert frame == "tilt_base"
    assert len(points) > 100_000
    floor = points[(np.abs(points[:, 0]) < 3) & (points[:, 2] < 0.0)]
    assert np.std(floor[:, 2]) < 0.1  # the floor is flat once the tilt is taken out
    tree = FrameTree(opened)
    assert tree.root_of("laser") == "tilt_base"
    assert tree.root_of("nobody") == "nobody"
    pytest.importorskip("matplotlib")
    assert main(["plot", str(data_folder() / "bags" / "tilt_laser.bag"), "-o", str(tmp_path / "x.png")]) == 0
    assert (tmp_path / "x.png").read_bytes().startswith(b"\x89PNG")


def test_a_run_becomes_a_picture_and_a_missing_package_one_line(
    run: Path, tmp_path: Path, monkeypatch: Any
) -> None:
    pytest.importorskip("matplotlib")
    assert main(["plot", str(run), "-o", str(tmp_path / "run.png")]) == 0
    assert (tmp_path / "run.png").stat().st_size > 10_000
    monkeypatch.setitem(__import__("sys").modules, "matplotlib", None)
    assert main(["plot", str(run), "-o", str(tmp_path / "again.png")]) == 1
    monkeypatch.setitem(__import__("sys").modules, "pandas", None)
    with pytest.raises(HippomatError, match=r"pip install 'hippomat\[tables\]'"):
        open_run(run)["/odom"].to_pandas()
