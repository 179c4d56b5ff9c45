"""Task sites on a map and the table of task slots: places worked out by hand, and the laws of merging."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial.distance import pdist

from hippomat_core.config import FleetConfig
from hippomat_core.errors import ConfigError, MapError
from hippomat_core.fleet.sites import check_sites, slot_site, task_sites
from hippomat_core.fleet.tasks import MAX_GENERATION, Tasks
from hippomat_core.wire.frames import CLAIMED, DONE, INACTIVE, WAITING, TasksFrame, TaskSlot

OPEN = np.ones((80, 80), np.bool_)
SITES = task_sites(OPEN, 0.05, -1.0, -2.0, 0.12)
M = 6
CONFIG = FleetConfig(task_slots=M)


def test_sites_stand_at_cell_centres_in_the_fleet_frame():
    free = np.zeros((4, 5), np.bool_)
    free[1, 2] = free[3, 4] = True
    assert task_sites(free, 1.0, -2.0, 10.0, 0.1).tolist() == [[50, 1150, 0], [250, 1350, 0]]


@given(arrays(np.bool_, (25, 31)), st.floats(0.02, 0.3))
@settings(max_examples=40)
def test_sites_are_free_cells_two_diameters_apart_and_none_could_be_added(free, radius_m):
    sites = task_sites(free, 0.1, -1.0, 2.0, radius_m)
    cells = np.rint((sites[:, :2] / 100 - [-1.0, 2.0]) / 0.1 - 0.5).astype(int)
    assert all(free[iy, ix] for ix, iy in cells)
    if len(sites) > 1:
        assert pdist(sites / 100).min() >= 4 * radius_m
    for iy, ix in np.argwhere(free):
        away_m = np.hypot(*(cells - [ix, iy]).T) * 0.1
        assert away_m.min() < 4 * radius_m + 0.015 + 1e-9


def test_a_map_too_wide_for_centimetres_is_refused():
    with pytest.raises(MapError, match="327 m"):
        task_sites(np.ones((1, 400), np.bool_), 1.0, 0.0, 0.0, 0.1)


def test_too_few_sites_for_the_slots_are_refused_with_the_number_that_fits():
    with pytest.raises(ConfigError, match=r"room for 5 task sites.*lower it to 2"):
        check_sites(SITES[:5], 3)
    with pytest.raises(ConfigError, match="task_slots = 6"):
        Tasks.start(CONFIG, SITES[:8])


def test_a_slot_goes_round_its_own_share_of_the_sites():
    places: dict[int, set[bytes]] = {}
    for slot in range(M):
        visited = [slot_site(SITES, 3, M, slot, generation).tobytes() for generation in range(60)]
        assert all(before != after for before, after in pairwise(visited))
        places[slot] = set(visited)
        assert len(places[slot]) == len(range(slot, len(SITES), M)), "every site of the share has its turn"
    assert len(set.union(*places.values())) == len(SITES)
    assert sum(len(share) for share in places.values()) == len(SITES), "and no other slot uses it"


def test_places_depend_on_the_seed_and_on_nothing_else():
    first = [slot_site(SITES, 1, M, 2, generation).tolist() for generation in range(9)]
    assert first == [slot_site(SITES.copy(), 1, M, 2, generation).tolist() for generation in range(9)]
    assert first != [slot_site(SITES, 2, M, 2, generation).tolist() for generation in range(9)]


def test_places_never_change_between_versions():
    # recorded runs depend on it
    places = [slot_site(SITES, 1, M, 0, generation).tolist() for generation in (0, 1, 71)]
    assert places == [[148, 98, 0], [3, 162, 0], [123, 143, 0]]


def test_continuous_tasks_are_open_at_once_and_refill():
    tasks = Tasks.start(CONFIG, SITES)
    assert tasks.states.tolist() == [WAITING] * M
    turned = tasks.turned(2, SITES, 50)
    assert (turned.generations[2], turned.states[2], turned.changed_ns[2]) == (1, WAITING, 50)
    assert turned.positions_m()[2].tolist() != tasks.positions_m()[2].tolist()
    assert tasks.generations[2] == 0, "a value: the one before is as it was"
    assert tasks.digest != turned.digest


def test_ordered_tasks_are_inactive_until_they_come():
    tasks = Tasks.start(FleetConfig(task_slots=M, task_source="orders"), np.zeros((0, 3), np.int16))
    assert tasks.states.tolist() == [INACTIVE] * M
    ordered = tasks.merged(TasksFrame((TaskSlot(1, 1, WAITING, 5, 6, 7),)), tasks.positions_cm[:0], 9)
    assert ordered.slot(1) == TaskSlot(1, 1, WAITING, 5, 6, 7)
    assert ordered.turned(1, tasks.positions_cm[:0], 10).slot(1) == TaskSlot(1, 2, DONE, 5, 6, 7)


def test_a_generation_never_wraps():
    tasks = Tasks.start(CONFIG, SITES).advanced(TaskSlot(0, MAX_GENERATION, WAITING, 0, 0, 0), SITES, 1)
    last = tasks.turned(0, SITES, 2)
    assert (last.generations[0], last.states[0]) == (MAX_GENERATION, DONE)


def test_a_task_that_somebody_calls_claimed_still_waits():
    tasks = Tasks.start(CONFIG, SITES)
    assert tasks.advanced(TaskSlot(2, 0, CLAIMED, 0, 0, 0), SITES, 1) is tasks
    assert tasks.advanced(TaskSlot(2, 1, CLAIMED, 0, 0, 0), SITES, 1).slot(2).state == WAITING


heard_slots = st.lists(
    st.builds(
        TaskSlot,
        st.integers(0, M),
        st.integers(0, 5),
        st.sampled_from([WAITING, CLAIMED, DONE]),
        *[st.integers(-9, 9)] * 3,
    ),
    max_size=5,
)


@given(heard_slots, heard_slots)
def test_merging_is_commutative_and_never_goes_back(first, second):
    tasks = Tasks.start(CONFIG, SITES)
    one, other = TasksFrame(tuple(first)), TasksFrame(tuple(second))
    straight = tasks.merged(one, SITES, 1).merged(other, SITES, 2)
    crossed = tasks.merged(other, SITES, 3).merged(one, SITES, 4)
    assert straight.digest == crossed.digest
    assert np.array_equal(straight.positions_cm, crossed.positions_cm)
    assert np.all(straight.generations >= tasks.generations)
    assert straight.merged(one, SITES, 5) is straight, "what is known changes nothing"


def test_robots_that_exchange_frames_agree_after_every_slot_had_its_turn():
    config = FleetConfig(task_slots=60)
    sites = task_sites(np.ones((170, 170), np.bool_), 0.05, 0.0, 0.0, 0.12)
    ahead = behind = Tasks.start(config, sites)
    for slot in range(0, 60, 3):
        ahead = ahead.turned(slot, sites, 5)
    frames = 0
    while ahead.digest != behind.digest:
        frame = ahead.frame(frames * 11 % 60)
        assert len(frame.slots) == 22
        behind = behind.merged(frame, sites, 6)
        frames += 1
    assert frames <= 6


def test_values_are_never_written_to():
    start = Tasks.start(CONFIG, SITES)
    for tasks in (start, start.turned(0, SITES, 1)):
        _refuses_writing(tasks)


def _refuses_writing(tasks: Tasks) -> None:
    for array in (tasks.generations, tasks.states, tasks.positions_cm, tasks.changed_ns):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0
