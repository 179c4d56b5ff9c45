"""Small logs of a fleet, written by the recorder from effects and events at given seconds."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

from recorded_run import START_NS, WALL_NS

from hippomat_core import messages as m
from hippomat_core.config import Config, FleetConfig, RobotConfig
from hippomat_core.wire import frames
from hippomat_logs.manifest import run_manifest
from hippomat_logs.recorder import Recorder

S = 10**9
FLEET = FleetConfig(size=3, task_slots=4, c_max_s=20.0, dwell_s=0.5)


def write_log(
    directory: Path,
    robot: int,
    stamped: Iterable[tuple[float, object]],
    *,
    fleet: FleetConfig = FLEET,
    session: str = "",
    wall_ns: int = WALL_NS,
) -> None:
    """A log of these effects and events at these seconds; wall_ns: the log's clock at second 0."""
    config = Config(fleet=fleet, robot=RobotConfig(id=robot))
    manifest = run_manifest(config, session_id=session or f"0000000{robot}")
    recorder = Recorder(directory, manifest, config=config, wall_ns=wall_ns, stamp_ns=START_NS, lossless=True)
    for at_s, message in stamped:
        stamp_ns = START_NS + round(at_s * S)
        if hasattr(message, "stamp_ns"):
            recorder.put(stamp_ns, replace(message, stamp_ns=stamp_ns))  # type: ignore[type-var]
        else:
            recorder.put(stamp_ns, message)  # type: ignore[arg-type]
    recorder.timing(START_NS, 2_000_000, 0)
    recorder.close()


def claim(what: str, slot: int, generation: int = 1) -> m.ClaimChanged:
    return m.ClaimChanged(what, "", slot, generation, 1, 127, 0, 0.0, 0.0, 0.0)


def stop_heard(sender: int, sequence: int, boot: int = 1, rssi_dbm: int = -40) -> m.StopHeard:
    header = frames.Header(frames.STOP, False, 1, sender, boot, sequence, 0)
    return m.StopHeard(0, 0, 0, rssi_dbm, header, frames.StopFrame(0, 0, 0))
