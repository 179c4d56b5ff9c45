"""hippomat-logs info: what logs hold, by their indexes alone; hundreds of files in a moment.

Decides what is shown. Whether every byte is right is doctor's question.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.markup import escape

from hippomat_core.errors import LogError
from hippomat_logs.file_kinds import logs_among
from hippomat_logs.opened_run import OpenedRun, distinct_logs, group_opened
from hippomat_logs.part import END_METADATA, RECOVERY_METADATA
from hippomat_logs.report import DAMAGED, REPRODUCED, TOOL_ERROR
from hippomat_logs.shortfalls import ENDED_EARLY
from hippomat_logs.sources import FusedSource, McapSource, Source, opened_sources


def add_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "paths",
        nargs="+",
        type=Path,
        metavar="LOG",
        help="logs (.mcap, .bag, ROS 2 bags), or directories of logs",
    )
    parser.add_argument("--json", action="store_true", help="print JSON")


def run(options: argparse.Namespace, console: Console) -> int:
    """What can be opened is shown, whatever else is broken."""
    sources: list[Source] = []
    broken: list[str] = []
    paths, foreign = logs_among(distinct_logs(options.paths))
    for path in paths:
        try:
            sources.extend(opened_sources(path))
        except LogError as error:
            broken.append(str(error))
    runs = group_opened(sources)
    if options.json:
        facts = {"runs": [as_json(opened) for opened in runs], "damaged": broken, "no_logs": foreign}
        print(json.dumps({**facts, "fused_files": _fused_files(runs)}, indent=2))
    else:
        for opened in runs:
            show(opened, console)
        for file in _fused_files(runs):
            size = f"{len(file['runs'])} runs, {file['bytes'] / 2**20:.1f} MiB"
            console.print(f"{file['file']}: {size}", markup=False)
        for line in broken:
            console.print(f"[red]damaged[/red]: {escape(line)}")
        for line in foreign:
            console.print(f"left out: {line}", style="yellow", markup=False)
    lossy = any(state_of(opened)["damaged"] for opened in runs)
    return DAMAGED if broken or lossy else TOOL_ERROR if foreign else REPRODUCED


def state_of(opened: OpenedRun) -> dict[str, Any]:
    """Is the run's end there, and what does it say of itself?"""
    ends = [_metadata(source, END_METADATA) for source in opened.sources]
    rescued = [_metadata(source, RECOVERY_METADATA) for source in opened.sources]
    passed_over = [facts["damage"] for facts in rescued if facts.get("damage")]
    parts = [int(_manifest(source).get("part", "0")) for source in opened.sources]
    complete = parts == list(range(len(parts))) and ends[-1].get("final") == "yes"
    if not opened.manifest:
        text, complete = "not recorded by hippomat", True
    elif not ends[-1] and _manifest(opened.sources[-1]).get("recovered"):
        text, complete = ENDED_EARLY, True
    elif complete:
        text = "; ".join(["finished", *(f"when it was recovered: {one}" for one in passed_over)])
    else:
        text = f"parts {', '.join(map(str, parts))} of a run that has more"
    return {
        "text": text,
        "complete": complete,
        "damaged": bool(passed_over),
        "shed": sum(int(facts.get("shed", "0")) for facts in ends),
        "worst_sync_ms": max(int(facts.get("worst_sync_ms", "0")) for facts in ends),
    }


def _metadata(source: Source, name: str) -> Mapping[str, str]:
    return source.file.metadata.get(name, {}) if isinstance(source, McapSource) else {}


def _manifest(source: Source) -> Mapping[str, str]:
    return _metadata(source, "hippomat.run")


def as_json(opened: OpenedRun) -> dict[str, Any]:
    begun_ns, ended_ns = opened.span_ns
    return {
        "name": opened.name,
        "files": [str(source.path) for source in opened.sources],
        "begun_ns": begun_ns,
        "seconds": (ended_ns - begun_ns) / 1e9,
        "bytes": _size(opened),  # null: runs in one file have no size of their own
        "manifest": opened.manifest,
        "state": state_of(opened),
        "topics": {
            topic.name: {"type": topic.type_name, "messages": topic.count} for topic in _topics(opened)
        },
        "left_out": opened.left_out,
    }


