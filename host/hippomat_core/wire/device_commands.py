"""What the robot core's effects mean to the devices: bytes for their ports; the inverse of device_events.py.

Decides also what a radio is told about its host, and when. Whoever owns the ports (the daemon, a simulator)
writes the bytes. Knows no port and no clock.
"""

from __future__ import annotations

from hippomat_core.config import Config
from hippomat_core.messages import BASE, RADIO, Drive, Effect, RadioStatus, SendState, SendTasks
from hippomat_core.wire.codec import encode_body, kind_of
from hippomat_core.wire.jetbot_base import encode_velocity
from hippomat_core.wire.link import (
    FLAG_PROVISIONED,
    LINK_VERSION,
    NO_ROBOT,
    Hello,
    SendBody,
    encode_message,
)


def command_of(effect: Effect) -> tuple[int, bytes] | None:
    """(port, bytes) for the effects that a device carries out; None for all others."""
    if isinstance(effect, SendState | SendTasks):
        body = SendBody(kind_of(effect.frame), encode_body(effect.frame))
        return RADIO, encode_message(body)
    if isinstance(effect, Drive):
        return BASE, encode_velocity(effect.v_mps, effect.wz_radps)
    return None


def hello_of(config: Config) -> Hello:
    """What the radio shall know of its host: who it is (255: it only listens), and its fleet's rounds."""
    fleet = config.fleet
    robot = config.robot.id if config.robot.id >= 0 else NO_ROBOT
    return Hello(LINK_VERSION, robot, fleet.id, fleet.channel, round(fleet.round_s * 1000), fleet.size)


def to_be_told(config: Config, status: RadioStatus) -> bool:
    """The radio is not what the configuration says and a Hello may change that: it is new, or restarted."""
    hello = hello_of(config)
    if status.robot != NO_ROBOT and config.robot.id < 0:
        return False  # a robot's radio that is only listened to
    adopts = status.robot == NO_ROBOT and not status.flags & FLAG_PROVISIONED
    identity = (
        (hello.robot, hello.fleet, hello.channel) if adopts else (status.robot, status.fleet, status.channel)
    )
    wanted = (*identity, hello.round_ms, hello.slots)
    return wanted != (status.robot, status.fleet, status.channel, status.round_ms, status.slots)
