"""Instructions that one frame costs the radio core, counted by callgrind, beside the committed figures.

    python tests/firmware/instructions.py [--commit]

Counts depend on the compiler: they are compared only where its major version is the one of figures.json.
"""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

FIRMWARE = Path(__file__).resolve().parent.parent.parent / "esp32_firmware"
CORE = FIRMWARE / "lib/radio_core"
FIGURES = FIRMWARE / "bench/figures.json"
SCENARIOS = ("receive_state", "receive_relay", "receive_foreign", "send_state", "send_relay", "tick")
TOLERANCE = 0.10


def missing() -> str:
    """The first program that is not installed, or nothing."""
    return next((name for name in ("gcc", "valgrind") if shutil.which(name) is None), "")


def compiler() -> str:
    """gcc and its major version: what the figures hold for."""
    return f"gcc {_run('gcc', '-dumpversion').split('.')[0].strip()} -O2"


def counted() -> dict[str, int]:
    """Instructions by scenario."""
    with tempfile.TemporaryDirectory() as name:
        program = Path(name) / "instructions"
        sources = [FIRMWARE / "bench/instructions.c", *sorted(CORE.glob("*.c"))]
        _run("gcc", "-std=c11", "-O2", "-g", "-I", CORE, *sources, "-o", program)
        return {scenario: _count(program, scenario) for scenario in SCENARIOS}


def committed() -> dict[str, object]:
    """figures.json: compiler and instructions."""
    figures: dict[str, object] = json.loads(FIGURES.read_text())
    return figures


def _count(program: Path, scenario: str) -> int:
    out = f"--callgrind-out-file={program.parent / 'callgrind.out'}"
    command = ["valgrind", "--tool=callgrind", "--toggle-collect=measured", out, str(program), scenario]
    result = subprocess.run(command, capture_output=True, text=True, check=True)
    found = re.search(r"Collected : (\d+)", result.stderr)
    assert found is not None, result.stderr
    return int(found[1])


def _run(*command: str | Path) -> str:
    return subprocess.run([str(part) for part in command], capture_output=True, text=True, check=True).stdout


def main() -> int:
    if name := missing():
        print(f"{name} was not found: install it (Debian: apt install {name})", file=sys.stderr)
        return 1
    now = counted()
    if "--commit" in sys.argv[1:]:
        FIGURES.write_text(json.dumps({"compiler": compiler(), "instructions": now}, indent=2) + "\n")
    before = committed()
    if before["compiler"] != compiler():
        print(f"the committed figures are of {before['compiler']}; this is {compiler()}: not compared")
    worse = 0
    known = before["instructions"]
    assert isinstance(known, dict)
    for scenario, count in now.items():
        change = count / known[scenario] - 1
        worse += change > TOLERANCE and before["compiler"] == compiler()
        print(f"{scenario:16} {count:7,d}   committed {known[scenario]:7,d}   {change:+7.1%}")
    return 2 if worse else 0


if __name__ == "__main__":
    sys.exit(main())
