"""Groups of trials compared: means with intervals, and differences to a baseline on the same instances.

Trials pair where seed, number of robots, task slots and map are the same. Knows figures, not logs.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from hippomat_core.errors import HippomatError
from hippomat_logs.metrics.intervals import Interval, mean_interval

Figures = Mapping[str, float]  # key -> value, nan: none


@dataclass(frozen=True, slots=True)
class Trial:
    """What one trial's logs gave. error: why they gave nothing. notes: what to mind of the figures."""

    name: str
    facts: tuple[str, ...]  # in the order of --by
    pairing: tuple[str, ...]  # equal: the same instance
    figures: Figures = field(default_factory=dict)
    error: str = ""
    notes: tuple[str, ...] = ()
    whole: bool = True  # none of its logs lacks anything


@dataclass(frozen=True, slots=True)
class Group:
    """Trials with the same facts. pairs: with the baseline's trials on the same instances, if any."""

    facts: tuple[str, ...]
    trials: tuple[Trial, ...]
    pairs: tuple[tuple[Figures, Figures], ...] = ()
    is_baseline: bool = False

    def interval(self, key: str) -> Interval:
        return mean_interval([trial.figures[key] for trial in self.trials])

    def difference(self, key: str) -> Interval:
        """Ours minus the baseline's."""
        return mean_interval([ours[key] - theirs[key] for ours, theirs in self.pairs])


def compare(trials: Sequence[Trial], baseline: str = "") -> list[Group]:
    """Groups in the order of their first trials. baseline: the first fact of those that are compared with."""
    by_facts: dict[tuple[str, ...], list[Trial]] = {}
    for trial in trials:
        by_facts.setdefault(trial.facts, []).append(trial)
    names = sorted({facts[0] for facts in by_facts if facts})
    if baseline and baseline not in names:
        raise HippomatError(f"--baseline {baseline}: no trial is that; there are {', '.join(names)}")
    groups = []
    for facts, members in by_facts.items():
        is_baseline = bool(baseline) and facts[0] == baseline
        theirs = by_facts.get((baseline, *facts[1:]), []) if baseline and not is_baseline else []
        groups.append(Group(facts, tuple(members), tuple(_pairs(members, theirs)), is_baseline))
    return groups


def _pairs(ours: Sequence[Trial], theirs: Sequence[Trial]) -> list[tuple[Figures, Figures]]:
    """One for each instance that both have; several trials of one instance count by their mean."""
    mine, other = _by_instance(ours), _by_instance(theirs)
    return [(_mean(mine[instance]), _mean(other[instance])) for instance in mine if instance in other]


def _by_instance(trials: Sequence[Trial]) -> dict[tuple[str, ...], list[Figures]]:
    found: dict[tuple[str, ...], list[Figures]] = {}
    for trial in trials:
        found.setdefault(trial.pairing, []).append(trial.figures)
    return found


def _mean(figures: Sequence[Figures]) -> Figures:
    return {key: float(np.mean([one[key] for one in figures])) for key in figures[0]}
