"""Prepared worlds on disk: named arrays under a key, each file behind the SHA-256 of what follows it.

A file that is damaged or cut off counts as missing. Written whole or not at all. Knows arrays, not worlds.
"""

from __future__ import annotations

import hashlib
import io
import os
import tempfile
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import platformdirs
from numpy.typing import NDArray

Arrays = Mapping[str, NDArray[np.generic]]
_DIGEST_BYTES = hashlib.sha256().digest_size


def user_directory() -> Path:
    """Where a user's caches belong on this system."""
    return Path(platformdirs.user_cache_dir("hippomat", appauthor=False)) / "worlds"


def load(directory: Path, key: str) -> dict[str, NDArray[np.generic]] | None:
    """The arrays stored under this key; None if there are none or the file is damaged."""
    try:
        data = _path(directory, key).read_bytes()
    except OSError:
        return None
    digest, body = data[:_DIGEST_BYTES], data[_DIGEST_BYTES:]
    if hashlib.sha256(body).digest() != digest:
        return None
    with np.load(io.BytesIO(body), allow_pickle=False) as archive:
        return {name: archive[name] for name in archive.files}


def store(directory: Path, key: str, arrays: Arrays) -> None:
    """Replace what is stored under this key. Warns, and stores nothing, where the disk refuses."""
    buffer = io.BytesIO()
    archived: dict[str, Any] = dict(arrays)
    np.savez_compressed(buffer, **archived)
    body = buffer.getvalue()
    try:
        directory.mkdir(parents=True, exist_ok=True)
        # Several processes may prepare at once: each writes its own, the last rename wins, all are alike.
        with tempfile.TemporaryDirectory(dir=directory, prefix="new-") as scratch:
            whole = Path(scratch) / "worlds"
            whole.write_bytes(hashlib.sha256(body).digest() + body)
            os.replace(whole, _path(directory, key))
    except OSError as error:
        warnings.warn(f"prepared worlds cannot be kept in {directory}: {error.strerror}", stacklevel=2)


def _path(directory: Path, key: str) -> Path:
    return directory / f"{key}.worlds"
