"""Snapshots as tensors: what every network takes. Knows no world and no weights.

The arrays are those of ProblemBatch, B in front; the derived ones are computed where a network asks for them.
"""

from __future__ import annotations

from dataclasses import dataclass, fields

import torch
from torch import Tensor

from hippomat_core.allocation.observation import NORMALISED_COST
from hippomat_core.allocation.tie_jitter import code_jitter
from hippomat_core.wire.frames import UNREACHABLE
from hippomat_sim.learn.problems import ProblemBatch


@dataclass(frozen=True, slots=True, eq=False)
class PolicyInputs:
    """B snapshots of N agents and M task slots. See the core's Problem for what each array means."""

    costs_q: Tensor  # (B, N, M) uint8
    available: Tensor  # (B, N) bool
    busy: Tensor  # (B, N) bool
    waiting: Tensor  # (B, M) bool
    present: Tensor  # (B, N) bool
    assigned: Tensor  # (B, N) bool
    ages_rounds: Tensor  # (B, N) float32
    jitter: (
        Tensor  # (B, N, M) float32 in codes, see code_jitter; goes with the agents and slots it was made for
    )

    def __len__(self) -> int:
        return len(self.costs_q)

    @property
    def device(self) -> torch.device:
        return self.costs_q.device

    @property
    def reachable(self) -> Tensor:
        """(B, N, M) bool."""
        return self.costs_q != UNREACHABLE

    @property
    def eligible(self) -> Tensor:
        """(B, N, M) bool: this agent may request this task."""
        return self.reachable & self.available[:, :, None] & self.waiting[:, None, :]

    def observations(self) -> Tensor:
        """x_i of every agent, (B, N, 1 + 2M) float32: the core's `observations`, in torch."""
        agents, tasks = self.costs_q.shape[1:]
        table = torch.as_tensor(NORMALISED_COST.copy(), device=self.device)
        flags = self.waiting.float()[:, None, :].expand(-1, agents, tasks) * 2.0 - 1.0
        status = self.assigned.float()[:, :, None] * 2.0 - 1.0
        x = torch.cat([status, table[self.costs_q.long()], flags], dim=2)
        return x * self.present[:, :, None]

    def __getitem__(self, rows: Tensor | slice) -> PolicyInputs:
        """The chosen snapshots."""
        return PolicyInputs(*(getattr(self, field.name)[rows] for field in fields(PolicyInputs)))

    def to(self, device: torch.device | str) -> PolicyInputs:
        return PolicyInputs(*(getattr(self, field.name).to(device) for field in fields(PolicyInputs)))

    def permuted(self, agents: Tensor, slots: Tensor) -> PolicyInputs:
        """The same snapshots with agent agents[i] in row i and the task of slots[j] in slot j."""

        def edges(value: Tensor) -> Tensor:
            return value[:, agents][:, :, slots]

        rows = (value[:, agents] for value in (self.available, self.busy, self.present, self.assigned))
        available, busy, present, assigned = rows
        return PolicyInputs(
            edges(self.costs_q), available, busy, self.waiting[:, slots], present, assigned,
            self.ages_rounds[:, agents], edges(self.jitter),
        )  # fmt: skip


def policy_inputs(problems: ProblemBatch, device: torch.device | str = "cpu") -> PolicyInputs:
    """Copies the batch: environments reuse their buffers."""
    count, agents, tasks = problems.costs_q.shape
    jitter = torch.tensor(code_jitter(agents, tasks), device=device).expand(count, agents, tasks)
    arrays = {
        field.name: torch.tensor(getattr(problems, field.name), device=device) for field in fields(problems)
    }
    return PolicyInputs(**arrays, jitter=jitter)
