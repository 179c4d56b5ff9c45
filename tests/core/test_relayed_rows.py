"""Rows that others pass on: when they count in the snapshot, and what the ledger says of them."""

from __future__ import annotations

import numpy as np
import pytest
from fleet_seat import (
    ROUND,
    SITES,
    M,
    air_claim,
    of,
    ready,
    relayed,
    seat,
)

from hippomat_core.fleet.state import with_map
from hippomat_core.messages import PeerClaimSeen, RoundDecided
from hippomat_core.wire.frames import BLOCKED, UNREACHABLE

MS = 1_000_000
ONLY_SLOT_0 = (1, UNREACHABLE, UNREACHABLE, UNREACHABLE)


def decided(outcome):
    (made,) = of(RoundDecided, outcome.effects)
    return made


def test_a_row_passed_on_is_used_where_it_is_newer_than_the_one_heard_directly():
    taken = ready(3, 1, 2)
    taken.hear(1, taken.row())
    taken.now_ns += ROUND  # robot 2 was last heard in the round before
    taken.relay(1, relayed(2, costs=np.array([1, 2, 3, 4], np.uint8)), age_ns=10 * MS)
    made = decided(taken.round(can_request=False))
    assert made.costs.reshape(3, M)[2].tolist() == [1, 2, 3, 4]
    assert made.row_via.tolist() == [255, 255, 1]
    assert made.row_available[2] == 1


def test_a_row_passed_on_of_the_round_that_was_heard_directly_changes_nothing():
    taken = ready(3, 1, 2)
    taken.hear(1, taken.row())
    taken.hear(2, taken.row())
    assert taken.relay(1, relayed(2, air_claim(0))) == []
    made = decided(taken.round())
    assert made.costs.reshape(3, M)[2].tolist() == [200] * M
    assert made.row_via.tolist() == [255, 255, 255]


def test_an_older_row_passed_on_changes_nothing():
    taken = ready(3, 1, 2)
    taken.now_ns += ROUND
    taken.hear(1, taken.row())
    taken.hear(2, taken.row())
    assert taken.relay(1, relayed(2, air_claim(0), age=1)) == []
    assert taken.fleet.relayed[2] is None


def test_the_owners_next_row_takes_the_place_of_what_was_passed_on():
    taken = ready(3, 1, 2)
    taken.now_ns += ROUND
    taken.relay(1, relayed(2, status=BLOCKED))
    taken.hear(2, taken.row())
    made = decided(taken.round(can_request=False))
    assert (made.row_via[2], made.row_available[2]) == (255, 1)


def test_the_ledger_names_the_relay_and_the_age_counts_from_the_begin_of_the_rows_round():
    taken = ready(3, 1)
    taken.hear(1, taken.row())
    taken.now_ns += 30 * MS
    begin_ns = taken.now_ns // ROUND * ROUND
    taken.relay(1, relayed(2), boot=77)
    read_ns, sequence = taken.now_ns, taken.sequence
    made = decided(taken.round())
    assert made.row_sequence.tolist()[2] == sequence
    assert (made.row_boot[2], made.row_via[2], made.row_rssi_dbm[2]) == (77, 1, -71)
    assert made.row_age_ms[2] == (read_ns + ROUND // 2 - begin_ns) // MS


@pytest.mark.parametrize(
    ("change", "available"),
    [
        ({}, 1),
        ({"localized": False}, 0),
        ({"stopped": True}, 0),
        ({"status": BLOCKED}, 0),
    ],
)
def test_a_robot_known_through_others_only_takes_part(change, available):
    taken = ready(3, 1)
    taken.hear(1, taken.row())
    taken.relay(1, relayed(2, **change))
    made = decided(taken.round())
    assert made.row_available[2] == available
    assert made.costs.reshape(3, M)[2].tolist() == [100] * M


def test_a_robot_known_through_others_only_is_left_out_when_nobody_passes_it_on_any_more():
    taken = ready(3, 1)
    taken.hear(1, taken.row())
    told = taken.relay(1, relayed(2, air_claim(3)))
    assert [(seen.robot, seen.what) for seen in of(PeerClaimSeen, told)] == [(2, "requested")]
    assert taken.fleet.alive(taken.now_ns) == 3
    outcomes = taken.rounds(3.1, 1, can_request=False)
    seen = [seen for outcome in outcomes for seen in of(PeerClaimSeen, outcome.effects)]
    assert [(one.robot, one.what) for one in seen] == [(2, "expired")]
    made = decided(outcomes[-1])
    assert (made.row_age_ms[2], made.row_available[2]) == (65535, 0)
    assert (made.costs.reshape(3, M)[2] == UNREACHABLE).all()
    assert taken.fleet.alive(taken.now_ns) == 2


@pytest.mark.parametrize("digest", [None, 0x1234])
def test_only_radios_of_our_digest_are_believed(digest):
    taken = seat(3)
    if digest is not None:
        taken.hear(1, taken.row(fleet_digest=digest))
    assert taken.relay(1, relayed(2, air_claim(0))) == []
    assert taken.fleet.relayed == (None, None, None)


def test_rows_of_another_size_and_our_own_row_are_left_alone():
    taken = ready(3, 1)
    wide = relayed(2, costs=np.zeros(M + 1, np.uint8))
    assert taken.relay(1, wide, relayed(0, air_claim(0))) == []
    assert taken.fleet.relayed == (None, None, None)


def test_when_fleet_time_begins_anew_rows_of_small_rounds_are_news_again():
    taken = ready(3, 1, 2)
    taken.now_ns += 5 * ROUND
    taken.hear(1, taken.row())
    taken.relay(1, relayed(2, status=BLOCKED), fleet_time_us=250_000)
    assert decided(taken.round()).row_via[2] == 1


def test_nothing_that_was_passed_on_outlives_a_new_map():
    taken = ready(3, 1)
    taken.hear(1, taken.row())
    taken.relay(1, relayed(2))
    taken.fleet, _ = with_map(taken.fleet, taken.now_ns, SITES, 77)
    assert taken.fleet.relayed == (None, None, None)
