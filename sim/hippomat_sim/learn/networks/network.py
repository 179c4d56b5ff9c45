"""What training and evaluation ask of every network. Knows none of them."""

from __future__ import annotations

from typing import Any, ClassVar

import torch
from torch import Tensor, nn

from hippomat_sim.learn.networks.inputs import PolicyInputs


class PolicyNetwork(nn.Module):
    """A policy over {0 = no request, task 1 .. M} and a value, for every agent of every snapshot.

    Logits of actions that are not valid are the core's MASKED_LOGIT. Every agent has a valid action.
    """

    network: ClassVar[str]  # its name in presets and policy files
    training_only: ClassVar[str] = ""  # parameters whose names begin so are not exported; empty: all are

    def evaluate(self, inputs: PolicyInputs) -> tuple[Tensor, Tensor]:
        """Logits (B, N, M + 1) and values (B, N), sharing what both need."""
        raise NotImplementedError

    def forward(self, inputs: PolicyInputs) -> Tensor:
        """Logits (B, N, M + 1)."""
        return self.evaluate(inputs)[0]

    def prepared(self, inputs: PolicyInputs) -> PolicyInputs:
        """The same snapshots with what no weight changes worked out, for those that see them repeatedly."""
        return inputs

    def values(self, inputs: PolicyInputs) -> Tensor:
        """(B, N) expected return."""
        return self.evaluate(inputs)[1]

    def evaluate_own(self, inputs: PolicyInputs, snapshots: Tensor, agents: Tensor) -> tuple[Tensor, Tensor]:
        """Logits (K, M + 1) and values (K,) of agent agents[k] in snapshot snapshots[k] alone."""
        logits, values = self.evaluate(inputs)
        return logits[snapshots, agents], values[snapshots, agents]

    def settings_dict(self) -> dict[str, Any]:
        """What `make_network` and a policy file's manifest need to build it again."""
        raise NotImplementedError

    def to_tensors(self) -> dict[str, Tensor]:
        """The policy's tensors under the core's keys, detached, on the CPU, float32."""
        left = self.training_only
        kept = (item for item in self.state_dict().items() if not (left and item[0].startswith(left)))
        return {key: exported(value) for key, value in kept}

    @torch.no_grad()
    def load_tensors(self, tensors: dict[str, Tensor]) -> None:
        """Takes over what `to_tensors` gave; whatever else the network has stays as it is."""
        own = self.state_dict()
        for key in self.to_tensors():
            own[key].copy_(tensors[key])


def exported(tensor: Tensor) -> Tensor:
    return tensor.detach().to("cpu").float().contiguous()
