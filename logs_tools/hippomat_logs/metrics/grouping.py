"""Which runs are one trial, by their times, directories and manifests alone.

A trial is what one fleet did at one time: runs of one fleet id that overlap in time by at least half of the
shorter one, and in which no robot is twice at the same time. Logs in one directory are put together first,
so that trials that were simulated side by side stay apart. Clocks may be years off: runs of different robots
that fit in all but their time are one trial where they leave no choice. A fused file is one trial: whoever
fused it said so.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from hippomat_logs.reader import Run, open_again

MIN_OVERLAP = 0.5


@dataclass(frozen=True, slots=True)
class LoggedRun:
    """One robot's run as the indexes of its parts tell it."""

    paths: tuple[Path, ...]
    manifest: dict[str, str]
    begun_ns: int
    ended_ns: int
    inside: str = ""  # of a fused file: which of its runs, as Run.inside

    def open(self) -> Run:
        """To be read, in whatever process; every checksum is checked."""
        return open_again(self.paths, self.inside)

    @property
    def robot(self) -> int:
        """Its id; -1: an observer."""
        return int(self.manifest.get("robot", "-1"))

    @property
    def directory(self) -> Path:
        return self.paths[0].parent


def by_fused_file(runs: Sequence[LoggedRun]) -> list[list[LoggedRun]]:
    groups: dict[Path, list[LoggedRun]] = {}
    for run in runs:
        if run.inside:
            groups.setdefault(run.paths[0], []).append(run)
    return list(groups.values())


def by_directory(runs: Sequence[LoggedRun], paths: Sequence[Path]) -> list[list[LoggedRun]]:
    """Every directory directly in one of `paths` is a trial, and so are the logs that lie in that itself."""
    tops = [path.resolve() for path in paths if path.is_dir()]
    groups: dict[Path, list[LoggedRun]] = {}
    for run in runs:
        place = run.directory.resolve()
        top = max(
            (top for top in tops if place.is_relative_to(top)), key=lambda t: len(t.parts), default=place
        )
        below = place.relative_to(top).parts
        groups.setdefault(top / below[0] if below else top, []).append(run)
    return list(groups.values())


def by_time(runs: Sequence[LoggedRun], root: Path) -> list[list[LoggedRun]]:
    """From the deepest directory up: what is there is put together, and goes on to its parent."""
    waiting: dict[Path, list[list[LoggedRun]]] = {}
    for run in runs:
        waiting.setdefault(run.directory.resolve(), []).append([run])
    while waiting:
        deepest = max(waiting, key=lambda path: len(path.parts))
        groups = _put_together(waiting.pop(deepest))
        if deepest == root or deepest == deepest.parent:
            if not waiting:
                return groups
            waiting.setdefault(root, []).extend(groups)
        else:
            waiting.setdefault(deepest.parent, []).extend(groups)
    return []


def _put_together(groups: list[list[LoggedRun]]) -> list[list[LoggedRun]]:
    """Longest first, each joins the group that it overlaps most, where it may."""
    made: list[list[LoggedRun]] = []
    for group in sorted(groups, key=lambda one: (-_length_ns(one), one[0].paths)):
        fitting = [other for other in made if _are_one(other, group)]
        if fitting:
            max(fitting, key=lambda other: _overlap_ns(other, group)).extend(group)
        else:
            made.append(list(group))
    return _whatever_the_time(made)


def _whatever_the_time(groups: list[list[LoggedRun]]) -> list[list[LoggedRun]]:
    """Groups that lack robots are put together whatever their clocks say, where that can be done in one way.

    It can where no robot is there twice, the fleet's size has room for all, and they took equally long.
    """
    kinds: dict[str, list[list[LoggedRun]]] = {}
    for group in groups:
        kinds.setdefault(_kind(group[0].manifest), []).append(group)
    made: list[list[LoggedRun]] = []
    for kind, alike in kinds.items():
        robots = [robot for group in alike for robot in {run.robot for run in group if run.robot >= 0}]
        lengths_ns = [_length_ns(group) for group in alike]
        one = kind and len(set(robots)) == len(robots) <= _fleet_size(alike[0][0].manifest)
        if one and min(lengths_ns) >= MIN_OVERLAP * max(lengths_ns):
            made.append([run for group in alike for run in group])
        else:
            made += alike
    return made


def _kind(manifest: dict[str, str]) -> str:
    """Equal for the robots of one trial; empty where the manifest has no settings."""
    if "config" not in manifest:
        return ""
    fleet = json.loads(manifest["config"]).get("fleet", {})
    return json.dumps([manifest.get("fleet"), manifest.get("map_hash"), fleet], sort_keys=True)


def _fleet_size(manifest: dict[str, str]) -> int:
    return int(json.loads(manifest["config"]).get("fleet", {}).get("size", 0))


def _are_one(group: Sequence[LoggedRun], other: Sequence[LoggedRun]) -> bool:
    if group[0].manifest.get("fleet") != other[0].manifest.get("fleet"):
        return False
    if not (hang_together(group) and hang_together(other)):
        return False
    shorter_ns = min(_length_ns(group), _length_ns(other))
    if _overlap_ns(group, other) < max(1, MIN_OVERLAP * shorter_ns):
        return False
    return not any(a.robot == b.robot and _overlap_ns([a], [b]) > 0 for a in group for b in other)


def hang_together(group: Sequence[LoggedRun]) -> bool:
    """False: its clocks are so far apart that the time between says nothing."""
    spans = sorted((run.begun_ns, run.ended_ns) for run in group)
    return all(begun <= max(end for _, end in spans[:k]) for k, (begun, _) in enumerate(spans) if k)


def span_ns(group: Sequence[LoggedRun]) -> tuple[int, int]:
    return min(run.begun_ns for run in group), max(run.ended_ns for run in group)


def _length_ns(group: Sequence[LoggedRun]) -> int:
    begun_ns, ended_ns = span_ns(group)
    return ended_ns - begun_ns


def _overlap_ns(group: Sequence[LoggedRun], other: Sequence[LoggedRun]) -> int:
    (begun_ns, ended_ns), (also_begun_ns, also_ended_ns) = span_ns(group), span_ns(other)
    return min(ended_ns, also_ended_ns) - max(begun_ns, also_begun_ns)
