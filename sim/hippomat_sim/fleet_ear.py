"""What an outsider learns of the fleet by listening to its STATE frames. Asks nobody and decides nothing."""

from __future__ import annotations

from dataclasses import dataclass

from hippomat_core.errors import WireError
from hippomat_core.wire.codec import decode_frame
from hippomat_core.wire.frames import NO_SLOT, SERVING, STATE, AirClaim, StateFrame

STATUS_NAMES = ("idle", "assigned", "serving", "observing", "blocked", "lost")


@dataclass(slots=True)
class RobotHeard:
    """The last STATE of one robot and what followed from all of them."""

    first_us: int = -1  # -1: never heard
    last_us: int = -1
    frame: StateFrame | None = None
    served: int = 0  # claims that ended while being served

    @property
    def status(self) -> str:
        if self.frame is None:
            return "silent"
        return STATUS_NAMES[self.frame.status] if self.frame.status < len(STATUS_NAMES) else "?"

    @property
    def claim(self) -> str:
        """slot.generation, with ? while not confirmed."""
        if self.frame is None or self.frame.claim.slot == NO_SLOT:
            return "-"
        claim = self.frame.claim
        return f"{claim.slot}.{claim.generation}{'' if claim.confirmed else '?'}"


class FleetEar:
    """Counts a task as served when a claim goes away out of service; the logs have the robots' own word."""

    def __init__(self, robots: int) -> None:
        self.robots = [RobotHeard() for _ in range(robots)]
        self.unreadable = 0

    def hear(self, at_us: int, frame: bytes) -> None:
        """One frame as it was on the air."""
        if frame[0] & 7 != STATE:  # bit 3: sealed
            return
        try:
            header, state = decode_frame(frame)
        except WireError:
            self.unreadable += 1
            return
        if header.sender >= len(self.robots) or not isinstance(state, StateFrame):
            return
        heard = self.robots[header.sender]
        if heard.frame is None:
            heard.first_us = at_us
        elif heard.frame.status == SERVING and _identity(heard.frame.claim) != _identity(state.claim):
            heard.served += 1
        heard.last_us, heard.frame = at_us, state


def _identity(claim: AirClaim) -> tuple[int, int]:
    return claim.slot, claim.generation
