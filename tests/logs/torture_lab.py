"""Ways to hurt a log, and what must still hold. tests/logs/test_torture.py tries few, `make torture` many."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
import time
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from log_samples import START_NS, new_recorder
from mcap.reader import make_reader
from recorded_run import record_run
from rosbags.highlevel import AnyReader

from hippomat_core import messages as m
from hippomat_core.errors import HippomatError, LogError
from hippomat_logs import open_run
from hippomat_logs.column_table import Table
from hippomat_logs.lenient_walk import walk_leniently
from hippomat_logs.mcap_writer import CHUNK, MAGIC
from hippomat_logs.reader import mapped, read_raw, reading_store
from hippomat_logs.records import DropRecord
from hippomat_logs.recovery import lenient_contents, recover_active
from hippomat_logs.schema import TOPICS
from hippomat_logs.sink import FullDiskSink, PowerCutSink, file_sinks
from hippomat_logs.walk import Contents, inflated, messages_inside, with_offsets

Message = tuple[int, int, str, bytes]  # number, log time, topic, data
ACTIVE_NAME = "robot00_x_000.mcap.active"
HOLE = TOPICS[DropRecord]


@dataclass
class Victim:
    """A log of several chunks, unfinished, as a dead daemon leaves it; and what stands in it."""

    data: bytes
    chunks: list[tuple[int, int, list[Message]]] = field(default_factory=list)  # first byte, end, messages

    def __post_init__(self) -> None:
        view, contents = memoryview(self.data), lenient_contents(reading_store())
        for at, opcode, body, behind in with_offsets(view, len(MAGIC), len(view)):
            if opcode == CHUNK:
                inside = memoryview(inflated(body, at))
                messages = [tuple_of(raw) for raw in messages_inside(inside, contents)]
                self.chunks.append((at, behind, messages))

    @property
    def messages(self) -> set[Message]:
        return {message for *_, messages in self.chunks for message in messages}


def tuple_of(raw: object) -> Message:
    return raw.number, raw.log_time_ns, raw.topic, raw.data  # type: ignore[attr-defined]


def make_victim(directory: Path, chunks: int = 8) -> Victim:
    """`chunks` chunks of a run of the robot core."""
    run = record_run(directory, ticks=30, close=False)
    (path,) = directory.glob("*.active")
    for k in range(chunks):
        size = path.stat().st_size
        for step in range(12):
            run.event(m.Tick(START_NS + 10**10 + (12 * k + step) * 50_000_000))
            run.read(START_NS + 10**10 + (12 * k + step) * 50_000_000, m.BASE, bytes(40))
        until_s = time.monotonic() + 10.0
        while path.stat().st_size == size and time.monotonic() < until_s:
            time.sleep(0.02)
    data = path.read_bytes()
    run.recorder.close()
    return Victim(data)


@dataclass
class Outcome:
    """What recovery made of one damaged log."""

    lost_whole: int = 0  # messages of undamaged chunks that it did not give back: must be 0
    invented: int = 0  # messages that were never recorded: must be 0
    kept: int = 0
    possible: int = 0  # messages in undamaged chunks


def recovered(victim: Victim, damaged: bytes, whole: list[list[Message]], directory: Path) -> Outcome:
    """Recover `damaged` and compare; whole: the messages of the chunks that no damage touched."""
    path = directory / ACTIVE_NAME
    path.write_bytes(damaged)
    must = {message for messages in whole for message in messages}
    kept: set[Message] = set()
    recover_active(path, reading_store())
    finished = directory / ACTIVE_NAME.removesuffix(".active")
    if finished.exists():
        kept = {tuple_of(raw) for raw in read_raw(finished, Contents())}
    for left in directory.iterdir():
        left.unlink()
    said = {message for message in kept if message[2] == HOLE}  # recovery's own words for a hole
    return Outcome(len(must - kept), len(kept - said - victim.messages), len(kept), len(must))


def truncated(victim: Victim, cut: int, directory: Path) -> Outcome:
    whole = [messages for _, end, messages in victim.chunks if end <= cut]
    return recovered(victim, victim.data[:cut], whole, directory)


def flipped(victim: Victim, bit: int, directory: Path) -> Outcome:
    damaged = bytearray(victim.data)
    damaged[bit // 8] ^= 1 << bit % 8
    whole = [messages for start, end, messages in victim.chunks if not start <= bit // 8 < end]
    return recovered(victim, bytes(damaged), whole, directory)


def strict_reader_notices(finished: bytes, bit: int, directory: Path) -> bool:
    """Does reading a finished log with one flipped bit raise before its end?"""
    damaged = bytearray(finished)
    damaged[bit // 8] ^= 1 << bit % 8
    path = directory / "flipped.mcap"
    path.write_bytes(damaged)
    try:
        for _ in read_raw(path, Contents()):
            pass
    except LogError:
        return True
    return False


def table_reader_is_right(finished: bytes, bit: int, directory: Path) -> bool:
    """open_run() on a finished log with one flipped bit: an error, or the very same values."""
    damaged = bytearray(finished)
    damaged[bit // 8] ^= 1 << bit % 8
    path = directory / "flipped.mcap"
    path.write_bytes(finished)
    right = open_run(path).tables()
    path.write_bytes(damaged)
    try:
        run = open_run(path)
        tables = run.tables()
    except HippomatError:
        return True
    return tables.keys() == right.keys() and all(_equal(tables[name], right[name]) for name in right)


def _equal(ours: Table, theirs: Table) -> bool:
    """Column by column, inner tables included."""
    if ours.columns.keys() != theirs.columns.keys() or ours.children.keys() != theirs.children.keys():
        return False
    pairs = ((ours[name], theirs[name]) for name in ours.columns)
    same = all(len(a) == len(b) and all(map(np.array_equal, a, b)) for a, b in pairs)
    return same and all(_equal(ours.children[name], theirs.children[name]) for name in ours.children)


# ---- a process that is killed, a plug that is pulled ----

RECORDING = """
import sys, time
sys.path.insert(0, {tests!r})
from pathlib import Path
from log_samples import START_NS, new_recorder
from hippomat_core import messages as m
recorder = new_recorder(Path(sys.argv[1]))
print("recording", flush=True)
k = 0
while True:
    now = time.monotonic_ns()
    recorder.put(now, m.Tick(now))
    k += 1
    if k % 20 == 0:
        print(now, flush=True)
    time.sleep(0.0016)
