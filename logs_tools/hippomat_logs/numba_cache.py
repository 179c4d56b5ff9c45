"""Somewhere for numba to keep compiled code, so that only the first start of an install has to compile.

numba looks beside the source and in the user's cache directory, and fails on import where it may write to
neither: a read-only install, a service without a home. Call this before the first import of compiled code.
"""

from __future__ import annotations

import atexit
import os
import shutil
import tempfile
from pathlib import Path

import hippomat_core
from hippomat_core.errors import HippomatError

SETTING = "NUMBA_CACHE_DIR"


def ensure_numba_cache() -> str:
    """What to tell the user of it; empty where numba finds a place by itself."""
    if any(map(_is_writable, _usual_places())):
        return ""
    try:
        directory = tempfile.mkdtemp(prefix="hippomat-numba-")  # ours alone: its files are run as code
    except OSError as error:
        raise HippomatError(
            f"there is no place for compiled code ({error.strerror or error}): set {SETTING} to a directory "
            "that can be written"
        ) from None
    atexit.register(shutil.rmtree, directory, ignore_errors=True)
    os.environ[SETTING] = directory
    return f"compiled code cannot be kept, so every start compiles it: set {SETTING} to a directory of yours"


def _usual_places() -> list[Path]:
    """Where numba looks (its caching.py), in its order."""
    given = os.environ.get(SETTING)
    cache = os.environ.get("XDG_CACHE_HOME") or os.path.join(os.path.expanduser("~"), ".cache")
    package = Path(hippomat_core.__file__).parent
    return [*([Path(given)] if given else []), package / "allocation" / "__pycache__", Path(cache) / "numba"]


def _is_writable(directory: Path) -> bool:
    try:
        directory.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=directory):
            return True
    except OSError:
        return False
