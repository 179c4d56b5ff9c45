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

HEADERS = ("frame.h", "cobs.h", "link.h", "radio_core.h")  # each needs those before it
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
    ffi = cffi.FFI()
    ffi.cdef(declarations())
    try:
        lib = ffi.dlopen(str(path))
    except OSError as error:
        raise BuildError(
            f"{path} does not load: {error}; delete it or unset HIPPOMAT_RADIO_LIBRARY"
        ) from None
    return Library(ffi, lib, path)
