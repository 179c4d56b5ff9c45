"""Many robots, a lossy air, no thread and no clock: rule F and the allocation as a fleet lives them.

Every robot has its own round phase and its own clock; frames take up to two rounds; links lose, fade in one
direction and split; robots reboot. Checked at every round end: at most one confirmed holder of a task. Rounds
in common, with relays: slotted_lab.py.
"""

from __future__ import annotations

import heapq
import itertools
import random
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from hippomat_core.allocation.port import Allocator
from hippomat_core.allocation.quantise import quantise
from hippomat_core.config import Config, FleetConfig, RobotConfig
from hippomat_core.fleet.claims import OwnClaim
from hippomat_core.fleet.hearing import heard_state, heard_tasks
from hippomat_core.fleet.holding import is_confirmed_at
from hippomat_core.fleet.inputs import Outlook, OwnInputs
from hippomat_core.fleet.rounds import RoundOutcome, end_round, ended_alone
from hippomat_core.fleet.sites import task_sites
from hippomat_core.fleet.state import FleetState, initial, started, with_map
from hippomat_core.fleet.votes import GIVEN, UNKNOWN_ROUND, ClaimId
from hippomat_core.messages import ClaimChanged, ConflictSeen, Effect
from hippomat_core.wire.codec import decode_frame, encode_frame
from hippomat_core.wire.frames import STATE, TASKS, Header, StateFrame, TasksFrame

SITES = task_sites(np.ones((100, 100), np.bool_), 0.05, 0.0, 0.0, 0.12)
DIGEST = 0xF1EE7
C_MAX_S = 20.0
SECOND = 10**9


@dataclass
class Robot:
    id: int
    phase_ns: int
    clock_ns: int  # its clock less the lab's
    fleet: FleetState
    x: float
    y: float
    up: bool = True
    boot: int = 1
    sequence: int = 0
    destination: tuple[float, float, float] | None = None
    life: int = 0  # round ends of earlier lives are ignored


