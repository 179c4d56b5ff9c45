"""What the sub-commands of hippomat-train do with their options."""

from __future__ import annotations

import argparse
import json
import sys
import time
from dataclasses import replace
from pathlib import Path

import torch
from rich.console import Console

from hippomat_core.errors import ConfigError
from hippomat_sim.learn.checkpoint import FILE_NAME, load_checkpoint
from hippomat_sim.learn.curves import draw_curves
from hippomat_sim.learn.export import exported_policy, write_policy
from hippomat_sim.learn.interrupt import Interrupt
from hippomat_sim.learn.pool_bar import make_pool_shown
from hippomat_sim.learn.ray_session import require_ray
from hippomat_sim.learn.rllib import train_with_ray
from hippomat_sim.learn.runs import POLICY_NAME
from hippomat_sim.learn.train_settings import (
    EpisodeSettings,
    TrainSettings,
    load_train_settings,
    settings_from_dict,
    settings_to_dict,
)
from hippomat_sim.learn.train_view import TrainView, summary
from hippomat_sim.learn.training import Training
from hippomat_sim.learn.world_pool import WorldPool

INTERRUPTED = 130
_ONLY_ANEW = ("config", "out", "seed", "steps", "agents", "tasks")  # what a run is told when it begins


def train(options: argparse.Namespace) -> int:
    """The exit code; INTERRUPTED after Ctrl-C."""
    console = Console(stderr=True)
    if options.minutes is not None and not options.minutes > 0.0:
        raise ConfigError(f"--minutes {options.minutes}: must be above 0")
    if options.runners is not None and not options.ray:
        raise ConfigError(f"--runners {options.runners}: they are Ray's; add --ray")
    if options.ray:
        return _with_ray(options, console)
    device = device_of(options.device)
    training = _resumed(options, device, console) if options.resume else _begun(options, device, console)
    _line(console, f"{training.folder}: {training.network.network} on {device}, {training.threads} threads")
    with Interrupt() as interrupt, _view(console, training) as view:
        ends_s = time.monotonic() + 60.0 * (options.minutes or float("inf"))
        rows = training.run(view.show, lambda: interrupt.asked or time.monotonic() >= ends_s)
    if interrupt.asked:
        return _said_interrupted(training.folder, training.clock.update)
    _finish(training.folder, rows, console)
    summary(
        console,
        {**rows[-1], "evaluation": training.evaluation},
        training.settings.ppo.epochs,
        training.threads,
    )
    if not training.done:
        _line(console, f"stopped before its end: go on with hippomat-train --resume {training.folder}")
    return 0


def export(options: argparse.Namespace) -> int:
    """Writes the policy; prints where, its hash and its size."""
    policy = exported_policy(options.run)
    path = options.out or options.run / POLICY_NAME
    write_policy(policy, path)
    print(f"{path}: {policy.network} {policy.hash[:12]}, {path.stat().st_size} bytes")
    return 0


def prepare(options: argparse.Namespace) -> int:
    """Makes the pools of training and of evaluation; prints what they are and how long it took."""
    console = Console(stderr=True)
    settings = load_train_settings(options.config).environment.world
    for split in ("train", "test"):
        began_s = time.monotonic()
        pool = make_pool_shown(settings, split, console)
        print(
            f"{split}: {settings.worlds} worlds {pool.hash[:12]}, c_max {pool.c_max_s:g} s, "
            f"{time.monotonic() - began_s:.1f} s"
        )
    return 0


def device_of(name: str) -> torch.device:
    """auto: a GPU where torch finds one. ConfigError where cuda was asked for and there is none."""
    if name == "cuda" and not torch.cuda.is_available():
        raise ConfigError("--device cuda: torch finds no GPU; take --device cpu")
    if name == "auto":
        name = "cuda" if torch.cuda.is_available() else "cpu"
    return torch.device(name)


def settings_of(options: argparse.Namespace, preset: str) -> TrainSettings:
    """The preset's or the file's settings with what the command line says otherwise."""
    settings = load_train_settings(preset)
    budget, episodes = settings.budget, settings.episodes
    if options.steps is not None:
        budget = replace(budget, agent_steps=options.steps)
    if options.agents is not None:
        episodes = tuple(replace(one, agents=(options.agents, options.agents)) for one in episodes)
        budget = replace(budget, evaluate_sizes=(options.agents,))
    if options.tasks is not None:
        episodes = tuple(replace(one, tasks=(options.tasks, options.tasks)) for one in episodes)
    seed = settings.seed if options.seed is None else options.seed
    changed = replace(settings, budget=budget, episodes=_distinct(episodes), seed=seed)
    return settings_from_dict(settings_to_dict(changed), "command line")  # ranges hold for options too


