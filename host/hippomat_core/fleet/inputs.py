"""What the caller tells the fleet at the end of a round. Knows integers of the wire, not their sources."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from hippomat_core.fleet.claims import OwnClaim
from hippomat_core.replaced import quickly_made
from hippomat_core.wire.frames import FLAG_LOCALIZED, IDLE


def _no_steps() -> NDArray[np.uint8]:
    return np.zeros(0, np.uint8)


@dataclass(frozen=True, slots=True, eq=False)
class Intent:
    """The cell where the robot is and the moves to its next ones (0..26, see StateFrame), map grid."""

    ix: int = 0
    iy: int = 0
    iz: int = 0
    steps: NDArray[np.uint8] = field(default_factory=_no_steps)  # (<= 12,)


@quickly_made
@dataclass(frozen=True, slots=True, eq=False)
class Outlook:
    """What holding a claim means for the robot, from this moment on."""

    eta_s: float  # until it is at the claim's destination; inf: there is no way
    costs_q: NDArray[np.uint8]  # (M,) until it could be at each task, once it has served the claim


@dataclass(frozen=True, slots=True, eq=False)
class OwnInputs:
    """What the robot says of itself at the end of a round. Fleet frame.

    A free robot broadcasts what tasks cost from here. One that holds a claim broadcasts its outlook instead,
    from the round on in which it makes the claim; so others know when and where it will be free.
    """

    costs_here: Callable[
        [], NDArray[np.uint8]
    ]  # (M,) for fleet.tasks as it is at the call; 255 = unreachable
    can_request: bool
    why_not: str = ""  # if it cannot
    arrived: bool = False  # within the goal tolerance of the claim's destination
    may_serve: bool = True  # nothing but the claim's confirmation stands in the way
    drop_claim: str = ""  # cause, if the claim must be let go
    shun_s: float = 0.0  # and for how long its task is not to be claimed again
    x_cm: int = 0
    y_cm: int = 0
    z_cm: int = 0
    yaw_256: int = 0
    speed_2cmps: int = 0
    outlook: Callable[[OwnClaim], Outlook] | None = None  # None: as if a claim were served already, here
    c_max_s: float = 1.0  # that the costs are quantised with
    status: int = IDLE  # IDLE, or OBSERVING, BLOCKED, LOST; ASSIGNED and SERVING follow from the claim
    flags: int = FLAG_LOCALIZED
    intent: Intent = field(default_factory=Intent)
    stop_counter: int = 0

    def outlook_of(self, claim: OwnClaim) -> Outlook:
        """With `claim` in hand."""
        return Outlook(0.0, self.costs_here()) if self.outlook is None else self.outlook(claim)
