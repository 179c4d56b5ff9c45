"""Maps from files, recordings of any ROS and of ours, and a rosbridge: the same cells, or one clear line."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from recorded_data import data_folder
from recorded_run import record_run, room
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Ros2Writer
from rosbags.typesys import Stores, get_typestore

from hippomat_core.errors import HippomatError, MapError, PortError
from hippomat_core.maps.map_event import grid_in, map_event
from hippomat_core.maps.occupancy_grid import OccupancyGrid
from hippomat_core.maps.source import MadeMaps, map_at
from hippomat_logs.map_files import save_map
from hippomat_logs.map_sources import map_from
from hippomat_logs.ros.dialect import MAP, ROS1, ROS2, Dialect
from hippomat_logs.ros.events import message_of
from hippomat_logs.ros.fake_rosbridge import FakeRosbridge

DIALECT = Dialect()
GRIDS = [OccupancyGrid(np.full((3, 4), cell, np.int8), 0.05, -1.0, 0.5) for cell in (-1, 0, 100)]
SECOND = 1_000_000_000


def ros1_bag(path: Path, topics=("/map",)) -> Path:
    store = get_typestore(Stores.ROS1_NOETIC)
    with Ros1Writer(path) as writer:
        for topic in topics:
            connection = writer.add_connection(topic, MAP, typestore=store)
            for k, grid in enumerate(GRIDS):
                data = DIALECT.encode_as(ROS1, MAP, message_of(DIALECT, map_event(grid))[1])
                writer.write(connection, (100 + 10 * k) * SECOND, data)
    return path


def ros2_bag(folder: Path, plugin: StoragePlugin) -> Path:
    store = get_typestore(Stores.ROS2_HUMBLE)
    with Ros2Writer(folder, version=9, storage_plugin=plugin) as writer:
        connection = writer.add_connection("/map", MAP, typestore=store)
        for k, grid in enumerate(GRIDS):
            data = DIALECT.encode_as(ROS2, MAP, message_of(DIALECT, map_event(grid))[1])
            writer.write(connection, (100 + 10 * k) * SECOND, data)
    return folder


def test_the_last_map_of_a_recording_or_the_one_of_a_time(tmp_path):
    places = [
        ros1_bag(tmp_path / "lab.bag"),
        ros2_bag(tmp_path / "lab_sqlite", StoragePlugin.SQLITE3),
        *ros2_bag(tmp_path / "lab_mcap", StoragePlugin.MCAP).glob("*.mcap"),
    ]
    places += (tmp_path / "lab_sqlite").glob("*.db3")
    assert len(places) == 4
    for place in places:
        assert map_from(str(place)) == GRIDS[2], place
        assert map_from(f"{place}:/map@15") == GRIDS[1]
        assert map_from(f"{place}@0") == GRIDS[0]


def test_the_map_of_a_run_is_the_map_that_it_was_run_with(tmp_path):
    record_run(tmp_path)
    (log,) = tmp_path.iterdir()
    assert map_from(str(log)) == grid_in(room())
    assert map_from(f"{log}:/map") == grid_in(room())


def test_a_map_file_is_a_source_too_whatever_is_in_its_name(tmp_path):
    for name in ("lab.yaml", "lab@2.yaml", "a:b.yaml"):
        save_map(GRIDS[2], tmp_path / name)
        assert map_from(str(tmp_path / name)) == GRIDS[2]


def test_a_rosbridge_is_a_source_while_it_says_maps():
    with FakeRosbridge() as bridge:
        bridge.topic("/map", MAP, latched=True)
        bridge.say_event("/map", map_event(GRIDS[1]))
        assert map_from(bridge.url) == GRIDS[1]
    with pytest.raises(PortError, match="connection refused; start rosbridge there"):
        map_from(bridge.url)


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("nothing.bag", "there is no such file"),
        ("two.bag", "maps are on /map_a, /map_b: give .*two.bag:TOPIC"),
        ("two.bag:/map_c", "maps are on /map_a, /map_b"),
        ("text.bag", "cannot be read"),
        ("text.mcap", "cannot be read"),
        ("nothing.yaml", "cannot be read"),
        ("folder", "cannot be read"),
    ],
)
def test_what_holds_no_map_is_named_in_one_line(tmp_path, name, said):
    ros1_bag(tmp_path / "two.bag", ("/map_a", "/map_b"))
    for text in ("text.bag", "text.mcap"):
        (tmp_path / text).write_text("this is no recording")
    (tmp_path / "folder").mkdir()
    with pytest.raises(MapError, match=said) as error:
        map_from(str(tmp_path / name))
    assert "\n" not in str(error.value)


def test_a_cut_recording_is_named_and_not_believed(tmp_path):
    (whole,) = ros2_bag(tmp_path / "lab", StoragePlugin.MCAP).glob("*.mcap")
    data = whole.read_bytes()
    for size in range(0, len(data), 97):
        (tmp_path / "cut.mcap").write_bytes(data[:size])
        with pytest.raises(HippomatError, match=r"cut\.mcap"):
            map_from(str(tmp_path / "cut.mcap"))


def test_recordings_of_others_give_their_map_or_say_that_they_have_none():
    bags = data_folder() / "bags"
    grid = map_from(f"{bags / 'ros2_94_topics.mcap'}")
    assert grid.cells.shape == (10, 10)
    assert grid.resolution_m == 0.05
    for name in ("tilt_laser.bag", "example-lz4.bag", "talker.mcap", "topics_and_services.mcap"):
        with pytest.raises(MapError, match="it holds no map"):
            map_from(str(bags / name))
    with pytest.raises(MapError, match="empty"):
        map_from(str(bags / "empty-file.bag"))


def test_a_source_gives_the_map_that_held_at_a_time():
    source = MadeMaps([(5 * SECOND, GRIDS[0]), (7 * SECOND, GRIDS[1])])
    assert map_at(source) == GRIDS[1]
    assert map_at(source, 1.9) == GRIDS[0]
    assert map_at(source, 2.0) == GRIDS[1]
    with pytest.raises(MapError, match="nowhere holds no map"):
        map_at(MadeMaps([], "nowhere"))
