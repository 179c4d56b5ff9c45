"""Which allocator and which weights the daemon decides with, and what it says of them before a port opens."""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import pytest
from safetensors.numpy import save
from test_host_cli import refused

from hippomat_core.allocation import factory
from hippomat_core.allocation.paper_network import expected_shapes
from hippomat_core.allocation.policy_file import read_policy
from hippomat_core.config import ALLOCATORS, POLICY_ALLOCATORS, Config, FleetConfig
from hippomat_core.errors import ConfigError
from hippomat_core.fleet.claims import COORDINATED
from hippomat_host.options import config_of, parser
from hippomat_host.startup import allocator_line
from hippomat_host.warm_up import prepare_allocator, told_if_slow
from hippomat_logs.numba_cache import SETTING
from hippomat_logs.policy_files import packaged_policy, policy_of


def configured(*arguments: str) -> Config:
    return config_of(parser().parse_args(["--port", "/dev/x", *arguments]))


def paper_weights(robots: int, tasks: int, per_robot: bool, value: float = 0.0) -> bytes:
    lead = (robots,) if per_robot else ()
    shapes = expected_shapes(tasks)
    return save({key: np.full((*lead, *shape), value, np.float32) for key, shape in shapes.items()})


def test_the_settings_and_the_factory_know_the_same_allocators():
    assert set(ALLOCATORS) == set(factory.ALLOCATORS)
    assert set(POLICY_ALLOCATORS) == set(factory.POLICIES)
    for name in factory.BASELINES:
        assert factory.make_allocator(name, None, 3, 4).name == name
    assert set(COORDINATED) <= set(factory.BASELINES)


def test_the_default_is_the_packaged_policy():
    fleet = Config().fleet
    assert fleet.allocator == "graphsage"
    assert policy_of(fleet) == packaged_policy()
    prefix = read_policy(packaged_policy(), "graphsage").hash[:12]
    assert allocator_line(fleet, policy_of(fleet)) == f"graphsage with the packaged policy, hash {prefix}"
    prepare_allocator(fleet, policy_of(fleet), lambda _: None)


def test_the_command_line_wins_over_the_file(tmp_path: Path):
    settings = tmp_path / "mine.toml"
    settings.write_text('[fleet]\nallocator = "greedy"\n')
    assert configured("--config", str(settings)).fleet.allocator == "greedy"
    fleet = configured("--config", str(settings), "--allocator", "paper_network", "--policy", "w").fleet
    assert (fleet.allocator, fleet.policy) == ("paper_network", "w")


def test_an_allocator_without_weights_says_so_and_reads_none():
    fleet = FleetConfig(allocator="hungarian", policy="/nowhere")
    assert policy_of(fleet) is None
    assert allocator_line(fleet, None) == "hungarian on the shared snapshot (no trained policy is in use)"


def test_weights_for_an_allocator_that_has_none_are_refused():
    with pytest.raises(ConfigError, match="--policy w: allocator 'greedy' has no weights"):
        configured("--allocator", "greedy", "--policy", "w")


def test_an_unknown_allocator_is_refused_with_the_known_ones():
    with pytest.raises(ConfigError, match=r"allocator = 'best' is not one of graphsage, .*fixed_slot"):
        configured("--allocator", "best")


def test_weights_of_each_robot_alone_are_said_and_left_out_of_the_digest():
    fleet = FleetConfig(policy_per_robot=True)
    assert "weights are not compared with the other robots'" in allocator_line(fleet, packaged_policy())


@pytest.mark.parametrize("per_robot", [False, True])
def test_one_file_holds_the_paper_networks_of_all_robots_or_one_for_all(tmp_path: Path, per_robot: bool):
    path = tmp_path / "paper.safetensors"
    path.write_bytes(paper_weights(5, 12, per_robot))
    fleet = FleetConfig(allocator="paper_network", policy=str(path))
    prepare_allocator(fleet, policy_of(fleet), pytest.fail)


