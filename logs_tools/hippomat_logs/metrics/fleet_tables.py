"""Tables of metrics and of what is in a log, for a terminal. Knows rich, not records."""

from __future__ import annotations

from rich.markup import escape
from rich.table import Table

from hippomat_logs.metrics import FleetMetrics, RobotMetrics, quantiles

TICKS_PER_S = 20
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
    """One row per robot and one for the fleet, 80 characters wide. Allocation and compute: medians."""
    table = Table(box=None, pad_edge=False, padding=(0, 1, 0, 0), header_style="bold")
    for name in _COLUMNS:
        table.add_column(escape(name), justify="right", no_wrap=True)
    for robot in metrics.robots:
        table.add_row(*_robot_row(robot))
    table.add_row(*_fleet_row(metrics), style="bold")
    return table


def fleet_lines(metrics: FleetMetrics) -> list[str]:
    """What a table cannot say."""
    twice = metrics.completed_twice
    done_twice = ", ".join(f"slot {slot} generation {generation}" for slot, generation in twice)
    lost = sum(robot.frames_lost for robot in metrics.robots)
    cost_s, travel_s = _number(metrics.travel_cost_s, 1), _number(metrics.travel_time_s, 1)
    return [
        f"total travel cost: {cost_s} s, driven in {travel_s} s",
        f"conflict-free rate CF1: {_number(100 * metrics.conflict_free_rate, 1)} %",
        f"tasks completed twice: {len(twice)}{' (' + done_twice + ')' if twice else ''}",
        f"allocation, from task seen to claim confirmed: {_spread(metrics.allocation_s, 2, 's')}",
        f"  of that from request to confirmation: {_spread(metrics.settling_s, 2, 's')}",
        f"compute per pass of the loop: {_spread(metrics.compute_ms, 1, 'ms')}",
        f"frames that somebody missed: {lost:,}",
        *_standstills(metrics),
    ]


def _standstills(metrics: FleetMetrics) -> list[str]:
    """Who was slowed by its scan guard, and who was stuck."""
    lines = []
    for robot in metrics.robots:
        if robot.guard_limited:
            held_s = _number(robot.guard_limited / TICKS_PER_S, 1)
            nearest = f"the nearest thing was {100 * robot.guard_nearest_m:.0f} cm away"
            lines.append(
                f"robot {robot.robot}: its scan guard slowed or stopped it for {held_s} s; {nearest}"
            )
        if robot.recoveries:
            tried = ", ".join(f"{count} x {step}" for step, count in sorted(robot.recoveries.items()))
            lines.append(f"robot {robot.robot}: was stuck and tried {tried}")
    return lines


def _robot_row(robot: RobotMetrics) -> list[str]:
    return [
        str(robot.robot) if robot.robot >= 0 else "observer",
        str(len(robot.completed)),
        _number(robot.travel_cost_s, 1),
        _number(robot.travel_time_s, 1),
        _number(robot.driven_m, 1),
        _number(quantiles(robot.allocation_s)[0], 2),
        _number(quantiles(robot.compute_ms)[0], 1),
        str(sum(robot.conflicts.values())),
        f"{robot.frames_sent:,}",
        f"{robot.frames_received:,}",
        _loss(robot.frames_lost, robot.frames_received),
    ]


def _fleet_row(metrics: FleetMetrics) -> list[str]:
    robots = metrics.robots
    received, lost = sum(r.frames_received for r in robots), sum(r.frames_lost for r in robots)
    return [
        "fleet",
        str(len(metrics.completed)),
        _number(metrics.travel_cost_s, 1),
        _number(metrics.travel_time_s, 1),
        _number(sum(robot.driven_m for robot in robots), 1),
        _number(quantiles(metrics.allocation_s)[0], 2),
        _number(quantiles(metrics.compute_ms)[0], 1),
        str(sum(sum(robot.conflicts.values()) for robot in robots)),
        f"{sum(robot.frames_sent for robot in robots):,}",
        f"{received:,}",
        _loss(lost, received),
    ]


def _number(value: float, digits: int) -> str:
    return "-" if value != value else f"{value:,.{digits}f}"


def _spread(values: list[float], digits: int, unit: str) -> str:
    median, mean, high = (_number(value, digits) for value in quantiles(values))
    return f"median {median} {unit}, mean {mean} {unit}, 95 % {high} {unit}"


def _loss(lost: int, received: int) -> str:
    total = lost + received
    return f"{100 * lost / total:.1f} %" if total else "-"
