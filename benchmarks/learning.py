"""The cases of learning: what a step of the environment and a decision of the learned policy cost."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from itertools import cycle

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from benchmarks.measure import Result, compare
from hippomat_core.allocation.factory import make_allocator
from hippomat_core.allocation.port import Allocator, Problem
from hippomat_sim.learn.env import VectorEnv
from hippomat_sim.learn.export import policy_file
from hippomat_sim.learn.ippo import Ippo
from hippomat_sim.learn.networks import PolicyInputs, policy_inputs
from hippomat_sim.learn.networks.graphsage import GraphSageNetwork
from hippomat_sim.learn.parallel_env import AllocationParallelEnv
from hippomat_sim.learn.rollout import Collector
from hippomat_sim.learn.settings import EnvSettings, WorldSettings
from hippomat_sim.learn.train_settings import load_train_settings
from hippomat_sim.learn.training import fresh_network
from hippomat_sim.learn.world_pool import WorldPool, make_pool

AGENTS = TASKS = 30
COPIES = 600  # hundreds: the call from Python is shared by all


def env_step_fixed() -> Result:
    """Every agent requests a slot of its own: each step ends an episode: the dearest step."""
    everyone_its_own = np.arange(1, AGENTS + 1)
    return _env_step("fixed", "never", np.tile(everyone_its_own, (1, COPIES, 1)))


def env_step_continuous() -> Result:
    """Random requests, after a while in which most agents have become busy."""
    return _env_step(
        "continuous", "on_claim", np.random.default_rng(0).integers(0, TASKS + 1, (64, COPIES, AGENTS))
    )


def _env_step(name: str, turnover: str, actions: NDArray[np.int64]) -> Result:
    """Per copy. actions: (K, E, N), over and over."""
    settings = EnvSettings(agents=AGENTS, tasks=TASKS, turnover=turnover)
    many, one = VectorEnv(settings, _pool(), COPIES, 0), AllocationParallelEnv(settings, _pool())
    one.reset()
    turns = cycle(actions)
    for _ in range(2 * len(actions)):
        many.step(next(turns))
    asked = cycle([dict(zip(one.possible_agents, row.tolist(), strict=True)) for row in actions[:, 0]])

    def step_of_one() -> None:
        one.step(next(asked))
        if not one.agents:
            one.reset()

    found = compare(
        f"environment step of one copy, {name}, N = M = {AGENTS}",
        lambda: many.step(next(turns)),
        "the same as a PettingZoo env",
        step_of_one,
        pairs=7,
    )
    return replace(found, ours_us=found.ours_us / COPIES, ratio=found.ratio * COPIES)


def policy_decision() -> Result:
    """From the snapshot to one robot's action, beside the same network in torch."""
    inputs, network, allocator, problem = _decision()
    network.compiled = False

    def in_torch() -> None:
        with torch.no_grad():
            network(inputs).argmax(2)

    in_torch()
    return compare(
        f"decision of the edge network, N = M = {AGENTS}",
        lambda: allocator.allocate(problem),
        "torch eager, tensors ready",
        in_torch,
    )


def policy_decision_and_scipy() -> Result:
    _, _, allocator, problem = _decision()
    costs = np.square(problem.costs_q.astype(np.float64))
    return compare(
        f"decision of the edge network, N = M = {AGENTS}",
        lambda: allocator.allocate(problem),
        "scipy linear_sum_assignment",
        lambda: linear_sum_assignment(costs),
    )


def learner_pass() -> Result:
    """One pass of our recipe over a batch with cloning, per agent-step, on one thread."""
    settings = load_train_settings("default")
    fleet = replace(settings.episodes[0], agents=(8, 8))
    settings = replace(settings, episodes=(fleet,), environment=EnvSettings(world=_pool().settings))
    network = fresh_network(settings)
    assert isinstance(network, GraphSageNetwork)
    ippo = Ippo(network, settings.ppo, settings.signals, settings.seed, torch.device("cpu"))
    rollout = Collector(settings, _pool()).collect(ippo.act)

    def learn(compiled: bool) -> None:
        network.compiled = compiled
        ippo.learn(rollout, 0.0)

    found = compare(
        "our learner's pass over a batch, N = M = 8, per agent-step",
        lambda: learn(True),
        "torch's operations alone",
        lambda: learn(False),
        pairs=5,
    )
    passes = rollout.agent_steps * settings.ppo.epochs
    return replace(found, ours_us=found.ours_us / passes, peer_us=found.peer_us / passes)


@cache
def _decision() -> tuple[PolicyInputs, GraphSageNetwork, Allocator, Problem]:
    """One snapshot, and the network in torch and in the core; what weights are in it costs the same."""
    network = GraphSageNetwork()
    policy = policy_file(network, {}, {})
    allocator = make_allocator("graphsage", policy.to_bytes(), AGENTS, TASKS)
    copies = VectorEnv(EnvSettings(agents=AGENTS, tasks=TASKS), _pool(), 1, 0)
    problems = copies.reset()
    problem = problems.take([0]).problem(0)
    allocator.allocate(problem)  # compiles
    return policy_inputs(problems), network, allocator, problem


@cache
def _pool() -> WorldPool:
    """Worlds half as wide as the paper's: what a step costs does not depend on it, making them does."""
    settings = WorldSettings(size_m=(25, 25, 15), obstacles=10, starts=256, worlds=4)
    return make_pool(settings, cache=False)


CASES: dict[str, Callable[[], Result]] = {
    case.__name__: case
    for case in (
        env_step_fixed,
        env_step_continuous,
        learner_pass,
        policy_decision,
        policy_decision_and_scipy,
    )
}
