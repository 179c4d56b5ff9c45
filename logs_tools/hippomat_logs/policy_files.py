"""The weights that an allocator decides with: from a file, or the ones that come with the package.

The core opens no file; the daemon, the simulator and the learning tools all read weights here.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from importlib.resources import files
from pathlib import Path

from hippomat_core.config import POLICY_ALLOCATORS, FleetConfig
from hippomat_core.errors import ConfigError

PACKAGED = "the packaged policy"
_PACKAGED_FOR = "graphsage"


def policy_of(fleet: FleetConfig) -> bytes | None:
    """A safetensors file's bytes; None where the allocator has no weights, or none were given.

    Raises ConfigError for a file that cannot be read.
    """
    if fleet.allocator not in POLICY_ALLOCATORS:
        return None
    if fleet.policy:
        return _read(fleet.policy)
    return packaged_policy() if fleet.allocator == _PACKAGED_FOR else None


def policy_name(fleet: FleetConfig) -> str:
    """Where policy_of finds them, for people."""
    return fleet.policy or PACKAGED


@contextlib.contextmanager
def naming(source: str) -> Iterator[None]:
    """What is wrong with weights is told with the name of where they came from; the core sees bytes only."""
    try:
        yield
    except ConfigError as error:
        raise ConfigError(f"{source}: {error}") from None


def packaged_policy() -> bytes:
    """The trained weights of allocator `graphsage` that every install has."""
    return (files("hippomat_core") / "policies" / "default.safetensors").read_bytes()


def _read(path: str) -> bytes:
    try:
        return Path(path).read_bytes()
    except (OSError, ValueError) as error:  # a name with a zero byte in it is a ValueError
        why = getattr(error, "strerror", None) or error
        raise ConfigError(
            f"[fleet] policy = {path!r} cannot be read: {why}; give the path of a safetensors file"
        ) from None
