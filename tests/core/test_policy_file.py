"""Policy files: what is written is read again, and whatever does not fit is named."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from safetensors.numpy import save

from hippomat_core.allocation.factory import make_allocator
from hippomat_core.allocation.graphsage import expected_shapes, load_graphsage
from hippomat_core.allocation.graphsage_settings import GraphSageSettings
from hippomat_core.allocation.paper_network import expected_shapes as paper_shapes
from hippomat_core.allocation.policy_file import PolicyFile, read_policy
from hippomat_core.errors import ConfigError

SMALL = GraphSageSettings(hops=1, width=4, hidden=8, heads=2)


def policy(settings: GraphSageSettings = SMALL) -> PolicyFile:
    random = np.random.default_rng(1)
    tensors = {
        key: random.normal(size=shape).astype("f4") for key, shape in expected_shapes(settings).items()
    }
    return PolicyFile("graphsage", settings.as_dict(), {"seed": 1}, {"cf1": 0.99}, tensors)


def changed(**changes: object) -> bytes:
    return dataclasses.replace(policy(), **changes).to_bytes()  # type: ignore[arg-type]


def test_a_policy_is_read_as_it_was_written():
    written = policy()
    read = read_policy(written.to_bytes(), "graphsage")
    assert (read.network, read.settings, read.training, read.metrics) == (
        written.network,
        written.settings,
        written.training,
        written.metrics,
    )
    assert read.hash == written.hash
    assert all(np.array_equal(read.tensors[key], tensor) for key, tensor in written.tensors.items())
    assert load_graphsage(read).settings == SMALL


def test_the_hash_counts_what_decides_and_nothing_else():
    base = policy()
    assert dataclasses.replace(base, metrics={"cf1": 0.5}, training={}).hash == base.hash
    assert dataclasses.replace(base, settings={**base.settings, "head_steps": 5}).hash != base.hash
    tensors = {**base.tensors, "out.bias": base.tensors["out.bias"] + 1}
    assert dataclasses.replace(base, tensors=tensors).hash != base.hash


def test_weights_without_a_manifest_are_the_papers_network():
    tensors = {key: np.zeros(shape, np.float32) for key, shape in paper_shapes(2).items()}
    assert read_policy(save(tensors)).network == "paper_network"
    assert make_allocator("paper_network", save(tensors), 3, 2).name == "paper_network"
    with pytest.raises(ConfigError, match=r"network 'paper_network', needed 'graphsage'.*allocator"):
        read_policy(save(tensors), "graphsage")


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"", "not valid safetensors"),
        (policy().to_bytes()[:-4], "not valid safetensors"),
        (
            save({"a": np.zeros(1, np.float32)}, {"format": "other-2"}),
            "format 'other-2', needed 'hippomat-policy-1'",
        ),
        (
            save({}, {"format": "hippomat-policy-1", "network": "mlp"}),
            "network 'mlp', needed one of: graphsage",
        ),
        (
            save({}, {"format": "hippomat-policy-1", "network": "graphsage", "settings": "{"}),
            "settings is not JSON",
        ),
        (
            save({}, {"format": "hippomat-policy-1", "network": "graphsage", "settings": "[]"}),
            "settings is list, needed an object",
        ),
    ],
)
def test_bytes_that_are_no_policy_are_refused(data: bytes, message: str):
    with pytest.raises(ConfigError, match=message):
        read_policy(data)


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (changed(settings={"hops": 99}), "hops = 99 is outside 0 .. 16"),
        (changed(settings={"layers": 2}), "'layers' is unknown; known: hops"),
        (changed(settings={"head": 1}), "head = 1 is not bool"),
        (changed(settings={"tau_last": "small"}), "tau_last = 'small' is not float"),
        (
            changed(settings={**SMALL.as_dict(), "hops": 0}),
            r"no graphsage: missing \[\], unknown .*hops.0.mix",
        ),
        (changed(tensors={}), "missing .*edge_in.bias"),
        (
            changed(tensors={**policy().tensors, "edge_in.bias": np.zeros(9, np.float32)}),
            r"'edge_in.bias' is float32\[9\], needed float32\[8\]",
        ),
        (
            changed(tensors={**policy().tensors, "edge_in.bias": np.zeros(8)}),
            r"'edge_in.bias' is float64\[8\], needed float32\[8\]",
        ),
        (
            changed(tensors={**policy().tensors, "out.bias": np.full(3, np.nan, np.float32)}),
            "'out.bias' has values that are not finite",
        ),
    ],
)
def test_a_policy_that_does_not_fit_names_tensor_or_setting(data: bytes, message: str):
    with pytest.raises(ConfigError, match=message):
        make_allocator("graphsage", data, 3, 4)


def test_a_setting_larger_than_any_float_is_refused():
    with pytest.raises(ConfigError, match="too large"):
        load_graphsage(read_policy(changed(settings={**SMALL.as_dict(), "tau_first": 10**400})))
