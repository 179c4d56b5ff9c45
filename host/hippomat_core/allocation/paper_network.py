"""The paper's network in NumPy: z_i = tanh(W x_i + sum over j != i of W' x_j), then an MLP policy on z_i.

Runs a policy that was trained elsewhere; refuses weights of another shape. Source: HIPPO-MAT, sections on the
graph network and the network architecture (z in R^6, two hidden layers of 128 with ReLU, softmax over 0..M).

The file is safetensors, float32, with these keys (PyTorch's convention, weight = (out, in)):

    sage.self.weight        (6, 1 + 2M)      W
    sage.neighbour.weight   (6, 1 + 2M)      W'
    policy.0.weight, .bias  (128, D), (128,)     D = 6: the policy sees z_i;  D = 7 + 2M: it sees [x_i, z_i]
    policy.1.weight, .bias  (128, 128), (128,)
    policy.2.weight, .bias  (M + 1, 128), (M + 1,)

Independent networks (one per robot, as in the paper) have one more axis of length N in front of every tensor.
Robots act by the most probable action that is valid; 0 (no request) always is.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hippomat_core.allocation.policy_file import read_policy
from hippomat_core.allocation.port import Decision, Problem, actions_one_by_one
from hippomat_core.errors import ConfigError

EMBEDDING = 6
HIDDEN = 128
MASKED_LOGIT = np.float32(-1e30)  # finite, so that recorded logits can be subtracted from one another
KEYS = (
    "sage.self.weight",
    "sage.neighbour.weight",
    "policy.0.weight",
    "policy.0.bias",
    "policy.1.weight",
    "policy.1.bias",
    "policy.2.weight",
    "policy.2.bias",
)

Array = NDArray[np.float32]


def expected_shapes(tasks: int, policy_input: int = EMBEDDING) -> dict[str, tuple[int, ...]]:
    """Shape of every tensor of one robot's network."""
    observation = 1 + 2 * tasks
    shapes = ((EMBEDDING, observation),) * 2, (HIDDEN, policy_input), (HIDDEN, HIDDEN), (tasks + 1, HIDDEN)
    sage, first, second, last = shapes
    return dict(zip(KEYS, (*sage, first, first[:1], second, second[:1], last, last[:1]), strict=True))


def load_weights(policy: bytes, robots: int, tasks: int) -> dict[str, Array]:
    """Tensors with a leading axis of 1 (shared) or N (one per robot); ConfigError says what is wrong."""
    tensors = read_policy(policy, "paper_network").tensors
    if set(tensors) != set(KEYS):
        missing, extra = sorted(set(KEYS) - set(tensors)), sorted(set(tensors) - set(KEYS))
        raise ConfigError(
            f"policy file is not the paper's network: missing {missing}, unknown {extra}; export it again"
        )
    first = tensors["policy.0.weight"].shape
    wide = bool(first) and first[-1] == EMBEDDING + 1 + 2 * tasks
    shapes = expected_shapes(tasks, EMBEDDING + 1 + 2 * tasks if wide else EMBEDDING)
    per_robot = len(first) == 3
    weights = {}
    for key in KEYS:
        expected = (robots, *shapes[key]) if per_robot else shapes[key]
        found = tensors[key]
        if found.shape != expected or found.dtype != np.float32:
            raise ConfigError(
                f"policy tensor {key!r} is {found.dtype}{list(found.shape)}, needed float32{list(expected)} "
                f"for {robots} robots and {tasks} task slots: train for this fleet or change [fleet] size, "
                "task_slots"
            )
        weights[key] = found if per_robot else found[None]
    return weights


@dataclass(frozen=True, slots=True, eq=False)
class PaperNetwork:
    """Allocator `paper_network`. weights: as load_weights returns them."""

    weights: dict[str, Array]

    @property
    def name(self) -> str:
        return "paper_network"

    def embeddings(self, x: Array, robot: int) -> Array:
        """z of every row, (N, 6), computed with one robot's W and W'. x: (N, 1 + 2M)."""
        own, neighbour = self._tensor("sage.self.weight", robot), self._tensor("sage.neighbour.weight", robot)
        messages = x @ neighbour.T
        embedded: Array = np.tanh(x @ own.T + messages.sum(axis=0) - messages)
        return embedded

    def logits(self, x: Array, robot: int) -> Array:
        """(M + 1,) before masking. x: (N, 1 + 2M)."""
        z = self.embeddings(x, robot)[robot]
        wide = self.weights["policy.0.weight"].shape[-1] != EMBEDDING
        hidden = np.concatenate([x[robot], z]) if wide else z
        for layer in (0, 1):
            hidden = np.maximum(self._linear(hidden, layer, robot), np.float32(0.0))
        return self._linear(hidden, 2, robot)

    def allocate(self, problem: Problem) -> Decision:
        logits = self.logits(problem.observations(), problem.self_index)
        valid = np.concatenate([[True], problem.eligible[problem.self_index]])
        masked = np.where(valid, logits, MASKED_LOGIT).astype(np.float32)
        return Decision(int(np.argmax(masked)), masked)

    def actions(self, problem: Problem) -> NDArray[np.int64]:
        return actions_one_by_one(self, problem)

    def _linear(self, value: Array, layer: int, robot: int) -> Array:
        weight = self._tensor(f"policy.{layer}.weight", robot)
        result: Array = weight @ value + self._tensor(f"policy.{layer}.bias", robot)
        return result

    def _tensor(self, key: str, robot: int) -> Array:
        stacked = self.weights[key]
        tensor: Array = stacked[robot if len(stacked) > 1 else 0]
        return tensor
