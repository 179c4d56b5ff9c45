"""Another way to decide than the recorded one: which allocator, with which weights. Opens the file."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from hippomat_core.allocation.factory import make_allocator
from hippomat_core.allocation.policy_file import read_policy
from hippomat_core.allocation.port import Allocator
from hippomat_core.config import POLICY_ALLOCATORS, Config
from hippomat_core.errors import ConfigError
from hippomat_logs.closed_loop.plan import FleetPlan
from hippomat_logs.policy_files import naming, policy_of


@dataclass(frozen=True, slots=True)
class Choice:
    """An allocator and its weights. path: of the weights, "" where they are the packaged ones or there are
    none."""

    allocator: str
    policy: bytes | None
    path: str = ""

    @property
    def text(self) -> str:
        """For people."""
        return f"{self.allocator} ({self.path})" if self.path else self.allocator

    def made(self, config: Config) -> Allocator:
        """For a fleet of this size; ConfigError where it does not fit."""
        return make_allocator(self.allocator, self.policy, config.fleet.size, config.fleet.task_slots)

    def config(self, recorded: Config) -> Config:
        """The recorded configuration with this choice."""
        return replace(recorded, fleet=replace(recorded.fleet, allocator=self.allocator, policy=self.path))

    def plan(self, recorded: FleetPlan) -> FleetPlan:
        """The recorded plan with this choice in every robot."""
        robots = tuple(
            replace(robot, config=self.config(robot.config), policy=self.policy) for robot in recorded.robots
        )
        return replace(recorded, robots=robots)


def other_choice(config: Config, allocator: str | None, path: Path | None) -> Choice:
    """What --allocator NAME and --policy FILE ask for; ConfigError names what does not do.

    Without NAME the file says which network it is.
    """
    if path is None:
        fleet = replace(config.fleet, allocator=allocator or config.fleet.allocator, policy="")
        choice = Choice(fleet.allocator, policy_of(fleet))
    else:
        fleet = replace(config.fleet, allocator=allocator or POLICY_ALLOCATORS[0], policy=str(path))
        data = policy_of(fleet)
        if data is None:
            raise ConfigError(
                f"--allocator {allocator} decides without weights: leave out --policy {path}, or give "
                f"--allocator {' or '.join(POLICY_ALLOCATORS)}"
            )
        with naming(str(path)):
            choice = Choice(allocator or read_policy(data).network, data, str(path))
    if choice.path:
        with naming(choice.path):
            choice.made(config)
    else:
        choice.made(config)
    return choice
