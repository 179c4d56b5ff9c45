"""Settings of a training run: presets load, files round-trip, and what cannot be used is refused by name."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from hippomat_core.errors import ConfigError
from hippomat_sim.learn.train_settings import (
    load_train_settings,
    parse_train_settings,
    presets,
    settings_from_dict,
    settings_to_dict,
)


@pytest.mark.parametrize("name", presets())
def test_every_preset_survives_json(name: str) -> None:
    settings = load_train_settings(name)
    assert settings_from_dict(json.loads(json.dumps(settings_to_dict(settings))), name) == settings


def test_the_papers_preset_has_the_papers_numbers() -> None:
    settings = load_train_settings("paper")
    (episodes,) = settings.episodes
    assert episodes.fragment_steps == 100
    assert episodes.fragment_steps * episodes.copies == 1000
    assert settings.ppo.epochs == 10
    assert settings.ppo.learning_rate == 1e-5
    assert settings.ppo.entropy == 0.05
    assert (settings.ppo.gamma, settings.ppo.gae_lambda) == (0.99, 0.95)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[ppo]\ngama = 1.0", r"mine.toml: \[ppo\] unknown key 'gama'; known: advantage"),
        ("[ppo]\ngamma = 1.5", r"\[ppo\] gamma = 1.5 is outside 0.0 .. 1.0"),
        ("[ppo]\nepochs = 1.5", r"\[ppo\] epochs = 1.5 must be of type int"),
        ('[network]\nkind = "mlp"', "'mlp' is not one of graphsage, paper_network, gcn"),
        ("episodes = []", "is empty"),
        ("[[episodes]]\nagents = [9, 3]", r"agents = \[9, 3\] must be \[least, most\]"),
        ("[[episodes]]\nagents = 3", "must be a list"),
        ("[budget]\nevaluate_sizes = [100]", "= 100 is outside 1 .. 64"),
        ("ppo = 3", "must be a table"),
        ("[ppo", "not valid TOML"),
    ],
)
def test_what_cannot_be_used_is_refused_by_name(text: str, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        parse_train_settings(text, "mine.toml")


def test_a_file_is_read_like_a_preset(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text("seed = 7\n[environment]\nloss = 0.3\n[environment.world]\nsize_m = [20, 20, 10]\n")
    settings = load_train_settings(str(path))
    assert (settings.seed, settings.environment.loss) == (7, 0.3)
    assert settings.environment.world.size_m == (20, 20, 10)


def test_neither_preset_nor_file_lists_the_presets() -> None:
    with pytest.raises(ConfigError, match="presets: default, learned_part, mappo_gcn, no_neighbours, paper"):
        load_train_settings("papr")
