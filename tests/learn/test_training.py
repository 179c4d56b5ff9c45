"""Training runs: they learn, repeat, and go on after an interruption as if there had been none."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from env_lab import small_pool
from training_lab import GCN, OURS, PAPER

from hippomat_core.allocation.graphsage_settings import AGE
from hippomat_core.allocation.policy_file import read_policy
from hippomat_core.errors import ConfigError
from hippomat_sim.learn import ippo
from hippomat_sim.learn.checkpoint import FILE_NAME
from hippomat_sim.learn.export import exported_policy
from hippomat_sim.learn.ippo import Ippo
from hippomat_sim.learn.networks import make_network
from hippomat_sim.learn.networks.graphsage import GraphSageNetwork
from hippomat_sim.learn.rollout import Collector
from hippomat_sim.learn.train_settings import EpisodeSettings, TrainSettings
from hippomat_sim.learn.training import Training, TrainingDiverged, fresh_network
from hippomat_sim.learn.training_log import METRICS, read_metrics

LOSSY = replace(
    OURS,
    episodes=(
        EpisodeSettings(
            turnover="on_claim", agents=(3, 3), tasks=(4, 4), edges=600, fragment_steps=4, episode_steps=10,
            loss=0.5, relay=False,
        ),
    ),
)  # fmt: skip
CPU = torch.device("cpu")
_TIMES = ("collect_s", "learn_s")


def begun(settings: TrainSettings, folder: Path) -> Training:
    return Training(settings, small_pool(), folder, CPU)


def resumed(folder: Path) -> Training:
    return Training.resumed(folder, lambda _: small_pool(), CPU)


def run(training: Training, updates: int | None = None) -> list[dict[str, Any]]:
    """To its end, or for so many updates."""
    left = iter(range(updates - 1)) if updates is not None else None
    return training.run(lambda _: None, lambda: left is not None and next(left, None) is None)


def without_times(rows: list[dict[str, Any]]) -> list[dict[str, Any]]:
    return [{name: value for name, value in row.items() if name not in _TIMES} for row in rows]


def assert_equal_weights(one: Training, other: Training) -> None:
    theirs = other.network.state_dict()
    for name, tensor in one.network.state_dict().items():
        assert torch.equal(tensor, theirs[name]), name


@pytest.fixture
def two_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    """Batches so small are shared by two threads all the same."""
    monkeypatch.setattr(ippo, "_LEAST_EDGES", 1)


TWO_THREADS = replace(OURS, budget=replace(OURS.budget, threads=2))


@pytest.mark.usefixtures("two_threads")
def test_two_threads_learn_what_their_shards_say_by_their_size() -> None:
    learner = Ippo(fresh_network(OURS), OURS.ppo, OURS.signals, 0, CPU, threads=2)
    batch = learner._batch(Collector(OURS, small_pool()).collect(learner.act), 0.0)
    shards = learner._shards(batch)
    assert [len(shard) for shard in shards] == [-(-len(batch) // 2), len(batch) // 2]
    parts = [learner._descent(shard, 0.0)[0] * (len(shard) / len(batch)) for shard in shards]
    norm = torch.linalg.vector_norm(parts[0] + parts[1])
    torch.testing.assert_close(learner._step(shards, 0.0, cloning=True)["gradient"], norm)


@pytest.mark.usefixtures("two_threads")
@pytest.mark.parametrize(
    "settings", [OURS, TWO_THREADS, LOSSY, PAPER, GCN], ids=["ours", "threads", "loss", "paper", "gcn"]
)
def test_a_resumed_run_equals_one_that_was_never_interrupted(settings: TrainSettings, tmp_path: Path) -> None:
    whole = begun(settings, tmp_path / "whole")
    rows = run(whole)
    assert len(rows) > 3
    run(begun(settings, tmp_path / "parts"), updates=2)
    run(resumed(tmp_path / "parts"), updates=1)
    last = resumed(tmp_path / "parts")
    assert without_times(run(last)) == without_times(rows)
    assert_equal_weights(last, whole)


def test_rows_after_the_checkpoint_are_written_again(tmp_path: Path) -> None:
    run(begun(OURS, tmp_path), updates=2)
    before = read_metrics(tmp_path)
    path = tmp_path / METRICS
    path.write_text(path.read_text() + json.dumps({"update": 3, "agent_steps": 10**9}) + '\n{"upd')
    run(resumed(tmp_path), updates=1)
    rows = read_metrics(tmp_path)
    assert rows[:2] == before
    assert [row["update"] for row in rows] == [1, 2, 3]
    assert rows[2]["agent_steps"] < 10**9


def test_another_seed_trains_other_weights(tmp_path: Path) -> None:
    one, other = begun(OURS, tmp_path / "0"), begun(replace(OURS, seed=1), tmp_path / "1")
    assert not torch.equal(one.network.edge_in.weight, other.network.edge_in.weight)  # type: ignore[union-attr]


def test_the_learned_part_learns_to_avoid_conflicts(tmp_path: Path) -> None:
    signals = replace(OURS.signals, alone=False, clone_start=0.0, dual_price=0.0)
    network = replace(OURS.network, options={**OURS.network.options, "head": False, "hops": 2, "width": 8})
    settings = replace(OURS, network=network, signals=signals, episodes=OURS.episodes[:1])
    settings = replace(settings, budget=replace(settings.budget, agent_steps=15_000, evaluate_every=0))
    rows = run(begun(settings, tmp_path))
    early, late = (sum(row["conflict_free"] for row in part) / 20 for part in (rows[:20], rows[-20:]))
    assert late > early + 10.0


def test_weights_of_one_agent_learn_from_its_own_experience_alone() -> None:
    agents, tasks = PAPER.episodes[0].agents[0], 4
    collector = Collector(PAPER, small_pool())
    network = make_network("paper_network", {}, agents, tasks)
    learner = Ippo(network, PAPER.ppo, PAPER.signals, 0, CPU)
    rollout = collector.collect(learner.act)
    before = {name: tensor.clone() for name, tensor in network.state_dict().items()}
    others = torch.arange(agents) != 1
    rollout.rewards[:, :, others] = 0.0  # what the others earn must not matter to agent 1
    twin = make_network("paper_network", {}, agents, tasks)
    twin.load_state_dict(before)
    twin_ippo = Ippo(twin, PAPER.ppo, PAPER.signals, 0, CPU)
    twin_ippo.random.set_state(learner.random.get_state())
    learner.learn(rollout, 0.0)
    rollout.rewards[:, :, others] = torch.rand(rollout.rewards[:, :, others].shape)
    twin_ippo.learn(rollout, 0.0)
    theirs = twin.state_dict()
    for name, tensor in network.state_dict().items():
        torch.testing.assert_close(tensor[1], theirs[name][1], msg=name)
        assert not torch.equal(tensor[1], before[name][1])


def test_what_ended_is_bootstrapped_from_its_own_last_observation() -> None:
    rollout = Collector(PAPER, small_pool()).collect(
        Ippo(fresh_network(PAPER), PAPER.ppo, PAPER.signals, 0, CPU).act
    )
    copies = rollout.rewards.shape[1]
    assert rollout.truncated[14].all()  # episodes of 15 steps
    assert not rollout.terminated.any()
    assert rollout.final_at.tolist() == [14 * copies, 14 * copies + 1]
    assert rollout.finals is not None
    following = rollout.problems.take(rollout.final_at.numpy() + copies)  # the next episode has begun
    assert not (rollout.finals.costs_q == following.costs_q).all()
    assert not following.assigned.any()


def test_the_exported_file_holds_weights_and_how_they_came_to_be(tmp_path: Path) -> None:
    training = begun(OURS, tmp_path)
    run(training, updates=2)
    policy = exported_policy(tmp_path)
    again = read_policy(policy.to_bytes(), "graphsage")
    assert again.hash == policy.hash
    assert again.settings["head"]  # trained alone, shipped with its head
    assert again.settings["head_steps"] == 8
    assert again.training["ppo"]["learning_rate"] == OURS.ppo.learning_rate
    assert again.metrics["update"] == 2
    for name, tensor in training.network.to_tensors().items():
        assert (again.tensors[name] == tensor.numpy()).all()


def test_networks_of_one_size_refuse_a_mixture(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="built for one number of agents"):
        begun(replace(PAPER, episodes=OURS.episodes), tmp_path)


def test_under_loss_everybody_decides_on_its_own_view() -> None:
    learner = Ippo(fresh_network(LOSSY), LOSSY.ppo, LOSSY.signals, 0, CPU)
    rollout = Collector(LOSSY, small_pool()).collect(learner.act)
    snapshots, agents = rollout.actions.shape
    assert rollout.own is not None
    assert rollout.own.tolist() == list(range(agents)) * snapshots
    assert len(rollout.views) == snapshots * agents
    rows = np.arange(len(rollout.views))
    own_costs = rollout.views.costs_q[rows, rollout.own.numpy()]
    np.testing.assert_array_equal(own_costs, rollout.problems.costs_q.reshape(own_costs.shape))
    assert (rollout.views.ages_rounds[rollout.views.present] > 0).any()
    batch = learner._batch(rollout, 0.0)
    mine = batch.acting.view(snapshots, agents, agents)
    assert not mine[:, ~torch.eye(agents, dtype=torch.bool)].any()
    own_actions = batch.actions.view(snapshots, agents, agents).diagonal(dim1=1, dim2=2)
    assert torch.equal(own_actions, rollout.actions)


def test_who_had_no_choice_leaves_no_trace_in_the_gradient() -> None:
    """A masked action's log-probability is so large that rounding alone moves it by more than exp() holds."""
    learner = Ippo(fresh_network(LOSSY), LOSSY.ppo, LOSSY.signals, 0, CPU)
    batch = learner._batch(Collector(LOSSY, small_pool()).collect(learner.act), 0.0)
    rounded = torch.where(batch.acting, batch.log_probs, batch.log_probs - 128.0)
    gradient, _ = learner._descent(replace(batch, log_probs=rounded), 0.0)
    assert torch.isfinite(gradient).all()
    expected, _ = learner._descent(batch, 0.0)
    torch.testing.assert_close(gradient, expected)


