"""The networks in torch, and the one place that knows them by the names presets and policy files use."""

from __future__ import annotations

from typing import Any

from hippomat_core.allocation.graphsage_settings import GraphSageSettings
from hippomat_core.errors import ConfigError
from hippomat_sim.learn.networks.flat import PaperNetwork
from hippomat_sim.learn.networks.gcn import GcnNetwork
from hippomat_sim.learn.networks.graphsage import GraphSageNetwork
from hippomat_sim.learn.networks.inputs import PolicyInputs, policy_inputs
from hippomat_sim.learn.networks.network import PolicyNetwork

__all__ = ["NETWORKS", "PolicyInputs", "PolicyNetwork", "make_network", "policy_inputs"]

NETWORKS = ("graphsage", "paper_network", "gcn")


def make_network(network: str, settings: dict[str, Any], agents: int, tasks: int) -> PolicyNetwork:
    """The network called `network` with fresh weights. settings: as `settings_dict` gives them."""
    if network == "graphsage":
        return GraphSageNetwork(GraphSageSettings.from_dict(settings))
    makers: dict[str, type[PaperNetwork] | type[GcnNetwork]] = {
        "paper_network": PaperNetwork,
        "gcn": GcnNetwork,
    }
    if network not in makers:
        raise ConfigError(f"network = {network!r} is unknown; known: {', '.join(NETWORKS)}")
    try:
        return makers[network](agents, tasks, **settings)
    except TypeError as error:
        raise ConfigError(f"settings of network {network!r}: {error}") from None
