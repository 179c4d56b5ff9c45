"""What is missing for this robot to take part, and the command that would add it. Pure."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Given:
    """What the command line (with configuration and stable names) came to; "" and -1: not given."""

    radio: str
    base: str = ""
    lidar: str = ""
    config: str = ""
    map: str = ""
    robot: int = -1
    start: str = ""  # x,y,yaw
    fleet: str = ""  # a fleet.toml, which may say map and start

    @property
    def missing(self) -> list[str]:
        """In words, in the order in which they are best found."""
        wants = {
            "the base (--base)": self.base,
            "the lidar (--lidar)": self.lidar,
            "the fleet's map (--map)": self.map,
            "this robot's id (--robot)": "" if self.robot < 0 else "given",
            "where it stands (--start)": self.start or self.fleet,
        }
        return [name for name, value in wants.items() if not value]

    @property
    def observes(self) -> bool:
        return self.robot < 0

    def next_command(self) -> str:
        """The whole command, with capitals where the user has to fill in."""
        config = f" --config {self.config}" if self.config else ""
        robot = f" --robot {self.robot if self.robot >= 0 else 'N'}"
        if self.fleet:
            place = f" --fleet {self.fleet}{robot}"
        else:
            place = f" --map {self.map or 'MAP.yaml'}{robot} --start {self.start or 'X,Y,YAW'}"
        return (
            f"hippomat-host --port {self.radio} --base {self.base or 'BASE'} --lidar {self.lidar or 'LIDAR'}"
            f"{config}{place}"
        )
