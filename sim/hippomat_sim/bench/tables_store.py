"""Finished measurements on the disk, one JSON line each, so that an interrupted run goes on where it was.

A line's key holds everything that determines the measurement; another policy, pool or code is another key.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict
from functools import lru_cache
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

from hippomat_core.errors import ConfigError
from hippomat_sim.bench.tables_cells import Cell
from hippomat_sim.learn.evaluation import Figures

STORE_NAME = "cells.jsonl"
# Whatever is changed in these packages, or in these modules, may change a figure.
_PACKAGES = (
    "hippomat_core.allocation",
    "hippomat_core.wire",
    "hippomat_sim.learn",
    "hippomat_sim.learn.networks",
)
_MODULES = (
    *(
        "hippomat_core.config",
        "hippomat_core.fields",
        "hippomat_core.replaced",
        "hippomat_core.settings_tree",
    ),
    *("hippomat_core.planning.field3d", "hippomat_core.planning.graph", "hippomat_sim.bench.tables_measure"),
)
_NO_SOURCE = (  # of those packages: only training reads these
    *("advantages", "checkpoint", "cli", "curves", "export", "frozen_set", "interrupt", "ippo", "optimal"),
    *("parallel_env", "pool_bar", "ray", "rllib", "rollout", "runs", "train"),
)


class Store:
    """cells.jsonl in a directory. fresh: begin with an empty one."""

    def __init__(self, directory: Path, fresh: bool) -> None:
        self._path = directory / STORE_NAME
        self._lines: dict[str, Figures] = {}
        if fresh:
            self._path.unlink(missing_ok=True)
        elif self._path.exists():
            self._load()

    def get(self, key: str) -> Figures | None:
        return self._lines.get(key)

    def put(self, key: str, figures: Figures) -> None:
        """On the disk when this returns."""
        self._lines[key] = figures
        values = {name: array.tolist() for name, array in figures.items()}
        with self._path.open("a", encoding="utf-8") as file:
            file.write(json.dumps({"key": json.loads(key), "figures": values}) + "\n")

    def _load(self) -> None:
        lines = self._path.read_text(encoding="utf-8").splitlines(keepends=True)
        if lines and not lines[-1].endswith("\n"):  # the writer was killed in the middle of it
            self._path.write_text("".join(lines := lines[:-1]), encoding="utf-8")
        for number, line in enumerate(lines, start=1):
            try:
                entry = json.loads(line)
                figures = {name: np.array(values, np.int64) for name, values in entry["figures"].items()}
                self._lines[_text(entry["key"])] = figures
            except (ValueError, KeyError, TypeError, AttributeError) as error:
                raise ConfigError(
                    f"{self._path}:{number} is damaged ({error}): remove the file or leave out --resume"
                ) from error


def key_of(cell: Cell, facts: Mapping[str, Any]) -> str:
    """facts: what else determines the measurement, such as seed, pool, weights, code."""
    return _text({**asdict(cell), **facts})


def _text(key: Mapping[str, Any]) -> str:
    return json.dumps(key, sort_keys=True)


@lru_cache(maxsize=1)
def code_hash() -> str:
    """Of the sources of allocators, environment and evaluation."""
    digest = hashlib.sha256()
    for name in measured_modules():
        package, _, module = name.rpartition(".")
        digest.update(name.encode() + files(package).joinpath(f"{module}.py").read_bytes())
    return digest.hexdigest()[:16]


def measured_modules() -> list[str]:
    """What code_hash() reads."""
    inside = (
        f"{package}.{source.name[: -len('.py')]}"
        for package in _PACKAGES
        for source in files(package).iterdir()
        if source.name.endswith(".py") and not source.name.startswith(_NO_SOURCE)
    )
    return sorted({*inside, *_MODULES})
