"""Our settings as RLlib's PPOConfig: what corresponds, and what RLlib's PPO cannot do.

RLlib's new API stack. A batch is `copies` environments times `fragment_steps`, as in ippo.py. RLlib is told
to count decisions (agent steps), where we count snapshots. It standardises advantages over all steps, also
those without a choice.
"""

from __future__ import annotations

from typing import Any

import torch
from ray.rllib.algorithms.ppo import PPOConfig
from ray.rllib.core.rl_module.multi_rl_module import MultiRLModuleSpec
from ray.rllib.core.rl_module.rl_module import RLModuleSpec

from hippomat_core.errors import ConfigError
from hippomat_sim.learn.networks import PolicyNetwork
from hippomat_sim.learn.parallel_env import agent_name
from hippomat_sim.learn.rllib_env import ENV_NAME, register
from hippomat_sim.learn.rllib_module import MAKE_NETWORK, AllocationModule, has_own_weights, module_settings
from hippomat_sim.learn.rollout import check_loss, environment_of
from hippomat_sim.learn.settings import EnvSettings
from hippomat_sim.learn.train_settings import TrainSettings

SHARED = "shared"  # the module of networks with one set of weights


def module_names(network: PolicyNetwork, agents: int) -> list[str]:
    return [agent_name(robot) for robot in range(agents)] if has_own_weights(network) else [SHARED]


def environment_settings(settings: TrainSettings) -> EnvSettings:
    """The one environment of the run. ConfigError for a mixture of sizes: RLlib's batches have one shape."""
    episode = settings.episodes[0]
    (fewest, agents), tasks = episode.agents, episode.sizes(episode.agents[1])
    if len(settings.episodes) > 1 or fewest != agents or tasks[0] != tasks[1]:
        found = f"agents = {list(episode.agents)}, tasks = {list(episode.tasks)}"
        raise ConfigError(
            f"--ray trains one size: found {len(settings.episodes)} [[episodes]], the first with {found}; "
            "give one with agents = [N, N], tasks = [M, M], or use --config rllib"
        )
    return environment_of(settings.environment, episode, agents, tasks[0])


def ppo_config(
    settings: TrainSettings, network: PolicyNetwork, device: torch.device, runners: int
) -> PPOConfig:
    """Everything of a run. runners: processes beside this one that play; 0 = none."""
    _refuse(settings)
    register()
    environment, ppo = environment_settings(settings), settings.ppo
    episode = settings.episodes[0]
    copies = episode.copies_of(environment.agents, environment.tasks)
    names = module_names(network, environment.agents)
    decisions = environment.agents // len(names)  # of a module in one snapshot
    batch = copies * episode.fragment_steps
    config = PPOConfig()
    config.environment(ENV_NAME, env_config={"settings": environment, "team_reward": ppo.reward == "team"})
    config.env_runners(
        num_env_runners=runners,
        num_envs_per_env_runner=_copies_each(copies, runners),
        rollout_fragment_length=episode.fragment_steps * environment.agents,
    )
    config.learners(num_learners=0, num_gpus_per_learner=int(device.type == "cuda"))
    config.training(
        train_batch_size_per_learner=batch * environment.agents,
        num_epochs=ppo.epochs,
        minibatch_size=(ppo.minibatch or batch) * decisions,
        lr=_rates(settings, environment),
        gamma=ppo.gamma,
        lambda_=ppo.gae_lambda,
        clip_param=ppo.clip,
        entropy_coeff=ppo.entropy,
        vf_loss_coeff=ppo.value_coefficient,
        vf_clip_param=float("inf"),
        use_kl_loss=False,
        grad_clip=ppo.gradient_clip or None,
        grad_clip_by="global_norm",
    )
    _add_modules(config, network, names, environment)
    config.debugging(seed=settings.seed, log_level="ERROR")
    return config


def _add_modules(
    config: PPOConfig, network: PolicyNetwork, names: list[str], environment: EnvSettings
) -> None:
    arguments = {
        "network": network.network,
        "settings": module_settings(network),
        "agents": environment.agents,
        "tasks": environment.tasks,
    }
    spec = RLModuleSpec(module_class=AllocationModule, model_config={MAKE_NETWORK: arguments})
    config.rl_module(rl_module_spec=MultiRLModuleSpec(rl_module_specs=dict.fromkeys(names, spec)))
    own = len(names) > 1
    config.multi_agent(
        policies=names,
        policy_mapping_fn=lambda agent, *_, **__: agent if own else SHARED,
        count_steps_by="agent_steps",
    )


def _rates(settings: TrainSettings, environment: EnvSettings) -> Any:
    """The learning rate, or its line over the steps of the environments."""
    ppo = settings.ppo
    if ppo.final_rate == 1.0:
        return ppo.learning_rate
    steps = max(1, settings.budget.agent_steps // environment.agents)
    return [[0, ppo.learning_rate], [steps, ppo.learning_rate * ppo.final_rate]]


def _copies_each(copies: int, runners: int) -> int:
    if copies % max(1, runners):
        raise ConfigError(
            f"--ray with {runners} runners: they cannot share {copies} copies of the environment equally; "
            f"use a divisor of {copies}"
        )
    return copies // max(1, runners)


def _refuse(settings: TrainSettings) -> None:
    """ConfigError for what ippo.py does and RLlib's PPO does not."""
    check_loss(settings)
    ppo, signals = settings.ppo, settings.signals
    wrong = {
        f"ppo.advantage = {ppo.advantage!r} (only 'gae')": ppo.advantage != "gae",
        "ppo.normalise_advantages = false (only true)": not ppo.normalise_advantages,
        f"ppo.rate_factors = {ppo.rate_factors} (only empty)": bool(ppo.rate_factors),
        f"signals.clone_start = {signals.clone_start} (only 0)": signals.clone_start > 0.0,
        f"signals.clone_end = {signals.clone_end} (only 0)": signals.clone_end > 0.0,
    }
    found = [what for what, is_wrong in wrong.items() if is_wrong]
    if found:
        raise ConfigError(
            f"--ray: RLlib's PPO cannot do {', '.join(found)}: use --config rllib or paper, or no --ray"
        )
