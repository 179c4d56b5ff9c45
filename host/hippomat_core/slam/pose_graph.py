"""What mapping knows: keyframes, where they are, and what was measured between them. Values; solves nothing.

A link says where one keyframe was seen from another, and how surely. Links between neighbours in time come
from the front end, loop links from wherever the robot came back to.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True, eq=False)
class Keyframe:
    """A scan that the map is made of."""

    stamp_ns: int
    points: NDArray[np.float64]  # (n, 2) [m] returns in the base frame


@dataclass(frozen=True, slots=True, eq=False)
class Links:
    """Each row is a measured pose of keyframe `second` in the frame of keyframe `first`."""

    first: NDArray[np.int32]  # (k,)
    second: NDArray[np.int32]  # (k,)
    motion: NDArray[np.float64]  # (k, 3) x [m], y [m], yaw [rad]
    information: NDArray[np.float64]  # (k, 3, 3) inverse covariance, axes of keyframe `second`

    def __len__(self) -> int:
        return len(self.first)

    def and_link(
        self, first: int, second: int, motion: NDArray[np.float64], information: NDArray[np.float64]
    ) -> Links:
        """These links and one more."""
        one = Links(
            np.array([first], np.int32),
            np.array([second], np.int32),
            motion[None, :],
            information[None, :, :],
        )
        return joined([self, one])


def joined(parts: list[Links]) -> Links:
    """All links of the parts, in order."""
    parts = [NO_LINKS, *parts]
    return Links(
        np.concatenate([part.first for part in parts]),
        np.concatenate([part.second for part in parts]),
        np.concatenate([part.motion for part in parts]),
        np.concatenate([part.information for part in parts]),
    )


NO_LINKS = Links(np.empty(0, np.int32), np.empty(0, np.int32), np.empty((0, 3)), np.empty((0, 3, 3)))


@dataclass(frozen=True, slots=True, eq=False)
class PoseGraph:
    """Keyframes with their poses in the map frame, and all links between them."""

    keyframes: tuple[Keyframe, ...]
    poses: NDArray[np.float64]  # (n, 3) x [m], y [m], yaw [rad]
    steps: Links  # from each keyframe to the next
    loops: Links
    searched: int = 0  # loops of the keyframes before this one have been looked for

    def __len__(self) -> int:
        return len(self.keyframes)


EMPTY_GRAPH = PoseGraph((), np.empty((0, 3)), NO_LINKS, NO_LINKS)
