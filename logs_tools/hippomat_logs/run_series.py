"""How the parts of one run begin: their name, what each carries, and the views that hold for the whole run.

The same for whoever records: beside a control loop (recorder.py) or in a simulation's own time
(direct_recorder.py).
"""

from __future__ import annotations

from collections.abc import Mapping
from datetime import datetime, timezone

from hippomat_core.config import Config
from hippomat_logs.derived import DerivedTopics
from hippomat_logs.part import POLICY_ATTACHMENT
from hippomat_logs.parts import Encoded, PartSeries
from hippomat_logs.schema import MessageStore
from hippomat_logs.sink import SinkOpener


def attachments(policy: bytes, files: Mapping[str, bytes] | None) -> dict[str, bytes]:
    """What every part carries."""
    return {**({POLICY_ATTACHMENT: policy} if policy else {}), **(files or {})}


def series_of(
    opener: SinkOpener,
    manifest: Mapping[str, str],
    store: MessageStore,
    config: Config,
    wall_ns: int,
    stamp_ns: int,
    carried: Mapping[str, bytes],
) -> PartSeries:
    """The parts of a run that starts at stamp_ns, which is wall_ns on the wall; not opened yet."""
    facts = {**manifest, "wall_offset_ns": str(wall_ns - stamp_ns), "started_ns": str(stamp_ns)}
    part_bytes, part_s = config.log.part_mib << 20, config.log.part_s
    return PartSeries(opener, log_name(manifest, wall_ns), facts, store, part_bytes, part_s, carried)


def begin(series: PartSeries, derived: DerivedTopics, wall_ns: int, now_s: float) -> None:
    """Open the first part, with the views that hold for the whole run; raises OSError where it cannot be."""
    series.open()
    for topic, data in derived.static():
        series.add(Encoded(topic, 0, wall_ns, data, derived=True), now_s)


def log_name(manifest: Mapping[str, str], wall_ns: int) -> str:
    """robot03_20250301T101500Z_<boot id>-<session id>, the stem of every part's file name."""
    when = datetime.fromtimestamp(wall_ns // 10**9, timezone.utc).strftime("%Y%m%dT%H%M%SZ")
    robot = manifest.get("robot", "-1")
    who = f"robot{int(robot):02d}" if robot.lstrip("-").isdigit() and int(robot) >= 0 else "observer"
    boot = manifest.get("boot_id", "").replace("-", "")[:8] or "noboot"
    return f"{who}_{when}_{boot}-{manifest.get('session_id', 'none')[:8]}"
