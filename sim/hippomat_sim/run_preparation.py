"""From a run's settings to all that is decided before it begins: map, places, configuration, air.

The same for daemons in real time and for a fleet in lockstep. Writes the directory and its hippomat.toml.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hippomat_core.config import Config
from hippomat_core.errors import ConfigError
from hippomat_core.maps.occupancy_grid import OccupancyGrid
from hippomat_core.planning.ground import ground_of
from hippomat_logs.map_files import load_map
from hippomat_sim.medium import AirSettings
from hippomat_sim.run_settings import RunSettings, checked, config_toml, described_map, run_config
from hippomat_sim.start_poses import start_poses
from hippomat_sim.virtual_fleet import SimulationSetup
from hippomat_sim.world import Body


@dataclass(frozen=True, slots=True)
class Prepared:
    """A run that can begin."""

    settings: RunSettings
    config: Config  # all robots' but for [robot]
    grid: OccupancyGrid
    starts: NDArray[np.float64]  # (N, 3) x, y [m], yaw [rad]
    toml: Path
    setup: SimulationSetup


def prepared(settings: RunSettings) -> Prepared:
    """Raises HippomatError where the settings, the configuration or the map do not do."""
    checked(settings)
    config = run_config(settings)
    map_yaml, text = described_map(settings)
    if text:
        settings.out.mkdir(parents=True, exist_ok=True)
        map_yaml.write_text(text, encoding="utf-8")
    settings = replace(settings, map_yaml=map_yaml)
    grid = load_map(map_yaml)
    ground = ground_of(grid, 0, config)
    for one in settings.carried:
        if not ground.costmap.is_free(grid.cell_of(*one.pose[:2])):
            place = f"{one.pose[0]:g},{one.pose[1]:g}"
            raise ConfigError(f"--carry: {place} is no free place of the map: give metres in its frame")
    starts = start_poses(ground, settings.robots, config.robot.radius_m, settings.seed)
    settings.out.mkdir(parents=True, exist_ok=True)
    toml = settings.out / "hippomat.toml"
    toml.write_text(config_toml(config), encoding="utf-8")
    key = _fleet_key(settings.seed) if settings.sealed else b""
    setup = simulation_setup(config, grid, starts, settings.seed, AirSettings(loss=settings.loss), key)
    return Prepared(settings, config, grid, starts, toml, setup)


def simulation_setup(
    config: Config,
    grid: OccupancyGrid,
    starts: NDArray[np.float64],
    seed: int,
    air: AirSettings,
    key: bytes = b"",
) -> SimulationSetup:
    """The world and the devices that a fleet of this configuration has."""
    return SimulationSetup(
        grid,
        starts,
        seed,
        Body(config.robot.radius_m, max(0.2, config.lidar.z_m + 0.05)),
        config.lidar,
        air,
        fleet=config.fleet.id,
        channel=config.fleet.channel,
        key=key,
    )


def _fleet_key(seed: int) -> bytes:
    """16 bytes; a simulated fleet has nothing to hide."""
    return hashlib.sha256(b"hippomat simulated fleet %d" % seed).digest()[:16]
