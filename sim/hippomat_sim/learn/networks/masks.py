"""Which actions are valid, and logits that say so."""

from __future__ import annotations

import torch
from torch import Tensor

from hippomat_core.allocation.paper_network import MASKED_LOGIT
from hippomat_sim.learn.networks.inputs import PolicyInputs


def valid_actions(inputs: PolicyInputs) -> Tensor:
    """(B, N, M + 1) bool: 0 always, a task where it is eligible."""
    eligible = inputs.eligible
    return torch.cat([torch.ones_like(eligible[:, :, :1]), eligible], dim=2)


def masked(logits: Tensor, valid: Tensor) -> Tensor:
    return logits.masked_fill(~valid, float(MASKED_LOGIT))
