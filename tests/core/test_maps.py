"""Occupancy grids, and ROS map files read and written as map_server does."""

from __future__ import annotations

import math
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays
from recorded_data import data_folder

from hippomat_core.errors import MapError
from hippomat_core.maps.occupancy_grid import OccupancyGrid
from hippomat_core.maps.ros_map import grid_from_image, parse_map_yaml
from hippomat_logs.map_files import load_map, save_map
from hippomat_sim.maps.demo_room import DEMO_ROOM, draw_demo_room

YAML = """# drawn by hand
image: room.pgm
resolution: 0.050000
origin: [-1.0, 2.5, 0.000000]
negate: 0
occupied_thresh: 0.65
free_thresh: 0.196
"""
SHAPES = array_shapes(min_dims=2, max_dims=2, max_side=12)
METRES = st.floats(-1000, 1000)


def grids(values: st.SearchStrategy[int]) -> st.SearchStrategy[OccupancyGrid]:
    cells = SHAPES.flatmap(lambda shape: arrays(np.int8, shape, elements=values))
    return st.builds(OccupancyGrid, cells, st.floats(1e-3, 10), METRES, METRES)


@given(st.one_of(grids(st.sampled_from([-1, 0, 100])), grids(st.integers(-1, 100))))
@settings(max_examples=60, deadline=None)
def test_a_saved_map_loads_equal(tmp_path_factory: pytest.TempPathFactory, grid: OccupancyGrid) -> None:
    path = tmp_path_factory.mktemp("map") / "it's a map.yaml"
    save_map(grid, path)
    assert load_map(path) == grid


METAS = st.builds(
    lambda mode, negate, thresholds: (mode, negate, *sorted(thresholds)),
    st.sampled_from(["trinary", "scale", "raw"]),
    st.booleans(),
    st.lists(st.floats(0.0, 1.0), min_size=2, max_size=2, unique=True),
)


def published(colours: list[int], alpha: int, mode: str, negate: bool, free: float, occupied: float) -> int:
    """nav2_map_server's loadMapFromFile, pixel by pixel."""
    channels = [*colours, alpha] if mode == "trinary" else colours
    shade = sum(channels) / len(channels) / 255.0
    if mode == "raw":
        percent = math.floor(shade * 255 + 0.5)
        return percent if percent <= 100 else -1
    occupancy = shade if negate else 1.0 - shade
    if mode == "scale" and alpha != 255:
        return -1
    if occupancy > occupied:
        return 100
    if occupancy < free:
        return 0
    return -1 if mode == "trinary" else round(100.0 * (occupancy - free) / (occupied - free))


@given(arrays(np.uint8, st.tuples(st.integers(1, 4), st.integers(1, 4), st.just(4))), METAS)
@settings(max_examples=100, deadline=None)
def test_any_image_in_any_mode_is_read_as_map_server_reads_it_and_survives_saving(
    tmp_path_factory: pytest.TempPathFactory, image: np.ndarray, settings_: tuple[str, bool, float, float]
) -> None:
    folder = tmp_path_factory.mktemp("map")
    mode, negate, free, occupied = settings_
    cv2.imwrite(str(folder / "room.png"), image)
    (folder / "room.yaml").write_text(
        f"image: room.png\nmode: {mode}\nresolution: 0.05\norigin: [0, 0, 0]\nnegate: {int(negate)}\n"
        f"free_thresh: {free:.17f}\noccupied_thresh: {occupied:.17f}\n"
    )
    assume(float(f"{free:.17f}") < float(f"{occupied:.17f}"))
    grid = load_map(folder / "room.yaml")
    for (row, ix), cell in np.ndenumerate(grid.cells[::-1]):
        colours, alpha = image[row, ix, :3].tolist(), int(image[row, ix, 3])
        expected = published(colours, alpha, mode, negate, float(f"{free:.17f}"), float(f"{occupied:.17f}"))
        assert abs(cell - expected) <= (1 if mode == "scale" and 0 < expected < 100 else 0)  # ties of rint
    save_map(grid, folder / "again.yaml")
    assert load_map(folder / "again.yaml") == grid


def test_the_image_runs_from_the_top_and_the_grid_from_the_bottom() -> None:
    pixels = np.array([[0, 254], [254, 205]], np.uint8)
    grid = grid_from_image(pixels, parse_map_yaml(YAML))
    assert grid.cells.tolist() == [[0, -1], [100, 0]]
    assert (grid.origin_x_m, grid.origin_y_m, grid.resolution_m) == (-1.0, 2.5, 0.05)


def cells_of(shades: list[int], changes: dict[str, str]) -> list[int]:
    text = YAML
    for key, value in changes.items():
        lines = [line for line in text.splitlines() if not line.startswith(key + ":")]
        text = "\n".join([*lines, f"{key}: {value}"])
    return grid_from_image(np.array([shades], np.uint8), parse_map_yaml(text)).cells[0].tolist()


def test_trinary_knows_three_values_by_the_two_thresholds() -> None:
    # 205 is 0.19608 occupied: unknown at 0.196, free at 0.25
    assert cells_of([0, 89, 90, 204, 205, 206, 255], {}) == [100, 100, -1, -1, -1, 0, 0]
    assert cells_of([205], {"free_thresh": "0.25"}) == [0]


