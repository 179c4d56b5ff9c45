"""Snapshots and networks for tests: seeded, with everything that a snapshot can hold."""

from __future__ import annotations

import numpy as np
import torch

from hippomat_core.allocation.graphsage import GraphSage, load_graphsage
from hippomat_core.allocation.graphsage_settings import AGE, GraphSageSettings
from hippomat_core.allocation.policy_file import PolicyFile, read_policy
from hippomat_sim.learn.networks import PolicyNetwork
from hippomat_sim.learn.networks.graphsage import GraphSageNetwork
from hippomat_sim.learn.problems import ProblemBatch


def plane_codes(random: np.random.Generator, count: int, agents: int, tasks: int) -> np.ndarray:
    """(B, N, M) codes of straight ways over 50 x 50 m, half of the agents at 5 m/s, half at 3 m/s."""
    starts, goals = random.uniform(0, 50, (count, agents, 1, 2)), random.uniform(0, 50, (count, 1, tasks, 2))
    speeds = np.where(np.arange(agents) % 2 == 0, 5.0, 3.0)
    costs_s = np.linalg.norm(starts - goals, axis=3) / speeds[:, None]
    return np.rint(254 * np.sqrt(np.clip(costs_s / 25.0, 0, 1))).astype(np.uint8)


def free_fleet(codes: np.ndarray) -> ProblemBatch:
    """Everybody is available, every task waits."""
    count, agents, tasks = codes.shape
    nobody, everybody = np.zeros((count, agents), np.bool_), np.ones((count, agents), np.bool_)
    return ProblemBatch(
        costs_q=codes,
        available=everybody,
        busy=nobody,
        waiting=np.ones((count, tasks), np.bool_),
        present=everybody.copy(),
        assigned=nobody.copy(),
        ages_rounds=np.zeros((count, agents), np.float32),
    )


def mixed_batch(random: np.random.Generator, count: int, agents: int, tasks: int) -> ProblemBatch:
    """Out of reach, busy, unheard, served and old in every mixture, and fleets where nothing is amiss."""
    codes = plane_codes(random, count, agents, tasks)
    closed = random.random(codes.shape) < random.choice([0.0, 0.0, 0.2, 0.6], (count, 1, 1))
    codes[closed] = 255
    present = random.random((count, agents)) < random.choice([1.0, 0.8], (count, 1))
    at_work = random.random((count, agents)) < random.choice([0.0, 0.0, 0.3, 0.9], (count, 1))
    waiting = random.random((count, tasks)) < random.choice([1.0, 0.6], (count, 1))
    ages = random.integers(0, 60, (count, agents)).astype(np.float32)
    idle = random.random((count, agents)) < 0.95
    codes[~present] = 255
    return ProblemBatch(codes, present & ~at_work & idle, present & at_work, waiting, present, at_work, ages)


def edge_network(seed: int = 0, **settings: object) -> GraphSageNetwork:
    """With random weights everywhere, also where training begins with zeros."""
    with torch.random.fork_rng(devices=[]):
        torch.manual_seed(seed)
        network = GraphSageNetwork(GraphSageSettings.from_dict(settings))
        for parameter in network.out.parameters():
            torch.nn.init.normal_(parameter, std=0.3)
        with torch.no_grad():
            network.edge_in.weight[:, AGE] = torch.randn(network.settings.hidden) * 0.1
    return network


def policy_bytes(network: PolicyNetwork) -> bytes:
    tensors = {key: tensor.numpy() for key, tensor in network.to_tensors().items()}
    return PolicyFile(network.network, network.settings_dict(), {}, {}, tensors).to_bytes()


def in_core(network: GraphSageNetwork) -> GraphSage:
    return load_graphsage(read_policy(policy_bytes(network), "graphsage"))
