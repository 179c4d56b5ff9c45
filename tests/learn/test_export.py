"""Weights that a robot would refuse are neither exported nor measured, and the file is named."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from hippomat_core.allocation.paper_network import expected_shapes
from hippomat_core.allocation.policy_file import PolicyFile, read_policy
from hippomat_core.errors import ConfigError
from hippomat_logs.policy_files import packaged_policy
from hippomat_sim.learn.export import write_policy
from hippomat_sim.learn.method_registry import Sources, make_method, policy_manifest
from hippomat_sim.learn.runs import Fleet, Run

FLEET = Fleet(3, 4, "never")


def ours(value: float) -> PolicyFile:
    file = read_policy(packaged_policy())
    tensors = {key: np.copysign(np.float32(value), tensor) for key, tensor in file.tensors.items()}
    return PolicyFile(file.network, file.settings, {}, {}, tensors)


def papers(value: float, network: str = "paper_network") -> PolicyFile:
    """One network for each of three robots; the last one has these weights."""
    tensors = {key: np.zeros((3, *shape), np.float32) for key, shape in expected_shapes(4).items()}
    for tensor in tensors.values():
        tensor[2] = value
    return PolicyFile(network, {}, {}, {}, tensors)


@pytest.mark.parametrize(
    ("policy", "said"),
    [
        (ours(np.nan), "values that are not finite"),
        (ours(3e38), "the logit of action 1 is nan"),
        (papers(np.inf), "values that are not finite"),
        (papers(3e38), "the logit of action 0 is"),
        (papers(np.nan, "gcn"), "values that are not finite"),
    ],
)
def test_a_training_that_went_astray_is_not_exported(policy: PolicyFile, said: str, tmp_path: Path) -> None:
    path = tmp_path / "mine.safetensors"
    with pytest.raises(ConfigError, match=rf"mine\.safetensors: .*{said}.*train or export it again"):
        write_policy(policy, path)
    assert not path.exists()


@pytest.mark.parametrize("policy", [ours(1.0), papers(0.5)])
def test_weights_that_decide_are_exported(policy: PolicyFile, tmp_path: Path) -> None:
    path = tmp_path / "mine.safetensors"
    write_policy(policy, path)
    assert read_policy(path.read_bytes()).hash == policy.hash


@pytest.mark.parametrize("value", [np.nan, 3e38])
def test_the_tables_refuse_weights_that_cannot_decide_by_the_name_of_their_file(
    value: float, tmp_path: Path
) -> None:
    path = tmp_path / "mine.safetensors"
    path.write_bytes(ours(value).to_bytes())
    for name in ("graphsage", "graphsage_look_ahead", "graphsage_no_head"):
        with pytest.raises(ConfigError, match=r"--policy .*mine\.safetensors: "):
            make_method(name, FLEET, Sources(tmp_path, path))
    run = Run("paper", FLEET)
    run.policy(tmp_path).parent.mkdir()
    run.policy(tmp_path).write_bytes(papers(value).to_bytes())
    with pytest.raises(ConfigError, match=rf"{run.name}/policy\.safetensors: "):
        make_method("paper", FLEET, Sources(tmp_path))


def test_a_policy_that_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"--policy nowhere: there is no such file"):
        policy_manifest(Sources(tmp_path, Path("nowhere")))
