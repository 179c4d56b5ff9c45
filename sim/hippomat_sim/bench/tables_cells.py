"""Which measurements the tables need. A cell is one method in one setting; it is measured once and stored.

Knows what is to be measured, not how.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from hippomat_sim.learn.method_registry import METHODS

ONE_SHOT, CONTINUOUS, LOSS, LOSS_CONTINUOUS = "one_shot", "continuous", "loss", "loss_continuous"
PERMUTED, TIME = "permuted", "time"

PARTS = ("fixed", "continuous", "loss", "generalise", "permuted", "time")  # of --only
PAPER_COST_AGENTS = (4, 8, 12, 20)
AGENTS = (5, 10, 20, 30)
LOSS_AGENTS = (10, 20, 30)
LOSSES = (0.0, 0.1, 0.2, 0.3, 0.4, 0.5)
CONTINUOUS_LOSSES = (0.3, 0.5)
LARGE = ((50, 50), (50, 60))  # agents, tasks
CONTINUOUS_TASKS = 30  # the paper's number of active tasks
# Copies of the continuous mode are this many times --episodes / N: with that many alone the interval of
# agent-seconds is +-0.8 % at N = 10, where a goal is 1 %.
MORE_COPIES = 6

UNDER_LOSS = ("hungarian", "greedy", "nearest", "graphsage")
UNDER_LOSS_CONTINUOUS = ("hungarian", "look_ahead", "graphsage", "graphsage_look_ahead")
PERMUTED_SLOTS = ("hungarian", "nearest", "fixed_slot", "graphsage", "paper", "mappo_gcn", "no_neighbours")
REFERENCE = "hungarian"  # what the others are compared with; measured wherever anything is
OPTIMUM = "optimum"  # the cheapest assignment by exact path times: what gaps are counted from


@dataclass(frozen=True, slots=True)
class Cell:
    """One measurement. count: instances, or copies of the environment."""

    kind: str
    method: str
    agents: int
    tasks: int
    count: int
    loss: float = 0.0
    relay: bool = True

    @property
    def about(self) -> str:
        """For a progress bar."""
        lost = f", loss {self.loss:.0%}{'' if self.relay else ' without relay'}" if self.loss else ""
        return f"{self.kind.replace('_', ' ')}: {self.method} {self.agents} x {self.tasks}{lost}"


@dataclass(frozen=True, slots=True)
class Plan:
    """What was asked for on the command line."""

    methods: tuple[str, ...] = tuple(METHODS)
    agents: tuple[int, ...] = ()  # empty: each table has its own
    episodes: int = 1000
    seed: int = 0
    loss: float | None = None  # this loss alone instead of 0 to 50 %
    parts: tuple[str, ...] = PARTS

    def sizes(self, usual: tuple[int, ...]) -> tuple[int, ...]:
        """Numbers of agents of a table that usually has these."""
        return self.agents or usual

    @property
    def losses(self) -> tuple[float, ...]:
        return LOSSES if self.loss is None else tuple(sorted({0.0, self.loss}))

    def cells(self) -> list[Cell]:
        """Every cell once, in the order of the parts; those that are timed come last, to run alone."""
        makers = {
            "fixed": self._fixed,
            "continuous": self._continuous,
            "loss": self._loss,
            "generalise": self._large,
            "permuted": self._permuted,
            "time": self._time,
        }
        found = dict.fromkeys(cell for part in PARTS if part in self.parts for cell in makers[part]())
        return sorted(found, key=lambda cell: cell.kind == TIME)

    def _named(self, among: tuple[str, ...] = tuple(METHODS)) -> tuple[str, ...]:
        return tuple(name for name in METHODS if name in among and name in (REFERENCE, *self.methods))

    def _instances(self, method: str) -> int:
        return max(2, round(self.episodes * METHODS[method].share))

    def _copies(self, method: str, agents: int, times: int = 1) -> int:
        """As many agent-steps for every size."""
        return max(2, round(times * self.episodes * METHODS[method].share / agents))

    def _one_shot(self, agents: int, tasks: int) -> Iterator[Cell]:
        yield Cell(ONE_SHOT, OPTIMUM, agents, tasks, self.episodes)
        for name in self._named():
            if METHODS[name].one_shot:
                yield Cell(ONE_SHOT, name, agents, tasks, self._instances(name))

    def _fixed(self) -> Iterator[Cell]:
        for agents in sorted({*self.sizes(PAPER_COST_AGENTS), *self.sizes(AGENTS)}):
            yield from self._one_shot(agents, agents)

    def _large(self) -> Iterator[Cell]:
        for agents, tasks in LARGE if not self.agents else ():
            for cell in self._one_shot(agents, tasks):
                if cell.method == OPTIMUM or METHODS[cell.method].any_size:
                    yield cell

    def _continuous(self) -> Iterator[Cell]:
        for agents in self.sizes(AGENTS):
            for name in (name for name in self._named() if METHODS[name].continuous):
                times = 1 if METHODS[name].share < 1.0 else MORE_COPIES
                yield Cell(CONTINUOUS, name, agents, CONTINUOUS_TASKS, self._copies(name, agents, times))

    def _loss(self) -> Iterator[Cell]:
        for agents in self.sizes(LOSS_AGENTS):
            for loss in self.losses:
                for relay in (True, False) if loss else (True,):
                    # Without relay every robot holds another view, and each is decided on by itself.
                    count = self.episodes if relay else max(2, round(6 * self.episodes / agents))
                    for name in self._named(UNDER_LOSS):
                        yield Cell(LOSS, name, agents, agents, count, loss, relay)
            for loss in CONTINUOUS_LOSSES if self.loss is None else (self.loss,):
                for relay in (True, False):
                    for name in self._named(UNDER_LOSS_CONTINUOUS):
                        copies = max(2, round(self._copies(name, agents) / 4))
                        yield Cell(LOSS_CONTINUOUS, name, agents, CONTINUOUS_TASKS, copies, loss, relay)

    def _permuted(self) -> Iterator[Cell]:
        count = max(2, self.episodes // 5)
        for agents in self.sizes(AGENTS):
            for tasks in dict.fromkeys((agents, CONTINUOUS_TASKS)):
                for name in self._named(PERMUTED_SLOTS):
                    yield Cell(PERMUTED, name, agents, tasks, count)

    def _time(self) -> Iterator[Cell]:
        for agents in self.sizes(AGENTS):
            for name in self._named():
                yield Cell(TIME, name, agents, agents, max(2, min(200, self.episodes)))
