"""Which environments there can be: every setting within its range, and room for all in the pool's worlds."""

from __future__ import annotations

import math

from hippomat_core.config import MAX_ROBOTS, MAX_TASK_SLOTS
from hippomat_core.errors import ConfigError
from hippomat_sim.learn.settings import TURNOVERS, EnvSettings
from hippomat_sim.learn.world_pool import WorldPool


def checked(settings: EnvSettings, pool: WorldPool) -> None:
    """ConfigError names the value that cannot be."""
    if settings.turnover not in TURNOVERS:
        raise ConfigError(f"turnover = {settings.turnover!r}: must be one of {', '.join(TURNOVERS)}")
    starts = pool.settings.starts
    _within(
        "agents", settings.agents, 1, min(MAX_ROBOTS, starts), f"the radio and {starts} starts have room for"
    )
    _within(
        "tasks",
        settings.tasks,
        1,
        min(MAX_TASK_SLOTS, _sites(settings, pool)),
        "frames and sites have room for",
    )
    _within("episode_steps", settings.episode_steps, 1, math.inf)
    for name in ("uav_share", "airborne_tasks", "loss"):
        _within(name, getattr(settings, name), 0.0, 1.0)
    _within("step_s", settings.step_s, 0.001, 60.0)
    _within("dwell_s", settings.dwell_s, 0.0, 600.0)
    _within("dead_s", settings.dead_s, 0.0, math.inf)
    _within("handover_gain_s", settings.handover_gain_s, 0.0, math.inf)
    if settings.airborne_tasks and not pool.settings.airborne_sites:
        raise ConfigError(f"airborne_tasks = {settings.airborne_tasks}: needs worlds with airborne_sites")


def _sites(settings: EnvSettings, pool: WorldPool) -> int:
    """Tasks that there are sites for; a task that is replaced moves to a site which no slot has."""
    sites, airborne = pool.settings.sites, pool.settings.airborne_sites
    usable = sites if settings.airborne_tasks else sites - airborne
    return usable - (settings.turnover != "never")


def _within(name: str, value: float, least: float, most: float, why: str = "must be") -> None:
    if not least <= value <= most:
        raise ConfigError(f"{name} = {value}: {why} {least:g} .. {most:g}")
