"""One fleet's metrics for a terminal, 80 columns wide. Knows rich and figures, not records."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterator

from numpy.typing import ArrayLike
from rich.markup import escape
from rich.table import Table

from hippomat_core.wire.frames import OPERATOR
from hippomat_logs.definitions import TICKS_PER_S
from hippomat_logs.metrics.figures import NONE, most, number, over_links
from hippomat_logs.metrics.fleet import FleetMetrics
from hippomat_logs.metrics.links import LinkMetrics
from hippomat_logs.metrics.robot import RobotMetrics
from hippomat_logs.metrics.same_motion import Rigid
from hippomat_logs.metrics.samples import Samples, mean, quantiles, together
from hippomat_logs.metrics.truth import PoseErrors, TruthMetrics

_OVER_LINKS = " (mean of the links' medians)"
_BAD_COUNTERS = ("dropped", "send_failed", "replaced")
_COLUMNS = (
    "robot",
    "tasks",
    "cost\n[s]",
    "travel\n[s]",
    "driven\n[m]",
    "alloc.\n[s]",
    "compute\n[ms]",
    "con-\nflicts",
    "frames\nsent",
    "\nheard",
    "\nlost",
)


def metrics_table(metrics: FleetMetrics) -> Table:
    """One row per robot and one for the fleet. Allocation and compute: medians."""
    table = _table(*_COLUMNS)
    for robot in metrics.robots:
        table.add_row(*_robot_row(robot))
    table.add_row(*_fleet_row(metrics), style="bold")
    return table


def fleet_lines(metrics: FleetMetrics) -> list[str]:
    """What a table cannot say."""
    return [
        *_who_lines(metrics),
        *_task_lines(metrics),
        *_link_lines(metrics),
        *_computer_lines(metrics),
        *_state_lines(metrics),
        *_trouble_lines(metrics),
        *([f"clocks: {metrics.clocks}"] if metrics.clocks else []),
    ]


def _who_lines(metrics: FleetMetrics) -> Iterator[str]:
    if metrics.coverage:
        yield f"{metrics.coverage} of the fleet: totals lack what the other robots did"


def _task_lines(metrics: FleetMetrics) -> Iterator[str]:
    twice = metrics.completed_twice
    done_twice = ", ".join(f"slot {slot} generation {generation}" for slot, generation in twice)
    cost_s, travel_s = number(metrics.travel_cost_s, 1), number(metrics.travel_time_s, 1)
    yield f"tasks per minute: {number(metrics.tasks_per_min, 1)}, in {metrics.duration_s:.0f} s"
    yield f"total travel cost: {cost_s} s, driven in {travel_s} s"
    yield f"conflict-free rate CF1: {number(100 * metrics.conflict_free_rate, 1)} %"
    if metrics.conflicts:
        causes = ", ".join(f"{count} x {cause}" for cause, count in sorted(metrics.conflicts.items()))
        yield f"conflicts as the robots saw them, on both sides: {causes}"
    yield f"tasks completed twice: {len(twice)}{' (' + done_twice + ')' if twice else ''}"
    yield f"allocation, from task seen to claim confirmed: {spread(metrics.allocation_s, 2, 's')}"
    yield f"  of that from request to confirmation: {spread(metrics.settling_s, 2, 's')}"


def _link_lines(metrics: FleetMetrics) -> Iterator[str]:
    links = [(robot.robot, link) for robot in metrics.robots for link in robot.links if link.received]
    if not links:
        return
    to, worst = min(links, key=lambda one: one[1].delivery)
    yield (
        f"frames delivered: {number(100 * metrics.delivery, 1)} %, "
        f"least {number(100 * worst.delivery, 1)} % from {name_of(worst.sender)} to {name_of(to)}"
    )
    rssi_dbm, low = over_links(lambda link: link.rssi_dbm), min(link.rssi_low_dbm for _, link in links)
    yield f"RSSI: {number(rssi_dbm(metrics), 0)} dBm{_OVER_LINKS}, worst 5 % of a link {number(low, 0)} dBm"
    in_time, relayed = number(100 * metrics.rows_in_time, 1), number(100 * metrics.rows_relayed, 1)
    yield f"rows there in time for decisions: {in_time} %, {relayed} % of them passed on by a third robot"
    ages = (over_links(lambda link: link.state_age_ms), over_links(lambda link: link.row_age_ms))
    by_state, rows = (number(age_ms(metrics), 0) for age_ms in ages)
    longest = number(most(link.longest_gap_ms for _, link in links), 0)
    yield f"age of information: {by_state} ms by STATE, longest gap {longest} ms; {rows} ms in decisions"
    if metrics.latencies:
        middle = number(metrics.latency_ms, 1)
        high = number(most(one.high_ms for one in metrics.latencies), 1)
        yield f"STATE core to core: {middle} ms{_OVER_LINKS}, 95 % of the slowest link {high} ms"
    yield f"  radio to radio, airtime included: {spread(metrics.air_ms, 2, 'ms')}"
    yield f"  radio to host, above the fastest: {spread(metrics.radio_to_host_ms, 1, 'ms')}"


def _computer_lines(metrics: FleetMetrics) -> Iterator[str]:
    yield f"compute per pass of the loop: {spread(metrics.compute_ms, 1, 'ms')}"
    shares = [100 * robot.computer.cpu_share for robot in metrics.robots]
    if not math.isnan(mean(shares)):
        memory_mib = most(robot.computer.memory_mib for robot in metrics.robots)
        yield f"processor: {number(mean(shares), 1)} % of a core; memory: at most {number(memory_mib, 0)} MiB"


def _state_lines(metrics: FleetMetrics) -> Iterator[str]:
    """Localization, and what the radios counted that should not be."""
    sweeps = Counter[str]()
    for robot in metrics.robots:
        sweeps.update(robot.sweeps)
    if sweeps:
        share = number(100 * sweeps["localized"] / sweeps.total(), 1)
        scores = [one.sweep_score for one in metrics.robots if one.sweep_score.count]
        yield f"localized in {share} % of the sweeps; score: {spread(together(scores), 2, '')}"
    counted = sum((Counter(robot.radio) for robot in metrics.robots), Counter[str]())
    bad = [f"{name} {n:,}" for name, n in counted.items() if name.startswith(_BAD_COUNTERS)]
    if bad:
        yield f"the radios counted: {', '.join(bad)}"


def _trouble_lines(metrics: FleetMetrics) -> Iterator[str]:
    for robot in metrics.robots:
        who = name_of(robot.robot)
        if robot.guard_limited:
            held_s = number(robot.guard_limited / TICKS_PER_S, 1)
            nearest = f"the nearest thing was {100 * robot.guard_nearest_m:.0f} cm away"
            yield f"{who}: its scan guard slowed or stopped it for {held_s} s; {nearest}"
        if robot.recoveries:
            tried = ", ".join(f"{count} x {step}" for step, count in sorted(robot.recoveries.items()))
            yield f"{who}: was stuck and tried {tried}"
        if robot.radio_reboots:
            yield f"{who}: its radio rebooted {robot.radio_reboots} times"


def link_tables(metrics: FleetMetrics) -> list[tuple[str, Table]]:
    """Matrices, sender by receiver, each with its title."""
    latencies = {(one.sender, one.receiver): one.median_ms for one in metrics.latencies if one.frames}
    made = [
        ("frames delivered [%]", _matrix(metrics, lambda link: number(100 * link.delivery, 1))),
        ("RSSI, median [dBm]", _matrix(metrics, lambda link: number(link.rssi_dbm, 0))),
        ("RSSI, 5 % [dBm]", _matrix(metrics, lambda link: number(link.rssi_low_dbm, 0))),
        (
            "age of the newest STATE heard, over time [ms]",
            _matrix(metrics, lambda link: number(link.state_age_ms, 0)),
        ),
        ("age of rows in decisions, 95 % [ms]", _matrix(metrics, lambda link: number(link.row_age_95_ms, 0))),
        ("rows in time [%]", _matrix(metrics, lambda link: number(100 * link.in_time, 1))),
    ]
    if latencies:
        title = "STATE from core to core, median [ms]"
        made.append((title, _pairs(metrics, lambda a, b: number(latencies.get((a, b), math.nan), 1))))
    return made


def _matrix(metrics: FleetMetrics, cell: Callable[[LinkMetrics], str]) -> Table:
    links = {(link.sender, robot.robot): link for robot in metrics.robots for link in robot.links}
    return _pairs(metrics, lambda a, b: cell(links[a, b]) if (a, b) in links else NONE)


def _pairs(metrics: FleetMetrics, cell: Callable[[int, int], str]) -> Table:
    receivers = [robot.robot for robot in metrics.robots]
    senders = sorted({link.sender for robot in metrics.robots for link in robot.links})
    table = _table("from \\ to", *(f"{to}" if to >= 0 else "obs." for to in receivers))
    for sender in senders:
        cells = ("" if sender == to else cell(sender, to) for to in receivers)
        table.add_row("operator" if sender == OPERATOR else str(sender), *cells)
    return table


def truth_table(truth: TruthMetrics) -> Table:
    """One row per robot and one for all."""
    columns = ("error", "median\n[m]", "95 %\n[m]", "max\n[m]", "ATE\n[m]", "yaw\n[deg]", "RPE 1 s\n[m]")
    table = _table(*columns, "RPE 1 s\n[deg]", "driven\n[m]", "place\nknown")
    for one in truth.robots:
        table.add_row(f"robot {one.robot}", *_error_cells(one))
    if len(truth.robots) > 1:
        table.add_row("fleet", *_error_cells(truth.together()), style="bold")
    return table


def _error_cells(one: PoseErrors) -> list[str]:
    sizes = [number(one.quantile_m(share), 3) for share in (0.5, 0.95, 1.0)]
    errors = [number(one.ate_m, 3), number(one.yaw_deg, 1), number(one.rpe_m, 3), number(one.rpe_deg, 1)]
    return [*sizes, *errors, number(one.driven_m, 1), f"{number(100 * one.known, 1)} %"]


def truth_lines(truth: TruthMetrics) -> Iterator[str]:
    """How the truth was put beside the logs, and what only it can say."""
    found, frame = truth.match, truth.match.frame
    if math.isnan(found.correlation):
        yield "the truth is the simulator's: its frame is the map's, and it knows the robots' clocks"
    else:
        alike = f"speeds correlate {found.correlation:.2f}"
        yield f"clock of the truth: {found.offset_s:+.3f} s makes it the logs'; {alike}"
        if frame == Rigid():
            yield "frame of the truth: taken as the map's"
        else:
            turned = f"turned {math.degrees(frame.yaw_rad):.2f} deg, shifted"
            yield f"frame of the truth: {turned} ({frame.x_m:.3f}, {frame.y_m:.3f}) m, as fits best"
    if truth.nearest is not None:
        a, b = truth.nearest.robots
        how = f"{100 * truth.nearest.clear_m:.0f} cm between their discs"
        yield f"nearest: robots {a} and {b}, {how}, {truth.nearest.time_s:.1f} s into the truth"


def name_of(robot: int) -> str:
    return "the observer" if robot < 0 else "the operator" if robot == OPERATOR else f"robot {robot}"


def _table(*columns: str) -> Table:
    table = Table(box=None, pad_edge=False, padding=(0, 1, 0, 0), header_style="bold")
    for name in columns:
        table.add_column(escape(name), justify="right", no_wrap=True)
    return table


def _robot_row(robot: RobotMetrics) -> list[str]:
    return [
        str(robot.robot) if robot.robot >= 0 else "observer",
        str(len(robot.completed)),
        number(robot.travel_cost_s, 1),
        number(robot.travel_time_s, 1),
        number(robot.driven_m, 1),
        number(quantiles(robot.allocation_s)[0], 2),
        number(quantiles(robot.compute_ms)[0], 1),
        str(sum(robot.conflicts.values())),
        f"{robot.frames_sent:,}",
        f"{robot.frames_received:,}",
        _loss(robot.frames_lost, robot.frames_received),
    ]


def _fleet_row(metrics: FleetMetrics) -> list[str]:
    robots = metrics.robots
    received, lost = sum(r.frames_received for r in robots), sum(r.frames_lost for r in robots)
    return [
        metrics.coverage.removesuffix(" logs") or "fleet",
        str(len(metrics.completed)),
        number(metrics.travel_cost_s, 1),
        number(metrics.travel_time_s, 1),
        number(metrics.driven_m, 1),
        number(quantiles(metrics.allocation_s)[0], 2),
        number(quantiles(metrics.compute_ms)[0], 1),
        str(sum(sum(robot.conflicts.values()) for robot in robots)),
        f"{sum(robot.frames_sent for robot in robots):,}",
        f"{received:,}",
        _loss(lost, received),
    ]


def spread(values: ArrayLike | Samples, digits: int, unit: str) -> str:
    """Median, mean and 95th percentile; "-" where there are no values."""
    median, mean_, high = (number(value, digits) for value in quantiles(values))
    behind = f" {unit}" if unit else ""
    return f"median {median}{behind}, mean {mean_}{behind}, 95 % {high}{behind}"


def _loss(lost: int, received: int) -> str:
    total = lost + received
    return f"{100 * lost / total:.1f} %" if total else NONE
