"""Building the radio core: warnings, compilers, the cache, the binding's declarations, sanitizers."""

from __future__ import annotations

import dataclasses
import os
import re
import shutil
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from c_values import ffi, lib

from hippomat_sim.radio import BuildError, Counters, load_library
from hippomat_sim.radio.binding import HEADERS, declarations
from hippomat_sim.radio.build import Compiler, build_library, find_compiler, source_directory

HERE = Path(__file__).parent
SOURCES = source_directory()
STRICT = ("-std=c11", "-O2", "-Wall", "-Wextra", "-Werror", "-Wconversion", "-Wpedantic", "-Wshadow")


def run(*command: str | Path, **more: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [str(part) for part in command], capture_output=True, text=True, check=False, **more
    )


def gcc() -> str:
    found = shutil.which("gcc")
    if found is None:
        pytest.skip("gcc is not installed")
    return found


def zig() -> Compiler:
    pytest.importorskip("ziglang", reason="the PyPI package ziglang is not installed")
    return Compiler((sys.executable, "-m", "ziglang", "cc"), "zig")


def test_gcc_has_nothing_to_say_about_the_sources(tmp_path):
    result = run(
        gcc(), *STRICT, "-fanalyzer", "-shared", "-fPIC", *SOURCES.glob("*.c"), "-o", tmp_path / "rc.so"
    )
    assert (result.returncode, result.stderr) == (0, "")


def test_the_compiler_of_ziglang_builds_a_library_that_loads(tmp_path):
    built = build_library(zig(), cache=tmp_path)
    script = "from hippomat_sim.radio import load_library; print(load_library().lib.rc_size())"
    env = os.environ | {"HIPPOMAT_RADIO_LIBRARY": str(built)}
    result = run(sys.executable, "-c", script, env=env)
    assert result.stdout.strip() == str(lib.rc_size()), result.stderr


def test_the_sources_are_pure(tmp_path):
    """No writable data, no allocation, no clock: the objects need only memory functions."""
    nm = shutil.which("nm")
    if nm is None:
        pytest.skip("nm is not installed")
    built = run(gcc(), "-std=c11", "-O2", "-c", *SOURCES.glob("*.c"), cwd=tmp_path)
    assert built.returncode == 0, built.stderr
    symbols = [line.split() for line in run(nm, "-A", *tmp_path.glob("*.o")).stdout.splitlines()]
    assert [parts for parts in symbols if parts[-2] in "BbDdCGgSs"] == []
    needed = {parts[-1] for parts in symbols if parts[-2] == "U" and not parts[-1].startswith("rc_")}
    assert needed <= {"memcpy", "memmove", "memset", "__stack_chk_fail", "_GLOBAL_OFFSET_TABLE_"}


def test_structs_have_the_same_layout_in_the_binding_and_in_c(tmp_path):
    program = tmp_path / "abi_sizes"
    built = run(gcc(), "-std=c11", "-I", SOURCES, HERE / "abi_sizes.c", "-o", program)
    assert built.returncode == 0, built.stderr
    in_c = {
        name: (int(size), int(last)) for name, size, last in map(str.split, run(program).stdout.splitlines())
    }
    shown = dict(re.findall(r"SHOW\((\w+), (\w+)\)", (HERE / "abi_sizes.c").read_text()))
    in_cffi = {
        name: (ffi.sizeof(name), ffi.offsetof(name, last)) for name, last in shown.items() if name in in_c
    }
    assert in_c == in_cffi
    structs = set(re.findall(r"^} (rc_\w+);", declarations(), re.MULTILINE))
    assert structs == set(in_c)


def test_every_declared_function_and_constant_is_in_the_library():
    names = re.findall(r"\b(rc_\w+)\(", re.sub(r"/\*.*?\*/", "", declarations(), flags=re.DOTALL))
    assert len(names) > 25
    assert all(getattr(lib, name) for name in names)
    assert all((SOURCES / name).is_file() for name in HEADERS)


def test_the_counters_have_the_same_names_in_c_and_python():
    in_c = [name for name, _ in ffi.typeof("rc_counters").fields]
    assert in_c == [field.name for field in dataclasses.fields(Counters)]


