"""Links, ages, latency and load: by hand where that is short, by theory where there is one."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hippomat_core import messages as m
from hippomat_core.config import Config, FleetConfig, RobotConfig
from hippomat_core.wire import frames
from hippomat_logs.metrics import FleetMetrics, MetricsReading, RobotMetrics, Samples, quantiles
from hippomat_logs.metrics.figures import figures_of
from hippomat_logs.metrics.fleet_tables import fleet_lines
from hippomat_logs.metrics.latency import LatencyMetrics, whole_latencies
from hippomat_logs.metrics.links import LinkMetrics
from hippomat_logs.metrics.samples import together
from hippomat_logs.reader import Record
from hippomat_logs.records import DropRecord, ProcessRecord, TimingRecord
from hippomat_logs.schema import blank

MS = 1_000_000
CONFIG = Config(fleet=FleetConfig(size=3, task_slots=1, c_max_s=20.0), robot=RobotConfig(id=0))
STATE_HEARD, ROUND, STATUS = blank(m.StateHeard), blank(m.RoundDecided), blank(m.RadioStatus)


def read(stamped: Iterable[tuple[int, Any]], robot: int = 0) -> RobotMetrics:
    """Of records at these milliseconds."""
    reading = MetricsReading(robot, CONFIG)
    for number, (at_ms, message) in enumerate(stamped, start=1):
        reading.feed(Record(number, at_ms * MS + 1, "", message))
    return reading.result()


def heard(at_ms: int, sender: int, sequence: int, **other: Any) -> tuple[int, m.StateHeard]:
    header = replace(STATE_HEARD.header, sender=sender, boot=1, sequence=sequence)
    return at_ms, replace(STATE_HEARD, header=header, stamp_ns=at_ms * MS, **other)


def decided(at_ms: int, ages_ms: list[int], via: list[int]) -> tuple[int, m.RoundDecided]:
    ages, ways = np.array(ages_ms, np.uint16), np.array(via, np.uint8)
    return at_ms, replace(ROUND, row_age_ms=ages, row_via=ways)


@pytest.mark.parametrize("loss", [0.0, 0.2, 0.5])
def test_the_age_of_what_is_heard_is_what_theory_says(loss: float) -> None:
    """T (1 + p) / (2 (1 - p)); a standard error of 60,000 frames is below 1 %."""
    period_ms = 100
    came = np.random.default_rng(5).random(60_000) >= loss
    (link, *_) = read(heard(k * period_ms, 1, k) for k in np.flatnonzero(came).tolist()).links
    assert link.state_age_ms == pytest.approx(period_ms * (1 + loss) / (2 * (1 - loss)), rel=0.03)
    assert link.delivery == pytest.approx(1 - loss, abs=0.01)


@given(st.lists(st.integers(0, 300), min_size=1), st.randoms(use_true_random=False))
def test_delivery_is_a_share_and_does_not_depend_on_the_order(numbers: list[int], random: Any) -> None:
    (link,) = read(heard(k, 1, number) for k, number in enumerate(numbers)).links
    assert 0.0 < link.delivery <= 1.0
    different = len(set(numbers))
    assert (link.received, link.lost) == (different, max(numbers) - min(numbers) + 1 - different)
    random.shuffle(numbers)
    (again,) = read(heard(k, 1, number) for k, number in enumerate(numbers)).links
    assert (again.received, again.lost) == (link.received, link.lost)


def test_signal_strength_is_by_sender() -> None:
    near, far = read([heard(k, 1 + (k == 9), k, rssi_dbm=-40 - k) for k in range(10)]).links
    assert (near.rssi_dbm, near.rssi_low_dbm) == (-44, -48)
    assert (far.rssi_dbm, far.rssi_low_dbm) == (-49, -49)


def test_rows_are_direct_relayed_or_late() -> None:
    first, second = read(
        [
            decided(100, [0, 30, 65535], [255, 255, 255]),
            decided(200, [0, 40, 90], [255, 2, 255]),
            decided(300, [0, 150, 151], [255, 255, 255]),
        ]
    ).links  # rounds of 100 ms: up to 150 ms are of the round
    assert (first.rows_direct, first.rows_relayed, first.rows_late) == (2, 1, 0)
    assert (second.rows_direct, second.rows_relayed, second.rows_late) == (1, 0, 2)
    assert first.row_age_ms == pytest.approx((30 + 40 + 150) / 3)
    assert second.row_age_ms == pytest.approx((90 + 151) / 2)  # never heard is no age
    assert math.isnan(second.delivery)
    assert second.in_time == pytest.approx(1 / 3)


def test_latency_is_from_core_to_core_of_frames_that_both_logs_have() -> None:
    sent = [(0, replace(STATUS, boot_counter=1))]
    for k in range(10):
        sent += [
            (100 * k, blank(m.SendState)),
            (100 * k + 10, m.FrameSent(0, 0, frames.STATE, k, k != 4)),
        ]
    sender, receiver = read(sent, robot=1), read(heard(100 * k + 25 + k, 1, k) for k in range(0, 10, 2))
    halves = [(1, sender.passages), (0, receiver.passages)]
    (found,) = whole_latencies(halves, lambda _place, times: times)
    assert (found.sender, found.receiver, found.frames) == (1, 0, 4)  # 0 2 6 8: 4 was given up
    assert found.median_ms == pytest.approx(25 + 4)
    (moved,) = whole_latencies(halves, lambda place, times: times - 5 * MS * place)
    assert moved.median_ms == pytest.approx(found.median_ms - 5)
    assert (sender.frames_sent, sender.states_sent, sender.frames_given_up) == (9, 9, 1)


def test_a_long_run_keeps_few_frames_and_the_two_sides_keep_the_same() -> None:
    reading = [MetricsReading(robot, CONFIG) for robot in (1, 0)]
    reading[0].feed(Record(1, 1, "", replace(STATUS, boot_counter=1)))
    for k in range(50_000):
        reading[0].feed(Record(2, 100 * k * MS, "", blank_state))
        reading[0].feed(Record(2, 100 * k * MS, "", m.FrameSent(0, 0, frames.STATE, k, True)))
        if k % 3:
            reading[1].feed(Record(2, (100 * k + 7) * MS, "", heard(k, 1, k)[1]))
    sender, receiver = (one.result() for one in reading)
    assert len(sender.passages.sent.times) <= 8192
    (found,) = whole_latencies([(1, sender.passages), (0, receiver.passages)], lambda _place, times: times)
    assert found.frames > 2000
    assert (found.median_ms, found.high_ms) == (7.0, 7.0)


blank_state = blank(m.SendState)


def test_radio_to_host_is_above_the_fastest_frame_whatever_the_clocks_offset() -> None:
    late_us = [900, 500, 1700, 500]
    stamped = [
        heard(k, 1, k, radio_time_us=77_000_000 + k * 1000 - late) for k, late in enumerate(late_us, start=1)
    ]
    found = read(stamped).radio_to_host_ms
    assert sorted(found.kept.tolist()) == pytest.approx([0.0, 0.0, 0.4, 1.2])


def test_time_in_the_air_counts_only_while_fleet_time_is_agreed() -> None:
    ended = replace(blank(m.RoundEnded), agreed=True)
    header = replace(STATE_HEARD.header, fleet_time_us=1000)
    frame = replace(STATE_HEARD, header=header, fleet_time_us=1310)
    found = read([(0, frame), (1, ended), (2, frame), (3, replace(ended, agreed=False)), (4, frame)]).air_ms
    assert found.kept.tolist() == pytest.approx([0.31])


def test_a_radios_counters_are_those_of_the_run_whatever_it_counted_before_or_after_a_reboot() -> None:
    states = [
        replace(STATUS, boot_id=7, sent=1000, dropped_usb=5),
        replace(STATUS, boot_id=7, sent=1500, dropped_usb=6),
        replace(STATUS, boot_id=8, sent=20, dropped_usb=0),
    ]
    found = read(enumerate(states))
    assert (found.radio["sent"], found.radio["dropped_usb"], found.radio_reboots) == (520, 1, 1)


def test_processor_share_is_by_the_machines_clock() -> None:
    found = read(
        [
            (0, ProcessRecord(0, 10_000 * MS, 900 * MS, 1024)),
            (100, TimingRecord(0, 3 * MS, 2 * MS)),
            (3000, ProcessRecord(0, 14_000 * MS, 1900 * MS, 4096)),
        ]
    ).computer
    assert (found.cpu_share, found.memory_mib) == (0.25, 4.0)
    assert (found.compute_ms.mean, found.lag_ms.high) == (3.0, 2.0)
    assert math.isnan(read([(0, TimingRecord(0, 1, 1))]).computer.cpu_share)


def test_what_the_recorder_lost_is_counted_by_cause() -> None:
    drops = DropRecord(3, 7, "disk"), DropRecord(9, 9, "disk"), DropRecord(11, 12, "queue")
    assert read(enumerate(drops)).records_lost == {"disk": 6, "queue": 2}


def test_a_robot_that_trembles_has_not_driven() -> None:
    poses = [(k, m.PoseEstimated(0.005 * (k % 2), 0.0, 0.0, 0.0, 0.0, "slam")) for k in range(1000)]
    assert read(poses).driven_m == 0.0
    moving = [(k, m.PoseEstimated(0.01 * k, 0.0, 0.0, 0.0, 0.0, "slam")) for k in range(101)]
    found = read(moving)
    assert found.driven_m == pytest.approx(1.0, abs=0.02)
    assert found.path.shape[1] == 2


@given(st.lists(st.floats(-1e6, 1e6, width=32), max_size=300), st.sampled_from([16, 64]))
def test_thinned_samples_keep_count_mean_and_extremes(values: list[float], capacity: int) -> None:
    found = Samples(values, capacity)
    assert found.count == len(values)
    assert len(found.kept) <= capacity
    if values:
        assert found.mean == pytest.approx(sum(values) / len(values), rel=1e-6, abs=1e-6)
        assert (found.low, found.high) == (min(values), max(values))
        assert set(found.kept.tolist()) <= set(values)
    else:
        assert math.isnan(found.mean)
        assert all(math.isnan(value) for value in quantiles(found))


def test_samples_of_runs_of_any_length_weigh_alike_when_put_together() -> None:
    long_run, short_run = Samples([1.0] * 1000, capacity=100), Samples([0.0] * 500, capacity=1000)
    assert together([long_run, short_run]).mean() == pytest.approx(2 / 3, abs=0.02)


def test_latency_of_a_fleet_is_the_mean_of_its_links_medians_wherever_it_stands() -> None:
    links = [LatencyMetrics(a, 1 - a, 9, median_ms, 99.0) for a, median_ms in ((0, 10.0), (1, 40.0))]
    silent = LatencyMetrics(2, 0, 0, math.nan, math.nan)
    heard_from = [
        LinkMetrics(k, 9, 1, rssi_dbm, rssi_dbm) for k, rssi_dbm in enumerate((-40.0, -50.0, -75.0))
    ]
    fleet = FleetMetrics([RobotMetrics(0, links=heard_from)], latencies=[*links, silent])
    lines = "\n".join(fleet_lines(fleet))
    assert "STATE core to core: 25.0 ms (mean of the links' medians)" in lines
    assert "RSSI: -55 dBm (mean of the links' medians)" in lines
    assert (figures_of(fleet)["latency"], figures_of(fleet)["rssi"]) == (25.0, -55.0)


def test_age_of_rows_counts_those_that_only_came_by_others_wherever_it_stands() -> None:
    direct = LinkMetrics(1, 9, 1, -50.0, -50.0, state_age_ms=70.0, row_age_ms=20.0)
    relayed = LinkMetrics(2, 0, 0, row_age_ms=40.0)
    fleet = FleetMetrics([RobotMetrics(0, links=[direct, relayed])])
    assert any(
        "age of information: 70 ms by STATE" in line and line.endswith("30 ms in decisions")
        for line in fleet_lines(fleet)
    )
    assert figures_of(fleet)["row_age"] == 30.0
