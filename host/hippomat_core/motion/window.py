"""Our planner: everyone's next moves in a window, one robot after the other, those who fail first.

Windowed prioritised space-time planning (Silver 2005), with two differences that make it live: a robot that
finds no path moves to the front of the line and the window starts anew; and who has had its goal longest is
first in line to begin with. Plans are kept for half a window; where a robot gets a new goal meanwhile, only its
own path is searched again. Knows what it is told in the Scene, nothing of radios.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hippomat_core.motion.reservations import table_size
from hippomat_core.motion.scene import Plan, Scene, first_in_line
from hippomat_core.motion.window_kernels import Fleet, Search, Table, Ways, plan_fleet, search_memory


class WindowPlanner:
    """`moves` of the slowest robot are planned ahead, and again after `kept_moves`.

    Keeps working memory between calls, and nothing that a result depends on.
    """

    name = "window"

    def __init__(self, moves: int = 8, kept_moves: int = 4) -> None:
        self._moves, self._kept_moves = moves, kept_moves
        self._memory: dict[tuple[int, int, int], tuple[Table, Search]] = {}

    def plan(self, scene: Scene, before: Plan | None) -> Plan:
        """See scene.MotionPlanner."""
        slowest = int(scene.ticks.max())
        if before is not None and _on_plan(scene, before, self._kept_moves * slowest):
            renewed = scene.goal != before.goal
            if not renewed.any():
                return before
            target = before.target.copy()
            if not self._fill(scene, target, scene.tick - before.tick, ~renewed):
                return Plan(before.tick, target, scene.goal.copy())
        target = np.repeat(scene.node[:, None], self._moves * slowest, axis=1)
        self._fill(scene, target, 0, np.zeros(len(scene.node), np.bool_))
        return Plan(scene.tick, target, scene.goal.copy())

    def _fill(
        self, scene: Scene, target: NDArray[np.int32], begin: int, kept: NDArray[np.bool_]
    ) -> int:
        graph = scene.graph
        ways = Ways(graph.neighbours, graph.middles, graph.places, graph.place_count)
        fleet = Fleet(
            scene.node, scene.ready, scene.leaving, scene.ticks, scene.goal_field, scene.fields
        )
        table, search = self._working_memory(len(scene.node), target.shape[1], int(scene.ticks.max()))
        return int(plan_fleet(ways, fleet, first_in_line(scene), begin, target, kept, table, search))

    def _working_memory(self, robots: int, window: int, slowest: int) -> tuple[Table, Search]:
        key = robots, window, slowest
        if key not in self._memory:
            size = table_size(robots, window + 2 * slowest)
            table = Table(np.zeros(size, np.int64), np.zeros(size, np.int32))
            self._memory = {key: (table, search_memory(window, slowest))}
        return self._memory[key]


def _on_plan(scene: Scene, before: Plan, kept_ticks: int) -> bool:
    """Whether the plan is young enough and every robot is where it said."""
    passed = scene.tick - before.tick
    if len(before.goal) != len(scene.goal) or not 0 <= passed < kept_ticks:
        return False
    return passed == 0 or bool((before.target[:, passed - 1] == scene.node).all())
