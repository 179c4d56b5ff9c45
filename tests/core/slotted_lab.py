"""The lab of fleet_lab.py with radios that agree on fleet time: common rounds, slots, relays, hosts held up.

A radio here knows without bitmaps which rows others lack; that the real one finds out is tested with its C.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from fleet_lab import Lab, Robot

from hippomat_core.fleet.hearing import heard_relay, heard_state, heard_tasks
from hippomat_core.fleet.rounds import ended_alone, radio_ended
from hippomat_core.fleet.state import awake
from hippomat_core.fleet.votes import GIVEN, ClaimId
from hippomat_core.messages import RoundEnded
from hippomat_core.wire.codec import decode_frame, encode_frame
from hippomat_core.wire.frames import (
    FLAG_LOCALIZED,
    FLAG_STOPPED,
    RELAY,
    STATE,
    TASKS,
    Header,
    RelayFrame,
    RelayRow,
    StateFrame,
    TasksFrame,
)

ROUND_NS = 100_000_000
SLOT_NS = 2_080_000
TICK_NS = 50_000_000
ROWS = 5

Frame = StateFrame | RelayFrame | TasksFrame


@dataclass
class Radio:
    """What a robot's radio holds; lost when it reboots."""

    boot_ns: int = 0
    held: dict[int, RelayRow] = field(default_factory=dict)  # of this round
    state: tuple[StateFrame, dict[int, ClaimId]] | None = None  # waits for a slot, with the votes in it
    tasks: list[TasksFrame] = field(default_factory=list)
    read_ns: int = 0  # when the host has read everything told so far


