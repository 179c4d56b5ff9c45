"""How good an action was: generalised advantage estimation, and the counterfactual of one-shot allocation.

Knows numbers, no environment and no network.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor


def generalised_advantages(
    rewards: Tensor,
    values: Tensor,
    next_values: Tensor,
    terminated: Tensor,
    ended: Tensor,
    gamma: float,
    gae_lambda: float,
) -> Tensor:
    """GAE (Schulman et al. 2016). rewards, values, next_values: (T, E, N); terminated, ended: (T, E) bool.

    next_values are those of the observation that followed the step, before any reset: an episode that was cut
    off (ended, not terminated) is bootstrapped from them, one that is over has nothing more to earn.
    """
    alive = (~terminated).to(rewards.dtype)[..., None]
    goes_on = (~ended).to(rewards.dtype)[..., None]
    errors = rewards + gamma * alive * next_values - values
    advantages = torch.empty_like(rewards)
    following = torch.zeros_like(rewards[0])
    for step in range(len(rewards) - 1, -1, -1):
        following = errors[step] + gamma * gae_lambda * goes_on[step] * following
        advantages[step] = following
    return advantages


@dataclass(frozen=True, slots=True)
class Payment:
    """What a request pays, in units of c_max, as the observation has costs: it holds at any scale."""

    task_value: float  # V, above the largest cost
    conflict: float  # lambda


def counterfactual_payments(costs: Tensor, wanted: Tensor, actions: Tensor, pay: Payment) -> Tensor:
    """D_i(j) of every action that i could have chosen while the others kept theirs, (B, N, M + 1).

    costs: (B, N, M) in c_max   wanted: (B, N, M) bool, pairs that exist   actions: (B, N) 0 .. M
    D_i(0) = 0; V - c_ij if nobody else claims j; else max(0, c_other - c_ij) - lambda with the cheapest other
    claim on j. Pairs that do not exist pay -V.
    """
    claims = torch.full_like(costs, torch.inf)
    chosen = (actions > 0)[..., None]
    slots = (actions - 1).clamp(min=0)[..., None]
    claimed = torch.where(chosen, costs.gather(2, slots), torch.inf)
    claims.scatter_(2, slots, claimed)
    other = _least_of_others(claims)
    contested = (other - costs).clamp(min=0.0) - pay.conflict
    request = torch.where(torch.isinf(other), pay.task_value - costs, contested)
    request = torch.where(wanted, request, -pay.task_value)
    return torch.cat([torch.zeros_like(request[..., :1]), request], dim=2)


def counterfactual_advantages(payments: Tensor, probabilities: Tensor, actions: Tensor) -> Tensor:
    """A_i = D_i(a_i) - sum over a of pi_i(a) D_i(a), (B, N). payments, probabilities: (B, N, M + 1)."""
    expected = (payments * probabilities).sum(dim=2)
    return payments.gather(2, actions[..., None])[..., 0] - expected


def _least_of_others(claims: Tensor) -> Tensor:
    """(B, N, M): the least of the column without the own row; inf where nobody else claims."""
    if claims.shape[1] == 1:
        return torch.full_like(claims, torch.inf)
    two, rows = torch.topk(claims, 2, dim=1, largest=False)
    own = torch.arange(claims.shape[1], device=claims.device)[None, :, None]
    return torch.where(own == rows[:, :1], two[:, 1:], two[:, :1])
