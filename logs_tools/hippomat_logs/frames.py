"""Where frames are, from the transforms of a log: /tf and /tf_static as a tree, looked up at any time.

Knows transforms (REP 105), not what moves. A lookup takes the latest transform before its time, or the first.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hippomat_core.errors import HippomatError
from hippomat_logs.exports import stamps_s
from hippomat_logs.opened_run import OpenedRun

TOPICS = ("/tf_static", "/tf")
Matrices = NDArray[np.float64]  # (n, 4, 4)


class FrameTree:
    """Transforms by child frame: its parent, stamps (n,) [s], matrices (n, 4, 4) child -> parent."""

    def __init__(self, run: OpenedRun) -> None:
        self._links: dict[str, tuple[str, NDArray[np.float64], Matrices]] = {}
        for topic in TOPICS:
            if topic in run.topics and run.topics[topic].count != 0:
                self._add(run, topic)

    def root_of(self, frame: str) -> str:
        """The frame that `frame` hangs on in the end; itself where nothing is known of it."""
        return self._chain(frame)[-1]

    def matrices(self, frame: str, times_s: NDArray[np.float64]) -> Matrices:
        """frame -> its root at every time: (n, 4, 4)."""
        result = np.broadcast_to(np.eye(4), (len(times_s), 4, 4))
        for child in self._chain(frame)[:-1]:
            _, stamps_s, links = self._links[child]
            index = np.clip(np.searchsorted(stamps_s, times_s, side="right") - 1, 0, len(stamps_s) - 1)
            result = links[index] @ result
        return result

    def _chain(self, frame: str) -> list[str]:
        chain = [_plain(frame)]
        while chain[-1] in self._links:
            chain.append(self._links[chain[-1]][0])
            if chain[-1] in chain[:-1]:
                raise HippomatError(f"the frames {' -> '.join(chain)} form a circle in this log")
        return chain

    def _add(self, run: OpenedRun, topic: str) -> None:
        table = run.table(topic).child("transforms")
        move = np.column_stack([table[f"transform.translation.{axis}"] for axis in "xyz"])
        turn = np.column_stack([table[f"transform.rotation.{axis}"] for axis in "xyzw"])
        links, times_s = _matrices(move, turn), stamps_s(table)
        children = np.array([_plain(name) for name in table["child_frame_id"]])
        for child in dict.fromkeys(children.tolist()):
            which = np.flatnonzero(children == child)
            which = which[np.argsort(times_s[which], kind="stable")]
            parent = _plain(table["header.frame_id"][which[0]])
            self._links[child] = parent, times_s[which], links[which]


def _plain(frame: str) -> str:
    """ROS 1 wrote /laser where ROS 2 writes laser."""
    return frame.lstrip("/")


def _matrices(move: NDArray[np.float64], turn: NDArray[np.float64]) -> Matrices:
    """Translations (n, 3) and quaternions (n, 4) x, y, z, w as (n, 4, 4)."""
    x, y, z, w = (turn / np.linalg.norm(turn, axis=1, keepdims=True)).T
    made = np.zeros((len(move), 4, 4))
    made[:, 3, 3] = 1.0
    made[:, :3, 3] = move
    made[:, 0, :3] = np.column_stack([1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)])
    made[:, 1, :3] = np.column_stack([2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)])
    made[:, 2, :3] = np.column_stack([2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)])
    return made
