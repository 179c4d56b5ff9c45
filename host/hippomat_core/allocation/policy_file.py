"""Policy files: safetensors whose metadata is a manifest. Reads, validates, writes bytes; opens no file.

Metadata, all text: format "hippomat-policy-1", network, and as JSON objects settings (what the network
needs to be built), training (how it came to be) and metrics. Files of the paper's network may come without
a manifest.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from safetensors.numpy import load, save

from hippomat_core.config import POLICY_ALLOCATORS
from hippomat_core.errors import ConfigError

FORMAT = "hippomat-policy-1"
NETWORKS = ("graphsage", "paper_network", "gcn")  # no robot runs gcn: it is for comparison

Array = NDArray[np.float32]


@dataclass(frozen=True, slots=True, eq=False)
class PolicyFile:
    network: str
    settings: dict[str, Any]
    training: dict[str, Any]
    metrics: dict[str, Any]
    tensors: dict[str, Array]

    @property
    def hash(self) -> str:
        """sha256 over network, settings and tensors, in hexadecimal; training and metrics do not count."""
        digest = hashlib.sha256()
        digest.update(json.dumps([self.network, self.settings], sort_keys=True).encode())
        for key in sorted(self.tensors):
            tensor = np.ascontiguousarray(self.tensors[key])
            digest.update(json.dumps([key, str(tensor.dtype), list(tensor.shape)]).encode())
            digest.update(tensor.astype(tensor.dtype.newbyteorder("<")).tobytes())
        return digest.hexdigest()

    def to_bytes(self) -> bytes:
        metadata = {"format": FORMAT, "network": self.network}
        for name in ("settings", "training", "metrics"):
            metadata[name] = json.dumps(getattr(self, name), sort_keys=True)
        data: bytes = save(self.tensors, metadata)
        return data


def read_policy(data: bytes, expected: str | None = None) -> PolicyFile:
    """The policy in a file's bytes, of network `expected` if given; ConfigError names what does not fit.

    Its tensors are finite.
    """
    try:
        tensors = load(data)
        metadata = _metadata(data)
    except Exception as error:
        raise ConfigError(f"policy file is not valid safetensors ({error}); export it again") from None
    _refuse_not_finite(tensors)
    found = metadata.get("format")
    if found is None:  # weights without a manifest: the paper's network, as others may have trained it
        network = "paper_network"
        return _of(expected, PolicyFile(network, {}, {}, {}, tensors))
    if found != FORMAT:
        raise ConfigError(f"policy file has format {found!r}, needed {FORMAT!r}: export it with this version")
    network = metadata.get("network", "")
    if network not in NETWORKS:
        raise ConfigError(f"policy file is of network {network!r}, needed one of: {', '.join(NETWORKS)}")
    settings, training, metrics = (
        _json_object(metadata, name) for name in ("settings", "training", "metrics")
    )
    return _of(expected, PolicyFile(network, settings, training, metrics, tensors))


def checked_tensors(policy: PolicyFile, shapes: Mapping[str, tuple[int, ...]]) -> dict[str, Array]:
    """The tensors, each float32 and of its shape; ConfigError names the first that is not."""
    missing, extra = sorted(set(shapes) - set(policy.tensors)), sorted(set(policy.tensors) - set(shapes))
    if missing or extra:
        raise ConfigError(
            f"policy file is no {policy.network}: missing {missing}, unknown {extra}; export it again"
        )
    for key, shape in shapes.items():
        tensor = policy.tensors[key]
        if tensor.shape != tuple(shape) or tensor.dtype != np.float32:
            raise ConfigError(
                f"policy tensor {key!r} is {tensor.dtype}{list(tensor.shape)}, needed float32{list(shape)}: "
                "export the policy again"
            )
    return {key: np.ascontiguousarray(policy.tensors[key]) for key in shapes}


def _refuse_not_finite(tensors: Mapping[str, NDArray[Any]]) -> None:
    for key, tensor in sorted(tensors.items()):
        wrong = tensor.size - int(np.isfinite(tensor).sum())
        if wrong:
            raise ConfigError(
                f"policy tensor {key!r} has {wrong} values that are not finite: train or export it again"
            )


def _of(expected: str | None, policy: PolicyFile) -> PolicyFile:
    if expected not in (None, policy.network):
        remedy = f"set [fleet] allocator = {policy.network!r} or give another file"
        if policy.network not in POLICY_ALLOCATORS:
            remedy = f"no robot runs it: give a file of network {expected!r}"
        raise ConfigError(f"policy file is of network {policy.network!r}, needed {expected!r}: {remedy}")
    return policy


def _metadata(data: bytes) -> dict[str, str]:
    """A file begins with the length of its JSON header, 8 bytes little endian; __metadata__ is text."""
    length = int.from_bytes(data[:8], "little")
    metadata: dict[str, str] = dict(json.loads(data[8 : 8 + length]).get("__metadata__", {}))
    return metadata


def _json_object(metadata: dict[str, str], name: str) -> dict[str, Any]:
    try:
        value = json.loads(metadata.get(name, "{}"))
    except (ValueError, RecursionError) as error:  # a number of too many digits, too many brackets
        raise ConfigError(f"policy file's {name} is not JSON ({error}); export it again") from None
    if not isinstance(value, dict):
        raise ConfigError(
            f"policy file's {name} is {type(value).__name__}, needed an object; export it again"
        )
    return value
