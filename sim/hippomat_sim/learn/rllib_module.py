"""Our networks as RLlib modules: the same torch classes, asked for one agent of each snapshot.

A module serves all agents with shared weights, or one agent where each has weights of its own (the paper's
IPPO); module_weights and load_modules go from the whole network to its modules and back. Knows no algorithm.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import fields
from typing import Any

import torch
from ray.rllib.core.columns import Columns
from ray.rllib.core.rl_module.apis.value_function_api import ValueFunctionAPI
from ray.rllib.core.rl_module.torch import TorchRLModule
from torch import Tensor

from hippomat_core.allocation.tie_jitter import code_jitter
from hippomat_sim.learn.networks import PolicyInputs, PolicyNetwork, make_network
from hippomat_sim.learn.problems import ProblemBatch

_ARRAYS = tuple(field.name for field in fields(ProblemBatch))
MAKE_NETWORK = "hippomat"  # RLlib adds keys of its own beside it
Observed = Mapping[str, Tensor]  # parallel_env.Observation, stacked: (B, ...)
Weights = dict[str, Tensor]


class AllocationModule(TorchRLModule, ValueFunctionAPI):  # type: ignore[misc]
    """model_config[MAKE_NETWORK]: the arguments of make_network. The network's own masks hold."""

    def setup(self) -> None:
        self.network = make_network(**self.model_config[MAKE_NETWORK])

    def _forward(self, batch: dict[str, Any], **_: Any) -> dict[str, Tensor]:
        logits, values = own_outputs(self.network, batch[Columns.OBS])
        return {Columns.ACTION_DIST_INPUTS: logits, Columns.EMBEDDINGS: values}

    def compute_values(self, batch: dict[str, Any], embeddings: Tensor | None = None) -> Tensor:
        """(B,). embeddings: the values that _forward found, which are computed together with the logits."""
        return own_outputs(self.network, batch[Columns.OBS])[1] if embeddings is None else embeddings


def own_outputs(network: PolicyNetwork, observed: Observed) -> tuple[Tensor, Tensor]:
    """Logits (B, M + 1) and values (B,) of the agents that observed. Agents of one snapshot share it."""
    inputs, which = distinct_inputs(observed)
    return network.evaluate_own(inputs, which, observed["self_index"].long())


def distinct_inputs(observed: Observed) -> tuple[PolicyInputs, Tensor]:
    """The U different snapshots among B observations, and for each observation which one it holds (B,)."""
    arrays = [observed[name].contiguous() for name in _ARRAYS]
    bytes_ = torch.cat([array.flatten(1).view(torch.uint8) for array in arrays], dim=1)
    kinds, which = torch.unique(bytes_, dim=0, return_inverse=True)
    holder = which.new_empty(len(kinds))
    holder[which] = torch.arange(len(which), device=which.device)  # whichever comes last: they are equal
    return _inputs([array[holder] for array in arrays]), which


def _inputs(arrays: list[Tensor]) -> PolicyInputs:
    """From a ProblemBatch's arrays, whose flags are numbers here."""
    costs_q = arrays[0]
    count, agents, tasks = costs_q.shape
    jitter = torch.as_tensor(code_jitter(agents, tasks).copy(), device=costs_q.device)
    typed = [array.bool() if array.dtype == torch.int8 else array for array in arrays]
    return PolicyInputs(*typed, *[jitter.expand(count, agents, tasks)])


def has_own_weights(network: PolicyNetwork) -> bool:
    """Every agent has weights of its own: RLlib trains a module for each."""
    return bool(getattr(network, "independent", False))


def module_settings(network: PolicyNetwork) -> dict[str, Any]:
    """Settings of the network of one module, which holds a single set of weights."""
    settings = network.settings_dict()
    return settings | {"independent": False} if has_own_weights(network) else settings


def module_weights(network: PolicyNetwork, module: int) -> Weights:
    """What module number `module` begins with: everything, or the weights of that agent."""
    whole = network.state_dict()
    if not has_own_weights(network):
        return dict(whole)
    return {name: value[module : module + 1] for name, value in whole.items()}


def load_modules(network: PolicyNetwork, modules: Sequence[Mapping[str, Any]]) -> None:
    """The inverse of module_weights, for all modules in their order."""
    weights = [{name: torch.as_tensor(value) for name, value in module.items()} for module in modules]
    joined = {name: torch.cat([module[name] for module in weights]) for name in weights[0]}
    network.load_state_dict(joined if has_own_weights(network) else weights[0])
