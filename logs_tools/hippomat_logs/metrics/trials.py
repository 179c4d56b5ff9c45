"""Which logs are one trial, and what its manifests say of it: found by indexes alone, whatever lies where.

A trial is what one fleet did at one time: runs of one fleet id that overlap in time by at least half of the
shorter one, and in which no robot is twice at the same time. Logs in one directory are put together first,
so that trials that were simulated side by side stay apart. Clocks may be years off: runs of different robots
that fit in all but their time are one trial where they leave no choice. A fused file is one trial: whoever
fused it said so. Knows no figures.
"""

from __future__ import annotations

import json
import os
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

from hippomat_core.errors import HippomatError, LogError
from hippomat_logs.opened_run import OpenedRun, group_opened, log_files
from hippomat_logs.reader import Run, open_again
from hippomat_logs.sources import FusedSource, Source, opened_sources

MIN_OVERLAP = 0.5
BY_TIME, BY_DIRECTORY = "time", "dir"
_CONFIG_NAMES = {
    "method": "fleet.allocator",
    "allocator": "fleet.allocator",
    "tasks": "fleet.task_slots",
    "seed": "fleet.seed",
    "turnover": "fleet.turnover",
    "planner": "planning.planner",
}
_OWN_NAMES = ("robots", "policy", "map", "dir", "trial")
UNKNOWN = "?"


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


@dataclass(frozen=True, slots=True)
class TrialFiles:
    """The runs of one trial. directory: the lowest that holds all; root: that of all trials."""

    runs: tuple[LoggedRun, ...]
    directory: Path
    root: Path
    name: str

    @property
    def size(self) -> int:
        """Bytes of all its files."""
        paths = {path for run in self.runs for path in run.paths}
        return sum(path.stat().st_size for path in paths)

    @property
    def robots(self) -> int:
        """How many recorded; observers do not count."""
        return len({run.robot for run in self.runs if run.robot >= 0})

    def fact(self, key: str) -> str:
        """What --by KEY is here; robots that do not agree are joined by "/". Raises HippomatError by name."""
        if key == "robots":
            return str(self.robots)
        if key == "trial":
            return self.name
        if key == "dir":
            below = Path(os.path.relpath(self.directory, self.root)).parts
            return below[0] if below else self.root.name
        found = {_fact_of(run.manifest, key) for run in self.runs}
        return "/".join(sorted(found))

    @property
    def pairing(self) -> tuple[str, ...]:
        """Trials that are equal in this differ by the method alone: seed, robots, tasks, map."""
        return tuple(self.fact(key) for key in ("seed", "robots", "tasks", "manifest.map_hash"))


@dataclass(frozen=True, slots=True)
class Found:
    """Trials by name, and a line for every file that is none of ours or cannot be opened."""

    trials: list[TrialFiles]
    foreign: list[str]
    damaged: list[str]


def find_trials(paths: Sequence[Path], by: str = BY_TIME) -> Found:
    """All trials in these logs and directories; reads indexes only."""
    files = dict.fromkeys(file for path in paths for file in log_files(path))
    sources: list[Source] = []
    damaged: list[str] = []
    foreign: list[str] = []
    for file in files:
        try:
            sources += opened_sources(file)
        except LogError as error:
            damaged.append(str(error))
        except HippomatError as error:
            foreign.append(str(error))
    opened = group_opened(sources)
    runs = [_logged(one) for one in opened if one.manifest]
    foreign += [f"{one.sources[0].path}: not a robot's log of ours" for one in opened if not one.manifest]
    root = _root(paths)
    fused = _by_fused_file(runs)
    own = [run for run in runs if not run.inside]
    groups = _by_directory(own, paths) if by == BY_DIRECTORY else _by_time(own, root)
    return Found(_named([*groups, *fused], root), foreign, damaged)


