"""The matrices and histograms of a report, and the figures beside them: the same as metrics gives."""

from __future__ import annotations

import html
from pathlib import Path
from typing import Any

import numpy as np
from bokeh.models import LinearColorMapper
from hypothesis import given
from hypothesis import strategies as st
from recorded_fleet import FIRST_REQUEST_S, OPERATED, RecordedFleet
from report_samples import write_fleet

from hippomat_logs.metrics import LinkMetrics
from hippomat_logs.metrics.fleet_tables import fleet_lines, link_tables
from hippomat_logs.metrics.samples import Samples
from hippomat_logs.report_html.building import build
from hippomat_logs.report_html.matrices import conflict_figure, delivery_figure, latency_counts, quantile
from hippomat_logs.report_html.page import render


def test_who_never_heard_whom_and_who_never_conflicted_shows_in_the_matrices(tmp_path: Path) -> None:
    """Robot 1 never hears robot 0, and so both want the task between them."""
    starts = [(0.6, 0.6), (1.3, 0.6), (4.4, 4.4)]
    fleet = RecordedFleet(3, relays=False, starts=starts, **{**OPERATED, "task_slots": 1})
    fleet.delivers = lambda sender, receiver: (sender, receiver) != (0, 1)
    fleet.order([(0.6, 2.0)])
    fleet.run(FIRST_REQUEST_S + 0.5)
    data, _ = build([fleet.write(tmp_path)])
    heard = cells_of(delivery_figure(data))
    assert {pair for pair, value in heard.items() if value == 0} == {("0", "1")}
    assert {("1", "0"), ("2", "0"), ("2", "1"), ("0", "2"), ("1", "2")} <= set(heard)
    conflicts = conflict_figure(data)
    counts = cells_of(conflicts)
    assert {pair: n for pair, n in counts.items() if n} == {("0", "1"): 1, ("1", "0"): 1}
    mapper = conflicts.select_one(LinearColorMapper)
    assert 0 < mapper.low < 1 <= mapper.high  # no conflict has no colour of the palette


def test_delivery_is_the_same_way_round_as_the_matrices_of_metrics(tmp_path: Path) -> None:
    fleet = RecordedFleet(3, relays=False, starts=[(0.6, 0.6), (1.3, 0.6), (4.4, 4.4)], **OPERATED)
    fleet.delivers = lambda sender, receiver: (sender, receiver) != (0, 1)
    fleet.run(FIRST_REQUEST_S)
    data, _ = build([fleet.write(tmp_path)])
    title, table = link_tables(data.metrics)[0]
    assert title == "frames delivered [%]"
    rows = {
        str(cells[0]): cells[1:] for cells in zip(*(column.cells for column in table.columns), strict=True)
    }
    receivers = [str(column.header) for column in table.columns[1:]]
    drawn = delivery_figure(data)
    for (row, column), value in cells_of(drawn).items():
        if value:  # the page shows a link on which nothing was heard, too
            assert rows[row][receivers.index(column)] == f"{value:.1f}"
    assert str(table.columns[0].header) == r"from \ to"
    assert (drawn.yaxis.axis_label, drawn.xaxis.axis_label) == ("from (sender)", "to (receiver)")


def test_a_page_gives_latency_and_age_as_one_figure_each_the_one_that_metrics_prints(tmp_path: Path) -> None:
    write_fleet(tmp_path, robots=3, seconds=10.0)
    data, _ = build([tmp_path])
    mine, *others = data.metrics.robots
    mine.air_ms = Samples([0.305, 0.306, 0.307, 0.307, 0.31] * 9)
    mine.links = [
        LinkMetrics(1, 9, 1, row_age_ms=20.2),
        LinkMetrics(2, 9, 1, row_age_ms=30.4),
    ]
    for robot in others:
        robot.air_ms, robot.links = Samples(), []
    data.age_counts[:] = 0
    data.age_counts[[10, 26, 33]] = 1, 90, 9
    page, lines = html.unescape(render(data, "0")), fleet_lines(data.metrics)
    air = next(line for line in lines if "radio to radio" in line).partition(": ")[2]
    assert air.startswith("median 0.31 ms")
    assert f"by the radios' common clock: {air}." in page
    assert any(line.endswith("25 ms in decisions") for line in lines)
    assert "relayed ones included: mean 25 ms, 95 % within 33 ms." in page
    assert latency_counts(data)[30:].tolist() == [36, 9]  # from 0.30 ms on, and from 0.31 ms on


def cells_of(matrix: Any) -> dict[tuple[str, str], float]:
    """(row, column) -> value."""
    cells = matrix.renderers[0].data_source.data
    return dict(zip(zip(cells["y"], cells["x"], strict=True), cells["value"], strict=True))


@given(st.lists(st.integers(0, 50), min_size=1, max_size=200))
def test_the_median_of_a_histogram_is_in_the_right_bin(values: list[int]) -> None:
    counts = np.bincount(values)
    middle = sorted(values)[(len(values) - 1) // 2]
    assert quantile(counts, 1.0, 0.5) == middle + 0.5
