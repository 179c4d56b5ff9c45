"""cffi's view of the radio core (ABI mode: no Python headers, no compiled extension).

The declarations are read from the C headers themselves, between their `cdef` marks, so that there is one
definition of every struct and function.
"""

from __future__ import annotations

import functools
import os
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cffi

from hippomat_sim.radio.build import BuildError, build_library, find_compiler, source_directory

HEADERS = (  # each needs those before it
    *("frame.h", "cobs.h", "seal.h", "schedule.h", "link.h", "fleet_time.h", "relay_table.h"),
    *("peers.h", "stop.h", "radio_core.h"),
)
_MARKED = re.compile(r"/\* cdef: begin \*/(.*?)/\* cdef: end \*/", re.DOTALL)


@dataclass(frozen=True, slots=True)
class Library:
    """The loaded radio core: `lib.rc_...` functions and constants, `ffi` to make their arguments."""

    ffi: Any
    lib: Any
    path: Path


def declarations(sources: Path | None = None) -> str:
    """What lies between the cdef marks of the headers."""
    sources = sources or source_directory()
    return "\n".join(part for name in HEADERS for part in _MARKED.findall((sources / name).read_text()))


@functools.cache
def load_library(sanitize: bool = False) -> Library:
    """Builds the radio core where necessary and loads it; raises BuildError with the remedy.

    sanitize: with address and undefined-behaviour checks; the process must have been started with the
    compiler's libasan in LD_PRELOAD. HIPPOMAT_RADIO_LIBRARY names a library to load instead of building one.
    """
    given = os.environ.get("HIPPOMAT_RADIO_LIBRARY")
    path = Path(given) if given else build_library(find_compiler(), sanitize)
    return _opened(path, declarations())


@functools.cache
def load_fleet_library(sanitize: bool = False) -> Library:
    """The same with fleet_driver.h, which drives many radios in one call."""
    header, source = (Path(__file__).with_name(name) for name in ("fleet_driver.h", "fleet_driver.c"))
    path = build_library(find_compiler(), sanitize, extra=(header, source))
    return _opened(path, "\n".join((declarations(), *_MARKED.findall(header.read_text()))))


def _opened(path: Path, declared: str) -> Library:
    ffi = cffi.FFI()
    ffi.cdef(declared)
    try:
        lib = ffi.dlopen(str(path))
    except OSError as error:
        raise BuildError(
            f"{path} does not load: {error}; delete it or unset HIPPOMAT_RADIO_LIBRARY"
        ) from None
    return Library(ffi, lib, path)
