"""Is the device behind a port the one that was asked for? If not, say what it is and which flag it wants."""

from __future__ import annotations

from hippomat_core.config import Config, FleetConfig
from hippomat_core.errors import PortError, ProtocolMismatch
from hippomat_core.messages import BASE, LIDAR, PORT_NAMES, RADIO
from hippomat_core.wire.device_commands import hello_of
from hippomat_core.wire.frames import PROTOCOL_VERSION
from hippomat_core.wire.link import FLAG_OPEN, LINK_VERSION, NO_ROBOT, Hello, HelloReply
from hippomat_host.identify import ASK, UNKNOWN, Identity
from hippomat_host.serial_port import present_ports

FLAGS = {RADIO: "--port", BASE: "--base", LIDAR: "--lidar"}

_CHECKS = {
    RADIO: "is the ESP32-S3 flashed (`cd esp32_firmware && pio run -t upload`)",
    BASE: "is the base switched on",
    LIDAR: "is the lidar powered",
}


def greeting_of(config: Config) -> Hello:
    """What a daemon says first. An observer only asks: the radio may be a robot's, and keeps its rounds."""
    return hello_of(config) if config.robot.id >= 0 else ASK


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
        raise _mismatch(path, identity)
    if identity.reply is not None:
        _check_radio(config, path, identity.reply)
    return identity.text


def radio_behind(path: str, identity: Identity) -> HelloReply:
    """Whatever radio it is; raises PortError or ProtocolMismatch where it is none, or none of ours."""
    if identity.mismatch:
        raise _mismatch(path, identity)
    if identity.reply is not None:
        return identity.reply
    if identity.port == UNKNOWN:
        raise PortError(_unknown(path, RADIO, identity))
    raise PortError(
        f"{path} is the {identity.name}, not a radio: give the radio's port with --port{_others(path)}"
    )


def _mismatch(path: str, identity: Identity) -> ProtocolMismatch:
    return ProtocolMismatch(
        f"radio on {path} speaks {identity.mismatch}, this host protocol {PROTOCOL_VERSION} "
        f"(link {LINK_VERSION}): run `pio run -t upload` in esp32_firmware"
    )


def _check_radio(config: Config, path: str, reply: HelloReply) -> None:
    """A daemon that is a robot needs that robot's radio, in its fleet and on its channel."""
    robot, fleet = config.robot.id, config.fleet
    if robot < 0:
        return
    if _are_defaults(config, reply):
        raise PortError(
            f"radio: fleet {reply.fleet}, channel {reply.channel}; "
            f"settings: fleet {fleet.id}, channel {fleet.channel} (wrong --config?)"
        )
    write = (
        f"`hippomat-host provision --port {path} --fleet {fleet.id} --robot {robot} --channel {fleet.channel}"
    )
    write += f"{' --open' if reply.flags & FLAG_OPEN else ' --key-file F'}` writes it anew"
    if reply.robot == NO_ROBOT:
        raise PortError(f"the radio on {path} is an operator's, not robot {robot}'s: {write}")
    if reply.robot != robot:
        raise PortError(
            f"the radio on {path} is robot {reply.robot}, not robot {robot}: give --robot {reply.robot}, "
            f"or the other robot's radio; {write}"
        )
    if reply.fleet != fleet.id:
        raise PortError(
            f"the radio on {path} belongs to fleet {reply.fleet}, not {fleet.id}: "
            f"set [fleet] id = {reply.fleet}; {write}"
        )
    if reply.channel != fleet.channel:
        raise PortError(
            f"the radio on {path} is on channel {reply.channel}, not {fleet.channel}: "
            f"set [fleet] channel = {reply.channel}; {write}"
        )


def _are_defaults(config: Config, reply: HelloReply) -> bool:
    """Fleet or channel is not the radio's, and what is not was probably never set."""
    fleet, default = config.fleet, FleetConfig()
    fits = reply.fleet == fleet.id, reply.channel == fleet.channel
    unset = fleet.id == default.id, fleet.channel == default.channel
    return not all(fits) and all(fit or never for fit, never in zip(fits, unset, strict=True))


def _unknown(path: str, expected: int, identity: Identity) -> str:
    name = PORT_NAMES[expected]
    return (
        f"no {name} on {path} (found: {identity.text}): {_CHECKS[expected]}? "
        f"If the {name} is elsewhere, give {FLAGS[expected]}{_others(path)}"
    )


def _others(path: str) -> str:
    others = [port for port in present_ports() if port != path]
    return f" (other ports: {', '.join(others)})" if others else "; `hippomat-host ports` lists what is there"
