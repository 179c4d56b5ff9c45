"""What a radio of robot 2 in fleet 1 says of itself; any field can be given another value."""

from __future__ import annotations

import dataclasses
from typing import Any

from hippomat_core.messages import RadioStatus
from hippomat_core.wire import frames as air
from hippomat_core.wire import link

_ZEROS = {field.name: 0 for field in dataclasses.fields(link.Status)}
_IDENTITY = {"robot": 2, "fleet": 1, "channel": 1, "rate_mbps": 6, "round_ms": 100, "slots": 5}
_BOOT = {"boot_id": 5, "boot_counter": 1, "reset_reason": 1, "flags": link.FLAG_OPEN}
_FIRMWARE = {"firmware": "hippomat 0.1.0", "git_hash": "abcdef01"}


def hello_of_robot(robot: int = 2, **changes: Any) -> link.Hello:
    identity = {name: _IDENTITY[name] for name in ("fleet", "channel", "round_ms", "slots")}
    return link.Hello(**({"link_version": link.LINK_VERSION, "robot": robot} | identity | changes))


def reply_of(**changes: Any) -> link.HelloReply:
    versions = {"link_version": link.LINK_VERSION, "protocol_version": air.PROTOCOL_VERSION}
    return link.HelloReply(**(versions | _BOOT | {"mac": bytes(6)} | _IDENTITY | _FIRMWARE | changes))


def status_of(**changes: Any) -> link.Status:
    return link.Status(**(_ZEROS | _BOOT | _IDENTITY | _FIRMWARE | changes))


def radio_status(stamp_ns: int, **changes: Any) -> RadioStatus:
    return RadioStatus(stamp_ns, **dataclasses.asdict(status_of(**changes)))
