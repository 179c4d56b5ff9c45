"""Every number of the learning environment, named: the world, the episode, the paper's rewards, the radio."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

UGV, UAV = 0, 1  # vehicle classes, first axis of WorldPool.travel_ms
TURNOVERS = ("never", "on_claim", "on_completion")


@dataclass(frozen=True, slots=True)
class WorldSettings:
    """The paper's world: a grid of 1 m cells with random obstacles (experimental set-up)."""

    size_m: tuple[int, int, int] = (50, 50, 30)
    obstacles: int = 40  # boxes standing on the ground, anywhere, overlapping or not
    obstacle_side_m: tuple[int, int] = (2, 6)  # shortest and longest side of a footprint
    obstacle_height_m: tuple[int, int] = (3, 30)  # lowest and highest; cut off at the top of the world
    ugv_speed_mps: float = 3.0
    uav_speed_mps: float = 5.0
    sites: int = 192  # task places per world, on the ground unless airborne
    airborne_sites: int = 32  # of `sites`: in the air, out of reach for UGVs
    starts: int = 512  # places where agents may start, per vehicle class
    worlds: int = 8
    seed: int = 0


@dataclass(frozen=True, slots=True)
class RewardSettings:
    """r_i of the paper. Costs are counted in units of c_max, as x_i has them (0 .. 1)."""

    conflict: float = 1.0  # lambda: several requested the task and another one got it
    idle: float = 0.5  # mu: no request although a task was open and reachable
    low_cost_bonus: float = 0.2  # eta: assigned at a low cost
    low_cost: float = 0.2  # of c_max: what counts as low
    busy_request: float = 0.5  # additional penalty: a request while the present claim is not done


@dataclass(frozen=True, slots=True)
class EnvSettings:
    """One environment. turnover: never (fixed: M tasks, not refilled), on_claim (the paper's continuous mode:
    a task is replaced as soon as it is allocated) or on_completion (it stays until it is served)."""

    agents: int = 10
    tasks: int = 10
    turnover: str = "never"
    uav_share: float = 0.5
    airborne_tasks: float = 0.0  # share of tasks drawn from the airborne sites
    step_s: float = 0.25  # time between allocation rounds
    dwell_s: float = 0.0  # how long an agent serves a task once it is there
    episode_steps: int = 100  # truncation
    loss: float = 0.0  # of every frame, independently per receiver
    relay: bool = True
    dead_s: float = 3.0  # a robot unheard for longer takes no part
    handover_gain_s: float = (
        math.inf
    )  # on_completion: leave a task to an idle agent that is there sooner by this
    rewards: RewardSettings = field(default_factory=RewardSettings)
    world: WorldSettings = field(default_factory=WorldSettings)
