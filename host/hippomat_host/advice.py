"""What is missing for this robot to take part, and the command that would add it. Pure."""

from __future__ import annotations

from dataclasses import dataclass, field

from hippomat_core.config import RosConfig


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
    ros: RosConfig = field(default_factory=RosConfig)
    maps: bool = False  # it makes a map: it has none, and no place in one

    @property
    def missing(self) -> list[str]:
        """In words, in the order in which they are best found."""
        wants = {
            "the base (--base)": self.base or self.ros.drives,
            "the lidar (--lidar)": self.lidar or self.ros.scans,
            "the fleet's map (--map)": self.map or self.ros.maps or self.maps,
            "this robot's id (--robot)": "" if self.robot < 0 else "given",
            "where it stands (--start)": self.start or self.fleet or self.ros.localizes or self.maps,
        }
        return [name for name, value in wants.items() if not value]

    @property
    def observes(self) -> bool:
        return self.robot < 0

    def next_command(self) -> str:
        """The whole command, with capitals where the user has to fill in."""
        robot = str(self.robot) if self.robot >= 0 else "N"
        elsewhere = bool(self.fleet) or self.maps  # a fleet.toml says map and start
        parts = [
            ("--port", self.radio, ""),
            ("--ros", self.ros.url, ""),
            ("--base", self.base, "" if self.ros.drives else "BASE"),
            ("--lidar", self.lidar, "" if self.ros.scans else "LIDAR"),
            ("--config", self.config, ""),
            ("--fleet", self.fleet, ""),
            ("--map", "" if elsewhere else self.map, "" if elsewhere or self.ros.maps else "MAP.yaml"),
            ("--robot", robot, ""),
            (
                "--start",
                "" if elsewhere else self.start,
                "" if elsewhere or self.ros.localizes else "X,Y,YAW",
            ),
        ]
        said = [f"{flag} {value or wanted}" for flag, value, wanted in parts if value or wanted]
        return " ".join(["hippomat-host", *said, *(["--slam"] if self.maps else [])])