@dataclass
class SlottedLab(Lab):
    """relays: rows are passed on. stalls: robot -> (at_s, for_s) in which its host reads nothing."""

    relays: bool = True
    stalls: dict[int, list[tuple[float, float]]] = field(default_factory=dict)
    hold_ups: float = 0.02  # of a host in a round, by a quarter of a second at most
    ends: dict[int, list[tuple[int, int, bool]]] = field(default_factory=dict)  # robot -> (at, round, common)

    def __post_init__(self) -> None:
        self.radios = [Radio() for _ in range(self.config.size)]
        super().__post_init__()
        self._later(0, lambda: self._begin(0))

    def _begin(self, number: int) -> None:
        start_ns, size = number * ROUND_NS, self.config.size
        for radio in self.radios:
            radio.held = {}
        for robot in self.robots:
            for phase in range(3):
                turn_ns = start_ns + (phase * size + robot.id) * SLOT_NS
                self._later(turn_ns, lambda robot=robot, phase=phase: self._turn(robot, phase))
            end_ns = start_ns + 3 * size * SLOT_NS + self.chance.randrange(300_000)
            self._later(end_ns, lambda robot=robot: self._round_over(robot, number))
        self._later(start_ns + ROUND_NS, lambda: self._begin(number + 1))

    def _round(self, robot: Robot, life: int) -> None:
        """A tick: rounds go on where the radio tells none."""
        if life != robot.life:
            return
        self._later(self.now_ns + TICK_NS, lambda: self._round(robot, life))
        stamp_ns = self.now_ns + robot.clock_ns
        if not self._stalled_until(robot) and robot.fleet.clock.due(stamp_ns):
            self._end(robot, ended_alone(robot.fleet, stamp_ns))
            self._note_end(robot)

    def _boot(self, robot: Robot) -> None:
        self.radios[robot.id] = Radio(self.now_ns - self.chance.randrange(10**9))
        super()._boot(robot)

    def _note_end(self, robot: Robot) -> None:
        clock = robot.fleet.clock
        self.ends.setdefault(robot.id, []).append((self.now_ns, clock.round, clock.common))

    # ---- the air ----

    def _send(self, robot: Robot, _kind: int, frame: StateFrame | TasksFrame | None) -> None:
        radio = self.radios[robot.id]
        if isinstance(frame, StateFrame):
            given = [vote.claim for vote in robot.fleet.votes if vote.phase == GIVEN]
            radio.state = (frame, {claim.robot: claim for claim in given})
        elif frame is not None:
            radio.tasks = [*radio.tasks, frame][-8:]

    def _turn(self, robot: Robot, phase: int) -> None:
        radio = self.radios[robot.id]
        if not robot.up or self.now_ns < radio.boot_ns + 3 * ROUND_NS:
            return
        if radio.state is not None:
            (frame, quoted), radio.state = radio.state, None
            self._on_air(robot, STATE, frame, quoted)
            radio.held[robot.id] = row_of(robot.id, frame)
        elif phase == 2 and radio.tasks:
            self._on_air(robot, TASKS, radio.tasks.pop(0), {})
        elif phase > 0 and self.relays:
            rows = self._needed(radio)
            if rows:
                held = sum(1 << k for k in radio.held)
                self._on_air(robot, RELAY, RelayFrame(self.config.size, held, rows), {})

    def _needed(self, radio: Radio) -> tuple[RelayRow, ...]:
        up = [self.radios[robot.id] for robot in self.robots if robot.up]
        lack = {k: sum(k not in other.held for other in up) for k in radio.held}
        most = sorted((k for k in lack if lack[k] > 0), key=lambda k: -lack[k])
        return tuple(radio.held[k] for k in most[:ROWS])

    def _on_air(self, robot: Robot, kind: int, frame: Frame, quoted: dict[int, ClaimId]) -> None:
        robot.sequence += 1
        fleet_us = self.now_ns // 1000
        header = Header(kind, False, self.config.id, robot.id, robot.boot, robot.sequence, fleet_us)
        if self.wire:
            header, frame = decode_frame(encode_frame(header, frame))  # type: ignore[assignment]
        if kind == STATE:
            self.quoted[robot.id, robot.boot, robot.sequence] = quoted
        for receiver in self.robots:
            lost = self.chance.random() < self.loss
            if receiver is robot or lost or not self.hears(robot.id, receiver.id, self.now_ns / 1e9):
                continue
            if isinstance(frame, StateFrame):
                self.radios[receiver.id].held[robot.id] = row_of(robot.id, frame)
            elif isinstance(frame, RelayFrame):
                for row in frame.rows:
                    self.radios[receiver.id].held.setdefault(row.robot, row)
            self._tell(receiver, lambda radio_us, to=receiver: self._read(to, radio_us, header, frame))

    # ---- from radio to host ----

    def _tell(self, robot: Robot, read: Callable[[int], None]) -> None:
        """The host reads it a moment later, in order, and not while it is held up."""
        if not robot.up:
            return
        radio, life, radio_us = self.radios[robot.id], robot.life, self._radio_us(robot)
        held_up = self.chance.random() < self.hold_ups / (3 * self.config.size)
        way_ns = self.chance.randrange(250_000_000) if held_up else self.chance.randrange(4_000_000)
        radio.read_ns = max(radio.read_ns, self.now_ns + way_ns, self._stalled_until(robot))
        self._later(radio.read_ns, lambda: read(radio_us) if robot.up and robot.life == life else None)

    def _stalled_until(self, robot: Robot) -> int:
        """0: it is not."""
        spans = (
            (round(at_s * 1e9), round((at_s + for_s) * 1e9)) for at_s, for_s in self.stalls.get(robot.id, [])
        )
        return max((end_ns for at_ns, end_ns in spans if at_ns <= self.now_ns < end_ns), default=0)

    def _radio_us(self, robot: Robot) -> int:
        return (self.now_ns - self.radios[robot.id].boot_ns) // 1000

    def _read(self, robot: Robot, radio_us: int, header: Header, frame: Frame) -> None:
        stamp_ns = self.now_ns + robot.clock_ns
        fleet = awake(robot.fleet, stamp_ns, radio_us)
        if isinstance(frame, StateFrame):
            robot.fleet, _ = heard_state(fleet, stamp_ns, header, frame, -50)
        elif isinstance(frame, RelayFrame):
            robot.fleet, _ = heard_relay(fleet, stamp_ns, header, frame, -50)
        else:
            robot.fleet, _ = heard_tasks(fleet, stamp_ns, header, frame)
        self._note_learnt(robot)
        if self.watchful:
            self._check()

    def _round_over(self, robot: Robot, number: int) -> None:
        held = sum(1 << k for k in self.radios[robot.id].held)
        fleet_us = self.now_ns // 1000
        self._tell(robot, lambda radio_us: self._told_round(robot, number, fleet_us, radio_us, held))

    def _told_round(self, robot: Robot, number: int, fleet_us: int, radio_us: int, held: int) -> None:
        stamp_ns = self.now_ns + robot.clock_ns
        robot.fleet, ends = radio_ended(
            robot.fleet, RoundEnded(stamp_ns, number, fleet_us, radio_us, held, True)
        )
        if ends:
            self._end(robot, robot.fleet)
            self._note_end(robot)


def row_of(robot: int, frame: StateFrame) -> RelayRow:
    """What RELAY carries of a STATE."""
    claim = frame.claim
    return RelayRow(
        robot=robot,
        age=0,
        status=frame.status,
        slot=claim.slot,
        generation=claim.generation,
        cost=claim.cost,
        confirmed=claim.confirmed,
        tag=claim.tag,
        localized=bool(frame.flags & FLAG_LOCALIZED),
        stopped=bool(frame.flags & FLAG_STOPPED),
        x_cm=claim.x_cm,
        y_cm=claim.y_cm,
        z_cm=claim.z_cm,
        eta_s=min(claim.eta_ds // 10, 255),
        costs=frame.costs,
    )