def _named(groups: list[list[LoggedRun]], root: Path) -> list[TrialFiles]:
    """By the directory that holds a trial, and the time of its start where that holds several.

    By its file where it is fused.
    """
    found: list[TrialFiles] = []
    groups.sort(key=lambda group: (_common_directory(group), _span_ns(group)))
    places = Counter(_common_directory(group) for group in groups if not group[0].inside)
    for group in groups:
        place = _common_directory(group)
        below = os.path.relpath(place, root)
        name = root.name if below == "." else below
        if group[0].inside:
            name = os.path.relpath(group[0].paths[0].resolve().with_suffix(""), root)
        elif places[place] > 1:
            begun = datetime.fromtimestamp(_span_ns(group)[0] / 1e9, timezone.utc)
            name += f" {begun:%Y-%m-%dT%H:%M:%SZ}"
        runs = tuple(sorted(group, key=lambda run: (run.robot, run.begun_ns)))
        found.append(TrialFiles(runs, place, root, name))
    return found


def _logged(opened: OpenedRun) -> LoggedRun:
    begun_ns, ended_ns = opened.span_ns
    first = opened.sources[0]
    inside = first.inside if isinstance(first, FusedSource) else ""
    return LoggedRun(tuple(one.path for one in opened.sources), opened.manifest, begun_ns, ended_ns, inside)


def _root(paths: Sequence[Path]) -> Path:
    folders = [path if path.is_dir() else path.parent for path in (path.resolve() for path in paths)]
    return Path(os.path.commonpath(folders)) if folders else Path()


def _common_directory(runs: Sequence[LoggedRun]) -> Path:
    return Path(os.path.commonpath([run.directory.resolve() for run in runs]))


# ---- which runs are one trial ----


def _by_fused_file(runs: Sequence[LoggedRun]) -> list[list[LoggedRun]]:
    groups: dict[Path, list[LoggedRun]] = {}
    for run in runs:
        if run.inside:
            groups.setdefault(run.paths[0], []).append(run)
    return list(groups.values())


def _by_directory(runs: Sequence[LoggedRun], paths: Sequence[Path]) -> list[list[LoggedRun]]:
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


def _by_time(runs: Sequence[LoggedRun], root: Path) -> list[list[LoggedRun]]:
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
    shorter_ns = min(_length_ns(group), _length_ns(other))
    if _overlap_ns(group, other) < max(1, MIN_OVERLAP * shorter_ns):
        return False
    return not any(a.robot == b.robot and _overlap_ns([a], [b]) > 0 for a in group for b in other)


def _span_ns(group: Sequence[LoggedRun]) -> tuple[int, int]:
    return min(run.begun_ns for run in group), max(run.ended_ns for run in group)


def _length_ns(group: Sequence[LoggedRun]) -> int:
    begun_ns, ended_ns = _span_ns(group)
    return ended_ns - begun_ns


def _overlap_ns(group: Sequence[LoggedRun], other: Sequence[LoggedRun]) -> int:
    (begun_ns, ended_ns), (also_begun_ns, also_ended_ns) = _span_ns(group), _span_ns(other)
    return min(ended_ns, also_ended_ns) - max(begun_ns, also_begun_ns)


# ---- what a manifest says ----


def _fact_of(manifest: dict[str, str], key: str) -> str:
    if key == "policy":
        return manifest.get("policy_hash", "")[:8] or "none"
    if key == "map":
        name, hash_ = Path(manifest.get("map", "")).stem, manifest.get("map_hash", "")[:8]
        return "-".join(part for part in (name, hash_) if part) or "none"
    if key.removeprefix("manifest.") in manifest:
        return manifest[key.removeprefix("manifest.")]
    if key.startswith("manifest."):
        return UNKNOWN
    return _setting(manifest, key)


def _setting(manifest: dict[str, str], key: str) -> str:
    section, _, name = _CONFIG_NAMES.get(key, key).partition(".")
    settings: dict[str, dict[str, Any]] = json.loads(manifest.get("config", "{}"))
    try:
        value = settings[section][name]
    except KeyError:
        own = ", ".join((*_CONFIG_NAMES, *_OWN_NAMES))
        raise HippomatError(
            f"--by {key}: is neither a setting (such as fleet.round_s) nor in the logs' manifest; also: {own}"
        ) from None
    return value if isinstance(value, str) else json.dumps(value)
