"""What our allocation has to achieve, and whether it did. A goal is judged only where enough was measured.

The others are listed all the same, with the reason. A goal is judged by the value, not by its interval, but
where `upper end` is said: "at least as good" is missed when the interval lies below zero as a whole.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from hippomat_sim.bench import tables_cells as kinds
from hippomat_sim.bench.tables_layout import Book
from hippomat_sim.bench.tables_stats import NOTHING, Estimate

ENOUGH_EPISODES = 300

OURS, LEARNED_PART, LOOKING_AHEAD = "graphsage", "graphsage_no_head", "graphsage_look_ahead"
# N: least CF1 [%], largest gap [%]
FIXED = {5: (99.5, 0.5), 10: (99.0, 0.5), 20: (98.0, 1.0), 30: (97.0, 2.0)}
FIXED_LEARNED = {5: (99.0, 9.0), 10: (94.0, 13.0), 20: (90.0, 15.0), 30: (87.0, 18.0)}
LEAST_CF = 99.5
MOST_AGENT_S_OVER, MOST_LOOKING_AHEAD = 1.0, -3.0  # % above myopic Hungarian
RELAYED = {(0.3, 10): 99.5, (0.3, 20): 99.5, (0.3, 30): 99.5, (0.5, 10): 94.0, (0.5, 30): 99.0}
DECISION_AGENTS, MOST_DECISION_MS = 30, 1.5
MOST_TRAINING_MIN, LEAST_LEARNED_PER_S, LEAST_ENV_STEPS_PER_S = 15.0, 50_000.0, 250_000.0


@dataclass(frozen=True, slots=True)
class Goal:
    """A value that must not be below (at_least) or above its bound."""

    name: str
    value: float
    bound: float
    at_least: bool
    unit: str
    not_judged: str = ""  # empty: it is judged

    @property
    def met(self) -> bool:
        """A value that could not be measured (NaN) meets nothing."""
        return self.value >= self.bound if self.at_least else self.value <= self.bound

    @property
    def missed(self) -> bool:
        return not self.not_judged and not self.met


def goals_of(book: Book, episodes: int, manifest: Mapping[str, Any]) -> list[Goal]:
    """The same ones for every run, judged or not. manifest: training and metrics of our policy's file."""
    judge = _Judge(book, episodes)
    allocation = (*_fixed(judge), *_continuous(judge), *_under_loss(judge))
    return [*allocation, judge.decision_time(), *_training(manifest)]


def _training(manifest: Mapping[str, Any]) -> Iterator[Goal]:
    """From what the policy's file says of its own training, wherever that was."""
    metrics, settings = manifest.get("metrics", {}), manifest.get("training", {})
    try:
        spent_s = metrics["collect_s"] + metrics["learn_s"]
        learned = metrics["agent_steps"] * settings["ppo"]["epochs"] / metrics["learn_s"]
        reason = ""
    except (KeyError, TypeError, ZeroDivisionError):
        spent_s = learned = float("nan")
        reason = "not measured"
    yield Goal("training of our policy", spent_s / 60.0, MOST_TRAINING_MIN, False, "min", reason)
    name = "learner, agent-steps of every pass over a batch"
    yield Goal(name, learned, LEAST_LEARNED_PER_S, True, "1/s", reason)
    reason = "printed by `make bench`"
    yield Goal("environment, N = M = 30", float("nan"), LEAST_ENV_STEPS_PER_S, True, "1/s", reason)


def verdict(goals: list[Goal]) -> str:
    """How many were met, and which were missed."""
    judged = [goal for goal in goals if not goal.not_judged]
    missed = "; ".join(goal.name for goal in judged if goal.missed)
    said = f"missed: {missed}" if missed else f"all {len(judged)} judged goals met"
    return f"{said}; not judged: {len(goals) - len(judged)}" if len(goals) > len(judged) else said


@dataclass(frozen=True, slots=True)
class _Judge:
    book: Book
    episodes: int

    def goal(
        self,
        name: str,
        where: tuple[str, str, str, int, int],
        bound: float,
        at_least: bool,
        unit: str = "%",
        loss: float = 0.0,
        relay: bool = True,
        upper_end: bool = False,
    ) -> Goal:
        """where: kind, metric, method, N, M of the figure."""
        kind, _, method, agents, tasks = where
        found: Estimate = self.book.find(*where, loss=loss, relay=relay) or NOTHING
        reason = ""
        if found is NOTHING:
            waits = (kind, method, agents, tasks) in self.book.untrained
            reason = "not trained" if waits else "not measured"
        elif self.episodes < ENOUGH_EPISODES:
            reason = f"fewer than {ENOUGH_EPISODES} episodes"
        return Goal(name, found.high if upper_end else found.value, bound, at_least, unit, reason)

    def decision_time(self) -> Goal:
        size = DECISION_AGENTS
        name = f"one decision at N = M = {size}, median"
        where = (kinds.TIME, "decision", OURS, size, size)
        return self.goal(name, where, MOST_DECISION_MS, False, "ms")


def _fixed(judge: _Judge) -> Iterator[Goal]:
    for method, said, bounds in (
        (OURS, "ours", FIXED),
        (LEARNED_PART, "learned part alone", FIXED_LEARNED),
    ):
        for size, (least_cf1, most_gap) in bounds.items():
            name = f"fixed, {said}, N = M = {size}"
            yield judge.goal(f"{name}: CF1", (kinds.ONE_SHOT, "cf1", method, size, size), least_cf1, True)
            yield judge.goal(f"{name}: gap", (kinds.ONE_SHOT, "gap", method, size, size), most_gap, False)


def _continuous(judge: _Judge) -> Iterator[Goal]:
    tasks, kind = kinds.CONTINUOUS_TASKS, kinds.CONTINUOUS
    for size in kinds.AGENTS:
        name = f"continuous, N = {size}"
        yield judge.goal(f"{name}: CF", (kind, "cf", OURS, size, tasks), LEAST_CF, True)
        where = (kind, "cf", LOOKING_AHEAD, size, tasks)
        yield judge.goal(f"{name}, looking ahead: CF", where, LEAST_CF, True)
        where = (kind, "agent_s_over", OURS, size, tasks)
        yield judge.goal(f"{name}: agent-seconds above Hungarian", where, MOST_AGENT_S_OVER, False)
    for size in kinds.AGENTS[1:]:
        where = (kind, "agent_s_over", LOOKING_AHEAD, size, tasks)
        name = f"continuous, N = {size}, looking ahead: agent-seconds above Hungarian"
        yield judge.goal(name, where, MOST_LOOKING_AHEAD, False)


def _under_loss(judge: _Judge) -> Iterator[Goal]:
    for (loss, size), least in RELAYED.items():
        name = f"loss {loss:.0%} with relay, N = M = {size}: CF1"
        yield judge.goal(name, (kinds.LOSS, "cf1", OURS, size, size), least, True, loss=loss)
    for size in kinds.LOSS_AGENTS:
        for loss in kinds.LOSSES[1:]:
            yield judge.goal(
                f"loss {loss:.0%} without relay, N = M = {size}: CF1 above Hungarian's, upper end",
                (kinds.LOSS, "cf1_over", OURS, size, size),
                0.0,
                True,
                "points",
                loss,
                relay=False,
                upper_end=True,
            )
