"""A map in the making through step(): poses, drawn maps, and answers of the solver as events."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from lidar_world import LidarWorld, flat

from hippomat_core.config import SlamConfig
from hippomat_core.mapping import answer_of, failed_answer
from hippomat_core.messages import AlarmCleared, AlarmRaised, LoopsDue, MapDrawn, PoseEstimated
from hippomat_core.slam.loop_closing import close_loops
from hippomat_core.slam.pose2 import apart

FLAT = flat()
POSE = (2.0, 2.5, 0.0)


@pytest.fixture(scope="module")
def mapped():
    """A robot that was pushed about for a while, without a map of its own."""
    world = LidarWorld(FLAT, POSE, POSE, seed=2, slam=SlamConfig(mode="map"), told=None, maps=False)
    for seconds, v_mps, wz_radps in [
        (4, 0.2, 0.0),
        (2, 0.0, 1.5),
        (5, 0.25, 0.2),
        (3, 0.0, -1.4),
        (6, 0.2, 0.3),
    ]:
        world.drive(seconds, v_mps, wz_radps)
    return world


def of(world, kind):
    return [effect for effect in world.effects if isinstance(effect, kind)]


def test_the_robot_knows_where_it_is_in_the_map_that_it_makes(mapped):
    assert mapped.state.charting is not None
    assert mapped.error_m < 0.06
    assert len(mapped.found) > 80
    assert {one.phase for one, _ in mapped.found} == {"mapping"}
    assert of(mapped, PoseEstimated)[-1].source == "slam"


def test_the_map_shows_the_walls_that_there_are(mapped):
    last = mapped.state.charting.mapper.grid()
    iy, ix = np.nonzero(last.cells == 100)
    columns = np.floor((last.origin_x_m + (ix + 0.5) * 0.05) / 0.05).astype(int)
    rows = np.floor((last.origin_y_m + (iy + 0.5) * 0.05) / 0.05).astype(int)
    walls = FLAT.cells == 100
    windows = [
        (slice(max(k - 2, 0), k + 3), slice(max(j - 2, 0), j + 3)) for k, j in zip(rows, columns, strict=True)
    ]
    near = [walls[window].any() for window in windows]
    assert len(near) > 300
    assert np.mean(near) > 0.98


def test_a_robot_that_makes_a_map_does_not_drive_and_says_why(mapped):
    codes = {code for code, _ in mapped.state.faults}
    assert "no_map" in codes
    texts = [effect.text for effect in of(mapped, AlarmRaised) if effect.code == "no_map"]
    assert all("map is being made" in text for text in texts)


def test_maps_are_drawn_and_loops_are_asked_for_once_until_they_are_answered(mapped):
    drawn, due = of(mapped, MapDrawn), of(mapped, LoopsDue)
    assert len(drawn) >= 2
    last = drawn[-1]
    assert len(last.cells) == last.width * last.height
    assert (last.cells == 100).sum() > 300
    assert len(due) == 1
    assert mapped.state.charting.asked


def test_an_answer_moves_the_map_and_the_robot_with_it(mapped):
    pytest.importorskip("gtsam")
    world, before = replace_world(mapped), mapped.state.charting
    mapper = before.mapper
    solution = close_loops(mapper.graph, mapper.epoch, mapper.settings)
    pose = world.state.pose
    world.feed(answer_of(solution, world.now_ns))
    after = world.state.charting
    assert after.mapper.epoch == mapper.epoch + 1
    assert not after.asked
    assert apart(world.state.pose, pose)[0] < 0.05  # little drift, little correction
    drawn = of(world, MapDrawn)[-1]
    assert drawn.epoch == after.mapper.epoch
    assert after.mapper.grid() == solution.evidence.grid()
    world.drive(1.0)
    assert world.error_m < 0.06


def replace_world(world):
    """The same world, to go on from without changing the fixture."""
    copy = object.__new__(LidarWorld)
    copy.__dict__.update(world.__dict__)
    copy.effects, copy.found, copy.truth = list(world.effects), list(world.found), list(world.truth)
    return copy


def test_an_answer_that_failed_is_an_alarm_and_the_next_question_comes(mapped):
    world = replace_world(mapped)
    world.feed(failed_answer("GTSAM is not installed", world.now_ns))
    assert "GTSAM" in of(world, AlarmRaised)[-1].text
    assert not world.state.charting.asked
    assert world.state.charting.mapper is mapped.state.charting.mapper


def test_answers_that_fail_one_after_the_other_are_one_alarm_until_one_succeeds(mapped):
    pytest.importorskip("gtsam")
    world, mapper = replace_world(mapped), mapped.state.charting.mapper
    told = len(world.effects)
    for _ in range(3):
        world.feed(failed_answer("the solver ended", world.now_ns))
    world.feed(answer_of(close_loops(mapper.graph, mapper.epoch, mapper.settings), world.now_ns))
    alarms = [e for e in world.effects[told:] if getattr(e, "code", "") == "loops_open"]
    assert [type(alarm) for alarm in alarms] == [AlarmRaised, AlarmCleared]


def test_an_answer_that_nobody_asked_for_changes_nothing():
    world = LidarWorld(FLAT, POSE, POSE).drive(1.0)
    before = world.state
    world.feed(failed_answer("too late", world.now_ns))
    assert replace(world.state) is not before
    assert world.state.place is before.place
