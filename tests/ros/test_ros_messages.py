"""Messages of ROS in all their forms say the same; garbage says nothing."""

from __future__ import annotations

import contextlib
import json
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from hippomat_core.errors import MapError
from hippomat_core.maps.map_event import map_event
from hippomat_core.maps.occupancy_grid import OccupancyGrid
from hippomat_core.messages import LaserScanReceived, MapReceived, OdometryReceived, TransformReceived
from hippomat_logs.ros.dialect import (
    MAP,
    ROS1,
    ROS2,
    SCAN,
    TYPES,
    Dialect,
    Undecodable,
    from_json,
    message_in,
    to_json,
)
from hippomat_logs.ros.events import events_of, grid_of, message_of
from hippomat_logs.ros.rosbridge import Incoming, fragments, publish
from hippomat_logs.schema import differences

DIALECT = Dialect()

number = st.floats(allow_nan=False, allow_infinity=False)
single = st.floats(width=32, allow_nan=False, allow_infinity=False)
between = st.floats(-60.0, 60.0, width=32)  # [s] rays; a message says how long all of them took
steps = st.floats(2.0**-20, 0.5, width=32) | st.floats(-0.5, -(2.0**-20), width=32)
stamps = st.integers(0, 2**31 * 10**9 - 1)
frames = st.text(st.characters(codec="utf-8", exclude_characters="\0/"), max_size=12)
ranges = arrays.arrays(np.float32, st.integers(1, 40), elements=single | st.just(np.float32(np.inf)))
events = st.one_of(
    st.builds(TransformReceived, st.just(0), stamps, frames, frames, st.booleans(), *[number] * 7),
    st.builds(LaserScanReceived, st.just(0), stamps, frames, single, steps, between, single, single, ranges),
    st.builds(OdometryReceived, st.just(0), stamps, number, number),
    st.builds(
        lambda cells, resolution, x, y: map_event(OccupancyGrid(cells, resolution, x, y)),
        arrays.arrays(
            np.int8, arrays.array_shapes(min_dims=2, max_dims=2, max_side=12), elements=st.integers(-1, 100)
        ),
        st.floats(np.float32(0.001), np.float32(100.0), width=32).map(lambda x: float(str(np.float32(x)))),
        *[number] * 2,
    ),
)


def read(kind, message, event):
    return list(events_of(kind, message, getattr(event, "fixed", False)))


@given(events)
def test_what_is_said_in_any_form_is_what_is_understood(event):
    kind, message = message_of(DIALECT, event)
    forms = {
        "ROS 2 bytes": Dialect.decode_as(DIALECT, ROS2, kind, DIALECT.encode_as(ROS2, kind, message)),
        "ROS 1 bytes": Dialect.decode_as(DIALECT, ROS1, kind, DIALECT.encode_as(ROS1, kind, message)),
        "ROS 2 JSON": from_json(json.loads(json.dumps(to_json(message, ROS2)))),
        "ROS 1 JSON": from_json(json.loads(json.dumps(to_json(message, ROS1)))),
    }
    for name, form in forms.items():
        (understood,) = read(kind, form, event)
        assert list(differences(event, understood)) == [], name


@given(events, st.sampled_from((ROS1, ROS2)))
def test_bytes_tell_which_ros_made_them(event, ros):
    kind, message = message_of(DIALECT, event)
    dialect = DIALECT
    dialect.speaks = 0
    (understood,) = read(kind, dialect.decode(kind, dialect.encode_as(ros, kind, message)), event)
    assert list(differences(event, understood)) == []


def test_a_ros_1_message_whose_counter_looks_like_cdr_is_understood():
    scan = LaserScanReceived(0, 5, "laser", 0.0, 0.5, 0.0, 0.25, 8.0, np.ones(3, np.float32))
    kind, message = message_of(DIALECT, scan)
    data = b"\x00\x01\x00\x00" + DIALECT.encode_as(ROS1, kind, message)[4:]  # Header.seq 256
    fresh = DIALECT
    fresh.speaks = 0
    assert list(differences(scan, read(kind, fresh.decode(kind, data), scan)[0])) == []


@given(st.binary(max_size=200), st.sampled_from(TYPES))
def test_garbage_is_undecodable_or_a_message_but_never_a_crash(data, kind):
    for head in (b"", b"\x00\x01\x00\x00"):
        DIALECT.speaks = 0
        with contextlib.suppress(Undecodable, MapError):
            list(events_of(kind, DIALECT.decode(kind, head + data)))


json_values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=8), inner, max_size=4),
    max_leaves=12,
)


