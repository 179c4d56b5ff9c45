"""What a re-run keeps of a recording, as values: map, robots, times, tasks (by the configuration) and air.

The contract between logs and a simulator; knows neither. Times count from the first robot's first event.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from hippomat_core.config import Config
from hippomat_core.errors import ConfigError
from hippomat_core.maps.occupancy_grid import OccupancyGrid
from hippomat_logs.metrics.robot import Stamped

RECORDED, IDEAL, LOSS = "recorded", "ideal", "loss"

Pose = tuple[float, float, float]  # x [m], y [m], yaw [rad], map frame
Sink = Callable[[int, Stamped], None]  # robot, what its log would hold, in order


@dataclass(frozen=True, slots=True, eq=False)
class SenderDeliveries:
    """What became of one robot's frames, in the order in which they were on the air."""

    times_us: NDArray[np.int64]  # (n,)
    kinds: NDArray[np.uint8]  # (n,) wire.frames.STATE ..
    heard: NDArray[np.bool_]  # (n, N) by receiver

    def delivered(self, at_us: int, kind: int) -> NDArray[np.bool_]:
        """(N,) who hears a frame of this kind at this time: as of the nearest recorded one."""
        (same,) = np.nonzero(self.kinds == kind)
        nearest = _nearest(self.times_us[same], at_us)
        if nearest is None or abs(int(self.times_us[same[nearest]]) - at_us) > NEAR_US:
            at = _nearest(self.times_us, at_us)  # rare kinds: how the links were then says more
            return self.heard[at] if at is not None else np.zeros(self.heard.shape[1], np.bool_)
        row: NDArray[np.bool_] = self.heard[same[nearest]]
        return row


NEAR_US = 1_000_000  # a frame of the same kind that is farther off says less than any frame nearby


def _nearest(times_us: NDArray[np.int64], at_us: int) -> int | None:
    if not len(times_us):
        return None
    behind = int(np.searchsorted(times_us, at_us))
    near = range(max(behind - 1, 0), min(behind + 1, len(times_us)))
    return min(near, key=lambda k: abs(int(times_us[k]) - at_us))


@dataclass(frozen=True, slots=True)
class Air:
    """kind: recorded (by sender, as in `deliveries`), ideal (everything arrives), loss (independent)."""

    kind: str = IDEAL
    loss: float = 0.0
    deliveries: Mapping[int, SenderDeliveries] = field(default_factory=dict)

    @property
    def text(self) -> str:
        """As --radio has it."""
        return f"{LOSS}={self.loss:g}" if self.kind == LOSS else self.kind


def parse_air(text: str) -> Air:
    """`recorded` (still without its deliveries), `ideal`, `loss=P`; ConfigError names what does not do."""
    if text in (RECORDED, IDEAL):
        return Air(text)
    name, _, value = text.partition("=")
    try:
        loss = float(value) if name == LOSS else -1.0
    except ValueError:
        loss = -1.0
    if not 0.0 <= loss <= 1.0:
        raise ConfigError(f"--radio {text!r} is none of: recorded, ideal, loss=P with P in 0 .. 1")
    return Air(LOSS, loss)


@dataclass(frozen=True, slots=True)
class RobotPlan:
    """One robot as it was recorded. config.robot.id is its place in the fleet."""

    config: Config
    policy: bytes | None
    start: Pose
    begins_s: float
    ends_s: float
    first_tick_s: float  # after begins_s: a computer that starts slowly hears nothing until then


@dataclass(frozen=True, slots=True, eq=False)
class FleetPlan:
    """A fleet of `size` robots, of which these have logs; the others are not there."""

    grid: OccupancyGrid
    size: int
    robots: tuple[RobotPlan, ...]
    air: Air

    @property
    def missing(self) -> tuple[int, ...]:
        """Robots of the fleet without a log."""
        there = {robot.config.robot.id for robot in self.robots}
        return tuple(robot for robot in range(self.size) if robot not in there)

    @property
    def seconds(self) -> float:
        return max(robot.ends_s for robot in self.robots)


class FleetWorld(Protocol):
    """What a class registered as a replay world may offer as its attribute `closed_loop`.

    Runs the whole fleet from begin to end; everything that the plan does not fix is drawn from the seed. The
    same plan and seed give the same records. Raises HippomatError where it cannot.
    """

    def __call__(self, plan: FleetPlan, seed: int, sink: Sink) -> None: ...
