"""After a STOP or RESUME was given to a radio: see who obeys, until all that are heard do, or the deadline.

The radio has a moment to obey itself; then every robot has, in its STATE. Decides the exit code; knows
nothing of what came before.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

from hippomat_core.errors import PortError
from hippomat_core.fleet.robot_names import named
from hippomat_core.wire.link import AskPeers, Command
from hippomat_host.conversation import Conversation
from hippomat_host.stop_watch import StopWatch
from hippomat_host.unheard import why_nobody

DEADLINE_S = 5.0
SOME_DID_NOT = 2
_REPEAT_S = 0.3  # a command that the radio has not obeyed by then is said again
_SILENT_S = 1.0
_STALE_S = 0.1  # frames of before the command may still wait in the radio


@dataclass(frozen=True, slots=True)
class Goal:
    """What was commanded, and how it shows."""

    command: Command
    at_least_s: float  # to go on listening, so that the fleet is known
    obeyed: Callable[[StopWatch], bool]  # by our own radio
    shows: Callable[[StopWatch, float], list[int]]  # robots that show it since that time
    done: str  # "robot 3 ..."
    unknown: str  # "whether it ... is not known"


class Following:
    """From the moment of a command on."""

    def __init__(self, radio: Conversation, watch: StopWatch, goal: Goal, begun_s: float) -> None:
        self._radio, self._watch, self._goal, self._begun_s = radio, watch, goal, begun_s
        self._obeyed = False
        self._shown: list[int] = []

    def run(self) -> int:
        """Prints who shows it, and returns the exit code; raises PortError where nothing can be seen."""
        until_s, repeat_s = self._begun_s + DEADLINE_S, self._begun_s + _REPEAT_S
        self._radio.say(AskPeers())  # its answer ends with a status
        while (now_s := time.monotonic()) < until_s and not self._complete(now_s):
            message = self._radio.hear(min(until_s, now_s + _REPEAT_S))
            if message is not None:
                self._watch.hear(time.monotonic(), message)
            self._look()
            if not self._obeyed and time.monotonic() >= repeat_s:
                repeat_s += _REPEAT_S
                self._radio.say(self._goal.command)
                self._radio.say(AskPeers())
        return self._result()

    def _look(self) -> None:
        self._obeyed = self._obeyed or self._goal.obeyed(self._watch)
        if not self._obeyed:
            return
        shown = self._goal.shows(self._watch, self._begun_s + _STALE_S)
        for robot in shown:
            if robot not in self._shown:
                say(f"  {time.monotonic() - self._begun_s:4.1f} s  robot {robot} {self._goal.done}")
        self._shown = shown

    def _complete(self, now_s: float) -> bool:
        listened = now_s >= self._begun_s + self._goal.at_least_s
        return listened and self._obeyed and bool(self._watch.heard) and not self._missing()

    def _missing(self) -> list[int]:
        return [robot for robot in self._watch.heard if robot not in self._shown]

    def _result(self) -> int:
        watch, missing, path = self._watch, self._missing(), self._radio.path
        if not self._obeyed:
            raise PortError(f"the radio on {path} does not obey: unplug it, plug it in again, and repeat")
        if not watch.heard and not watch.twin:
            raise PortError(
                f"sent, but no robot is heard: {why_nobody(path, self._radio.reply, watch)} "
                "(the radio goes on sending it for a minute while it has power)"
            )
        if watch.twin:
            say(f"          {watch.twin}: whether it {self._goal.unknown} is not known")
        for robot in missing:
            say(f"          robot {robot}: {self._why_not(robot)}")
        if missing:
            count = f"{len(missing)} of {len(watch.heard)} robots heard"
            say(f"{count} did not within {DEADLINE_S:.0f} s: {named(missing)}")
            return SOME_DID_NOT
        if watch.twin:
            return SOME_DID_NOT
        say(f"done: {'all ' if len(watch.heard) > 1 else ''}{named(watch.heard)}")
        return 0

    def _why_not(self, robot: int) -> str:
        shown, now_s = self._watch.robots.get(robot), time.monotonic()
        if robot in self._watch.doubled:
            return "two radios send under its id: provision one of them anew"
        if shown is None or now_s - shown.at_s > _SILENT_S:
            silent = "no STATE of it was heard" if shown is None else f"SILENT for {now_s - shown.at_s:.1f} s"
            alive = robot in self._watch.radios_now
            return silent + ", but its radio is heard: is its daemon running?" * alive
        if not shown.stopped:
            return "NOT STOPPED"
        return f"STOPPED by STOP {shown.counter}" if shown.counter >= 0 else "STOPPED"


def say(text: str) -> None:
    """At once, whatever standard output is."""
    print(text, flush=True)
