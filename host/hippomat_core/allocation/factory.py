"""Allocators by the name that `[fleet] allocator` has. The one place that knows them all."""

from __future__ import annotations

from collections.abc import Callable

from hippomat_core.allocation.auction import Auction
from hippomat_core.allocation.fixed_slot import FixedSlot
from hippomat_core.allocation.graphsage import load_graphsage
from hippomat_core.allocation.greedy import Greedy
from hippomat_core.allocation.hungarian import Hungarian
from hippomat_core.allocation.ipso_g import IpsoG
from hippomat_core.allocation.look_ahead import LookAhead
from hippomat_core.allocation.nearest import Nearest
from hippomat_core.allocation.paper_network import PaperNetwork, load_weights
from hippomat_core.allocation.policy_file import read_policy
from hippomat_core.allocation.port import Allocator
from hippomat_core.allocation.random_request import RandomRequest
from hippomat_core.errors import ConfigError


def _paper_network(policy_bytes: bytes, robots: int, tasks: int) -> Allocator:
    return PaperNetwork(load_weights(policy_bytes, robots, tasks))


def _graphsage(policy_bytes: bytes, robots: int, tasks: int) -> Allocator:  # noqa: ARG001 - fits every fleet
    return load_graphsage(read_policy(policy_bytes, "graphsage"))


BASELINES: dict[str, Callable[[], Allocator]] = {
    "hungarian": Hungarian,
    "look_ahead": LookAhead,
    "greedy": Greedy,
    "nearest": Nearest,
    "auction": Auction,
    "ipso_g": IpsoG,
    "random": RandomRequest,
    "fixed_slot": FixedSlot,
}
POLICIES: dict[str, Callable[[bytes, int, int], Allocator]] = {
    "graphsage": _graphsage,
    "paper_network": _paper_network,
}
ALLOCATORS = (*BASELINES, *POLICIES)


def make_allocator(name: str, policy_bytes: bytes | None, robots: int, tasks: int) -> Allocator:
    """The allocator called `name` for a fleet of N robots and M task slots; ConfigError names the remedy."""
    if name in BASELINES:
        return BASELINES[name]()
    if name not in POLICIES:
        raise ConfigError(f"[fleet] allocator = {name!r} is unknown; known: {', '.join(ALLOCATORS)}")
    if policy_bytes is None:
        raise ConfigError(
            f"[fleet] allocator = {name!r} needs weights: set [fleet] policy to a safetensors file"
        )
    return POLICIES[name](policy_bytes, robots, tasks)
