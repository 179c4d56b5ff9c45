"""Compiles the radio core into a shared library, once per sources, compiler and flags.

Finds the sources in a checkout or in an installed wheel, and a C compiler: $CC, cc, gcc, clang, or the one
that the PyPI package ziglang carries. Knows no Python binding.
"""

from __future__ import annotations

import hashlib
import importlib.util
import os
import shlex
import shutil
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import platformdirs

from hippomat_core.errors import HippomatError

FLAGS = ("-std=c11", "-O2", "-fPIC", "-shared", "-Wall", "-Wextra")
SANITIZE_FLAGS = (
    "-g",
    "-fno-omit-frame-pointer",
    "-fsanitize=address,undefined",
    "-fno-sanitize-recover=all",
)


class BuildError(HippomatError):
    """The radio core cannot be compiled on this machine."""


@dataclass(frozen=True, slots=True)
class Compiler:
    """A C compiler as the beginning of a command line, and what it says of itself."""

    command: tuple[str, ...]
    version: str


def source_directory() -> Path:
    """Where the C sources are: esp32_firmware/lib/radio_core of a checkout, or inside the wheel."""
    package = Path(__file__).resolve().parent.parent
    candidates = (package.parent.parent / "esp32_firmware/lib/radio_core", package / "radio_core_c")
    for candidate in candidates:
        if (candidate / "radio_core.h").is_file():
            return candidate
    places = " nor ".join(str(candidate) for candidate in candidates)
    raise BuildError(f"radio_core.h found neither in {places}: reinstall hippomat")


def find_compiler() -> Compiler:
    """The first C compiler that answers; $CC is taken at its word."""
    chosen = os.environ.get("CC")
    if chosen:
        compiler = _answering(tuple(shlex.split(chosen)))
        if compiler is None:
            raise BuildError(f"CC = {chosen!r} does not run: correct or unset the variable CC")
        return compiler
    for command in (("cc",), ("gcc",), ("clang",), (sys.executable, "-m", "ziglang", "cc")):
        compiler = _answering(command)
        if compiler is not None:
            return compiler
    raise BuildError("no C compiler found (tried $CC, cc, gcc, clang, ziglang): run `pip install ziglang`")


def build_library(
    compiler: Compiler,
    sanitize: bool = False,
    cache: Path | None = None,
    extra: tuple[Path, ...] = (),
) -> Path:
    """The shared library, from the cache if built before. extra: C files and headers beside the core."""
    sources = source_directory()
    files = [*sorted(sources.glob("*.[ch]")), *extra]
    flags = (*FLAGS, *(SANITIZE_FLAGS if sanitize else ()), f"-I{sources}")
    cache = cache or Path(platformdirs.user_cache_dir("hippomat", appauthor=False))
    target = cache / f"radio_core-{_fingerprint(files, compiler, flags)}.so"
    if not target.is_file():
        _compile(compiler, flags, files, target)
    return target


def _answering(command: tuple[str, ...]) -> Compiler | None:
    if command[1:2] == ("-m",):
        if importlib.util.find_spec("ziglang") is None:
            return None
    elif shutil.which(command[0]) is None:
        return None
    try:
        answer = subprocess.run(
            (*command, "--version"), capture_output=True, text=True, check=True, timeout=60
        )
    except (OSError, subprocess.SubprocessError):
        return None
    return Compiler(command, answer.stdout)


def _fingerprint(files: list[Path], compiler: Compiler, flags: tuple[str, ...]) -> str:
    digest = hashlib.sha256(repr((compiler.command, compiler.version, flags)).encode())
    for file in files:
        digest.update(file.name.encode() + b"\0" + file.read_bytes() + b"\0")
    return digest.hexdigest()[:20]


def _compile(compiler: Compiler, flags: tuple[str, ...], files: list[Path], target: Path) -> None:
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        # Several processes may build at once: each compiles for itself, the last rename wins, all are alike.
        with tempfile.TemporaryDirectory(dir=target.parent, prefix="build-") as scratch:
            output = Path(scratch) / target.name
            units = [str(file) for file in files if file.suffix == ".c"]
            command = [*compiler.command, *flags, *units, "-o", str(output)]
            result = subprocess.run(command, capture_output=True, text=True, check=False)
            if result.returncode != 0:
                said = result.stderr.strip()
                raise BuildError(f"the radio core does not compile: {shlex.join(command)}\n{said}")
            output.rename(target)
    except OSError as error:
        raise BuildError(f"cannot write to {target.parent}: {error}; set XDG_CACHE_HOME elsewhere") from None
