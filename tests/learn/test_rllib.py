"""RLlib: the same trajectories, the same networks, training that changes weights, ports on loopback alone.

Ray is imported in the tests: it reads at its import that it shall stay on loopback.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import pytest
import torch
from world_samples import SMALL

from hippomat_core.errors import ConfigError
from hippomat_sim.learn.checkpoint import load_checkpoint, save_checkpoint
from hippomat_sim.learn.cli import main
from hippomat_sim.learn.env import VectorEnv
from hippomat_sim.learn.networks import PolicyNetwork, make_network, policy_inputs
from hippomat_sim.learn.parallel_env import AllocationParallelEnv
from hippomat_sim.learn.ray_session import LOCAL, ray_session, stay_on_loopback
from hippomat_sim.learn.rllib import train_with_ray
from hippomat_sim.learn.settings import EnvSettings
from hippomat_sim.learn.train_settings import TrainSettings, load_train_settings, settings_to_dict
from hippomat_sim.learn.training import fresh_network
from hippomat_sim.learn.world_pool import WorldPool, make_pool

WORLD = replace(SMALL, sites=20)
CPU = torch.device("cpu")
FIXED = EnvSettings(agents=4, tasks=4, episode_steps=10, world=WORLD)
CONTINUOUS = EnvSettings(agents=3, tasks=5, turnover="on_claim", episode_steps=15, world=WORLD)
LOSSY = replace(CONTINUOUS, loss=0.4, relay=False)
NETWORKS: dict[str, dict[str, Any]] = {
    "graphsage": {"head_steps": 6},
    "paper_network": {"policy_input": "xz", "independent": True},
    "gcn": {},
}

stay_on_loopback()
pytest.importorskip("ray.rllib")


@pytest.fixture(scope="module")
def pool() -> WorldPool:
    return make_pool(WORLD)  # from the disk, as the environments that RLlib makes find it


def small(preset: str, **options: Any) -> TrainSettings:
    """A preset with three agents, five tasks and batches of 40 steps."""
    settings = load_train_settings(preset)
    episode = replace(
        settings.episodes[0],
        turnover="on_claim",
        agents=(3, 3),
        tasks=(5, 5),
        fragment_steps=20,
        episode_steps=20,
        copies=2,
    )
    return replace(
        settings,
        network=replace(settings.network, options={**settings.network.options, **options}),
        ppo=replace(settings.ppo, epochs=2, minibatch=20, learning_rate=1e-3),
        budget=replace(settings.budget, agent_steps=120, evaluate_sizes=(3,), evaluate_episodes=4),
        environment=replace(settings.environment, world=WORLD),
        episodes=(episode,),
    )


@pytest.mark.parametrize("settings", [FIXED, CONTINUOUS, LOSSY], ids=["fixed", "continuous", "loss"])
def test_the_registered_environment_plays_as_the_vectorised_one(
    settings: EnvSettings, pool: WorldPool
) -> None:
    from ray.tune.registry import ENV_CREATOR, _global_registry

    import hippomat_sim.learn.rllib_env  # noqa: F401 - registers it

    env = _global_registry.get(ENV_CREATOR, "hippomat-allocation")({"settings": settings, "seed": 5})
    vector = VectorEnv(settings, pool, 1, seed=5)
    observations, _ = env.reset()
    vector.reset()
    random, ends = np.random.default_rng(1), 0
    for _ in range(60):
        actions = random.integers(0, settings.tasks + 1, settings.agents)
        observations, rewards, terminated, truncated, _ = env.step(
            dict(zip(env.agents, actions.tolist(), strict=True))
        )
        step = vector.step(actions[None])
        seen = step.final or (vector.views() if settings.loss else step.problems)
        assert list(rewards.values()) == step.rewards[0].tolist()
        assert terminated["__all__"] == step.terminated[0]
        assert truncated["__all__"] == step.truncated[0]
        for robot, observed in enumerate(observations.values()):
            problem = seen.problem(robot if len(seen) > 1 else 0)
            np.testing.assert_array_equal(observed["costs_q"], problem.costs_q)
            np.testing.assert_array_equal(observed["observation"], problem.observations()[robot])
        if step.final is not None:
            env.reset()
            ends += 1
    assert ends >= 3


def test_two_workers_do_not_play_the_same_episodes(pool: WorldPool) -> None:  # noqa: ARG001 - prepared
    from hippomat_sim.learn.rllib_env import AllocationMultiAgentEnv

    first, second = (AllocationMultiAgentEnv(CONTINUOUS, worker=worker) for worker in (1, 2))
    rows = [env.reset(seed=9)[0]["agent_0"]["costs_q"] for env in (first, second)]
    assert (rows[0] != rows[1]).any()


def test_the_reward_of_a_team_is_the_sum_for_everybody(pool: WorldPool) -> None:  # noqa: ARG001 - prepared
    from hippomat_sim.learn.rllib_env import AllocationMultiAgentEnv

    own, team = (AllocationMultiAgentEnv(CONTINUOUS, team_reward=team) for team in (False, True))
    own.reset()
    team.reset()
    requests = {"agent_0": 1, "agent_1": 1, "agent_2": 3}
    assert set(team.step(requests)[1].values()) == {sum(own.step(requests)[1].values())}


@pytest.mark.parametrize("name", NETWORKS)
@pytest.mark.parametrize("settings", [CONTINUOUS, LOSSY], ids=["common", "loss"])
def test_a_module_says_what_the_network_says_to_its_agent(
    name: str, settings: EnvSettings, pool: WorldPool
) -> None:
    from hippomat_sim.learn.rllib_module import load_modules, module_settings, module_weights, own_outputs

    agents, tasks = settings.agents, settings.tasks
    network = shaken(make_network(name, NETWORKS[name], agents, tasks))
    count = agents if name == "paper_network" else 1
    modules = [make_network(name, module_settings(network), agents, tasks) for _ in range(count)]
    for at, module in enumerate(modules):
        module.load_state_dict(module_weights(network, at))
    env, vector = AllocationParallelEnv(settings, pool, seed=2), VectorEnv(settings, pool, 1, seed=2)
    observations, _ = env.reset()
    vector.reset()
    logits, values = network.evaluate(policy_inputs(vector.views()))
    for robot, observed in enumerate(observations.values()):
        stacked = {key: torch.from_numpy(np.stack([value, value])) for key, value in observed.items()}
        own_logits, own_values = own_outputs(modules[robot % count], stacked)
        for row in range(2):
            torch.testing.assert_close(own_logits[row], logits[robot, robot])
            torch.testing.assert_close(own_values[row], values[robot, robot])
    again = make_network(name, NETWORKS[name], agents, tasks)
    load_modules(again, [module.state_dict() for module in modules])
    for key, value in network.state_dict().items():
        assert torch.equal(again.state_dict()[key], value)


def shaken(network: PolicyNetwork) -> PolicyNetwork:
    torch.manual_seed(3)
    with torch.no_grad():
        for parameter in network.parameters():
            parameter.add_(0.3 * torch.randn_like(parameter))
    return network


@pytest.mark.timeout(400)
def test_one_iteration_changes_the_weights_and_listens_on_loopback_alone(
    pool: WorldPool, tmp_path: Path
) -> None:
    settings, listened = small("rllib", head_steps=6), set[str]()
    training = train_with_ray(
        settings, pool, tmp_path, CPU, lambda _: listened.update(listening()), lambda: False
    )
    assert listened == {"127.0.0.1"}
    assert training.done
    assert training.clock.agent_steps >= 120
    row = training.rows[-1]
    assert {"reward", "team_reward", "entropy", "policy_loss", "value_loss", "evaluation"} <= row.keys()
    assert_changed(training.network, fresh_network(settings))
    saved = load_checkpoint(tmp_path)["network"]
    assert all(torch.equal(saved[key], value) for key, value in training.network.state_dict().items())

    longer = replace(settings, budget=replace(settings.budget, agent_steps=240))
    resumed = train_with_ray(longer, pool, tmp_path, CPU, lambda _: None, lambda: False, resume=True)
    assert resumed.clock.update == training.clock.update + 1
    assert [row["update"] for row in resumed.rows] == list(range(1, resumed.clock.update + 1))
    assert_changed(resumed.network, training.network)


@pytest.mark.timeout(400)
def test_every_agent_of_the_papers_network_learns_weights_of_its_own(pool: WorldPool, tmp_path: Path) -> None:
    settings = small("paper")
    training = train_with_ray(settings, pool, tmp_path, CPU, lambda _: None, lambda: False)
    before, after = fresh_network(settings).state_dict(), training.network.state_dict()
    for key, value in after.items():
        assert len(value) == 3
        assert all((value[agent] != before[key][agent]).any() for agent in range(3)), key


def listening() -> Iterator[str]:
    """Addresses on which this process and its children wait for connections."""
    me = psutil.Process()
    for process in [me, *me.children(recursive=True)]:
        for connection in process.net_connections("inet"):
            if connection.status == psutil.CONN_LISTEN:
                yield connection.laddr.ip.removeprefix("::ffff:")


def assert_changed(network: PolicyNetwork, before: PolicyNetwork) -> None:
    old = before.state_dict()
    assert any((value != old[key]).any() for key, value in network.state_dict().items())
    assert all(value.isfinite().all() for value in network.state_dict().values())


def test_without_ray_the_remedy_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "ray.rllib", None)
    with pytest.raises(ConfigError, match=r"pip install 'hippomat\[ray\]'"), ray_session(LOCAL, 1):
        pass


def test_a_run_goes_on_the_way_it_began(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    state = {"settings": json.dumps(settings_to_dict(small("rllib"))), "network": {}}
    save_checkpoint(tmp_path, state)
    assert main(["--resume", str(tmp_path)]) == 1
    assert capsys.readouterr().err == (
        f"hippomat-train: --resume {tmp_path}: it was trained through RLlib: add --ray\n"
    )


def test_runners_are_rays(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--runners", "2"]) == 1
    assert capsys.readouterr().err == "hippomat-train: --runners 2: they are Ray's; add --ray\n"


def test_a_cluster_that_does_not_answer_is_one_line() -> None:
    words = r"--ray 127\.0\.0\.1:1: no Ray cluster there \(.*\); start one"
    with pytest.raises(ConfigError, match=words), ray_session("127.0.0.1:1", 1):
        pass


@pytest.mark.parametrize(
    ("preset", "words"),
    [
        ("default", r"RLlib's PPO cannot do ppo\.advantage = 'counterfactual'"),
        ("lossy", r'\[\[episodes\]\] loss with advantage = "gae"'),
        ("mixture", r"--ray trains one size: found 2 \[\[episodes\]\]"),
        ("odd", r"--ray with 3 runners: they cannot share 2 copies"),
    ],
)
def test_what_rllib_cannot_do_is_refused(preset: str, words: str) -> None:
    from hippomat_sim.learn.rllib_config import ppo_config

    settings = load_train_settings("default") if preset == "default" else small("rllib")
    if preset == "mixture":
        settings = replace(settings, episodes=settings.episodes * 2)
    if preset == "lossy":
        settings = replace(settings, episodes=(replace(settings.episodes[0], loss=0.3),))
    with pytest.raises(ConfigError, match=words):
        ppo_config(settings, fresh_network(settings), CPU, runners=3 if preset == "odd" else 0)
