"""fleet.toml: one file for all robots - what they share, their map, who they are and where they start.

Decides what one robot's settings are. Its sections are those of hippomat.toml, and on top
    map = "lab.yaml"               relative to the file
    [vehicles.NAME.SECTION]        settings of all robots of that kind
    [[robots]]                     id, name, start = [x, y, yaw] in the map, vehicle
Knows TOML text, not files.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field
from typing import Any, TypeAlias

from hippomat_core.config import MAX_ROBOTS, Config
from hippomat_core.errors import ConfigError
from hippomat_core.settings_tree import number, parse_toml, read_table

Tree: TypeAlias = dict[str, dict[str, Any]]  # section -> key -> value, only what was said

SECTIONS = tuple(f.name for f in dataclasses.fields(Config))
PER_ROBOT = ("id", "start_x_m", "start_y_m", "start_yaw_rad", "start_known")


@dataclass(frozen=True, slots=True)
class Member:
    """One robot of the roster."""

    id: int = number(-1, 0, MAX_ROBOTS - 1)
    name: str = ""
    start: tuple[float, ...] = number((), -1000.0, 1000.0)  # type: ignore[arg-type]  # x, y [m], yaw [rad]
    vehicle: str = ""


@dataclass(frozen=True, slots=True)
class Roster:
    """A fleet.toml."""

    source: str  # the file, for errors
    map: str = ""
    shared: Tree = field(default_factory=dict)
    vehicles: dict[str, Tree] = field(default_factory=dict)
    members: tuple[Member, ...] = ()

    def member(self, robot: int) -> Member:
        """Raises ConfigError for a robot that is not in the roster."""
        for member in self.members:
            if member.id == robot:
                return member
        known = ", ".join(f"{member.id}{f' ({member.name})' * bool(member.name)}" for member in self.members)
        raise ConfigError(f"{self.source}: robot {robot} is not in the roster; known: {known}")

    def settings(self, robot: int) -> Tree:
        """What the file says for one robot; -1: for one that only observes."""
        size = 1 + max(member.id for member in self.members)
        fleet: Tree = {"fleet": {"size": size}}
        if robot < 0:
            return merged(fleet, self.shared)
        member = self.member(robot)
        own: dict[str, Any] = {"id": robot}
        if member.start:
            x_m, y_m, yaw_rad = member.start
            own |= {"start_x_m": x_m, "start_y_m": y_m, "start_yaw_rad": yaw_rad, "start_known": True}
        return merged(fleet, self.shared, self.vehicles.get(member.vehicle, {}), {"robot": own})


def merged(*trees: Tree) -> Tree:
    """Later trees win, key by key."""
    whole: Tree = {}
    for tree in trees:
        for section, values in tree.items():
            whole[section] = {**whole.get(section, {}), **values}
    return whole


def parse_roster(text: str, source: str = "fleet.toml") -> Roster:
    """Raises ConfigError naming file, thing and value. Settings are checked where they are used."""
    tree = parse_toml(text, source)
    map_name, robots, vehicles = tree.pop("map", ""), tree.pop("robots", []), tree.pop("vehicles", {})
    if not isinstance(map_name, str):
        raise ConfigError(f"{source}: map = {map_name!r} must be the name of a map's .yaml file")
    if not isinstance(robots, list) or not robots:
        raise ConfigError(f"{source}: has no [[robots]]: every robot needs at least its id")
    if not isinstance(vehicles, dict):
        raise ConfigError(f"{source}: [vehicles] must hold tables such as [vehicles.jetbot.limits]")
    shared = _sections(tree, source)
    kinds = {name: _sections(kind, f"{source}: [vehicles.{name}]") for name, kind in vehicles.items()}
    members = tuple(
        _member(read_table(Member, robot, f"{source}: [[robots]]"), kinds, source) for robot in robots
    )
    for key in ("id", "name"):
        values = [value for member in members if (value := getattr(member, key)) != ""]
        twice = [value for value in values if values.count(value) > 1]
        if twice:
            raise ConfigError(f"{source}: [[robots]] {key} = {twice[0]!r} is used twice")
    return Roster(source, map_name, shared, kinds, members)


def _member(member: Member, vehicles: dict[str, Tree], source: str) -> Member:
    who = f"{source}: robot {member.id}"
    if member.id < 0:
        raise ConfigError(f"{source}: a robot of [[robots]] has no id")
    if len(member.start) not in (0, 3):
        raise ConfigError(
            f"{who}: start = {list(member.start)} must be [x, y, yaw] (metres, metres, radians)"
        )
    if member.vehicle and member.vehicle not in vehicles:
        known = ", ".join(vehicles) or "none"
        raise ConfigError(f"{who}: vehicle = {member.vehicle!r} is not in [vehicles]; known: {known}")
    return member


def _sections(tree: Any, where: str) -> Tree:
    if not isinstance(tree, dict):
        raise ConfigError(f"{where} must be a table, found {tree!r}")
    for section, values in tree.items():
        if section not in SECTIONS:
            raise ConfigError(f"{where}: unknown section [{section}]; known: {', '.join(SECTIONS)}")
        if not isinstance(values, dict):
            raise ConfigError(f"{where}: [{section}] must be a table, found {values!r}")
        personal = [key for key in values if section == "robot" and key in PER_ROBOT]
        if personal:
            raise ConfigError(f"{where}: [robot] {personal[0]} belongs to one robot: say it in [[robots]]")
    return tree
