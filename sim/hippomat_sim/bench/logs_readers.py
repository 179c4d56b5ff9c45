"""Messages per second and memory of log readers, each in a process of its own.

Run as a module it is that process: READER FILE -> one JSON object. Decides what counts as decoded: every
message of every topic as values, by the reader's usual way.
"""

from __future__ import annotations

import json
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

PASSES = 2  # the first one compiles decoders, which the second has


@dataclass(frozen=True, slots=True)
class ReaderFigures:
    """messages: of one pass; 0 with the reason in `refused`."""

    reader: str
    messages: int = 0
    first_per_s: float = 0.0
    per_s: float = 0.0
    peak_mib: float = 0.0  # of the whole process, interpreter and packages included
    refused: str = ""


def ours(path: Path) -> int:
    """hippomat_logs.open_run: every topic as a table."""
    from hippomat_logs import open_run

    return sum(len(table) for table in open_run(path).tables().values())


def ours_in_batches(path: Path) -> int:
    """The same in bounded memory, topic by topic."""
    from hippomat_logs import open_run

    run = open_run(path)
    return sum(len(batch) for topic in run.topics for batch in run.batches(topic, rows=5000))


def rosbags_any_reader(path: Path) -> int:
    from rosbags.highlevel import AnyReader

    count = 0
    with AnyReader([path]) as reader:
        for connection, _, data in reader.messages():
            reader.deserialize(data, connection.msgtype)
            count += 1
    return count


def mcap_ros2(path: Path) -> int:
    from mcap.reader import make_reader
    from mcap_ros2.decoder import DecoderFactory

    with path.open("rb") as file:
        return sum(1 for _ in make_reader(file, decoder_factories=[DecoderFactory()]).iter_decoded_messages())


def mcap_undecoded(path: Path) -> int:
    """mcap's own reader: bytes only, which is less than what the others do."""
    from mcap.reader import make_reader

    with path.open("rb") as file:
        return sum(1 for _ in make_reader(file).iter_messages())


READERS: dict[str, tuple[str, Callable[[Path], int]]] = {
    "ours": ("hippomat open_run, tables", ours),
    "batches": ("hippomat open_run, batches", ours_in_batches),
    "rosbags": ("rosbags AnyReader", rosbags_any_reader),
    "mcap_ros2": ("mcap + mcap_ros2", mcap_ros2),
    "mcap": ("mcap, bytes only", mcap_undecoded),
}


def peak_memory_mib() -> float:
    """Of this process since it began; getrusage() would tell its parent's too."""
    with open("/proc/self/status", encoding="ascii") as file:
        return next(int(line.split()[1]) for line in file if line.startswith("VmHWM")) / 1024


def measure(reader: str, path: Path) -> ReaderFigures:
    """In a process of its own."""
    command = [sys.executable, "-m", "hippomat_sim.bench.logs_readers", reader, str(path)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    title = READERS[reader][0]
    try:
        return ReaderFigures(title, **json.loads(done.stdout))
    except ValueError:
        lines = done.stderr.strip().splitlines()
        return ReaderFigures(title, refused=lines[-1] if lines else f"exit code {done.returncode}")


def _main() -> None:
    _, reader, name = sys.argv
    read, path, rates, messages = READERS[reader][1], Path(name), [], 0
    try:
        for _ in range(PASSES):
            begun_s = time.perf_counter()
            messages = read(path)
            rates.append(messages / (time.perf_counter() - begun_s))
    except Exception as error:  # whatever a reader finds wrong with a file is its answer
        print(json.dumps({"refused": " ".join(f"{type(error).__name__}: {error}".split())[:200]}))
        return
    peak_mib = peak_memory_mib()
    first, *rest = rates
    print(json.dumps({"messages": messages, "first_per_s": first, "per_s": max(rest), "peak_mib": peak_mib}))


if __name__ == "__main__":
    _main()
