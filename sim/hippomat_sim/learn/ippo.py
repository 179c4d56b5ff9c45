"""Independent proximal policy optimisation (HIPPO-MAT, "Independent PPO Training"; Schulman et al. 2017).

    L_i = E[min(rho_i A_i, clip(rho_i, 1 - clip, 1 + clip) A_i)] - c_v E[(V_i - return_i)^2] + c_e E[H(pi_i)]

with rho_i = pi_i(a_i | o_i) / pi_i,old(a_i | o_i), for every agent from its own experience alone. A_i is the
generalised advantage (the paper), or the counterfactual of its request (ours, see advantages.py); beside it
the optimal assignment may be cloned, in the first pass over each batch. Where agents share weights their
losses are averaged; where every agent has weights of its own they are summed, so that each is trained as if
it were alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import torch
from torch import Tensor, nn

from hippomat_core.allocation.graphsage_settings import GraphSageSettings
from hippomat_core.allocation.paper_network import MASKED_LOGIT
from hippomat_core.allocation.quantise import FULL_SCALE
from hippomat_core.errors import ConfigError
from hippomat_core.wire.frames import UNREACHABLE
from hippomat_sim.learn.advantages import (
    Payment,
    counterfactual_advantages,
    counterfactual_payments,
    generalised_advantages,
)
from hippomat_sim.learn.networks import PolicyInputs, PolicyNetwork, policy_inputs
from hippomat_sim.learn.networks.graphsage import GraphSageNetwork
from hippomat_sim.learn.optimal import best_slots, task_prices
from hippomat_sim.learn.problems import ProblemBatch
from hippomat_sim.learn.rollout import Rollout
from hippomat_sim.learn.train_settings import PpoSettings, SignalSettings

_LITTLE = 1e-8
_HEAD = ("head_steps", "tau_first", "tau_last", "relaxation", "head_temperature")  # of a head while cloned
_LEAST_EDGES = 5_000  # of a shard: below, threads cost more than they save


@dataclass(frozen=True, slots=True, eq=False)
class Batch:
    """B decisions of N agents with everything that the loss needs."""

    inputs: PolicyInputs
    acting: Tensor  # (B, N) bool: had a choice
    actions: Tensor  # (B, N)
    log_probs: Tensor  # (B, N) of the policy that acted
    advantages: Tensor  # (B, N)
    returns: Tensor | None  # (B, N) what the value should be; None where values are not used
    optimal: Tensor | None  # (B, N) action of the optimal assignment; None where it is not cloned

    def __len__(self) -> int:
        return len(self.actions)

    def rows(self, chosen: Tensor) -> Batch:
        returns = None if self.returns is None else self.returns[chosen]
        optimal = None if self.optimal is None else self.optimal[chosen]
        return Batch(
            self.inputs[chosen],
            self.acting[chosen],
            self.actions[chosen],
            self.log_probs[chosen],
            self.advantages[chosen],
            returns,
            optimal,
        )


class Ippo:
    """A network, its Adam, and how they learn from a rollout. progress: 0 at a run's start, 1 at its end."""

    def __init__(
        self,
        network: PolicyNetwork,
        settings: PpoSettings,
        signals: SignalSettings,
        seed: int,
        device: torch.device,
        threads: int = 1,
    ) -> None:
        """threads: that share the passes over a batch, each with the means of its own share; they are part of
        what a run is."""
        self.network = network.to(device)
        self.parameters = list(self.network.parameters())
        self.sizes = [parameter.numel() for parameter in self.parameters]
        self.threads = threads
        # Gradients of a settled policy are full of subnormal numbers, which halve the speed and say nothing.
        self.workers = ThreadPoolExecutor(threads, initializer=torch.set_flush_denormal, initargs=(True,))
        self.settings, self.signals, self.device = settings, signals, device
        self.random = torch.Generator(device).manual_seed(seed)
        self.cloned_head = _cloned_head(network, signals)
        self.own_weights = bool(getattr(network, "independent", False))
        self.optimiser = torch.optim.Adam(self._groups(), lr=settings.learning_rate, fused=True)

    @torch.no_grad()
    def act(self, problems: ProblemBatch) -> tuple[Tensor, Tensor]:
        """Actions drawn from the policy (E, N), and its logits (E, N, M + 1)."""
        logits = self.network(policy_inputs(problems, self.device))
        waiting = torch.empty_like(logits).exponential_(generator=self.random)
        return (logits - torch.log(waiting)).argmax(dim=2), logits  # Gumbel: the first to arrive

    def learn(self, rollout: Rollout, progress: float) -> dict[str, float]:
        """Updates the network; returns the means of its losses over the update."""
        batch = self._batch(rollout, progress)
        self._set_rate(progress)
        size = self.settings.minibatch or len(batch)
        whole = self._shards(batch) if size >= len(batch) else None  # each pass takes them again
        sums: dict[str, tuple[float, int]] = {}
        for epoch in range(self.settings.epochs):
            cloning = epoch == 0  # once per batch
            for chosen in torch.split(self._order(len(batch)), size):
                shards = whole or self._shards(batch.rows(chosen))
                for name, value in self._step(shards, progress, cloning).items():
                    total, count = sums.get(name, (0.0, 0))
                    sums[name] = total + value.item(), count + 1
        return {name: total / count for name, (total, count) in sums.items()}

    def _order(self, count: int) -> Tensor:
        return torch.randperm(count, generator=self.random, device=self.device)

    def _loss(self, batch: Batch, progress: float) -> tuple[Tensor, dict[str, Tensor]]:
        settings = self.settings
        logits, values, cloned = self._evaluate(batch)
        log_policy = torch.log_softmax(logits, dim=2)
        log_probs = log_policy.gather(2, batch.actions[..., None])[..., 0]
        moved = (log_probs - batch.log_probs).masked_fill(~batch.acting, 0.0)  # masked actions: no numbers
        ratio = torch.exp(moved)
        clipped = ratio.clamp(1.0 - settings.clip, 1.0 + settings.clip)
        gain = torch.minimum(ratio * batch.advantages, clipped * batch.advantages)
        entropy = -(log_policy.exp() * log_policy).sum(dim=2)
        losses = {
            "policy_loss": -self._mean(gain, batch.acting),
            "entropy": self._mean(entropy, batch.acting),
        }
        loss = losses["policy_loss"] - settings.entropy * losses["entropy"]
        if values is not None and batch.returns is not None:
            losses["value_loss"] = self._mean(
                torch.square(values - batch.returns), torch.ones_like(batch.acting)
            )
            loss = loss + settings.value_coefficient * losses["value_loss"]
        if batch.optimal is not None:
            losses["clone_loss"] = self._clone_loss(cloned, batch)
            loss = loss + self._clone_weight(progress) * losses["clone_loss"]
        with torch.no_grad():
            outside = (torch.abs(ratio - 1.0) > settings.clip).float()
            losses["clipped"] = self._mean(outside, batch.acting)
        return loss, self._shown(losses, batch)

    def _evaluate(self, batch: Batch) -> tuple[Tensor, Tensor | None, Tensor]:
        """Logits of the policy, values where they are used, and the logits that learn by cloning."""
        if batch.returns is not None:
            logits, values = self.network.evaluate(batch.inputs)
            return logits, values, logits
        if self.signals.alone and batch.optimal is not None and isinstance(self.network, GraphSageNetwork):
            alone, with_head = self.network.evaluate_both(batch.inputs, self.cloned_head)
            return alone, None, with_head
        logits = self.network(batch.inputs)
        return logits, None, logits

    def _clone_loss(self, logits: Tensor, batch: Batch) -> Tensor:
        """Cross-entropy with the optimal assignment, where the policy can choose as it does."""
        assert batch.optimal is not None
        at = batch.optimal[..., None]
        possible = logits.gather(2, at)[..., 0] > float(MASKED_LOGIT) / 2.0
        log_policy = torch.log_softmax(logits, dim=2)
        return self._mean(-log_policy.gather(2, at)[..., 0], batch.acting & possible)

    def _mean(self, figure: Tensor, counted: Tensor) -> Tensor:
        """Mean over what counts; with weights of their own, the sum of the agents' means."""
        figure = figure.masked_fill(~counted, 0.0)
        if self.own_weights:
            return (figure.sum(dim=0) / counted.sum(dim=0).clamp(min=1)).sum()
        return figure.sum() / counted.sum().clamp(min=1)

    def _shown(self, losses: dict[str, Tensor], batch: Batch) -> dict[str, Tensor]:
        agents = batch.actions.shape[1] if self.own_weights else 1
        return {name: value.detach() / agents for name, value in losses.items()}

    def _step(self, shards: Sequence[Batch], progress: float, cloning: bool) -> dict[str, Tensor]:
        """One step of Adam on the shards' losses, weighted by size; returns them and the gradient's norm."""
        if not cloning:
            shards = [replace(shard, optimal=None) for shard in shards]
        descents = list(self.workers.map(lambda shard: self._descent(shard, progress), shards))
        count = sum(len(shard) for shard in shards)
        weights = [len(shard) / count for shard in shards]
        gradient = _weighted(weights, [part for part, _ in descents])
        norm = torch.linalg.vector_norm(gradient)
        if self.settings.gradient_clip > 0.0:
            gradient *= (self.settings.gradient_clip / (norm + _LITTLE)).clamp(max=1.0)
        for parameter, part in zip(self.parameters, torch.split(gradient, self.sizes), strict=True):
            parameter.grad = part.view_as(parameter)
        self.optimiser.step()
        losses = {name: _weighted(weights, [parts[name] for _, parts in descents]) for name in descents[0][1]}
        return {**losses, "gradient": norm}

    def _shards(self, batch: Batch) -> list[Batch]:
        """Equal parts, one for each thread where there is enough for it to do, with prepared inputs."""
        edges = batch.inputs.costs_q.numel()
        count = max(1, min(self.threads, edges // _LEAST_EDGES, len(batch)))
        rows = torch.arange(len(batch), device=self.device).chunk(count)
        parts = [batch] if count == 1 else [batch.rows(some) for some in rows]
        prepared = self.workers.map(self.network.prepared, [part.inputs for part in parts])
        return [replace(part, inputs=inputs) for part, inputs in zip(parts, prepared, strict=True)]

    def _descent(self, batch: Batch, progress: float) -> tuple[Tensor, dict[str, Tensor]]:
        """The loss's gradient by all parameters, one after the other, and the loss's parts."""
        loss, parts = self._loss(batch, progress)
        used = torch.autograd.grad(loss, self.parameters, allow_unused=True, materialize_grads=True)
        return torch.cat([gradient.flatten() for gradient in used]), parts

    @torch.no_grad()
    def _batch(self, rollout: Rollout, progress: float) -> Batch:
        inputs = policy_inputs(rollout.views, self.device)
        acting = inputs.eligible.any(dim=2)
        returns = None
        if self.settings.advantage == "gae":
            advantages, returns = self._generalised(rollout, inputs)
        else:
            advantages = self._counterfactual(rollout)
        optimal = self._slots(rollout.problems) + 1 if self._clone_weight(progress) > 0.0 else None
        actions = rollout.actions
        if rollout.own is not None:  # everybody decides for itself, on its own view
            mine = nn.functional.one_hot(rollout.own, actions.shape[1]).bool().to(self.device)
            acting = acting & mine
            actions, advantages = _to_views(actions, mine), _to_views(advantages, mine)
            optimal = None if optimal is None else _to_views(optimal, mine)
        if self.settings.normalise_advantages:
            advantages = self._normalised(advantages, acting)
        log_probs = torch.log_softmax(rollout.logits, dim=2).gather(2, actions[..., None])[..., 0]
        return Batch(inputs, acting, actions, log_probs, advantages, returns, optimal)

    def _generalised(self, rollout: Rollout, inputs: PolicyInputs) -> tuple[Tensor, Tensor]:
        """Advantages and returns, (T E, N)."""
        rewards = rollout.rewards.to(self.device)
        if self.settings.reward == "team":
            rewards = rollout.team_rewards.to(self.device)[..., None].expand_as(rewards)
        values = self.network.values(inputs).view_as(rewards)
        last = self.network.values(policy_inputs(rollout.last, self.device))
        following = torch.cat([values[1:], last[None]])
        if rollout.finals is not None:
            finals = self.network.values(policy_inputs(rollout.finals, self.device))
            following.flatten(0, 1)[rollout.final_at.to(self.device)] = finals
        terminated = rollout.terminated.to(self.device)
        ended = terminated | rollout.truncated.to(self.device)
        gamma, gae_lambda = self.settings.gamma, self.settings.gae_lambda
        advantages = generalised_advantages(rewards, values, following, terminated, ended, gamma, gae_lambda)
        return advantages.flatten(0, 1), (advantages + values).flatten(0, 1)

    def _counterfactual(self, rollout: Rollout) -> Tensor:
        """(T E, N), paid by the costs as they were. Busy agents count as claiming what the optimum promises
        them: looking ahead pays."""
        signals = self.signals
        inputs = policy_inputs(rollout.problems, self.device)
        costs = torch.square(inputs.costs_q.float() / FULL_SCALE)
        if signals.dual_price > 0.0:
            eligible = inputs.eligible.cpu().numpy()
            prices = task_prices(rollout.problems.costs_q, eligible, signals.task_value)
            costs = costs + signals.dual_price * torch.from_numpy(prices).to(self.device)[:, None, :]
        claims = rollout.actions
        if bool(inputs.busy.any()):
            claims = torch.where(inputs.busy, self._slots(rollout.problems) + 1, claims)
        pay = Payment(signals.task_value, signals.conflict)
        payments = counterfactual_payments(costs, inputs.eligible, claims, pay)
        logits = rollout.logits
        if rollout.own is not None:
            agents = claims.shape[1]
            logits = logits.view(-1, agents, agents, logits.shape[2]).diagonal(dim1=1, dim2=2).mT
        return counterfactual_advantages(payments, torch.softmax(logits, dim=2), rollout.actions)

    def _slots(self, problems: ProblemBatch) -> Tensor:
        """(B, N) slot of every agent in the optimal assignment that looks ahead, -1 = none."""
        open_ = (problems.costs_q != UNREACHABLE) & problems.waiting[:, None, :]
        eligible = open_ & problems.available[:, :, None]
        promisable = open_ & (problems.busy & ~problems.available)[:, :, None]
        return torch.from_numpy(best_slots(problems.costs_q, eligible, promisable)).to(self.device)

    def _normalised(self, advantages: Tensor, acting: Tensor) -> Tensor:
        """Mean 0 and deviation 1 over the decisions; of every agent alone where it has weights of its own."""
        over = (0,) if self.own_weights else (0, 1)
        counted = acting.to(advantages.dtype)
        count = counted.sum(dim=over, keepdim=True).clamp(min=1.0)
        mean = (advantages * counted).sum(dim=over, keepdim=True) / count
        centred = (advantages - mean) * counted
        deviation = torch.sqrt(torch.square(centred).sum(dim=over, keepdim=True) / count)
        return centred / (deviation + _LITTLE)

    def _clone_weight(self, progress: float) -> float:
        return self.signals.clone_start + (self.signals.clone_end - self.signals.clone_start) * progress

    def _groups(self) -> list[dict[str, object]]:
        """Parameters by their factor of the learning rate: the longest prefix of the name that has one."""
        groups: dict[float, list[nn.Parameter]] = {}
        for name, parameter in self.network.named_parameters():
            fitting = [prefix for prefix in self.settings.rate_factors if name.startswith(prefix)]
            factor = self.settings.rate_factors[max(fitting, key=len)] if fitting else 1.0
            groups.setdefault(factor, []).append(parameter)
        return [{"params": parameters, "factor": factor} for factor, parameters in groups.items()]

    def _set_rate(self, progress: float) -> None:
        fall = 1.0 + (self.settings.final_rate - 1.0) * progress
        for group in self.optimiser.param_groups:
            group["lr"] = self.settings.learning_rate * fall * group["factor"]


def _cloned_head(network: PolicyNetwork, signals: SignalSettings) -> GraphSageSettings:
    """The network's, but for what [signals.clone_head] says; ConfigError where it cannot say so."""
    if not isinstance(network, GraphSageNetwork):
        return GraphSageSettings()
    for name in signals.clone_head:
        if name not in _HEAD:
            raise ConfigError(f"[signals.clone_head] {name}: unknown; known: {', '.join(_HEAD)}")
    return GraphSageSettings.from_dict({**network.settings.as_dict(), **signals.clone_head, "head": True})


def _to_views(figures: Tensor, mine: Tensor) -> Tensor:
    """(T E, N) of the agents -> (T E N, N) of their views, 0 where the view is another one's."""
    return figures.repeat_interleave(figures.shape[1], dim=0) * mine


def _weighted(weights: Sequence[float], parts: Sequence[Tensor]) -> Tensor:
    """Their weighted sum, always in the same order."""
    return torch.stack([weight * part for weight, part in zip(weights, parts, strict=True)]).sum(dim=0)
