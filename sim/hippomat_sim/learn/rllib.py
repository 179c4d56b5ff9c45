"""Training through Ray RLlib, on this machine or on a cluster: `hippomat-train train --ray`.

Imports Ray only when it is asked to train, so that everything else works without it.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import torch

from hippomat_sim.learn.ray_session import LOCAL, ray_session
from hippomat_sim.learn.train_settings import TrainSettings
from hippomat_sim.learn.world_pool import WorldPool

if TYPE_CHECKING:
    from hippomat_sim.learn.rllib_training import RayTraining


def train_with_ray(
    settings: TrainSettings,
    pool: WorldPool,
    folder: Path,
    device: torch.device,
    show: Callable[[dict[str, Any]], None],
    stop: Callable[[], bool],
    *,
    resume: bool = False,
    address: str = LOCAL,
    runners: int = 0,
) -> RayTraining:
    """Trains until the budget is used up or stop(); returns the run, with its network, log and evaluation.

    address: LOCAL starts a Ray of our own that nobody else can reach; else a cluster's head. runners:
    processes that play the environments; 0 = this one plays and learns. ConfigError: what RLlib cannot do.
    """
    with ray_session(address, processors=1 + runners):
        from hippomat_sim.learn.rllib_training import RayTraining

        training = RayTraining(settings, pool, folder, device, runners)
        try:
            if resume:
                training.restore()
            training.run(show, stop)
        finally:
            training.close()
    return training
