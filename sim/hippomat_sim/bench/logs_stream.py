"""What one robot of ten records in a second, made up: 618 messages of the kinds and sizes that a run has.

Decides the mix; the values are random. The same seed makes the same stream.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from hippomat_core import messages as m
from hippomat_core.config import Config, FleetConfig, LogConfig, RobotConfig
from hippomat_logs.manifest import run_manifest
from hippomat_logs.recorder import Recorder
from hippomat_logs.schema import fields_of

PEERS, TASKS = 9, 12
SECOND_NS = 1_000_000_000
WAKE_NS = 4_000_000  # the daemon's loop takes what came together (hippomat_host.reactor)
START_NS, WALL_NS = 5 * SECOND_NS, 1_700_000_000 * SECOND_NS
CONFIG = Config(
    fleet=FleetConfig(size=PEERS + 1, task_slots=TASKS, allocator="hungarian"),
    robot=RobotConfig(id=3, start_known=True),
    log=LogConfig(expected_min=0.0, part_mib=100_000, part_s=0.0),
)
SERIAL, TIMING = "serial", "timing"
# a second has so many of each; with the views (/odom, /tf: one per pose, /scan: one per sweep) 618 messages
EVENTS = {
    m.Tick: 20,
    m.BaseFeedback: 25,
    m.ScanReceived: 10,
    m.StateHeard: 10 * PEERS,
    m.RelayHeard: 60,
    m.RoundEnded: 10,
    m.FrameSent: 20,
}
EFFECTS = {m.Drive: 20, m.PoseEstimated: 20, m.RoundDecided: 10, m.SendState: 10, m.ClaimChanged: 2}
READS = {
    m.RADIO: (131, 60),
    m.BASE: (50, 45),
    m.LIDAR: (70, 150),
}  # so many reads and writes of so many bytes
TIMINGS = 20
VIEWS = 2 * EFFECTS[m.PoseEstimated] + EVENTS[m.ScanReceived]
LENGTHS = {
    m.ScanReceived: 360, m.StateHeard: TASKS, m.RelayHeard: TASKS, m.SendState: TASKS,
    m.BaseFeedback: 3, m.RoundDecided: PEERS + 1,
}  # fmt: skip

MESSAGES_PER_S = (
    sum(EVENTS.values()) + sum(EFFECTS.values()) + sum(n for n, _ in READS.values()) + TIMINGS + VIEWS
)

Step = tuple[int, str, Any]  # nanoseconds into the second, what, its content


class Stream:
    """steps(k) is second k, in the order of its times."""

    def __init__(self, seed: int = 1) -> None:
        rng = np.random.default_rng(seed)
        steps: list[Step] = []
        for what, kinds in (("event", EVENTS), ("effect", EFFECTS)):
            for kind, count in kinds.items():
                steps += [
                    (_when(k, count), what, _made(kind, rng, LENGTHS.get(kind, 4))) for k in range(count)
                ]
        for port, (count, size) in READS.items():
            steps += [(_when(k, count), SERIAL, (port, k % 2, rng.bytes(size))) for k in range(count)]
        steps += [(_when(k, TIMINGS), TIMING, 900_000) for k in range(TIMINGS)]
        self._steps = sorted(steps, key=lambda step: step[0])

    def steps(self, second: int) -> Iterator[Step]:
        """Events carry their stamp."""
        begun_ns = START_NS + second * SECOND_NS
        for at_ns, what, content in self._steps:
            if what == "event":
                content = dataclasses.replace(content, stamp_ns=begun_ns + at_ns)
            yield begun_ns + at_ns, what, content


def _when(index: int, count: int) -> int:
    """Evenly, but at the daemon's wake-ups."""
    return (2 * index + 1) * SECOND_NS // (2 * count) // WAKE_NS * WAKE_NS


def _made(kind: type, rng: np.random.Generator, length: int) -> Any:
    """A record with random numbers and arrays of `length`."""
    values: list[Any] = []
    for one in fields_of(kind):
        if one.python is bytes:
            values.append(rng.bytes(length))
        elif one.python is not None:
            rows = tuple(_made(one.python, rng, length) for _ in range(5 if one.many else 1))
            values.append(rows if one.many else rows[0])
        elif one.many:
            size = TASKS * length if one.name == "costs" else length
            values.append(rng.integers(0, 100, size).astype(one.ros[:-2]))
        else:
            plain = {"string": "follow", "bool": True, "float64": float(rng.normal())}
            values.append(plain.get(one.ros, int(rng.integers(0, 100))))
    return kind(*values)


def new_recorder(directory: Path, lossless: bool = False) -> Recorder:
    manifest = run_manifest(CONFIG, session_id="bench000")
    return Recorder(directory, manifest, config=CONFIG, wall_ns=WALL_NS, stamp_ns=START_NS, lossless=lossless)


Call = tuple[int, Callable[..., None], tuple[Any, ...]]  # due, what to call, with what


def call_of(recorder: Recorder, step: Step) -> Call:
    """The call to the recorder that a step is."""
    stamp_ns, what, content = step
    if what == "event":
        return stamp_ns, recorder.put, (content.stamp_ns, content)
    if what == "effect":
        return stamp_ns, recorder.put, (stamp_ns, content)
    if what == SERIAL:
        port, direction, data = content
        return stamp_ns, recorder.serial, (stamp_ns, port, direction, 1, data)
    return stamp_ns, recorder.timing, (stamp_ns, content, 0)


def record(directory: Path, seconds: int, seed: int = 1) -> Path:
    """A log of so many seconds of robot time, as fast as it can be written."""
    recorder, stream = new_recorder(directory, lossless=True), Stream(seed)
    for second in range(seconds):
        for step in stream.steps(second):
            _, call, arguments = call_of(recorder, step)
            call(*arguments)
    status = recorder.close(timeout_s=600.0)
    return directory / status.file
