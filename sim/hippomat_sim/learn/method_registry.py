"""Every way to allocate that the tables compare, by name, and how it comes by its weights.

A method whose weights are not there raises NotTrained with the command that makes them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from hippomat_core.allocation.auction import auction
from hippomat_core.allocation.factory import make_allocator
from hippomat_core.allocation.graphsage import load_graphsage
from hippomat_core.allocation.policy_file import PolicyFile, read_policy
from hippomat_core.allocation.port import Allocator, Problem
from hippomat_core.allocation.warm_up import warm_up
from hippomat_core.errors import ConfigError, HippomatError
from hippomat_logs.policy_files import PACKAGED, naming, packaged_policy
from hippomat_sim.learn.methods import AllocatorMethod, Method
from hippomat_sim.learn.runs import Fleet, Run


class NotTrained(HippomatError):
    """Weights that a method needs are missing; the message names the command that trains them."""


@dataclass(frozen=True, slots=True)
class Sources:
    """Where weights come from. policy: ours instead of the packaged one. runs: directory of training runs."""

    runs: Path
    policy: Path | None = None


def _one_message(_problem: Problem) -> int:
    """The robot's row of costs."""
    return 1


def _bids(problem: Problem) -> int:
    """An auction's robots share bids instead of rows, once in every round of it."""
    return auction(problem.costs_q, problem.eligible).rounds


@dataclass(frozen=True, slots=True)
class MethodSpec:
    """How a method is called, built and measured."""

    label: str
    make: Callable[[Fleet, Sources], Method]
    share: float = 1.0  # of the usual number of instances: slow methods get fewer, the first ones
    preset: str = ""  # what trains it; empty: nothing has to be trained, or the package has the weights
    any_size: bool = True  # False: trained for one fleet at a time
    one_shot: bool = True  # is measured in one-shot problems
    continuous: bool = True  # is measured in continuous ones
    paper: str = ""  # what the paper's tables call it
    messages: Callable[[Problem], int] = _one_message  # that each robot sends for one decision


def _core(name: str, alone: bool = False) -> Callable[[Fleet, Sources], Method]:
    def make(fleet: Fleet, _sources: Sources) -> Method:
        return AllocatorMethod(make_allocator(name, None, fleet.agents, fleet.tasks), alone=alone)

    return make


def _paper_network(preset: str) -> Callable[[Fleet, Sources], Method]:
    """Weights of one fleet's size each, run by the core as on a robot."""

    def make(fleet: Fleet, sources: Sources) -> Method:
        run = Run(preset, fleet)
        data = _trained(run, sources)
        with naming(str(run.policy(sources.runs))):
            allocator = make_allocator("paper_network", data, fleet.agents, fleet.tasks)
            return _decides(allocator, read_policy(data).hash, fleet)

    return make


def _in_torch(preset: str) -> Callable[[Fleet, Sources], Method]:
    """A network that no robot runs."""

    def make(fleet: Fleet, sources: Sources) -> Method:
        run = Run(preset, fleet)
        data = _trained(run, sources)
        from hippomat_sim.learn.torch_method import torch_method  # here: only these need torch

        with naming(str(run.policy(sources.runs))):
            return torch_method(data, fleet)

    return make


def _learned_part(fleet: Fleet, sources: Sources) -> Method:
    """Ours without a head, trained without one."""
    run = Run("learned_part")
    data = _trained(run, sources)
    with naming(str(run.policy(sources.runs))):
        file = read_policy(data, "graphsage")
        changed = replace(file, settings={**file.settings, "look_ahead": False})
        return _decides(load_graphsage(changed), changed.hash, fleet)


def _decides(allocator: Allocator, fingerprint: str, fleet: Fleet) -> AllocatorMethod:
    """ConfigError where the weights are finite and the decision is not."""
    warm_up(allocator, fleet.agents, fleet.tasks)
    return AllocatorMethod(allocator, fingerprint)


