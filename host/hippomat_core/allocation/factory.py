"""Allocators by the name that `[fleet] allocator` has. The one place that knows them all."""

from __future__ import annotations

from hippomat_core.allocation.greedy import Greedy
from hippomat_core.allocation.hungarian import Hungarian
from hippomat_core.allocation.paper_network import PaperNetwork, load_weights
from hippomat_core.allocation.port import Allocator
from hippomat_core.allocation.random_request import RandomRequest
from hippomat_core.errors import ConfigError


def make_allocator(name: str, policy_bytes: bytes | None, robots: int, tasks: int) -> Allocator:
    """The allocator called `name` for a fleet of N robots and M task slots; ConfigError names the remedy."""
    if name == "hungarian":
        return Hungarian()
    if name == "greedy":
        return Greedy()
    if name == "random":
        return RandomRequest()
    if name == "paper_network":
        if policy_bytes is None:
            raise ConfigError(
                "[fleet] allocator = 'paper_network' needs weights: set [fleet] policy to a safetensors file"
            )
        return PaperNetwork(load_weights(policy_bytes, robots, tasks))
    known = "hungarian, greedy, random, paper_network"
    raise ConfigError(f"[fleet] allocator = {name!r} is unknown; known: {known}")
