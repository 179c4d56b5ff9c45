"""The fleet digest: 32 bits over everything that robots of one fleet must agree on. Knows no files."""

from __future__ import annotations

import dataclasses
import hashlib

from hippomat_core.config import FleetConfig
from hippomat_core.wire.frames import PROTOCOL_VERSION


def fleet_digest(config: FleetConfig, c_max_s: float, ground: bytes, policy_hash: bytes = b"") -> int:
    """Digest of protocol version, fleet settings, the c_max in use [s], the ground and the policy's weights.

    ground: the map's hash, the planner's name and, where tasks are placed by everyone for himself, the sites:
    they follow from radius and inflation too, and robots that differ would drive elsewhere for the same task.
    policy_hash stands for the weights themselves: the path of their file may differ between robots.
    """
    settings = dataclasses.asdict(dataclasses.replace(config, c_max_s=c_max_s, policy=""))
    text = f"hippomat {PROTOCOL_VERSION} {sorted(settings.items())!r}"
    whole = hashlib.blake2b(digest_size=4)
    for part in (text.encode(), ground, policy_hash):
        whole.update(len(part).to_bytes(4, "little"))
        whole.update(part)
    return int.from_bytes(whole.digest(), "little")
