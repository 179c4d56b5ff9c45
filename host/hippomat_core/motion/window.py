"""Our planner: everyone's next moves in a window, one robot after the other, those who fail first.

Windowed prioritised space-time planning (Silver 2005), with two differences that make it live: a robot that
finds no path moves to the front of the line and the window starts anew; and who has had its goal longest is
first in line to begin with. Plans are kept for half a window; where a robot gets a new goal meanwhile, only
its own path is searched again. Knows what it is told in the Scene, nothing of radios.

In a crowd so dense that the line has started anew twice per robot in vain, whoever found no path stays where
it is, and later moves of others may lead through it (`whole` is False then): a plan is a wish, and only moves
that are committed are driven (commitment.py).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hippomat_core.motion.reservations import table_size
from hippomat_core.motion.scene import Plan, Scene, fleet_of, ways_of
from hippomat_core.motion.search import Search, Table, search_memory
from hippomat_core.motion.window_kernels import plan_fleet, renewed


class WindowPlanner:
    """`moves` of the slowest robot are planned ahead, and again after `kept_moves`.

    Keeps working memory between calls, and nothing that a result depends on.
    """

    name = "window"

    def __init__(self, moves: int = 8, kept_moves: int = 4) -> None:
        self._moves, self._kept_moves = moves, kept_moves
        self._memory: dict[tuple[int, int, int], tuple[Table, Search]] = {}
        self._reserved: Plan | None = None  # whose reservations are in the table

    @property
    def whole(self) -> bool:
        """Whether every robot found a path in the last plan that was made: then no two of it meet."""
        return self._reserved is not None

    def plan(self, scene: Scene, before: Plan | None) -> Plan:
        """See scene.MotionPlanner."""
        count, slowest = len(scene.node), int(scene.ticks.max())
        passed = -1 if before is None else scene.tick - before.tick
        if before is not None and 0 <= passed < self._kept_moves * slowest and len(before.goal) == count:
            kept = np.empty(count, np.bool_)
            changed = renewed(before.target, passed, scene.node, before.goal, scene.goal, kept)
            if changed == 0:
                return before
            if changed > 0:
                target = before.target.copy()
                if self._fill(scene, target, passed, kept, before is self._reserved):
                    self._reserved = Plan(before.tick, target, scene.goal.copy())
                    return self._reserved
        target = np.repeat(scene.node[:, None], self._moves * slowest, axis=1)
        plan = Plan(scene.tick, target, scene.goal.copy())
        # Where a robot found no path the table depends on the order in which it was filled: not kept.
        self._reserved = plan if self._fill(scene, target, 0, np.zeros(count, np.bool_), False) else None
        return plan

    def _fill(
        self, scene: Scene, target: NDArray[np.int32], begin: int, kept: NDArray[np.bool_], reserved: bool
    ) -> bool:
        """Whether every robot that is not kept has found a path; target (N, W) has them."""
        self._reserved = None
        table, search = self._working_memory(len(scene.node), target.shape[1], int(scene.ticks.max()))
        ways, fleet = ways_of(scene.graph), fleet_of(scene)
        return not plan_fleet(ways, fleet, begin, target, kept, reserved, table, search)

    def _working_memory(self, robots: int, window: int, slowest: int) -> tuple[Table, Search]:
        key = robots, window, slowest
        if key not in self._memory:
            size = table_size(robots, window + 2 * slowest)
            table = Table(np.zeros(size, np.int64), np.zeros(size, np.int32))
            self._memory = {key: (table, search_memory(window, slowest))}
        return self._memory[key]
