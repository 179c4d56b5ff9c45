"""What one robot makes of its peers, driven by hand: rows, expiry, alarms, a new map."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from fleet_seat import (
    DIGEST,
    ROUND,
    SITES,
    M,
    air_claim,
    claimed_slot,
    of,
    ready,
    requesting,
    seat,
    tag_of,
)

from hippomat_core.config import Config, FleetConfig, RobotConfig
from hippomat_core.fleet.hearing import heard_relay
from hippomat_core.fleet.inputs import Intent, OwnInputs
from hippomat_core.fleet.rounds import end_round
from hippomat_core.fleet.sites import task_sites
from hippomat_core.fleet.state import initial, started, with_map
from hippomat_core.messages import (
    AlarmCleared,
    AlarmRaised,
    ClaimChanged,
    PeerClaimSeen,
    RoundDecided,
    TaskTurned,
)
from hippomat_core.wire.codec import decode_frame, encode_frame
from hippomat_core.wire.frames import (
    CLAIMED,
    RELAY,
    STATE,
    WAITING,
    Header,
    RelayFrame,
    RelayRow,
)


def test_a_dead_peers_claim_expires_and_its_task_waits_again():
    taken = ready()
    taken.hear(1, taken.row(air_claim(0, confirmed=True)))
    assert taken.rounds(0.1, 2)[-1].state_frame.task_states[0] == CLAIMED  # type: ignore[union-attr]
    outcomes = taken.rounds(3.0, 2, can_request=False)
    seen = [event for outcome in outcomes for event in of(PeerClaimSeen, outcome.effects)]
    assert [(event.robot, event.slot, event.what) for event in seen] == [(1, 0, "expired")]
    assert outcomes[-1].state_frame.task_states[0] == WAITING  # type: ignore[union-attr]


def test_a_peers_claim_is_followed_through_its_life():
    taken = ready()
    told = taken.hear(1, taken.row(air_claim(0)))
    told += taken.hear(1, taken.row(air_claim(0, confirmed=True)))
    told += taken.hear(1, taken.row(air_claim(0, confirmed=True)))
    told += taken.hear(1, taken.row(air_claim(2, tag=2)))
    told += taken.hear(1, taken.row())
    assert [event.what for event in of(PeerClaimSeen, told)] == [
        "requested",
        "confirmed",
        "gone",
        "requested",
        "gone",
    ]


def test_an_older_row_never_replaces_a_newer_one():
    taken = seat()
    taken.hear(1, taken.row(x_cm=1), sequence=10)
    for late in (10, 9):
        assert taken.hear(1, taken.row(x_cm=2), sequence=late) == []
    assert taken.fleet.peers[1].frame.x_cm == 1  # type: ignore[union-attr]
    taken.hear(1, taken.row(x_cm=3), boot=2, sequence=1)
    assert taken.fleet.peers[1].frame.x_cm == 3  # type: ignore[union-attr]
    assert of(AlarmRaised, taken.hear(1, taken.row(x_cm=4), boot=1, sequence=11))[0].code == "peer_duplicate"
    assert taken.fleet.peers[1].frame.x_cm == 3  # type: ignore[union-attr]


def test_sequence_numbers_run_round():
    taken = seat()
    taken.hear(1, taken.row(x_cm=1), sequence=2**24 - 1)
    taken.hear(1, taken.row(x_cm=2), sequence=0)
    assert taken.fleet.peers[1].frame.x_cm == 2  # type: ignore[union-attr]


def test_a_peer_of_another_fleet_digest_is_named_once_and_left_out_until_it_agrees():
    taken = ready()
    (alarm,) = taken.hear(1, taken.row(air_claim(0), fleet_digest=0x1234))
    assert isinstance(alarm, AlarmRaised)
    assert alarm.code == "peer_digest"
    assert "the policy's weights" in alarm.text
    assert all(part in alarm.text for part in ("robot 1", "00001234", "robot 0", "0000abcd"))
    assert taken.hear(1, taken.row(air_claim(0), fleet_digest=0x1234)) == []
    outcome = taken.round()
    assert of(RoundDecided, outcome.effects)[0].row_available[1] == 0
    assert outcome.state_frame is not None
    assert outcome.state_frame.endorsed.tolist()[1] == 0
    assert taken.hear(1, taken.row())[0] == AlarmCleared("peer_digest")


def test_a_row_of_other_sizes_is_of_another_fleet_whatever_its_digest():
    taken = seat()
    alarms = taken.hear(1, taken.row(costs=np.zeros(9, np.uint8), task_states=np.zeros(9, np.uint8)))
    assert [alarm.code for alarm in of(AlarmRaised, alarms)] == ["peer_digest"]
    assert taken.round().state_frame is not None


def test_another_radio_with_our_id_makes_us_passive():
    taken, _ = requesting()
    (alarm,) = taken.hear(0, taken.row())
    assert isinstance(alarm, AlarmRaised)
    assert alarm.code == "duplicate_id"
    outcome = taken.round()
    assert outcome.state_frame is None
    assert not outcome.has_claim
    assert of(ClaimChanged, outcome.effects)[0].cause == "duplicate id"
    assert taken.hear(0, taken.row()) == []


def test_a_robot_outside_the_roster_is_named_once():
    taken = seat()
    alarms = taken.hear(9, taken.row()) + taken.hear(9, taken.row())
    assert [alarm.code for alarm in of(AlarmRaised, alarms)] == ["unknown_robot"]


def test_a_relayed_row_is_a_sign_of_life():
    taken = ready()
    taken.hear(1, taken.row(air_claim(0)))
    row = RelayRow(1, 2, 1, 0, 0, 5, False, 1, True, False, 0, 0, 0, 0, np.zeros(M, np.uint8))
    outcomes = []
    for _ in range(40):
        taken.hear(2, taken.row())
        header = Header(RELAY, False, 1, 2, 1, taken.sequence, 0)
        taken.fleet, _ = heard_relay(taken.fleet, taken.now_ns, header, RelayFrame(3, 0, (row,)), -60)
        outcomes.append(taken.round(can_request=False))
    assert not [event for outcome in outcomes for event in of(PeerClaimSeen, outcome.effects)]
    assert outcomes[-1].state_frame is not None
    assert outcomes[-1].state_frame.endorsed.tolist() == [0, 1, 0]


def test_an_observer_follows_the_fleet_and_says_nothing():
    observer = seat(robot=-1, mapped=False)
    observer.hear(1, observer.row())
    outcome = observer.round()
    assert outcome.state_frame is None
    assert outcome.tasks_frames == ()
    assert of(RoundDecided, outcome.effects)[0].reason == "observing"
    assert [peer is not None for peer in observer.fleet.peers].count(True) == 1


def test_without_a_map_a_robot_sends_nothing_and_accuses_nobody():
    taken = seat(mapped=False)
    assert taken.hear(1, taken.row()) == []
    outcome = taken.round()
    assert outcome.state_frame is None
    assert of(RoundDecided, outcome.effects)[0].reason == "no map"


def test_a_new_map_drops_the_claim_and_begins_anew():
    taken, _ = requesting()
    taken.fleet, effects = with_map(taken.fleet, taken.now_ns, SITES, 77)
    assert [change.cause for change in of(ClaimChanged, effects)] == ["map changed"]
    assert len(of(TaskTurned, effects)) == M
    assert not taken.round().has_claim


def test_rows_from_before_a_new_map_count_for_nothing_until_their_senders_agree_on_it():
    taken, outcome = requesting()
    taken.hear(1, taken.row(air_claim(3), endorsed=tag_of(outcome)))
    taken.fleet, effects = with_map(taken.fleet, taken.now_ns, SITES, 77)
    assert [gone.what for gone in of(PeerClaimSeen, effects)] == ["gone"]
    assert taken.fleet.alive_peers(taken.now_ns) == []
    assert taken.fleet.peers[1].claim is None
    decided = of(RoundDecided, taken.round().effects)[0]
    assert not decided.row_available[1:].any()
    (alarm,) = of(AlarmRaised, taken.hear(1, taken.row()))
    assert alarm.code == "peer_digest"
    taken.hear(2, taken.row(fleet_digest=77))
    assert [peer.robot for peer in taken.fleet.alive_peers(taken.now_ns)] == [2]


def test_what_was_refused_on_the_last_map_is_not_refused_on_a_new_one():
    taken = seat()
    taken.fleet = replace(taken.fleet, shunned=((0, 0, 10**12),))
    taken.fleet, _ = with_map(taken.fleet, taken.now_ns, SITES, 77)
    assert taken.fleet.shunned == ()


def test_a_peer_that_changes_its_claim_in_every_row_does_not_fill_the_memory():
    taken, _ = requesting()
    slot = claimed_slot(taken)
    for number in range(40):
        taken.hear(1, taken.row(replace(air_claim(slot, cost=99), round=number)))
        taken.round()
    assert len(taken.fleet.own_claim.opposed) == 1


def test_a_stale_claim_read_during_a_hold_up_gets_no_vote_when_the_hold_up_is_over():
    taken = ready()
    taken.now_ns += 2 * 10**9
    taken.hear(2, taken.row(air_claim(3)))
    taken.now_ns += ROUND // 2
    outcome = taken.round()
    assert outcome.state_frame.endorsed[2] == 0
    taken.hear(2, taken.row(air_claim(3)))
    assert taken.round().state_frame.endorsed[2] == 1


def test_costs_for_another_number_of_tasks_are_refused():
    with pytest.raises(ValueError, match="needed"):
        ready().round(costs=(1, 2, 3))


def test_rounds_are_due_once_each():
    taken = seat()
    assert taken.fleet.clock.due(0)
    taken.now_ns = -ROUND // 2
    taken.round()
    assert not taken.fleet.clock.due(ROUND - 1)
    assert taken.fleet.clock.due(ROUND)


def test_the_largest_fleet_fits_the_frame():
    settings = FleetConfig(size=64, task_slots=80, round_s=0.2, allocator="hungarian")
    fleet = started(initial(Config(fleet=settings, robot=RobotConfig(id=63))), 0)
    sites = task_sites(np.ones((160, 160), np.bool_), 0.05, 0.0, 0.0, 0.12)
    fleet, _ = with_map(fleet, 0, sites, DIGEST)
    intent = Intent(1, 2, 0, np.full(12, 14, np.uint8))
    own = OwnInputs(lambda: np.zeros(80, np.uint8), can_request=True, intent=intent)
    fleet, outcome = end_round(fleet, 1, own)
    assert outcome.state_frame is not None
    header = Header(STATE, False, 1, 63, 1, 1, 0)
    _, decoded = decode_frame(encode_frame(header, outcome.state_frame))
    assert repr(decoded) == repr(outcome.state_frame)
