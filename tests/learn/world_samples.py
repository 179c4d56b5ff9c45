"""Worlds that are prepared in a moment."""

from __future__ import annotations

from hippomat_sim.learn.settings import WorldSettings

SMALL = WorldSettings(
    size_m=(12, 12, 6),
    obstacles=5,
    obstacle_side_m=(1, 4),
    obstacle_height_m=(1, 6),
    sites=8,
    airborne_sites=3,
    starts=16,
    worlds=3,
    seed=7,
)
