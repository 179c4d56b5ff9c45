"""What the radio core may use: memory, stack, instructions."""

from __future__ import annotations

import functools
import re
import shutil
import subprocess
from pathlib import Path

import instructions
import pytest
from c_values import lib

CORE = instructions.CORE
RAM_BYTES = 64 * 1024
STACK_BYTES = 3 * 1024  # of the 12 KiB that the shell gives its task


def test_a_radio_with_all_its_peers_fits_64_kib():
    """Room for 64 robots; the requirement was 30."""
    assert lib.RC_MAX_ROBOTS >= 30
    assert lib.rc_size() < RAM_BYTES, lib.rc_size()


@functools.cache
def call_graph(directory: Path) -> tuple[dict[str, int], dict[str, set[str]]]:
    """(bytes of stack, functions called) by function, as gcc says; static functions are named file:function."""
    command = ["gcc", "-std=c11", "-O2", "-c", "-fstack-usage", "-fcallgraph-info=su"]
    subprocess.run([*command, *map(str, sorted(CORE.glob("*.c")))], cwd=directory, check=True)
    frames: dict[str, int] = {}
    calls: dict[str, set[str]] = {}
    for file in directory.glob("*.ci"):
        text = file.read_text()
        for title, size in re.findall(r'node: \{ title: "([^"]+)" label: "[^"]*?(\d+) bytes \(static\)', text):
            frames[title] = int(size)
        for source, target in re.findall(r'edge: \{ sourcename: "([^"]+)" targetname: "([^"]+)"', text):
            calls.setdefault(source, set()).add(target)
    return frames, calls


def needs_gcc() -> None:
    if shutil.which("gcc") is None:
        pytest.skip("gcc is not installed")


def test_no_function_has_a_stack_frame_of_unknown_size(tmp_path):
    needs_gcc()
    call_graph(tmp_path)
    usage = [line for file in tmp_path.glob("*.su") for line in file.read_text().splitlines()]
    assert len(usage) > 100
    assert [line for line in usage if not line.endswith("\tstatic")] == []


def test_nothing_calls_itself_and_the_deepest_call_needs_little_stack(tmp_path):
    needs_gcc()
    frames, calls = call_graph(tmp_path)

    @functools.cache
    def depth(function: str) -> tuple[int, tuple[str, ...]]:
        if function in path:
            raise AssertionError(f"recursion: {' -> '.join([*path, function])}")
        path.append(function)
        deepest = max((depth(callee) for callee in calls.get(function, ())), default=(0, ()))
        path.pop()
        return frames.get(function, 0) + 8 + deepest[0], (function, *deepest[1])

    path: list[str] = []
    worst, way = max(depth(function) for function in frames)
    print(f"worst stack {worst} bytes: {' -> '.join(way)}")
    assert worst < STACK_BYTES, way


def test_a_received_frame_costs_under_3000_instructions_and_nothing_got_more_than_a_tenth_dearer():
    if name := instructions.missing():
        pytest.skip(f"{name} is not installed")
    now = instructions.counted()
    assert now["receive_state"] < 3000
    assert now["receive_relay"] < 3000
    figures = instructions.committed()
    if figures["compiler"] != instructions.compiler():
        pytest.skip(f"the committed figures are of {figures['compiler']}, this is {instructions.compiler()}")
    known = figures["instructions"]
    dearer = {name: (count, known[name]) for name, count in now.items() if count > 1.1 * known[name]}
    assert dearer == {}, "run tests/firmware/instructions.py --commit if it is worth it"