def test_several_builds_at_once_leave_one_library(tmp_path):
    compiler = find_compiler()
    with ThreadPoolExecutor(3) as pool:
        built = set(pool.map(lambda _: build_library(compiler, cache=tmp_path), range(3)))
    assert [path.name for path in tmp_path.iterdir()] == [path.name for path in built]


def test_a_second_build_comes_from_the_cache(tmp_path):
    compiler = find_compiler()
    first = build_library(compiler, cache=tmp_path)
    stamp = first.stat().st_mtime_ns
    assert build_library(compiler, cache=tmp_path).stat().st_mtime_ns == stamp
    assert build_library(dataclasses.replace(compiler, version="newer"), cache=tmp_path) != first


def test_a_machine_without_a_compiler_is_told_the_remedy(tmp_path):
    script = (
        "import sys; sys.modules['ziglang'] = None\n"
        "from hippomat_sim.radio.build import find_compiler\n"
        "try: find_compiler()\n"
        "except Exception as error: print(type(error).__name__, error)"
    )
    env = {key: value for key, value in os.environ.items() if key != "CC"} | {"PATH": str(tmp_path)}
    assert run(sys.executable, "-c", script, env=env).stdout.strip() == (
        "BuildError no C compiler found (tried $CC, cc, gcc, clang, ziglang): run `pip install ziglang`"
    )


def test_a_wrong_cc_is_named():
    script = "from hippomat_sim.radio.build import find_compiler; find_compiler()"
    result = run(sys.executable, "-c", script, env=os.environ | {"CC": "no-such-cc -O3"})
    assert "CC = 'no-such-cc -O3' does not run: correct or unset the variable CC" in result.stderr


def test_a_failed_compilation_shows_the_command_and_what_it_said(tmp_path):
    broken = Compiler((sys.executable, "-c", "import sys; sys.exit('out of registers')"), "broken")
    with pytest.raises(BuildError, match=r"(?s)the radio core does not compile: .*out of registers"):
        build_library(broken, cache=tmp_path)


def test_a_cache_that_cannot_be_written_is_named(tmp_path):
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(BuildError, match=r"cannot write to .*file/cache.*; set XDG_CACHE_HOME elsewhere"):
        build_library(find_compiler(), cache=tmp_path / "file" / "cache")


def test_a_library_that_does_not_load_is_named(tmp_path):
    script = "from hippomat_sim.radio import load_library; load_library()"
    env = os.environ | {"HIPPOMAT_RADIO_LIBRARY": str(tmp_path / "none.so")}
    assert "none.so does not load" in run(sys.executable, "-c", script, env=env).stderr


def test_the_library_is_loaded_once():
    assert load_library() is load_library()


@pytest.mark.timeout(300)
def test_nothing_is_read_or_written_out_of_bounds(tmp_path):
    """The other tests of the C once more, built with checks of addresses and undefined behaviour."""
    compiler = Compiler((gcc(),), "for sanitizers")
    runtime = Path(run(*compiler.command, "-print-file-name=libasan.so").stdout.strip())
    if not runtime.is_absolute():
        pytest.skip(f"{compiler.command[0]} has no libasan: install its sanitizer runtime")
    library = build_library(compiler, sanitize=True, cache=tmp_path)
    env = os.environ | {
        "HIPPOMAT_RADIO_LIBRARY": str(library),
        "LD_PRELOAD": str(runtime.resolve()),
        "ASAN_OPTIONS": "detect_leaks=0:abort_on_error=0:exitcode=99",
        "PYTHONMALLOC": "malloc",
        "HIPPOMAT_EXAMPLES": "50",
    }
    names = ("test_differential.py", "test_wire_golden.py", "test_radio_core.py", "test_stop.py")
    relay = ("test_relay_table.py", "test_relay_laws.py")
    files = [HERE / name for name in (*names, *relay, "test_seal.py", "test_security.py")]
    result = run(
        sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", *files, env=env, cwd=HERE.parent
    )
    assert result.returncode == 0, result.stdout[-3000:] + result.stderr[-3000:]
    overrun = "from c_values import *; lib.rc_frame_valid(exactly(bytes([0x21] * 20)), 200)"
    broken = run(sys.executable, "-c", overrun, env=env | {"PYTHONPATH": str(HERE)})
    assert "heap-buffer-overflow" in broken.stderr, "the sanitizer sees nothing: " + broken.stderr[-2000:]
