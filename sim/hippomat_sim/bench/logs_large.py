"""How much memory a summary of a large log takes: a log of gigabytes, made, examined and removed.

Run as a module it is the process that is measured: COMMAND FILE -> peak memory in MiB.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from hippomat_core.errors import HippomatError
from hippomat_core.messages import BASE
from hippomat_logs.disk_space import free_bytes
from hippomat_sim.bench.logs_readers import peak_memory_mib
from hippomat_sim.bench.logs_stream import START_NS, new_recorder

COMMANDS = ("info", "doctor")
READ_BYTES = 16_000


@dataclass(frozen=True, slots=True)
class LargeFigures:
    """Peak memory [MiB] of a whole process that summarises a log of `mib`."""

    mib: float
    info_mib: float
    doctor_mib: float


def measure_large(mib: int, progress: Callable[[float], None]) -> LargeFigures:
    """Makes a log of `mib` in the temporary directory; HippomatError where it does not fit."""
    with tempfile.TemporaryDirectory(prefix="hippomat-bench-") as directory:
        room = free_bytes(Path(directory)) >> 20
        if room < 1.2 * mib + 500:
            raise HippomatError(
                f"--large {mib}: {directory} has {room} MiB free; set TMPDIR to a larger disk"
            )
        path = _make(Path(directory), mib, progress)
        size = path.stat().st_size / 2**20
        peaks = []
        for index, command in enumerate(COMMANDS):
            peaks.append(_peak_mib(command, path))
            progress(0.6 + 0.2 * (index + 1))
    return LargeFigures(size, *peaks)


def _make(directory: Path, mib: int, progress: Callable[[float], None]) -> Path:
    """Random serial bytes: nothing compresses, so the file is as large as what is in it."""
    rng = np.random.default_rng(1)
    pool = [rng.bytes(READ_BYTES) for _ in range(64)]
    recorder = new_recorder(directory, lossless=True)
    count = (mib << 20) // READ_BYTES
    for k in range(count):
        noise = rng.bytes(8)
        recorder.serial(START_NS + k * 1_000_000, BASE, 0, 1, noise + pool[k % 64])
        if k % 1000 == 0:
            progress(0.6 * k / count)
    status = recorder.close(timeout_s=600.0)
    if status.problem or status.lost:
        raise HippomatError(f"the large log could not be written: {status.problem}")
    return directory / status.file


def _peak_mib(command: str, path: Path) -> float:
    line = [sys.executable, "-m", "hippomat_sim.bench.logs_large", command, str(path)]
    done = subprocess.run(line, capture_output=True, text=True, check=False)
    try:
        return float(done.stdout.split()[-1])
    except (ValueError, IndexError):
        raise HippomatError(f"hippomat-logs {command} failed: {done.stderr.strip()[-200:]}") from None


def _main() -> None:
    from contextlib import redirect_stdout
    from io import StringIO

    from hippomat_logs.cli import main

    with redirect_stdout(StringIO()):
        main(sys.argv[1:])
    print(peak_memory_mib())


if __name__ == "__main__":
    _main()