def test_negate_turns_black_into_free() -> None:
    assert cells_of([0, 255], {"negate": "1"}) == [0, 100]


def test_scale_grades_between_the_thresholds() -> None:
    assert cells_of([255, 205, 147, 90, 0], {"mode": "scale"}) == [0, 0, 50, 99, 100]


def test_raw_takes_the_pixels_and_calls_the_rest_unknown() -> None:
    assert cells_of([0, 42, 100, 101, 255], {"mode": "raw"}) == [0, 42, 100, -1, -1]


def test_colours_are_averaged_and_transparent_pixels_unknown(tmp_path: Path) -> None:
    image = np.array([[[255, 255, 255, 255], [0, 0, 0, 255], [255, 255, 255, 0]]], np.uint8)
    cv2.imwrite(str(tmp_path / "room.png"), image)
    (tmp_path / "room.yaml").write_text(YAML.replace("pgm", "png"))
    assert load_map(tmp_path / "room.yaml").cells.tolist() == [[0, 100, -1]]


@pytest.mark.parametrize(
    ("broken", "says"),
    [
        (YAML.replace("resolution: 0.050000\n", ""), "key 'resolution' is missing"),
        (YAML.replace("0.050000", "-1"), "resolution = -1.0 must be greater than 0"),
        (YAML.replace("0.050000", "tiny"), "resolution has 'tiny'; a finite number is needed"),
        (YAML.replace("0.050000", ".nan"), "a finite number is needed"),
        (YAML.replace("0.000000]", "0.3]"), "origin yaw = 0.3 is not supported"),
        (YAML.replace(", 0.000000]", "]"), "origin = [-1.0, 2.5] must be [x, y, yaw]"),
        (YAML.replace("0.65", "0.1"), "need 0 <= free_thresh < occupied_thresh <= 1"),
        (YAML.replace("negate: 0", "negate: yes please"), "negate = 'yes please' must be 0 or 1"),
        (YAML + "mode: fancy\n", "mode = 'fancy' is not one of trinary, scale, raw"),
        (YAML.replace("room.pgm", "[]"), "image = [] must be the name of an image file"),
        ("just text", "expected keys such as image and resolution"),
        ("a: [", "not valid YAML"),
    ],
)
def test_a_broken_description_is_refused_in_one_line_that_names_it(broken: str, says: str) -> None:
    with pytest.raises(MapError) as refused:
        parse_map_yaml(broken, "room.yaml")
    message = str(refused.value)
    assert message.startswith("map room.yaml: ")
    assert says in message
    assert "\n" not in message


def test_a_map_without_its_image_says_which_image(tmp_path: Path) -> None:
    (tmp_path / "room.yaml").write_text(YAML)
    with pytest.raises(MapError, match=r"room.yaml names image room.pgm, which does not exist"):
        load_map(tmp_path / "room.yaml")


def test_what_is_no_map_or_no_image_is_named(tmp_path: Path) -> None:
    with pytest.raises(MapError, match=r"gone.yaml: cannot be read: No such file"):
        load_map(tmp_path / "gone.yaml")
    (tmp_path / "room.pgm").write_bytes(b"P5\n\xff\xfe garbage")
    (tmp_path / "room.yaml").write_text(YAML)
    with pytest.raises(MapError, match="is not an image that OpenCV can read"):
        load_map(tmp_path / "room.yaml")
    with pytest.raises(MapError, match=r"give the map's .yaml file"):
        load_map(tmp_path / "room.pgm")


def test_cells_and_centres_belong_together() -> None:
    grid = OccupancyGrid(np.zeros((4, 6), np.int8), 0.05, -1.0, 2.0)
    for ix in range(6):
        for iy in range(4):
            assert grid.cell_of(*grid.centre_of(ix, iy)) == (ix, iy)
    assert grid.cell_of(-1.001, 2.0) == (-1, 0)
    assert not grid.holds(-1, 0)
    assert grid.holds(5, 3)


def test_equal_maps_have_equal_hashes_and_any_change_shows() -> None:
    grid = draw_demo_room()
    assert grid.hash() == draw_demo_room().hash()
    changed = grid.cells.copy()
    changed[50, 50] = 42
    others = [
        OccupancyGrid(changed, grid.resolution_m, grid.origin_x_m, grid.origin_y_m),
        OccupancyGrid(grid.cells, 0.051, grid.origin_x_m, grid.origin_y_m),
        OccupancyGrid(grid.cells, grid.resolution_m, 0.0, grid.origin_y_m),
        OccupancyGrid(grid.cells.reshape(52, 208), grid.resolution_m, grid.origin_x_m, grid.origin_y_m),
    ]
    assert len({grid.hash(), *(other.hash() for other in others)}) == 5


def test_the_demo_room_file_is_what_its_function_draws() -> None:
    assert load_map(DEMO_ROOM) == draw_demo_room()


def test_the_turtlebot3_world_reads_as_drawn() -> None:
    grid = load_map(data_folder() / "ros_maps" / "turtlebot3_world.yaml")
    assert (grid.width, grid.height, grid.resolution_m, grid.origin_x_m) == (384, 384, 0.05, -10.0)
    assert {int(k): int((grid.cells == k).sum()) for k in np.unique(grid.cells)} == {
        -1: 138722,
        0: 7939,
        100: 795,
    }
