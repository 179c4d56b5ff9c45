"""Is the device behind a port the one that was asked for? If not, say what it is and which flag it wants."""

from __future__ import annotations

from hippomat_core.config import Config
from hippomat_core.errors import PortError, ProtocolMismatch
from hippomat_core.messages import BASE, LIDAR, PORT_NAMES, RADIO
from hippomat_core.wire.frames import PROTOCOL_VERSION
from hippomat_core.wire.link import LINK_VERSION, NO_ROBOT, Hello, HelloReply
from hippomat_host.identify import UNKNOWN, Identity
from hippomat_host.serial_port import present_ports

FLAGS = {RADIO: "--port", BASE: "--base", LIDAR: "--lidar"}

_CHECKS = {
    RADIO: "is the ESP32-S3 flashed (`cd esp32_firmware && pio run -t upload`)",
    BASE: "is the base switched on",
    LIDAR: "is the lidar powered",
}


def hello_of(config: Config) -> Hello:
    """How the daemon introduces itself; without a robot id it only listens."""
    robot = config.robot.id if config.robot.id >= 0 else NO_ROBOT
    return Hello(LINK_VERSION, robot, config.fleet.id, config.fleet.channel)


def accept(config: Config, path: str, expected: int, identity: Identity) -> str:
    """What the device said of itself; raises PortError or ProtocolMismatch in one line with the remedy."""
    name = PORT_NAMES[expected]
    if identity.port == UNKNOWN:
        raise PortError(_unknown(path, expected, identity))
    if identity.port != expected:
        raise PortError(
            f"{path} is the {identity.name}, not the {name}: use {FLAGS[identity.port]} {path} "
            f"and give the {name}'s port with {FLAGS[expected]}{_others(path)}"
        )
    if identity.mismatch:
        raise ProtocolMismatch(
            f"radio on {path} speaks {identity.mismatch}, this host protocol {PROTOCOL_VERSION} "
            f"(link {LINK_VERSION}): run `pio run -t upload` in esp32_firmware"
        )
    if identity.reply is not None:
        _check_radio(config, path, identity.reply)
    return identity.text


def _check_radio(config: Config, path: str, reply: HelloReply) -> None:
    robot, fleet = config.robot.id, config.fleet.id
    if robot < 0:
        return
    if reply.robot != robot:
        raise PortError(
            f"the radio on {path} is robot {reply.robot}, not robot {robot}: give --robot {reply.robot}, "
            "or the other robot's radio"
        )
    if reply.fleet != fleet:
        raise PortError(
            f"the radio on {path} belongs to fleet {reply.fleet}, not {fleet}: set [fleet] id = {reply.fleet}"
        )


def _unknown(path: str, expected: int, identity: Identity) -> str:
    name = PORT_NAMES[expected]
    return (
        f"no {name} on {path} (found: {identity.text}): {_CHECKS[expected]}? "
        f"If the {name} is elsewhere, give {FLAGS[expected]}{_others(path)}"
    )


def _others(path: str) -> str:
    others = [port for port in present_ports() if port != path]
    return f" (other ports: {', '.join(others)})" if others else "; `hippomat-host ports` lists what is there"
