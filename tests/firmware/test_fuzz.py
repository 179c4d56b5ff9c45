"""The fuzz targets, briefly: they build, find nothing, and would find something. `make fuzz` runs long."""

from __future__ import annotations

import os
import random
import shutil
import subprocess
from pathlib import Path

import fuzz_agree
import pytest
from fuzz_corpus import seeds, write

FUZZ = Path(__file__).resolve().parent.parent.parent / "esp32_firmware/fuzz"
CORE = FUZZ.parent / "lib/radio_core"
FLAGS = ("-std=c11", "-g", "-O1", "-Wall", "-Wextra", "-Werror", "-fsanitize=fuzzer,address,undefined")
RUNS = 2000


def test_c_and_python_agree_on_mutated_bytes():
    valid = fuzz_agree.run(9000, 2, quiet=True)
    assert 500 < valid < 8500


def test_a_disagreement_is_told_with_its_input(monkeypatch):
    monkeypatch.setattr(fuzz_agree, "c_decode", lambda _: None)
    with pytest.raises(fuzz_agree.Disagreement, match="air frame 2"):
        fuzz_agree.run(300, 1, quiet=True)


def test_mutations_are_the_same_for_the_same_seed():
    corpus = seeds()["fuzz_usb"]
    first, second = (
        [fuzz_agree.mutated(corpus[0], corpus, draw) for _ in range(50)]
        for draw in (random.Random(3), random.Random(3))
    )
    assert first == second
    assert len(set(first)) > 25


def built(target: Path, tmp_path: Path, core: Path = CORE) -> Path:
    if shutil.which("clang") is None:
        pytest.skip("clang is not installed")
    program = tmp_path / target.stem
    command = [
        "clang",
        *FLAGS,
        "-I",
        str(core),
        str(target),
        *map(str, sorted(core.glob("*.c"))),
        "-o",
        str(program),
    ]
    result = subprocess.run(command, capture_output=True, text=True, check=False)
    if "libclang_rt.fuzzer" in result.stderr:
        pytest.skip("clang has no libFuzzer: install libclang-rt-dev")
    assert result.returncode == 0, result.stderr
    return program


def fuzzed(program: Path, tmp_path: Path) -> subprocess.CompletedProcess[str]:
    write(tmp_path / "corpus")
    folders = [str(tmp_path / "corpus" / program.name)]
    found = FUZZ / "found" / program.name
    folders += [str(found)] if found.is_dir() else []
    command = [
        str(program),
        f"-runs={RUNS}",
        "-seed=1",
        "-max_len=2048",
        f"-artifact_prefix={tmp_path}/",
        *folders,
    ]
    return subprocess.run(
        command, capture_output=True, text=True, check=False, env=os.environ | {"TMPDIR": str(tmp_path)}
    )


@pytest.mark.parametrize("target", sorted(FUZZ.glob("fuzz_*.c")), ids=lambda path: path.stem)
def test_a_target_finds_nothing(target, tmp_path):
    result = fuzzed(built(target, tmp_path), tmp_path)
    assert result.returncode == 0, result.stderr[-3000:]
    assert f"Done {RUNS} runs" in result.stderr


def test_a_target_finds_a_fault_that_is_there(tmp_path):
    """The checks above can fail: here a STOP is decoded whatever its length."""
    core = tmp_path / "core"
    shutil.copytree(CORE, core)
    source = core / "body_stop.c"
    text = source.read_text()
    assert "n != RC_STOP_BYTES" in text
    source.write_text(text.replace("n != RC_STOP_BYTES", "n < 1"))
    result = fuzzed(built(FUZZ / "fuzz_frame.c", tmp_path, core), tmp_path)
    assert result.returncode != 0
    assert "SUMMARY" in result.stderr