def _trained(run: Run, sources: Sources) -> bytes:
    path = run.policy(sources.runs)
    if not path.is_file():
        raise NotTrained(f"{run.name} is not trained: run `hippomat-bench tables --train`")
    return path.read_bytes()


def _ours(untrained: bool = False, **changes: bool) -> Callable[[Fleet, Sources], Method]:
    """The shipped policy with other options. untrained: what it was before training, the head alone."""

    def make(fleet: Fleet, sources: Sources) -> Method:
        file = our_policy(sources)
        tensors = dict(file.tensors)
        if untrained:  # training begins with an output layer of zeros
            tensors |= {name: np.zeros_like(tensors[name]) for name in ("out.weight", "out.bias")}
        changed = replace(file, tensors=tensors, settings={**file.settings, **changes})
        with naming(_our_name(sources)):
            return _decides(load_graphsage(changed), changed.hash, fleet)

    return make


def policy_manifest(sources: Sources) -> dict[str, Any]:
    """`training` and `metrics` of our policy's file."""
    file = our_policy(sources)
    return {"training": file.training, "metrics": file.metrics}


def our_policy(sources: Sources) -> PolicyFile:
    """Our weights: the packaged ones unless a file was given; ConfigError names it."""
    with naming(_our_name(sources)):
        if sources.policy is None:
            return read_policy(packaged_policy(), "graphsage")
        if not sources.policy.is_file():
            raise ConfigError("there is no such file; give the path of a safetensors file")
        return read_policy(sources.policy.read_bytes(), "graphsage")


def _our_name(sources: Sources) -> str:
    return PACKAGED if sources.policy is None else f"--policy {sources.policy}"


METHODS: dict[str, MethodSpec] = {
    "hungarian": MethodSpec("Hungarian", _core("hungarian"), paper="Hungarian"),
    "look_ahead": MethodSpec("look-ahead Hungarian", _core("look_ahead"), one_shot=False),
    "greedy": MethodSpec("sequential greedy", _core("greedy")),
    "auction": MethodSpec("auction", _core("auction"), messages=_bids),
    "ipso_g": MethodSpec("IPSO-G", _core("ipso_g", alone=True), share=0.1, paper="IPSO-G"),
    "nearest": MethodSpec("nearest", _core("nearest")),
    "random": MethodSpec("random", _core("random", alone=True), paper="Random"),
    "fixed_slot": MethodSpec("fixed slot", _core("fixed_slot")),
    "graphsage": MethodSpec("ours", _ours(look_ahead=False)),
    "graphsage_look_ahead": MethodSpec("ours, looking ahead", _ours(look_ahead=True), one_shot=False),
    "graphsage_untrained": MethodSpec(
        "ours, untrained", _ours(untrained=True, look_ahead=False), continuous=False
    ),
    "graphsage_no_head": MethodSpec("ours, learned part alone", _ours(look_ahead=False, head=False)),
    "learned_part": MethodSpec(
        "ours, trained without head", _learned_part, preset="learned_part", continuous=False
    ),
    "paper": MethodSpec(
        "the paper's network",
        _paper_network("paper"),
        preset="paper",
        any_size=False,
        paper="HIPPO-MAT",
    ),
    "no_neighbours": MethodSpec(
        "the same without neighbours",
        _paper_network("no_neighbours"),
        preset="no_neighbours",
        any_size=False,
    ),
    "mappo_gcn": MethodSpec(
        "MAPPO + GCN", _in_torch("mappo_gcn"), preset="mappo_gcn", any_size=False, paper="MAPPO+GCN"
    ),
}


def make_method(name: str, fleet: Fleet, sources: Sources) -> Method:
    """The method called `name` for this fleet; NotTrained, or ConfigError for weights of another shape."""
    return METHODS[name].make(fleet, sources)


def run_of(name: str, fleet: Fleet) -> Run | None:
    """The training run whose weights a method needs for this fleet; None where it needs none."""
    spec = METHODS[name]
    if not spec.preset:
        return None
    return Run(spec.preset) if spec.any_size else Run(spec.preset, fleet)
