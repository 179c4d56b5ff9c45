"""The values that the paper prints, for its own instances: printed beside ours, never compared in size.

Source: HIPPO-MAT, tables on the cost of fixed and of continuous allocation, success rate and allocation time.
"""

from __future__ import annotations

FIXED_COST, FIXED_SUCCESS, FIXED_TIME = "fixed_cost", "fixed_success", "fixed_time"
CONTINUOUS_COST, CONTINUOUS_SUCCESS = "continuous_cost", "continuous_success"

OURS = "HIPPO-MAT"  # what the paper calls its own arm

_TABLES: dict[str, tuple[tuple[int, ...], dict[str, tuple[float, ...]]]] = {
    FIXED_COST: (
        (4, 8, 12, 20),
        {
            "Hungarian": (20.3, 60.3, 131.9, 254.3),
            OURS: (20.3, 62.1, 138.2, 327.4),
            "MAPPO+GCN": (20.3, 61.2, 134.7, 321.5),
            "IPSO-G": (22.5, 65.8, 140.5, 383.2),
            "Random": (27.9, 72.3, 175.7, 423.8),
        },
    ),
    CONTINUOUS_COST: (
        (5, 10, 20, 30),
        {
            "Hungarian": (281.58, 560.3, 1931.16, 4524.3),
            OURS: (295.58, 612.1, 2236.2, 6212.4),
            "MAPPO+GCN": (295.3, 638.4, 2342.0, 6701.2),
            "IPSO-G": (302.3, 667.2, 2445.0, 7201.1),
            "Random": (484.4, 736.5, 3282.3, 9453.2),
        },
    ),
    FIXED_SUCCESS: (
        (5, 10, 20, 30),
        {
            "Hungarian": (100, 100, 100, 100),
            OURS: (100, 100, 90, 80),
            "MAPPO+GCN": (100, 90, 70, 70),
            "IPSO-G": (90, 80, 80, 60),
        },
    ),
    FIXED_TIME: (
        (5, 10, 20, 30),
        {
            "Hungarian": (0.8, 1.5, 2.8, 5.6),
            OURS: (0.2, 0.2, 0.4, 0.5),
            "MAPPO+GCN": (0.4, 0.6, 1.5, 3.2),
            "IPSO-G": (0.3, 0.3, 0.5, 1.2),
        },
    ),
    CONTINUOUS_SUCCESS: (
        (5, 10, 20, 30),
        {
            "Hungarian": (100, 100, 100, 100),
            OURS: (100, 100, 90, 80),
            "MAPPO+GCN": (60, 60, 50, 50),
            "IPSO-G": (80, 80, 70, 60),
        },
    ),
}


_METHODS = {  # [fleet] allocator -> the paper's name of the method
    "graphsage": OURS,
    "paper_network": OURS,
    "hungarian": "Hungarian",
    "ipso_g": "IPSO-G",
    "random": "Random",
}


def method_of(allocator: str) -> str:
    """What the paper calls it; empty where it does not have it."""
    return _METHODS.get(allocator, "")


def sizes(table: str) -> tuple[int, ...]:
    """Numbers of agents that a table has."""
    return _TABLES[table][0]


def paper_value(table: str, method: str, agents: int) -> float | None:
    """None where the paper says nothing. Costs and times in s (its cost has no stated unit), success in %."""
    sizes, methods = _TABLES[table]
    if method not in methods or agents not in sizes:
        return None
    return float(methods[method][sizes.index(agents)])
