"""A trained policy as the file that robots read, with the manifest that says how it came to be."""

from __future__ import annotations

import json
from importlib.metadata import version
from pathlib import Path
from typing import Any

from hippomat_core.allocation.factory import make_allocator
from hippomat_core.allocation.policy_file import PolicyFile, read_policy
from hippomat_core.allocation.warm_up import warm_up
from hippomat_core.config import POLICY_ALLOCATORS
from hippomat_logs.policy_files import naming
from hippomat_sim.learn.checkpoint import load_checkpoint
from hippomat_sim.learn.networks import PolicyNetwork
from hippomat_sim.learn.train_settings import settings_from_dict
from hippomat_sim.learn.training import fresh_network, shipped

ANY_FLEET = 5, 12  # robots, task slots: what a network for every size is tried with


def exported_policy(folder: Path) -> PolicyFile:
    """The policy of a run's checkpoint; ConfigError where there is none."""
    state = load_checkpoint(folder)
    settings = settings_from_dict(json.loads(state["settings"]), str(folder))
    network = fresh_network(settings)
    network.load_state_dict(state["network"])
    metrics = {"evaluation": json.loads(state["evaluation"]), **state["clock"]}
    training = {"version": version("hippomat"), "worlds": state["pool"], **json.loads(state["settings"])}
    return policy_file(shipped(network, settings), training, metrics)


def policy_file(network: PolicyNetwork, training: dict[str, Any], metrics: dict[str, Any]) -> PolicyFile:
    tensors = {key: tensor.numpy() for key, tensor in network.to_tensors().items()}
    return PolicyFile(network.network, network.settings_dict(), training, metrics, tensors)


def write_policy(policy: PolicyFile, path: Path) -> None:
    """Replaces the file in one move, so that nobody reads half of it.

    ConfigError where a training went astray: weights that a robot would refuse are not written.
    """
    data = policy.to_bytes()
    with naming(str(path)):
        _check_that_it_decides(policy, data)
    path.parent.mkdir(parents=True, exist_ok=True)
    beside = path.with_suffix(".tmp")
    beside.write_bytes(data)
    beside.replace(path)


def _check_that_it_decides(policy: PolicyFile, data: bytes) -> None:
    """As a robot does before it opens a port."""
    if policy.network not in POLICY_ALLOCATORS:
        read_policy(data)
        return
    robots, tasks = ANY_FLEET
    if policy.network == "paper_network":  # holds for one size of fleet, which its last layer shows
        last = policy.tensors["policy.2.bias"]
        robots, tasks = len(last) if last.ndim > 1 else robots, last.shape[-1] - 1
    warm_up(make_allocator(policy.network, data, robots, tasks), robots, tasks)