@dataclass
class Lab:
    """A world of points that move in straight lines, and the air between them."""

    config: FleetConfig
    seed: int
    loss: float = 0.0
    speed_mps: float = 1.0
    hears: Callable[[int, int, float], bool] = lambda *_: True  # (sender, receiver, second)
    reboots: dict[int, list[tuple[float, float]]] = field(default_factory=dict)  # robot -> (at_s, down_s)
    now_ns: int = 0
    completed: dict[tuple[int, int], list[tuple[int, int]]] = field(default_factory=dict)
    served_by: Counter[int] = field(default_factory=Counter)
    learnt: dict[tuple[int, int], dict[int, int]] = field(default_factory=dict)  # who knew of it, and when
    effects: list[tuple[int, int, Effect]] = field(default_factory=list)
    quoted: dict[tuple[int, int, int], dict[int, ClaimId]] = field(default_factory=dict)
    watchful: bool = False  # check at every frame heard, not only at round ends
    wire: bool = False  # frames travel as bytes
    allocator: Allocator | None = None  # of all robots; None: made by the name in the config

    def __post_init__(self) -> None:
        self.chance = random.Random(self.seed)
        self.order = itertools.count()
        self.queue: list[tuple[int, int, Callable[[], None]]] = []
        self.robots = [self._robot(k) for k in range(self.config.size)]
        for robot in self.robots:
            self._later(robot.phase_ns, lambda robot=robot: self._boot(robot))
            for at_s, down_s in self.reboots.get(robot.id, []):
                self._later(round(at_s * SECOND), lambda robot=robot: self._crash(robot))
                self._later(round((at_s + down_s) * SECOND), lambda robot=robot: self._boot(robot))

    def run(self, seconds: float) -> None:
        end_ns = self.now_ns + round(seconds * SECOND)
        while self.queue and self.queue[0][0] <= end_ns:
            self.now_ns, _, action = heapq.heappop(self.queue)
            action()

    def confirmed_holders(self) -> list[int]:
        return [k.id for k in self.robots if is_confirmed_at(k.fleet, self.now_ns + k.clock_ns)]

    def served_again(self) -> dict[tuple[int, int], list[tuple[int, int]]]:
        """Tasks served twice."""
        return {task: times for task, times in self.completed.items() if len(times) > 1}

    def twice_completed(self) -> dict[tuple[int, int], list[tuple[int, int]]]:
        """Tasks served twice, but for what cannot be removed: a robot served, then was cut off or died before
        a majority learnt of it."""
        again = self.served_again()
        return {task: times for task, times in again.items() if self._was_known(task, times[1][0])}

    def _was_known(self, task: tuple[int, int], at_ns: int) -> bool:
        timing = self.robots[0].fleet.timing  # votes given before count for so long
        before_ns = at_ns - timing.lease_ns - timing.delay_ns
        learnt = [learnt_ns for learnt_ns in self.learnt.get(task, {}).values() if learnt_ns < before_ns]
        return len(learnt) > self.config.size // 2

    def changes(self, what: str) -> list[ClaimChanged]:
        changed = [e for _, _, e in self.effects if isinstance(e, ClaimChanged)]
        return [change for change in changed if change.what == what]

    def conflicts(self) -> list[ConflictSeen]:
        return [effect for _, _, effect in self.effects if isinstance(effect, ConflictSeen)]

    def _robot(self, k: int) -> Robot:
        phase_ns = self.chance.randrange(100_000_000)
        clock_ns = self.chance.randrange(10**12)
        config = Config(fleet=self.config, robot=RobotConfig(id=k))
        return Robot(k, phase_ns, clock_ns, initial(config, self.allocator), 0.4 + 0.7 * k, 2.5, up=False)

    def _later(self, at_ns: int, action: Callable[[], None]) -> None:
        heapq.heappush(self.queue, (at_ns, next(self.order), action))

    def _crash(self, robot: Robot) -> None:
        robot.up, robot.life, robot.destination = False, robot.life + 1, None
        for known in self.learnt.values():
            known.pop(robot.id, None)

    def _boot(self, robot: Robot) -> None:
        config = Config(fleet=self.config, robot=RobotConfig(id=robot.id))
        stamp_ns = self.now_ns + robot.clock_ns
        fleet = started(initial(config, self.allocator), stamp_ns)
        robot.fleet, _ = with_map(fleet, stamp_ns, SITES, DIGEST)
        robot.up, robot.boot, robot.sequence = True, robot.boot + 1, 0
        life = robot.life
        self._later(self.now_ns + 1, lambda: self._round(robot, life))

    def _round(self, robot: Robot, life: int) -> None:
        if life != robot.life:
            return
        round_ns = robot.fleet.timing.round_ns
        jitter_ns = self.chance.randrange(20_000_000)
        self._later(self.now_ns + round_ns + jitter_ns - 10_000_000, lambda: self._round(robot, life))
        self._end(robot, ended_alone(robot.fleet, self.now_ns + robot.clock_ns))

    def _end(self, robot: Robot, ending: FleetState) -> None:
        self._check()
        arrived = self._move(robot)
        stamp_ns = self.now_ns + robot.clock_ns
        robot.fleet, outcome = end_round(ending, stamp_ns, self._inputs(robot, arrived))
        robot.destination = outcome.destination
        self._note(robot, outcome)
        self._note_learnt(robot)
        self._send(robot, STATE, outcome.state_frame)
        for frame in outcome.tasks_frames:
            self._send(robot, TASKS, frame)

    def _move(self, robot: Robot) -> bool:
        if robot.destination is None:
            return False
        dx, dy = robot.destination[0] - robot.x, robot.destination[1] - robot.y
        distance, step = float(np.hypot(dx, dy)), self.speed_mps * 0.1
        share = min(1.0, step / distance) if distance > 0 else 1.0
        robot.x, robot.y = robot.x + share * dx, robot.y + share * dy
        return distance <= step

    def _inputs(self, robot: Robot, arrived: bool) -> OwnInputs:
        away = np.hypot(*(robot.fleet.tasks.positions_m()[:, :2] - [robot.x, robot.y]).T)
        costs_q = quantise(away / self.speed_mps, C_MAX_S)
        x_cm, y_cm = round(robot.x * 100), round(robot.y * 100)
        return OwnInputs(
            lambda: costs_q,
            can_request=True,
            arrived=arrived,
            x_cm=x_cm,
            y_cm=y_cm,
            outlook=lambda claim: self._outlook(robot, claim),
            c_max_s=C_MAX_S,
        )

    def _outlook(self, robot: Robot, claim: OwnClaim) -> Outlook:
        x, y, _ = claim.destination_m
        eta_s = float(np.hypot(x - robot.x, y - robot.y)) / self.speed_mps
        free_s = eta_s + claim.dwell_left_s(self.now_ns + robot.clock_ns, self.config.dwell_s)
        away = np.hypot(*(robot.fleet.tasks.positions_m()[:, :2] - [x, y]).T)
        return Outlook(eta_s, quantise(free_s + away / self.speed_mps, C_MAX_S))

    def _note(self, robot: Robot, outcome: RoundOutcome) -> None:
        for effect in outcome.effects:
            if isinstance(effect, ClaimChanged | ConflictSeen):
                self.effects.append((self.now_ns, robot.id, effect))
            if isinstance(effect, ClaimChanged) and effect.what == "completed":
                task = (effect.slot, effect.generation)
                self.completed.setdefault(task, []).append((self.now_ns, robot.id))
                self.served_by[robot.id] += 1

    def _check(self) -> None:
        """At this instant: one confirmed holder per task, and every vote counted was meant for that claim."""
        holders: dict[tuple[int, int], int] = {}
        for robot in self.robots:
            if robot.up and is_confirmed_at(robot.fleet, self.now_ns + robot.clock_ns):
                claim = robot.fleet.own_claim
                assert claim is not None
                other = holders.setdefault(claim.id.task, robot.id)
                assert other == robot.id, f"{other} and {robot.id} hold {claim.id.task} at {self.now_ns}"
                self._check_votes(robot, claim)

    def _check_votes(self, robot: Robot, claim: OwnClaim) -> None:
        timing, stamp_ns = robot.fleet.timing, self.now_ns + robot.clock_ns
        for peer in robot.fleet.peers:
            if peer is None or not claim.since_ns < peer.stamp_ns >= stamp_ns - timing.lease_ns:
                continue
            if peer.frame.endorsed[robot.id] == claim.id.tag:
                meant = self.quoted[peer.robot, peer.boot, peer.sequence][robot.id]
                same = meant == claim.id and meant.round in (claim.id.round, UNKNOWN_ROUND)
                assert same, f"{peer.robot} voted for {meant}, counted for {claim.id}"

    def _send(self, robot: Robot, kind: int, frame: StateFrame | TasksFrame | None) -> None:
        if frame is None:
            return
        robot.sequence += 1
        header = Header(kind, False, self.config.id, robot.id, robot.boot, robot.sequence, 0)
        if self.wire:
            header, frame = decode_frame(encode_frame(header, frame))  # type: ignore[assignment]
        given = [vote.claim for vote in robot.fleet.votes if vote.phase == GIVEN]
        self.quoted[robot.id, robot.boot, robot.sequence] = {claim.robot: claim for claim in given}
        for receiver in self.robots:
            lost = self.chance.random() < self.loss
            slow = self.chance.random() < 0.02
            delay_ns = self.chance.randrange(2_000_000, 180_000_000 if slow else 15_000_000)
            if receiver is not robot and not lost and self.hears(robot.id, receiver.id, self.now_ns / SECOND):
                self._later(
                    self.now_ns + delay_ns,
                    lambda receiver=receiver, life=receiver.life: self._hear(receiver, life, header, frame),
                )

    def _hear(self, robot: Robot, life: int, header: Header, frame: StateFrame | TasksFrame) -> None:
        if not robot.up or life != robot.life:
            return
        stamp_ns = self.now_ns + robot.clock_ns
        if isinstance(frame, StateFrame):
            robot.fleet, _ = heard_state(robot.fleet, stamp_ns, header, frame, -50)
        else:
            robot.fleet, _ = heard_tasks(robot.fleet, stamp_ns, header, frame)
        self._note_learnt(robot)
        if self.watchful:
            self._check()

    def _note_learnt(self, robot: Robot) -> None:
        for slot, generation in enumerate(robot.fleet.tasks.generations.tolist()):
            if generation > 0:
                self.learnt.setdefault((slot, generation - 1), {}).setdefault(robot.id, self.now_ns)


def fleet_config(size: int = 5, slots: int = 12, **others: object) -> FleetConfig:
    settings: dict[str, object] = {"dwell_s": 0.3, "allocator": "hungarian", **others}
    return FleetConfig(size=size, task_slots=slots, **settings)  # type: ignore[arg-type]


def draws(*seed: int) -> random.Random:
    return random.Random(repr(seed))
