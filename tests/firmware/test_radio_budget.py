"""What the radio core may use: memory, stack, instructions."""

from __future__ import annotations

import dataclasses
import functools
import re
import shutil
import subprocess

import instructions
import pytest
from c_values import lib

CORE = instructions.CORE
RAM_BYTES = 64 * 1024
STACK_BYTES = 3 * 1024  # of the 12 KiB that the shell gives its task
CIPHER_PORT = "__indirect_call"  # gcc's name for any call through a pointer


def test_a_radio_with_all_its_peers_fits_64_kib():
    """Room for 64 robots; the requirement was 30."""
    assert lib.RC_MAX_ROBOTS >= 30
    assert lib.rc_size() < RAM_BYTES, lib.rc_size()


@dataclasses.dataclass(frozen=True)
class Stack:
    """What gcc says of the stack at -O2. Static functions are named file:function."""

    usage: list[str]  # lines of -fstack-usage: place, bytes, kind
    frames: dict[str, int]  # bytes by function, the return address included
    calls: dict[str, set[str]]


@pytest.fixture(scope="module")
def stack(tmp_path_factory: pytest.TempPathFactory) -> Stack:
    directory = tmp_path_factory.mktemp("stack")
    (directory / "empty.c").write_text("")
    command = ["gcc", "-std=c11", "-O2", "-c", "-fstack-usage", "-fcallgraph-info=su"]
    if shutil.which("gcc") is None:
        pytest.skip("gcc is not installed")
    if subprocess.run([*command, "empty.c"], cwd=directory, capture_output=True, check=False).returncode != 0:
        pytest.skip("gcc does not write a call graph: GNU gcc 10 or later does")
    subprocess.run([*command, *map(str, sorted(CORE.glob("*.c")))], cwd=directory, check=True)
    usage = [line for file in directory.glob("*.su") for line in file.read_text().splitlines()]
    graph = "".join(file.read_text() for file in directory.glob("*.ci"))
    calls: dict[str, set[str]] = {}
    for source, target in re.findall(r'edge: \{ sourcename: "([^"]+)" targetname: "([^"]+)"', graph):
        calls.setdefault(source, set()).add(target)
    nodes = re.findall(r'node: \{ title: "([^"]+)" label: "[^"]*\\n(\d+) bytes \(', graph)
    return Stack(usage, {name: int(size) for name, size in nodes}, calls)


def test_every_function_has_a_stack_frame_of_known_size(stack):
    """`dynamic,bounded`: arguments are pushed, and the bytes are the most there can be."""
    assert len(stack.frames) == len(stack.usage) > 50
    known = ("\tstatic", "\tdynamic,bounded")
    assert [line for line in stack.usage if not line.endswith(known)] == []


def test_the_stack_of_all_that_is_called_is_known(stack):
    """But for memory functions, which use next to none, and the port of the cipher, which is the shell's."""
    unknown = set().union(*stack.calls.values()) - set(stack.frames)
    assert unknown <= {"memcpy", "memmove", "memset", "memcmp", "__stack_chk_fail", CIPHER_PORT}
    assert {caller for caller, called in stack.calls.items() if CIPHER_PORT in called} == {
        "rc_seal",
        "rc_unseal",
    }


def test_nothing_calls_itself_and_the_deepest_call_needs_little_stack(stack):
    path: list[str] = []

    @functools.cache
    def deepest(function: str) -> tuple[int, tuple[str, ...]]:
        assert function not in path, f"recursion: {' -> '.join([*path, function])}"
        path.append(function)
        below, way = max((deepest(callee) for callee in stack.calls.get(function, ())), default=(0, ()))
        path.pop()
        return stack.frames.get(function, 0) + below, (function, *way)

    worst, way = max(deepest(function) for function in stack.frames)
    print(f"{worst} bytes: {' -> '.join(name.rpartition('/')[2] for name in way)}")
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