def test_training_under_loss_teaches_the_age_of_a_row(tmp_path: Path) -> None:
    training = begun(LOSSY, tmp_path)
    network = training.network
    assert isinstance(network, GraphSageNetwork)
    assert not network.edge_in.weight[:, AGE].any()
    run(training)
    assert network.edge_in.weight[:, AGE].any()
    without = begun(OURS, tmp_path / "without")
    run(without)
    assert isinstance(without.network, GraphSageNetwork)
    assert not without.network.edge_in.weight[:, AGE].any()


def test_loss_that_cannot_be_trained_with_is_refused_by_name(tmp_path: Path) -> None:
    with pytest.raises(
        ConfigError, match=r"\[environment\] loss = 0\.3, .* set loss and relay in \[\[episodes"
    ):
        begun(replace(OURS, environment=replace(OURS.environment, loss=0.3)), tmp_path)
    generalised = replace(PAPER, episodes=(replace(PAPER.episodes[0], loss=0.3),))
    with pytest.raises(ConfigError, match='set loss = 0 or advantage = "counterfactual"'):
        begun(generalised, tmp_path)
    fixed = replace(LOSSY, episodes=(replace(LOSSY.episodes[0], turnover="never"),))
    with pytest.raises(ConfigError, match='set loss = 0 or turnover = "on_claim"'):
        begun(fixed, tmp_path)


def test_settings_of_the_cloned_head_are_checked_before_the_run(tmp_path: Path) -> None:
    for values, words in (({"head_stepz": 3}, "head_stepz: unknown"), ({"head_steps": 3.5}, "is not int")):
        with pytest.raises(ConfigError, match=words):
            begun(replace(OURS, signals=replace(OURS.signals, clone_head=values)), tmp_path)


def test_a_run_that_diverges_says_so_and_keeps_its_checkpoint(
    tmp_path: Path,
) -> None:
    run(begun(OURS, tmp_path), updates=1)
    before = (tmp_path / FILE_NAME).read_bytes()
    training = resumed(tmp_path)
    with torch.no_grad():
        next(training.network.parameters()).fill_(torch.nan)
    with pytest.raises(TrainingDiverged, match=r"nan at update 2: .* lower \[ppo\] learning_rate"):
        run(training)
    assert (tmp_path / FILE_NAME).read_bytes() == before


def test_what_cannot_be_resumed_is_said(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=f"there is no {FILE_NAME}"):
        resumed(tmp_path)
    (tmp_path / FILE_NAME).write_bytes(b"not a checkpoint")
    with pytest.raises(ConfigError, match="not a readable checkpoint"):
        resumed(tmp_path)
