"""What a log lacks that passed every check, in the words that all tools use. Such a log is exit code 3.

Decides what "not whole" means: records were shed or lost, or its end went with a crash. Everything else of it
is as good as any log's.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Protocol

ENDED_EARLY = "recovered after a crash: its last moments are missing"


class Told(Protocol):
    """A run whose records were read to the end: reader.Run, fleet_story.values.RobotStory."""

    @property
    def lost(self) -> Sequence[str]: ...
    @property
    def recovered(self) -> bool: ...


def shortfalls(told: Told) -> list[str]:
    """One line each; none: the log is whole."""
    return [*told.lost, *([ENDED_EARLY] if told.recovered else [])]


def not_whole(who: str, lacks: Iterable[str]) -> list[str]:
    """The same with whose log it is, e.g. "robot 2"."""
    return [f"log of {who} is not whole: {line}" for line in lacks]


def whose_log(robot: int) -> str:
    return f"robot {robot}" if robot >= 0 else "the observer"