def test_weights_that_do_not_fit_the_fleet_are_one_line_before_a_port_is_opened(tmp_path: Path):
    path = tmp_path / "paper.safetensors"
    path.write_bytes(paper_weights(5, 11, per_robot=False))
    chosen = ("--allocator", "paper_network", "--policy", path)
    line = refused("--port", "/dev/ttyUSB99", *chosen, cwd=tmp_path)
    assert f"{path}: policy tensor" in line
    assert "for 5 robots and 12 task slots" in line


@pytest.mark.parametrize(
    ("data", "found"),
    [
        (b"", "not valid safetensors"),
        (np.random.default_rng(1).bytes(4000), "not valid safetensors"),
        (paper_weights(5, 12, per_robot=False, value=np.nan), "has 128 values that are not finite"),
        (paper_weights(5, 12, per_robot=True, value=3e38), "the logit of action 0 is nan"),
        (paper_weights(4, 12, per_robot=True), "needed float32[5, 6, 25] for 5 robots"),
    ],
)
def test_weights_that_cannot_decide_are_one_line_that_names_their_file(
    tmp_path: Path, data: bytes, found: str
):
    path = tmp_path / "mine.safetensors"
    path.write_bytes(data)
    chosen = ("--allocator", "paper_network", "--policy", path)
    line = refused("--port", "/dev/ttyUSB99", *chosen, cwd=tmp_path)
    assert f"{path}: " in line
    assert found in line


@pytest.mark.parametrize("path", ["missing.safetensors", ".", "a\0b"])
def test_a_file_of_weights_that_cannot_be_read_is_named(path: str):
    with pytest.raises(
        ConfigError, match=r"policy = .* cannot be read: .*; give the path of a safetensors file"
    ):
        policy_of(FleetConfig(policy=path))


def test_an_empty_name_for_weights_is_not_taken_for_the_packaged_ones():
    with pytest.raises(ConfigError, match="--policy '' names no file"):
        configured("--policy", "")


def test_what_takes_long_is_said_while_it_takes_long():
    said: list[str] = []
    told = threading.Event()

    def say(text: str) -> None:
        said.append(text)
        told.set()

    with told_if_slow("compiling", say, patience_s=0.01):
        assert told.wait(10.0)
    assert said == ["compiling; only the first start takes so long ...", "compiling: done after 0 s"]


# ---- a place for compiled code ----


def test_a_read_only_install_without_a_home_compiles_into_a_directory_of_its_own(tmp_path: Path):
    """Files where directories should be made refuse even root."""
    blocked = tmp_path / "blocked"
    blocked.write_text("")
    script = (
        "import os, hippomat_core; hippomat_core.__file__ = '/dev/null/x/__init__.py';"
        "from hippomat_logs.numba_cache import ensure_numba_cache;"
        f"print(ensure_numba_cache()); print(os.environ[{SETTING!r}], os.path.isdir(os.environ[{SETTING!r}]))"
    )
    given = {"HOME": str(blocked), "XDG_CACHE_HOME": str(blocked), "TMPDIR": str(tmp_path)}
    environment = {key: value for key, value in os.environ.items() if key != SETTING}
    done = subprocess.run(
        [sys.executable, "-c", script], env={**environment, **given}, capture_output=True, text=True
    )
    said, place = done.stdout.splitlines()
    assert said.startswith("compiled code cannot be kept, so every start compiles it: set NUMBA_CACHE_DIR")
    directory, made = place.split()
    assert made == "True"
    assert Path(directory).parent == tmp_path
    assert not Path(directory).exists(), "it is gone with the process"


def test_where_numba_finds_a_place_nothing_is_changed_and_nothing_said(tmp_path: Path):
    script = (
        "import os; from hippomat_logs.numba_cache import ensure_numba_cache;"
        f"print(repr(ensure_numba_cache()), os.environ.get({SETTING!r}))"
    )
    given = {**os.environ, SETTING: str(tmp_path)}
    done = subprocess.run([sys.executable, "-c", script], env=given, capture_output=True, text=True)
    assert done.stdout.split() == ["''", str(tmp_path)]
