"""Carrier sense, hidden stations, partitions and bursts: what collides, what waits, what is lost."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from hippomat_sim.air import AirSettings, Ended, airtime_us, hidden_pairs
from hippomat_sim.carrier import CONTENTION_SLOTS, DIFS_US, SLOT_US
from hippomat_sim.medium import Medium

CLEAN = AirSettings(duplicate=0.0, driver_jitter_us=0)
FRAME = bytes(200)
AIR_US = airtime_us(len(FRAME))


def after(medium: Medium, sends: list[tuple[int, int]]) -> list[Ended]:
    """Everything that ends when `sends` (time, sender) have been made."""
    for now_us, sender in sends:
        medium.send(now_us, sender, FRAME)
    ends = []
    while (ended := medium.pop_ended(10**12)) is not None:
        ends.append(ended)
    return ends


def starts(ends: list[Ended]) -> list[int]:
    return [ended.at_us - AIR_US for ended in ends]


def test_hidden_stations_collide_where_both_are_heard_and_reach_the_others() -> None:
    # 0 and 1 are hidden from each other; 2 hears both, 3 only 0, 4 only 1.
    hidden = frozenset({(0, 1), (1, 3), (0, 4)})
    medium = Medium(5, AirSettings(duplicate=0.0, driver_jitter_us=0, hidden=hidden), 1)
    ends = after(medium, [(0, 0), (200, 1)])
    assert [sorted(ended.receivers.tolist()) for ended in ends] == [[3], [4]]
    assert medium.counts[2].collided == 2
    assert medium.counts[1].unreached == medium.counts[0].unreached == 1


def test_the_same_stations_do_not_collide_where_they_sense_each_other() -> None:
    ends = after(Medium(5, CLEAN, 1), [(0, 0), (200, 1)])
    assert [len(ended.receivers) for ended in ends] == [4, 4]


def test_a_busy_channel_defers_by_difs_and_a_whole_number_of_slots() -> None:
    seen = set()
    for seed in range(200):
        first, second = starts(after(Medium(2, CLEAN, seed), [(0, 0), (100, 1)]))
        slots, rest = divmod(second - first - AIR_US - DIFS_US, SLOT_US)
        assert rest == 0
        seen.add(slots)
    assert seen == set(range(CONTENTION_SLOTS))


def test_a_back_off_goes_on_where_it_was_frozen() -> None:
    for seed in range(50):
        first, second, third = starts(after(Medium(3, CLEAN, seed), [(0, 0), (50, 1), (100, 2)]))
        if second == third:
            continue
        # The second waited a slots, the third b > a: a before the second's frame and b - a behind it.
        a = (second - first - AIR_US - DIFS_US) // SLOT_US
        b = a + (third - second - AIR_US - DIFS_US) // SLOT_US
        assert 0 <= a < b < CONTENTION_SLOTS


def test_equal_back_offs_collide_about_as_often_as_they_are_drawn() -> None:
    collided, trials = 0, 1000
    for seed in range(trials):
        _, second, third = after(Medium(4, CLEAN, seed), [(0, 0), (100, 1), (110, 2)])
        if second.at_us == third.at_us:
            collided += 1
            assert not len(second.receivers)
            assert not len(third.receivers)
        else:
            assert len(second.receivers) == len(third.receivers) == 3
    assert collided / trials == pytest.approx(1 / CONTENTION_SLOTS, abs=0.03)


def test_a_station_that_sends_is_deaf_to_what_it_did_not_sense() -> None:
    medium = Medium(3, CLEAN, 1)
    ends = after(medium, [(0, 0), (2, 1)])  # 2 us apart: too late to be noticed
    assert [ended.receivers.tolist() for ended in ends] == [[], []]
    assert (medium.counts[0].deaf, medium.counts[1].deaf, medium.counts[2].collided) == (1, 1, 2)


def test_a_much_stronger_frame_survives_where_capture_is_on() -> None:
    for capture_db, expected in ((10.0, [2]), (40.0, [])):
        air = AirSettings(
            duplicate=0.0, driver_jitter_us=0, hidden=frozenset({(0, 1)}), capture_db=capture_db
        )
        medium = Medium(3, air, 1)
        medium.positions_m = [(0.0, 0.0), (20.0, 0.0), (1.0, 0.0)]  # 2 is near to 0 and far from 1
        near, far = after(medium, [(0, 0), (100, 1)])
        assert (near.receivers.tolist(), far.receivers.tolist()) == (expected, [])


def test_frames_of_one_station_go_in_order_and_one_at_a_time() -> None:
    medium = Medium(2, CLEAN, 1)
    for k in range(20):
        medium.send(0, 0, bytes([k]) * 50)
    ends = after(medium, [])
    assert [ended.frame[0] for ended in ends] == list(range(20))
    assert all(b.at_us - a.at_us >= airtime_us(50) + DIFS_US for a, b in itertools.pairwise(ends))


def test_parts_neither_hear_nor_sense_each_other_until_they_are_one_again() -> None:
    medium = Medium(4, CLEAN, 1)
    medium.partition([(0, 1), (2, 3)])
    ends = after(medium, [(0, 0), (100, 2)])
    assert starts(ends) == [CLEAN.driver_us, 100 + CLEAN.driver_us]
    assert [ended.receivers.tolist() for ended in ends] == [[1], [3]]
    medium.heal()
    assert [ended.receivers.tolist() for ended in after(medium, [(10_000, 0)])] == [[1, 2, 3]]


def test_late_frames_are_as_many_as_asked_for_and_at_most_that_late() -> None:
    air = AirSettings(duplicate=0.0, late=0.1)
    ends = after(Medium(11, air, 3), [(k * 1000, 0) for k in range(2000)])
    delays = np.concatenate([ended.arrivals_us - ended.at_us for ended in ends]) - air.latency_us
    late = delays[delays > air.jitter_us]
    assert len(late) / len(delays) == pytest.approx(0.1, abs=0.01)
    assert late.max() <= air.late_us + air.jitter_us
    assert delays.min() >= 0


@pytest.mark.parametrize("bursts", ["link", "receiver"])
def test_bursts_lose_the_share_asked_for_in_runs_of_the_length_asked_for(bursts: str) -> None:
    air = AirSettings(loss=0.3, bursts=bursts, burst_s=0.1, duplicate=0.0)  # type: ignore[arg-type]
    receivers, frames, period_us = 20, 5000, 10_000
    medium = Medium(receivers + 1, air, 5)
    heard = np.zeros((frames, receivers + 1), bool)
    for k, ended in enumerate(after(medium, [(k * period_us, 0) for k in range(frames)])):
        heard[k, ended.receivers] = True
    lost = ~heard[:, 1:]
    assert lost.mean() == pytest.approx(0.3, abs=0.03)
    runs = np.diff(lost.astype(int), axis=0)
    mean_s = lost.sum() / (runs == 1).sum() * period_us / 1e6
    assert mean_s == pytest.approx(0.1, rel=0.15)


def test_fades_hit_a_receiver_for_all_senders_and_bursts_one_link() -> None:
    agreed = {}
    for bursts in ("link", "receiver"):
        air = AirSettings(loss=0.5, bursts=bursts, burst_s=1.0, duplicate=0.0)  # type: ignore[arg-type]
        ends = after(Medium(3, air, 2), [(500 * k, k % 2) for k in range(4000)])
        heard = [2 in ended.receivers for ended in ends]
        agreed[bursts] = np.mean([a == b for a, b in itertools.pairwise(heard)])
    assert agreed["receiver"] > 0.95
    assert agreed["link"] < 0.9


def test_hidden_pairs_are_the_share_asked_for_and_the_seeds() -> None:
    pairs = hidden_pairs(30, 0.2, 7)
    assert len(pairs) == 87
    assert all(0 <= a < b < 30 for a, b in pairs)
    assert pairs == hidden_pairs(30, 0.2, 7) != hidden_pairs(30, 0.2, 8)
    assert hidden_pairs(30, 0.0, 7) == frozenset()
