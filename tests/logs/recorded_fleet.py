"""Fleets whose logs are known to the last frame: cores in lockstep, an air that tests cut where they like."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from slotted_world import SlottedWorld

from hippomat_core import messages as m
from hippomat_core.config import FleetConfig
from hippomat_core.wire.frames import OPERATOR, RELAY, TASKS, WAITING, Header, TasksFrame, TaskSlot
from hippomat_logs.manifest import run_manifest
from hippomat_logs.reader import Record, Run
from hippomat_logs.recorder import Recorder
from hippomat_logs.schema import EVENTS, TOPICS

WALL_NS, START_NS = 1_700_000_000_000_000_000, 1_000_000_000
FIRST_REQUEST_S = 3.7  # nobody requests earlier: robots listen first
OPERATED = {"task_source": "orders", "turnover": "on_completion", "dwell_s": 0.5}


@dataclass(slots=True)
class MemoryRun(Run):
    """A run whose records were never written."""

    kept: list[Record] = field(default_factory=list)

    def records_in_order(self, kinds: Collection[type] = ()) -> Iterator[Record]:
        return (record for record in self.kept if not kinds or type(record.message) in kinds)

    @property
    def name(self) -> str:
        return f"robot{self.robot:02d}"


class RecordedFleet(SlottedWorld):
    """What is on the air reaches whom `delivers` says, unless it is lost; who is `mute` sends no STATE."""

    def __init__(
        self,
        robots: int = 3,
        loss: float = 0.0,
        seed: int = 1,
        starts: Sequence[tuple[float, float]] = (),
        relays: bool = True,
        policy: bytes | None = None,
        **fleet: Any,
    ) -> None:
        settings: dict[str, Any] = {"task_slots": 4, "allocator": "hungarian", **fleet}
        super().__init__(robots, loss, seed, fleet=FleetConfig(**settings), policy=policy, starts=starts)
        self.relays, self.number = relays, 0
        self.delivers: Callable[[int, int], bool] = lambda *_: True  # (sender, receiver)
        self.mute: set[int] = set()
        self.hears = lambda sender, receiver: sender != receiver and self.delivers(sender, receiver)

    def order(self, places: Sequence[tuple[float, float]], *robots: int) -> None:
        """An operator's tasks, one per slot, heard by these robots (default: all) right now."""
        slots = [
            TaskSlot(slot, 1, WAITING, round(100 * x_m), round(100 * y_m), 0)
            for slot, (x_m, y_m) in enumerate(places)
        ]
        header = Header(TASKS, False, 1, OPERATOR, 1, 1, self.now_ns // 1000)
        for robot in robots or range(len(self.bodies)):
            at_ns = self._next_ns(robot)
            told = m.TasksHeard(at_ns, at_ns // 1000, at_ns // 1000, -50, header, TasksFrame(tuple(slots)))
            self.bodies[robot].take(told)

    def deafen_to_rounds(self, robot: int) -> None:
        """Its radio tells it no rounds any more."""
        body = self.bodies[robot]
        take = body.take
        body.take = lambda event: () if isinstance(event, m.RoundEnded) else take(event)  # type: ignore[method-assign]

    def manifest(self, robot: int) -> dict[str, str]:
        config = self.bodies[robot].state.config
        return run_manifest(config, session_id=f"{len(self.bodies):04x}{robot:04x}", policy=self.policy)

    def runs(self) -> list[Run]:
        """As if they had been written and read."""
        return [
            MemoryRun((Path(f"robot{k}"),), self.manifest(k), self.policy or b"", kept=_records(body.trace))
            for k, body in enumerate(self.bodies)
        ]

    def write(self, directory: Path, *robots: int) -> Path:
        """The logs of these robots (default: all) as files."""
        for robot in robots or range(len(self.bodies)):
            body = self.bodies[robot]
            recorder = Recorder(
                directory,
                self.manifest(robot),
                config=body.state.config,
                wall_ns=WALL_NS,
                stamp_ns=START_NS,
                lossless=True,
                policy=self.policy or b"",
            )
            for stamp_ns, message in body.trace:
                if isinstance(message, EVENTS):
                    recorder.put(message.stamp_ns, message)  # type: ignore[arg-type]
                else:
                    recorder.put(stamp_ns, message)  # type: ignore[arg-type]
            recorder.close()
        return directory

    def _round(self, number: int) -> None:
        self.number = number
        self.states = {robot: frame for robot, frame in self.states.items() if robot not in self.mute}
        super()._round(number)

    def _on_air(self, sender: int, kind: int, frame: Any, held: list[set[int]]) -> None:
        if kind == RELAY and not self.relays:
            return
        super()._on_air(sender, kind, frame, held)
        body, at_ns = self.bodies[sender], self._next_ns(sender)
        body.take(m.FrameSent(at_ns, at_ns // 1000, kind, body.sequence, True))


def _records(trace: Sequence[tuple[int, Any]]) -> list[Record]:
    offset_ns = WALL_NS - START_NS
    return [
        Record(number, stamp_ns + offset_ns, TOPICS[type(message)], message)
        for number, (stamp_ns, message) in enumerate(trace, 1)
    ]
