"""What a log says of its run before its first record: configuration, versions and the machine's fingerprint.

Two runs with equal fingerprints compute floating-point numbers alike; then a replay must be bit-equal.
"""

from __future__ import annotations

import hashlib
import json
import os
import platform
import secrets
import sys
from collections.abc import Mapping
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import numpy as np

import hippomat_core
from hippomat_core.allocation.policy_file import read_policy
from hippomat_core.config import Config, config_from_dict, config_to_dict
from hippomat_core.errors import LogError
from hippomat_core.wire.frames import PROTOCOL_VERSION
from hippomat_logs.facts import object_of
from hippomat_logs.part import package_version

FORMAT = "1"
_LIBRARIES = ("numpy", "scipy", "opencv-python-headless", "numba", "llvmlite")
THREAD_SETTINGS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


def new_session_id() -> str:
    """Names one start of the daemon; 8 hexadecimal digits."""
    return secrets.token_hex(4)


def machine_boot_id() -> str:
    """Linux's boot id, "" where there is none."""
    try:
        with open("/proc/sys/kernel/random/boot_id", encoding="ascii") as file:
            return file.read().strip()
    except OSError:
        return ""


def fingerprint() -> dict[str, str]:
    """CPU features as NumPy uses them, library versions and thread counts."""
    core = getattr(np, "_core", None) or np.core
    features: Mapping[str, bool] = core._multiarray_umath.__cpu_features__
    facts = {
        "machine": platform.machine(),
        "python": ".".join(map(str, sys.version_info[:3])),
        "cpu": " ".join(sorted(name for name, present in features.items() if present)),
        **{name: os.environ.get(name) or f"one per core ({os.cpu_count()})" for name in THREAD_SETTINGS},
    }
    for name in _LIBRARIES:
        try:
            facts[name] = version(name)
        except PackageNotFoundError:
            facts[name] = "absent"
    return facts


def recorded_threads(manifest: Mapping[str, str]) -> dict[str, str]:
    """Thread settings of the run, for the environment of a process that shall compute alike."""
    try:
        facts = object_of(manifest.get("fingerprint", "{}"), "fingerprint")
    except LogError:
        return {}
    return {name: str(facts[name]) for name in THREAD_SETTINGS if str(facts.get(name, "")).isdigit()}


@cache
def core_hash() -> str:
    """SHA-256 of the robot core's source, which decides; two runs of one hash differ for another reason."""
    digest = hashlib.sha256()
    root = Path(hippomat_core.__file__).parent
    for path in sorted(root.rglob("*.py")):
        digest.update(path.relative_to(root).as_posix().encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()


def run_manifest(
    config: Config,
    *,
    session_id: str,
    map_hash: bytes = b"",
    policy: bytes | None = None,
    extra: Mapping[str, str] | None = None,
) -> dict[str, str]:
    """The manifest that Recorder wants; `extra` adds facts such as firmware version or command line."""
    return {
        "format": FORMAT,
        "hippomat": package_version(),
        "protocol": str(PROTOCOL_VERSION),
        "core_hash": core_hash(),
        "robot": str(config.robot.id),
        "fleet": str(config.fleet.id),
        "session_id": session_id,
        "boot_id": machine_boot_id(),
        "host": platform.node(),
        "config": json.dumps(config_to_dict(config), sort_keys=True),
        "map_hash": map_hash.hex(),
        "policy_hash": read_policy(policy).hash if policy else "",
        "fingerprint": json.dumps(fingerprint(), sort_keys=True),
        **(extra or {}),
    }


def config_of(manifest: Mapping[str, str], name: str) -> Config:
    """The run's configuration; `name` is the file, for the error."""
    try:
        return config_from_dict(object_of(manifest["config"], "config"), name)
    except (KeyError, LogError) as error:
        raise LogError(
            f"{name}: its manifest holds no usable configuration ({error}); is it a hippomat log?"
        ) from None
