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
from hippomat_core.allocation.warm_up import warm_up
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


def header_alone(header: bytes) -> bytes:
    return len(header).to_bytes(8, "little") + header


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
        (
            save({}, {"format": "hippomat-policy-1", "network": "graphsage", "settings": "[" * 100_000}),
            "settings is not JSON",
        ),
        (
            save({}, {"format": "hippomat-policy-1", "network": "graphsage", "settings": "9" * 5000}),
            "settings is",
        ),
        (header_alone(b'{"__metadata__": null}'), "not valid safetensors"),
    ],
    ids=lambda value: (
        value if isinstance(value, str) else f"{len(value)} bytes"
    ),  # safetensors orders keys anew each time
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
            "'out.bias' has 3 values that are not finite",
        ),
    ],
)
def test_a_policy_that_does_not_fit_names_tensor_or_setting(data: bytes, message: str):
    with pytest.raises(ConfigError, match=message):
        make_allocator("graphsage", data, 3, 4)


def test_a_setting_larger_than_any_float_is_refused():
    with pytest.raises(ConfigError, match="too large"):
        load_graphsage(read_policy(changed(settings={**SMALL.as_dict(), "tau_first": 10**400})))


# ---- weights that no robot can decide with ----


def edge_weights(value: float) -> bytes:
    """Every weight of this size, its sign as it was."""
    return changed(tensors={key: np.copysign(np.float32(value), w) for key, w in policy().tensors.items()})


def papers_weights(value: float, robots: int = 0, whose: int = 0) -> bytes:
    """The paper's network for four tasks; robots: one for each, of which `whose` has these weights."""
    draw = np.random.default_rng(1)
    tensors = {}
    for key, shape in paper_shapes(4).items():
        tensor = draw.normal(size=(*(robots,) * bool(robots), *shape)).astype("f4")
        chosen = tensor[whose] if robots else tensor
        chosen[...] = np.copysign(np.float32(value), chosen)
        tensors[key] = tensor
    return save(tensors)


@pytest.mark.parametrize("value", [np.nan, np.inf])
@pytest.mark.parametrize(
    ("network", "make"), [("graphsage", edge_weights), ("paper_network", papers_weights)]
)
def test_weights_that_are_no_numbers_are_refused(network, make, value):
    with pytest.raises(ConfigError, match=r"policy tensor '[a-z_.0-9]+' has \d+ values that are not finite"):
        make_allocator(network, make(value), 3, 4)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(
    ("network", "data"),
    [
        ("graphsage", edge_weights(3e38)),
        ("paper_network", papers_weights(3e38)),
        ("paper_network", papers_weights(3e38, robots=3, whose=2)),
    ],
)
def test_weights_too_large_to_decide_with_are_found_before_the_first_round(network, data):
    allocator = make_allocator(network, data, 3, 4)
    with pytest.raises(ConfigError, match=rf"'{network}' .*action \d is (nan|-?inf).*export it again"):
        warm_up(allocator, 3, 4)


@pytest.mark.parametrize("value", [1e-3, 1.0, 10.0])
def test_weights_of_any_usual_size_decide(value):
    warm_up(make_allocator("graphsage", edge_weights(value), 3, 4), 3, 4)
    warm_up(make_allocator("paper_network", papers_weights(value), 3, 4), 3, 4)


def test_a_file_of_a_network_that_no_robot_runs_says_so():
    data = changed(network="gcn")
    with pytest.raises(ConfigError, match="no robot runs it: give a file of network 'graphsage'"):
        read_policy(data, "graphsage")
