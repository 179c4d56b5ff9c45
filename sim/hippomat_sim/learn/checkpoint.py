"""A training run's state in one file, written so that a power cut leaves the old one or the new one whole."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import torch

from hippomat_core.errors import ConfigError

FORMAT = "hippomat-training-1"
FILE_NAME = "checkpoint.pt"


def save_checkpoint(folder: Path, state: dict[str, Any]) -> Path:
    """state: tensors, numbers, texts and containers of them, so that reading it runs no code."""
    path = folder / FILE_NAME
    beside = path.with_suffix(".tmp")
    with beside.open("wb") as file:
        torch.save({"format": FORMAT, **state}, file)
        file.flush()
        os.fsync(file.fileno())
    beside.replace(path)
    return path


def load_checkpoint(folder: Path) -> dict[str, Any]:
    """What save_checkpoint was given, on the CPU; ConfigError where there is no usable checkpoint."""
    path = folder / FILE_NAME
    if not path.is_file():
        raise ConfigError(f"--resume {folder}: there is no {FILE_NAME}; give the directory of a training run")
    try:
        state: dict[str, Any] = torch.load(path, map_location="cpu", weights_only=True)
        found = state.pop("format", None)
    except Exception as error:  # torch raises several kinds for damaged files
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise ConfigError(f"{path}: not a readable checkpoint ({reason}); start the run anew") from None
    if found != FORMAT:
        raise ConfigError(f"{path}: format {found!r}, needed {FORMAT!r}; start the run anew")
    return state
