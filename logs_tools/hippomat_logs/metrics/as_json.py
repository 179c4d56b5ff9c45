"""One fleet's metrics as values that JSON has: no infinity, and null for what has no value."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

from hippomat_logs.metrics.beside_paper import beside_paper
from hippomat_logs.metrics.figures import figures_of
from hippomat_logs.metrics.fleet import FleetMetrics
from hippomat_logs.metrics.robot import RobotMetrics
from hippomat_logs.metrics.samples import Samples
from hippomat_logs.metrics.truth import TruthMetrics

_LEFT_OUT = ("path", "requested", "confirmed", "seen", "passages")


def fleet_as_json(metrics: FleetMetrics) -> dict[str, Any]:
    """Everything but the paths driven and the single tasks' times of day."""
    made: dict[str, Any] = plain(
        {
            "completed": len(metrics.completed),
            "completed_twice": metrics.completed_twice,
            "duration_s": metrics.duration_s,
            "travel_cost_s": metrics.travel_cost_s,
            "travel_time_s": metrics.travel_time_s,
            "conflict_free_rate": metrics.conflict_free_rate,
            "allocation_s": metrics.allocation_s,
            "settling_s": metrics.settling_s,
            "clocks": metrics.clocks,
            "logs": metrics.recorded,
            "fleet_size": metrics.size,
            "not_whole": metrics.not_whole,
            "figures": figures_of(metrics),
            "paper": beside_paper(metrics),
            "latencies": metrics.latencies,
            "robots": [_robot(robot) for robot in metrics.robots],
        }
    )
    return made


def _robot(robot: RobotMetrics) -> dict[str, Any]:
    facts = {f.name: getattr(robot, f.name) for f in dataclasses.fields(robot) if f.name not in _LEFT_OUT}
    return {**facts, "travel_cost_s": robot.travel_cost_s, "travel_time_s": robot.travel_time_s}


def truth_as_json(truth: TruthMetrics) -> dict[str, Any]:
    """Figures of the errors instead of every one of them."""
    robots = []
    for one in truth.robots:
        facts = {f.name: getattr(one, f.name) for f in dataclasses.fields(one) if f.name != "errors_m"}
        shares = {"median_m": 0.5, "percentile_95_m": 0.95, "most_m": 1.0}
        robots.append(
            {**facts, "ate_m": one.ate_m, **{name: one.quantile_m(q) for name, q in shares.items()}}
        )
    made: dict[str, Any] = plain({"match": truth.match, "nearest": truth.nearest, "robots": robots})
    return made


def plain(value: Any) -> Any:
    """Dataclasses as objects, samples by their spread, nan and infinity as null."""
    if isinstance(value, Samples):
        return plain(spread_of(value))
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return {f.name: plain(getattr(value, f.name)) for f in dataclasses.fields(value)}
    if isinstance(value, dict):
        return {str(key): plain(one) for key, one in value.items()}
    if isinstance(value, list | tuple):
        return [plain(one) for one in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def spread_of(samples: Samples) -> dict[str, float]:
    low, high = (samples.low, samples.high) if samples.count else (math.nan, math.nan)
    return {
        "count": samples.count,
        "mean": samples.mean,
        "median": samples.quantile(0.5),
        "percentile_95": samples.quantile(0.95),
        "least": low,
        "most": high,
    }