@given(json_values, st.sampled_from(TYPES))
def test_json_of_another_shape_is_undecodable_and_never_a_crash(value, kind):
    incoming = Incoming()
    operation = incoming.operation(json.dumps(value))
    if operation is None:
        assert incoming.garbage == 1
    for held in (operation or {}, {"op": "publish", "msg": value}):
        with contextlib.suppress(Undecodable, MapError):
            list(events_of(kind, message_in(held, kind, DIALECT)))


@given(json_values, st.integers(1, 50), st.randoms(use_true_random=False))
def test_fragments_in_any_order_give_the_whole(value, size, random):
    text = json.dumps(publish("/map", {"data": value}))
    pieces = fragments(text, size, "map 1")
    random.shuffle(pieces)
    incoming = Incoming()
    found = [incoming.operation(piece) for piece in pieces]
    assert found[:-1] == [None] * (len(pieces) - 1)
    assert json.dumps(found[-1]) == json.dumps(json.loads(text))
    assert incoming.garbage == 0


def test_fragments_of_a_message_whose_rest_never_comes_are_forgotten():
    incoming = Incoming()
    for k in range(1000):
        assert incoming.operation(fragments('{"op": "x"}', 4, f"m{k}")[0]) is None
    assert len(incoming._pieces) < 10


@pytest.mark.parametrize(
    "bad", [{"num": 3, "total": 3}, {"num": -1, "total": 3}, {"num": 0, "total": 10**9}, {}]
)
def test_a_fragment_with_impossible_numbers_is_garbage(bad):
    incoming = Incoming()
    assert incoming.operation(json.dumps({"op": "fragment", "id": "x", "data": "y", **bad})) is None
    assert incoming.garbage == 1


# ---- maps ----


def grid_message(**changes):
    grid = OccupancyGrid(np.zeros((3, 4), np.int8), 0.05, -1.0, 2.0)
    _, message = message_of(DIALECT, map_event(grid))
    for name, value in changes.items():
        setattr(message.info, name, value)
    return message, grid


def test_a_map_from_ros_has_the_hash_of_the_same_map_from_its_file():
    """ROS keeps the resolution in 32 bits."""
    message, grid = grid_message()
    again = DIALECT.decode_as(ROS2, MAP, DIALECT.encode_as(ROS2, MAP, message))
    assert again.info.resolution != grid.resolution_m
    assert grid_of(again).hash() == grid.hash()


def test_a_map_that_cannot_be_used_is_refused_by_name():
    for changes, named in (
        ({"width": 5}, "not 5 x 3"),
        ({"resolution": 0.0}, "resolution"),
        ({"width": 0}, "0 x 3"),
    ):
        with pytest.raises(MapError, match=named):
            grid_of(grid_message(**changes)[0])
    turned, _ = grid_message()
    turned.info.origin.orientation.z = math.sin(0.1)
    with pytest.raises(MapError, match="turned"):
        grid_of(turned)
    odd = from_json(to_json(grid_message()[0]))
    odd.data[0] = 300
    with pytest.raises(MapError, match=r"-1 or 0 \.\. 100"):
        grid_of(odd)


def test_null_in_a_scan_is_no_return():
    (scan,) = events_of(SCAN, from_json(to_json(message_of(DIALECT, _scan([1.0, math.inf]))[1])))
    assert scan.ranges_m.tolist() == [1.0, math.inf]


@pytest.mark.parametrize("changes", [{"angle_increment": 0.0}, {"angle_min": math.nan}, {"ranges": []}])
def test_a_scan_that_would_show_free_space_where_nobody_looked_is_undecodable(changes):
    _, message = message_of(DIALECT, _scan([1.0, 2.0]))
    for name, value in changes.items():
        setattr(message, name, value)
    with pytest.raises(Undecodable):
        list(events_of(SCAN, message))


def _scan(values):
    return LaserScanReceived(0, 0, "laser", 0.0, 0.1, 0.0, 0.0, 9.0, np.array(values, np.float32))


def test_frames_lose_the_slash_that_ros_1_puts_before_them():
    kind, message = message_of(DIALECT, TransformReceived(0, 0, "/map", "/odom", False, *[0.0] * 6, 1.0))
    (event,) = events_of(kind, message)
    assert (event.parent, event.child) == ("map", "odom")


def test_a_map_event_carries_its_grid_whole():
    grid = OccupancyGrid(np.arange(6, dtype=np.int8).reshape(2, 3), 0.1, 1.0, 2.0)
    event = map_event(grid, 5, 7)
    assert isinstance(event, MapReceived)
    assert (event.width, event.height, event.epoch, event.stamp_ns) == (3, 2, 7, 5)
