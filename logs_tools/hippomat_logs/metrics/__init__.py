"""What a fleet achieved, from the logs alone: tasks, travel cost, conflicts, times, links, load.

`run_metrics(paths)` of a fleet's logs; `MetricsReading` takes the same records from memory. docs/metrics.md
defines every figure.
"""

from hippomat_logs.definitions import Task
from hippomat_logs.metrics.fleet import FleetMetrics, clocks_of, fleet_metrics, robot_metrics, run_metrics
from hippomat_logs.metrics.latency import LatencyMetrics
from hippomat_logs.metrics.links import LinkMetrics
from hippomat_logs.metrics.machines import ComputerMetrics
from hippomat_logs.metrics.robot import KINDS, Completed, MetricsReading, RobotMetrics
from hippomat_logs.metrics.samples import Samples, quantiles

__all__ = [
    "KINDS",
    "Completed",
    "ComputerMetrics",
    "FleetMetrics",
    "LatencyMetrics",
    "LinkMetrics",
    "MetricsReading",
    "RobotMetrics",
    "Samples",
    "Task",
    "clocks_of",
    "fleet_metrics",
    "quantiles",
    "robot_metrics",
    "run_metrics",
]
