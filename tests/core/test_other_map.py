"""A robot with another map is shown, requests nothing, and has no part in the others' allocation."""

from __future__ import annotations

import numpy as np
import pytest
from fleet_world import FleetWorld, map_event, room

from hippomat_core.maps.occupancy_grid import OccupancyGrid
from hippomat_core.messages import AlarmRaised, RoundDecided, SendState

STRANGER = 2


@pytest.fixture(scope="module")
def fleet():
    """Three robots; the last one's map has one wall cell more, far from everything."""
    world = FleetWorld(3, seed=4)
    cells = room().cells.copy()
    cells[1, 1] = 100
    other = OccupancyGrid(cells, 0.05, 0.0, 0.0)
    world.bodies[STRANGER].take(map_event(other, world.now_ns, epoch=2))
    world.run(15.0)
    return world


def said(body, kind):
    return [effect for _, effect in body.effects if isinstance(effect, kind)]


def test_the_maps_of_the_same_settings_give_different_digests(fleet):
    digests = [said(body, SendState)[-1].frame.fleet_digest for body in fleet.bodies]
    assert digests[0] == digests[1] != digests[STRANGER]


def test_both_sides_name_each_other(fleet):
    for body in fleet.bodies:
        texts = [alarm.text for alarm in said(body, AlarmRaised) if alarm.code.startswith("peer_digest")]
        assert texts, "nobody was named"
    assert any(f"robot {STRANGER}" in alarm.text for alarm in said(fleet.bodies[0], AlarmRaised))


def test_the_stranger_is_heard_but_never_takes_part_in_the_others_decisions(fleet):
    for body in fleet.bodies[:STRANGER]:
        assert body.state.fleet.peers[STRANGER] is not None
        late = said(body, RoundDecided)[20:]
        assert len(late) > 100
        assert not any(decided.row_available[STRANGER] for decided in late)
        assert all(int(decided.row_slot[STRANGER]) == 255 for decided in late)


def test_the_others_work_and_the_stranger_requests_nothing(fleet):
    assert all(body.claims("completed") for body in fleet.bodies[:STRANGER])
    assert not fleet.bodies[STRANGER].claims("requested")
    assert not np.any([decided.action for decided in said(fleet.bodies[STRANGER], RoundDecided)[20:]])
