"""Which logs are one trial, and what its manifests say of it: found by indexes alone, whatever lies where.

Knows files and manifests, no figures; grouping.py says which runs are one trial.
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
from hippomat_logs.copies import refuse_other_version
from hippomat_logs.file_kinds import refuse_foreign
from hippomat_logs.metrics.grouping import (
    LoggedRun,
    by_directory,
    by_fused_file,
    by_time,
    hang_together,
    span_ns,
)
from hippomat_logs.opened_run import OpenedRun, distinct_logs, group_opened, manifest_of
from hippomat_logs.sources import FusedSource, Source, opened_sources

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
class TrialFiles:
    """The runs of one trial. directory: the lowest that holds all; root: that of all trials."""

    runs: tuple[LoggedRun, ...]
    directory: Path
    root: Path
    name: str
    guessed: bool = False  # put together by times and settings; else by whoever fused or sorted the files

    def doubt(self, linked: bool) -> str:
        """Why its runs may be no trial; linked: they heard each other's frames, which settles it."""
        if linked or not self.guessed or self.robots < 2:
            return ""
        why = (
            "their times overlap" if hang_together(self.runs) else "nothing but their times speaks against it"
        )
        return (
            f"{len(self.runs)} runs without a frame in common were taken for one fleet, as {why}; "
            "if each is a trial: give them a directory each and --trials dir"
        )

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
    """Trials by name; a line for every file that is none of ours, cannot be opened, or is there twice."""

    trials: list[TrialFiles]
    foreign: list[str]
    damaged: list[str]
    twice: list[str]


def find_trials(paths: Sequence[Path], by: str = BY_TIME) -> Found:
    """All trials in these logs and directories; reads indexes only."""
    sources: list[Source] = []
    damaged: list[str] = []
    foreign: list[str] = []
    for file in distinct_logs(paths):
        try:
            refuse_foreign(file)
            sources += opened_sources(file)
        except LogError as error:
            damaged.append(str(error))
        except HippomatError as error:
            foreign.append(str(error))
    sources, twice = _once(sources)
    opened = group_opened(sources)
    runs = [_logged(one) for one in opened if one.manifest]
    damaged += [f"{one.sources[0].path}: its run manifest is lost" for one in opened if not one.manifest]
    root = _root(paths)
    fused = _new_ones(by_fused_file(runs), twice)
    own = [run for run in runs if not run.inside]
    groups = by_directory(own, paths) if by == BY_DIRECTORY else by_time(own, root)
    return Found(_named([*groups, *fused], root, guessed=by == BY_TIME), foreign, damaged, twice)


def _once(sources: Sequence[Source]) -> tuple[list[Source], list[str]]:
    """Without copies of a part, and a line for each. HippomatError where two of one part differ."""
    first: dict[tuple[str, ...], Source] = {}
    kept, twice = list[Source](), list[str]()
    for source in sources:
        facts = manifest_of(source)
        part = facts.get("robot", ""), facts.get("session_id", ""), facts.get("part", "0")
        fused = isinstance(source, FusedSource) or not part[1]
        other = source if fused else first.setdefault(part, source)
        if other is source:
            kept.append(source)
        else:
            refuse_other_version(source.path, other.path)
            twice.append(f"{source.path} is a copy of {other.path}")
    return kept, twice


def _new_ones(fused: Sequence[list[LoggedRun]], twice: list[str]) -> list[list[LoggedRun]]:
    """Fused files without those that hold a run of another one, which holds as many or more."""
    holders: dict[tuple[int, str], Path] = {}
    kept = []
    for group in sorted(fused, key=lambda group: -len(group)):
        keys = [(run.robot, run.manifest.get("session_id", "")) for run in group]
        if other := next((holders[key] for key in keys if key in holders), None):
            twice.append(f"{group[0].paths[0]} holds the runs of {other}")
            continue
        holders |= dict.fromkeys(keys, group[0].paths[0])
        kept.append(group)
    return kept


def _named(groups: list[list[LoggedRun]], root: Path, guessed: bool) -> list[TrialFiles]:
    """By the directory that holds a trial, and the time of its start where that holds several.

    By its file where it is fused.
    """
    found: list[TrialFiles] = []
    groups.sort(key=lambda group: (_common_directory(group), span_ns(group)))
    places = Counter(_common_directory(group) for group in groups if not group[0].inside)
    for group in groups:
        place = _common_directory(group)
        below = os.path.relpath(place, root)
        name = root.name if below == "." else below
        if group[0].inside:
            name = os.path.relpath(group[0].paths[0].resolve().with_suffix(""), root)
        elif places[place] > 1:
            begun = datetime.fromtimestamp(span_ns(group)[0] / 1e9, timezone.utc)
            name += f" {begun:%Y-%m-%dT%H:%M:%SZ}"
        runs = tuple(sorted(group, key=lambda run: (run.robot, run.begun_ns)))
        found.append(TrialFiles(runs, place, root, name, guessed and not group[0].inside))
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
