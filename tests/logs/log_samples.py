"""Records with generated values, and short logs made of them; seeded."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

import numpy as np

from hippomat_core import messages as m
from hippomat_core.config import Config, FleetConfig, RobotConfig
from hippomat_logs.manifest import run_manifest
from hippomat_logs.recorder import Recorder
from hippomat_logs.schema import EFFECTS, EVENTS, fields_of

WALL_NS, START_NS = 1_700_000_000_000_000_000, 5_000_000_000
CONFIG = Config(fleet=FleetConfig(size=5, task_slots=6), robot=RobotConfig(id=2, start_known=True))


def sample(kind: type, rng: np.random.Generator) -> Any:
    """A record of `kind` with values from the whole range of every field."""
    values = []
    samples = int(rng.integers(0, 40))  # of a sweep: its arrays have one length
    for f in fields_of(kind):
        if f.python is bytes:
            values.append(rng.bytes(int(rng.integers(0, 60))))
        elif f.python is not None:
            rows = tuple(sample(f.python, rng) for _ in range(int(rng.integers(0, 4))))
            values.append(rows if f.many else sample(f.python, rng))
        elif f.ros == "string":
            values.append("".join(map(chr, rng.integers(32, 900, int(rng.integers(0, 12))))))
        elif f.ros == "bool":
            values.append(bool(rng.integers(0, 2)))
        else:
            count = None if not f.many else samples if kind is m.ScanReceived else int(rng.integers(0, 40))
            values.append(_number(f.ros.removesuffix("[]"), count, rng))
    return kind(*values)


def _number(ros: str, count: int | None, rng: np.random.Generator) -> Any:
    dtype = np.dtype(ros)
    raw = np.frombuffer(rng.bytes(dtype.itemsize * (1 if count is None else count)), dtype)
    if dtype.kind == "f":
        raw = np.nan_to_num(raw)
    return raw if count is not None else raw[0].item()


def stamped(event: Any, stamp_ns: int) -> Any:
    return dataclasses.replace(event, stamp_ns=stamp_ns)


def new_recorder(directory: Path, config: Config = CONFIG, **options: Any) -> Recorder:
    manifest = run_manifest(config, session_id="5e551011")
    return Recorder(directory, manifest, config=config, wall_ns=WALL_NS, stamp_ns=START_NS, **options)


def record_samples(recorder: Recorder, count: int, seed: int = 1) -> list[Any]:
    """`count` ticks with one event, one effect, serial bytes and timing each; what was given, in order."""
    rng = np.random.default_rng(seed)
    given: list[Any] = []
    for k in range(count):
        stamp_ns = START_NS + k * 50_000_000
        data = rng.bytes(int(rng.integers(1, 200)))
        recorder.serial(stamp_ns, m.BASE, 0, 1, data)
        event = stamped(sample(EVENTS[k % len(EVENTS)], rng), stamp_ns)
        recorder.put(event.stamp_ns, event)
        effect = sample(EFFECTS[k % len(EFFECTS)], rng)
        recorder.put(stamp_ns, effect)
        recorder.timing(stamp_ns, 1000 + k, 0)
        given += [data, event, effect, 1000 + k]
    return given