"""


def seconds_lost_by_kill(directory: Path, seed: int) -> float:
    """Kill -9 a recording process at a random moment; between the last record kept and the last one made."""
    program = RECORDING.format(tests=str(Path(__file__).parent))
    child = subprocess.Popen(
        [sys.executable, "-c", program, str(directory)], stdout=subprocess.PIPE, text=True
    )
    assert child.stdout is not None
    assert child.stdout.readline() == "recording\n"
    until_s = time.monotonic() + 0.6 + float(np.random.default_rng(seed).uniform(0, 0.8))
    last = "0"
    while time.monotonic() < until_s:
        last = child.stdout.readline()
    os.kill(child.pid, signal.SIGKILL)
    rest = [line for line in child.stdout.read().split("\n") if line]
    child.wait()
    child.stdout.close()
    (path,) = directory.glob("*.active")
    return (int((rest or [last])[-1]) - last_stamp_ns(path.read_bytes())) / 1e9


def last_stamp_ns(data: bytes) -> int:
    """Stamp of the newest Tick that can be had of an unfinished log; 0 if there is none."""
    store, topic, newest = reading_store(), TOPICS[m.Tick], 0
    for raw in walk_leniently(memoryview(data), lenient_contents(store)):
        if raw.topic == topic:
            newest = max(newest, store.decode(m.Tick, raw.data).stamp_ns)
    return newest


def seconds_lost_by_power_cut(directory: Path, seed: int, cuts: int, rate_hz: float = 618.0) -> list[float]:
    """Pull the plug `cuts` times at random moments of a recording; a page cache keeps nothing unsynced."""
    rng = np.random.default_rng(seed)
    sinks: list[PowerCutSink] = []

    def open_sink(name: str) -> PowerCutSink:
        sinks.append(PowerCutSink(directory, name))
        return sinks[-1]

    recorder = new_recorder(directory, open_sink=open_sink)
    seen: list[tuple[int, bytes]] = []
    moments = np.cumsum(rng.uniform(0.05, 0.45, cuts)) + 0.5
    begun_s = time.monotonic()
    pause = threading.Event()
    for moment in moments:
        while time.monotonic() - begun_s < moment:
            recorder.put(time.monotonic_ns(), m.Tick(time.monotonic_ns()))
            pause.wait(1.0 / rate_hz)
        seen.append((time.monotonic_ns(), sinks[-1].cut()))
    recorder.close()
    return [(now_ns - last_stamp_ns(data)) / 1e9 for now_ns, data in seen]


def whole_file(directory: Path) -> bytes:
    """A finished log."""
    record_run(directory, ticks=30)
    (path,) = directory.glob("*.mcap")
    with mapped(path) as data:
        return bytes(data)


# ---- a disk that is full ----


def full_disk(directory: Path) -> str:
    """Record onto a disk that fills up and stays full; every reader must agree on what is left."""
    files = file_sinks(directory)
    room = iter([150_000, 150_000])
    recorder = new_recorder(directory, open_sink=lambda name: FullDiskSink(files(name), next(room, 0)))
    rng = np.random.default_rng(1)
    for k in range(60):
        recorder.serial(START_NS + k * 50_000_000, m.BASE, 0, 1, rng.bytes(4000))
        time.sleep(0.03)
    status = recorder.close()
    counts = counts_of_every_reader(directory)
    assert len(set(counts.values())) == 1, counts
    assert status.records == 60
    kept = next(iter(counts.values()))
    return f"{status.records} records made; {kept} messages for every reader; {status.problem}"


def counts_of_every_reader(directory: Path) -> dict[str, int]:
    """Messages in the finished logs of a directory by ours (strict, tables), rosbags and mcap."""
    counts = dict.fromkeys(("strict", "tables", "rosbags", "mcap"), 0)
    for path in sorted(directory.glob("*.mcap")):
        counts["strict"] += sum(1 for _ in read_raw(path, Contents()))
        counts["tables"] += sum(len(table) for table in open_run(path).tables().values())
        with AnyReader([path]) as reader:
            counts["rosbags"] += sum(1 for _ in reader.messages())
        with path.open("rb") as file:
            counts["mcap"] += sum(1 for _ in make_reader(file, validate_crcs=True).iter_messages())
    return counts