def show(opened: OpenedRun, console: Console) -> None:
    facts, state = opened.manifest, state_of(opened)
    begun_ns, ended_ns = opened.span_ns
    seconds = (ended_ns - begun_ns) / 1e9
    who = f"robot {opened.robot}" if opened.robot >= 0 else "observer"
    console.print(
        f"[bold]{escape(opened.name)}[/bold]"
        + (f": {who} of fleet {facts.get('fleet', '?')}" if facts else "")
    )
    for source in opened.sources:
        console.print(f"  {source.path}", markup=False)
    begun = datetime.fromtimestamp(begun_ns / 1e9, timezone.utc).strftime("%Y-%m-%d %H:%M:%S UTC")
    total = sum(topic.count or 0 for topic in opened.topics.values())
    size = _size(opened)
    of_size = "" if size is None else f", {size / 2**20:.1f} MiB"
    console.print(f"  begun {begun}, {seconds:.1f} s, {total:,} messages{of_size}")
    if isinstance(opened.sources[0], FusedSource):
        console.print(f"  one of the runs fused in this file, at {opened.sources[0].inside}", markup=False)
    console.print(f"  {state['text']}{_by(facts)}", markup=False)
    if state["shed"]:
        console.print(f"  [yellow]{state['shed']:,} bulk records were shed while recording[/yellow]")
    for line in _topic_lines(opened, seconds):
        console.print(line, markup=False, no_wrap=True, overflow="ignore", crop=False)
    for topic, why in opened.left_out.items():
        console.print(f"  left out: {topic}: {why}", markup=False, style="yellow")


def _by(facts: Mapping[str, str]) -> str:
    if not facts:
        return ""
    allocator = json.loads(facts.get("config", "{}")).get("fleet", {}).get("allocator", "?")
    made = f"; recorded by hippomat {facts.get('hippomat', '?')} on {facts.get('host', '?')}\n"
    map_hash, weights = facts.get("map_hash", "")[:12] or "none", facts.get("policy_hash", "")[:12] or "none"
    hashes = f"map {map_hash}, weights {weights}"
    return f"{made}  allocator {allocator}, {hashes}"


def _topics(opened: OpenedRun) -> list[Any]:
    return [opened.topics[name] for name in sorted(opened.topics)]


def _topic_lines(opened: OpenedRun, seconds: float) -> list[str]:
    """Columns as wide as they must be: a table of rich's would cut topics short in a pipe."""
    rows = []
    for topic in _topics(opened):
        if topic.count == 0:
            continue
        rate = f"{topic.count / seconds:.1f} Hz" if topic.count and seconds > 0 else ""
        rows.append((topic.name, "?" if topic.count is None else f"{topic.count:,}", rate, topic.type_name))
    name, count, rate_width = (max((len(row[k]) for row in rows), default=0) for k in range(3))
    return [f"  {a:{name}}  {b:>{count}}  {c:>{rate_width}}  {d}" for a, b, c, d in rows]


def _fused_files(runs: list[OpenedRun]) -> list[dict[str, Any]]:
    """Each file that holds several runs, once, with its size."""
    names: dict[Path, list[str]] = {}
    for opened in runs:
        if isinstance(opened.sources[0], FusedSource):
            names.setdefault(opened.sources[0].path, []).append(opened.name)
    return [{"file": str(path), "bytes": path.stat().st_size, "runs": of} for path, of in names.items()]


def _size(opened: OpenedRun) -> int | None:
    """Bytes of its files; None in a fused file, which is all its runs'."""
    if isinstance(opened.sources[0], FusedSource):
        return None
    files = [file for source in opened.sources for file in _files(source.path)]
    return sum(file.stat().st_size for file in files)


def _files(path: Path) -> list[Path]:
    return [file for file in path.iterdir() if file.is_file()] if path.is_dir() else [path]