def _distinct(episodes: tuple[EpisodeSettings, ...]) -> tuple[EpisodeSettings, ...]:
    return tuple(dict.fromkeys(episodes))


def _begun(options: argparse.Namespace, device: torch.device, console: Console) -> Training:
    preset = options.config or "default"
    settings, folder = settings_of(options, preset), folder_of(options, preset)
    training = Training(settings, _pool(settings, console), folder, device)
    folder.mkdir(parents=True, exist_ok=True)
    told = {"config": preset, "device": str(device), "settings": settings_to_dict(settings)}
    (folder / "run.json").write_text(json.dumps(told, indent=2) + "\n", "utf-8")
    return training


def folder_of(options: argparse.Namespace, preset: str) -> Path:
    """Where the run goes; ConfigError where another one is."""
    name = Path(preset).stem
    folder: Path = options.out or Path("runs") / time.strftime(f"train-{name}-%Y%m%d-%H%M%S")
    if (folder / FILE_NAME).exists():
        raise ConfigError(f"--out {folder}: a run is there; take --resume {folder} or another directory")
    return folder


def _resumed(options: argparse.Namespace, device: torch.device, console: Console) -> Training:
    _refuse_anew(options)
    training = Training.resumed(options.resume, lambda settings: _pool(settings, console), device)
    if training.done:
        raise ConfigError(
            f"--resume {options.resume}: the run has used up its steps; export it or begin anew"
        )
    return training


def _refuse_anew(options: argparse.Namespace) -> None:
    for name in _ONLY_ANEW:
        if getattr(options, name) is not None:
            raise ConfigError(f"--{name} with --resume: a run keeps what it was told; begin a new one")


def _pool(settings: TrainSettings, console: Console) -> WorldPool:
    return make_pool_shown(settings.environment.world, "train", console)


def _view(console: Console, training: Training) -> TrainView:
    return TrainView(console, training.settings.budget.agent_steps, training.clock.agent_steps)


def _finish(folder: Path, rows: list[dict[str, object]], console: Console) -> None:
    """Policy and curves of what there is."""
    policy = exported_policy(folder)
    write_policy(policy, folder / POLICY_NAME)
    pictures = ", ".join(path.name for path in draw_curves(folder, rows))
    _line(console, f"{folder / POLICY_NAME}: {policy.network} {policy.hash[:12]}; {pictures}")


def _said_interrupted(folder: Path, update: int, how: str = "") -> int:
    print(
        f"hippomat-train: interrupted after update {update}, checkpoint written: "
        f"go on with hippomat-train {how}--resume {folder}",
        file=sys.stderr,
    )
    return INTERRUPTED


def _with_ray(options: argparse.Namespace, console: Console) -> int:
    require_ray()
    if options.resume:
        _refuse_anew(options)
        told_then = json.loads(load_checkpoint(options.resume)["settings"])
        settings, folder = settings_from_dict(told_then, str(options.resume)), options.resume
    else:
        preset = options.config or "rllib"
        settings, folder = settings_of(options, preset), folder_of(options, preset)
        folder.mkdir(parents=True, exist_ok=True)
        told = {
            "config": preset,
            "device": options.device,
            "ray": True,
            "settings": settings_to_dict(settings),
        }
        (folder / "run.json").write_text(json.dumps(told, indent=2) + "\n", "utf-8")
    ends_s = time.monotonic() + 60.0 * (options.minutes or float("inf"))
    with Interrupt() as interrupt, TrainView(console, settings.budget.agent_steps, 0) as view:
        training = train_with_ray(
            settings,
            _pool(settings, console),
            folder,
            device_of(options.device),
            view.show,
            lambda: interrupt.asked or time.monotonic() >= ends_s,
            resume=options.resume is not None,
            address=options.ray,
            runners=options.runners or 0,
        )
    if interrupt.asked:
        return _said_interrupted(folder, training.clock.update, "--ray ")
    _finish(folder, training.rows, console)
    return 0


def _line(console: Console, text: str) -> None:
    console.print(text, markup=False, highlight=False, soft_wrap=True)
