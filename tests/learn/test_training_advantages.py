"""Advantages against hand-computed ones; prices and assignments against the core's Hungarian method."""

from __future__ import annotations

import numpy as np
import torch
from hypothesis import example, given, settings
from hypothesis import strategies as st

from hippomat_core.allocation.hungarian import assign
from hippomat_core.allocation.look_ahead import assign_ahead
from hippomat_sim.learn.advantages import (
    Payment,
    counterfactual_advantages,
    counterfactual_payments,
    generalised_advantages,
)
from hippomat_sim.learn.optimal import best_slots, task_prices


def _column(*values: float) -> torch.Tensor:
    return torch.tensor(values, dtype=torch.float64)[:, None, None]


def _flags(*values: int) -> torch.Tensor:
    return torch.tensor(values, dtype=torch.bool)[:, None]


def test_a_terminated_episode_has_nothing_more_to_earn_and_a_cut_one_is_bootstrapped() -> None:
    rewards, values, following = _column(1, 2, 3), _column(0.5, 0.25, 0.125), _column(0.25, 10, 20)
    arguments = (rewards, values, following)
    over = generalised_advantages(*arguments, _flags(0, 1, 0), _flags(0, 1, 0), 0.5, 0.5)
    cut = generalised_advantages(*arguments, _flags(0, 0, 0), _flags(0, 1, 0), 0.5, 0.5)
    # last: 3 + .5 * 20 - .125; second: over 2 - .25, cut 2 + .5 * 10 - .25; first: .625 + .25 * second
    torch.testing.assert_close(over, _column(0.625 + 0.25 * 1.75, 1.75, 12.875))
    torch.testing.assert_close(cut, _column(0.625 + 0.25 * 6.75, 6.75, 12.875))


def test_with_gamma_zero_only_the_reward_counts() -> None:
    rewards, values = torch.rand(4, 3, 2), torch.rand(4, 3, 2)
    no = torch.zeros(4, 3, dtype=torch.bool)
    found = generalised_advantages(rewards, values, torch.rand(4, 3, 2), no, no, 0.0, 0.95)
    torch.testing.assert_close(found, rewards - values)


def test_what_each_request_would_have_paid() -> None:
    costs = torch.tensor([[[0.1, 0.5], [0.3, 0.2], [0.4, 0.9]]])
    exists = torch.tensor([[[1, 1], [1, 1], [1, 0]]], dtype=torch.bool)
    actions = torch.tensor([[1, 1, 0]])  # two agents on task 1, the third asks for nothing
    found = counterfactual_payments(costs, exists, actions, Payment(task_value=1.0, conflict=0.1))
    expected = torch.tensor([[[0, 0.1, 0.5], [0, -0.1, 0.8], [0, -0.1, -1.0]]])
    torch.testing.assert_close(found, expected)


def test_one_agent_alone_is_never_contested() -> None:
    found = counterfactual_payments(
        torch.tensor([[[0.25]]]), torch.ones(1, 1, 1, dtype=torch.bool), torch.ones(1, 1, dtype=torch.long),
        Payment(1.0, 0.1),
    )  # fmt: skip
    torch.testing.assert_close(found, torch.tensor([[[0.0, 0.75]]]))


def test_the_counterfactual_advantage_is_zero_on_average() -> None:
    payments, probabilities = torch.rand(5, 3, 4), torch.softmax(torch.rand(5, 3, 4), dim=2)
    each = [
        counterfactual_advantages(payments, probabilities, torch.full((5, 3), action)) for action in range(4)
    ]
    mean = (torch.stack(each, dim=2) * probabilities).sum(dim=2)
    torch.testing.assert_close(mean, torch.zeros(5, 3), atol=1e-6, rtol=0.0)


@st.composite
def _snapshots(draw: st.DrawFn) -> tuple[np.ndarray, np.ndarray]:
    shape = (draw(st.integers(1, 4)), draw(st.integers(1, 8)), draw(st.integers(1, 8)))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    return rng.integers(0, 255, shape).astype(np.uint8), rng.random(shape) < draw(
        st.sampled_from([0.3, 0.8, 1])
    )


_ZERO_COST = np.array([[[221], [2], [144], [0]]], np.uint8)


@settings(deadline=None, max_examples=60)
@given(_snapshots())
def test_the_batch_assigns_as_the_core_does(snapshots: tuple[np.ndarray, np.ndarray]) -> None:
    costs_q, eligible = snapshots
    expected = [assign(costs, allowed) for costs, allowed in zip(costs_q, eligible, strict=True)]
    np.testing.assert_array_equal(best_slots(costs_q, eligible), expected)


@example((_ZERO_COST, _ZERO_COST == 0), 0)  # at equal totals nobody promises
@settings(deadline=None, max_examples=60)
@given(_snapshots(), st.integers(0, 2**32 - 1))
def test_with_busy_agents_the_batch_assigns_as_the_core_looks_ahead(
    snapshots: tuple[np.ndarray, np.ndarray], seed: int
) -> None:
    costs_q, possible = snapshots
    busy = (np.random.default_rng(seed).random(costs_q.shape[:2]) < 0.4)[:, :, None]
    eligible, promisable = possible & ~busy, possible & busy
    expected = [assign_ahead(*arrays) for arrays in zip(costs_q, eligible, promisable, strict=True)]
    np.testing.assert_array_equal(best_slots(costs_q, eligible, promisable), expected)


@settings(deadline=None, max_examples=60)
@given(_snapshots())
def test_at_these_prices_the_optimal_task_is_everybodys_cheapest(
    snapshots: tuple[np.ndarray, np.ndarray],
) -> None:
    costs_q, eligible = snapshots
    value = 8.0  # far above any cost, so that as many as can be are assigned
    prices = task_prices(costs_q, eligible, value)
    assert ((prices >= 0.0) & (prices <= value)).all()
    reduced = np.where(eligible, np.square(costs_q / 254.0) + prices[:, None, :], np.inf)
    slots = best_slots(costs_q, eligible)
    batch, agent = np.nonzero(slots >= 0)
    own = reduced[batch, agent, slots[batch, agent]]
    np.testing.assert_allclose(own, reduced[batch, agent].min(axis=1), atol=1e-5)
