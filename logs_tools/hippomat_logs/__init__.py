"""The run log: recorder, recovery, reader, replay and metrics (MCAP, ROS 2 profile).

from hippomat_logs import open_run
run = open_run("runs/robot03_...")          # ours, or any .mcap, .bag, ROS 2 bag
run["/odom"]["pose.pose.position.x"]        # NumPy; run["/odom"].to_pandas()
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from hippomat_logs.column_table import Table
    from hippomat_logs.opened_run import OpenedRun, group_runs, open_run

__all__ = ["OpenedRun", "Table", "group_runs", "open_run"]


def __getattr__(name: str) -> Any:
    """Loaded when first asked for: the daemon imports this package and needs no reader."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from hippomat_logs import opened_run

    return getattr(opened_run, name)
