"""Fleets of real rc_relay_table structs over lossy links, one round after the other, all in slot order.

Nothing collides and nobody is late unless told so; who misses a frame is drawn from the seed.
"""

from __future__ import annotations

import random
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from c_values import exactly, ffi, lib

from hippomat_core.wire import codec
from hippomat_core.wire import frames as air

DIGEST = 0xF1EE7
ROUND_US = 100_000
RATE_MBPS = 6
_OUT = ffi.new("uint8_t[]", lib.RC_MAX_BODY)


def state_body(
    mark: int, *, n: int = 5, m: int = 4, digest: int = DIGEST, heard: int = 0, claim: bool = False
) -> bytes:
    """A STATE whose costs show `mark`."""
    state: dict[str, Any] = {"n": n, "m": m, "fleet_digest": digest, "heard": heard & ((1 << n) - 1)}
    state["costs"] = [(mark >> 8 * (j % 3)) & 255 for j in range(m)]
    state["claim"] = {"slot": 0, "tag": 2, "generation": mark & 0xFFFF} if claim else {"slot": air.NO_SLOT}
    size = lib.rc_state_encode(ffi.new("rc_state *", state), _OUT)
    assert size
    return bytes(ffi.buffer(_OUT, size))


def row_of(robot: int, body: bytes) -> air.RelayRow:
    """The row that a STATE says, as the Python side of the wire reads it."""
    state = codec.decode_body(air.STATE, body)
    assert isinstance(state, air.StateFrame)
    claim, flags = state.claim, state.flags
    return air.RelayRow(
        *(robot, 0, state.status, claim.slot, claim.generation, claim.cost, claim.confirmed, claim.tag),
        *(bool(flags & air.FLAG_LOCALIZED), bool(flags & air.FLAG_STOPPED)),
        *(claim.x_cm, claim.y_cm, claim.z_cm, min((claim.eta_ds + 5) // 10, 255), state.costs),
    )


def relay_body(n: int, held: Iterable[int], rows: Iterable[air.RelayRow]) -> bytes:
    return codec.encode_body(air.RelayFrame(n, sum(1 << k for k in held), tuple(rows)))


def row_bytes(robot: int, body: bytes) -> bytes:
    """The same row in RELAY's bytes."""
    return relay_body(64, (), [row_of(robot, body)])[2 + 8 :]


class Table:
    """One rc_relay_table; bodies are handed over in buffers of their exact length."""

    def __init__(self, robot: int, round_: int = 0) -> None:
        self.robot = robot
        self.struct: Any = ffi.new("rc_relay_table *")
        lib.rc_relay_init(self.struct, robot)
        self.begin(round_)

    def begin(self, round_: int) -> None:
        lib.rc_relay_begin(self.struct, round_)

    def own(self, body: bytes, round_: int | None = None) -> None:
        lib.rc_relay_own(self.struct, self._round(round_), exactly(body), len(body))

    def state(self, sender: int, body: bytes, round_: int | None = None) -> None:
        lib.rc_relay_heard_state(self.struct, self._round(round_), sender, exactly(body), len(body))

    def relay(self, sender: int, body: bytes, round_: int | None = None) -> None:
        lib.rc_relay_heard_relay(self.struct, self._round(round_), sender, exactly(body), len(body))

    def fill(self) -> bytes:
        """The body of a RELAY, or nothing."""
        room = ffi.new("uint8_t[]", lib.RC_MAX_BODY)
        return bytes(ffi.buffer(room, lib.rc_relay_fill(self.struct, room)))

    def passed_on(self) -> air.RelayFrame | None:
        body = self.fill()
        frame = codec.decode_body(air.RELAY, body) if body else None
        assert frame is None or isinstance(frame, air.RelayFrame)
        return frame

    def heard_bits(self) -> int:
        return int(lib.rc_relay_heard_bits(self.struct))

    def loss_from(self, robot: int) -> float:
        return int(lib.rc_relay_loss_to_us(self.struct, robot)) / 255

    @property
    def held(self) -> set[int]:
        return {k for k in range(64) if self.struct.held >> k & 1}

    def row(self, robot: int) -> bytes:
        return bytes(ffi.buffer(self.struct.rows[robot], lib.RC_RELAY_ROW_BYTES + self.struct.m))

    def bytes(self) -> bytes:
        """All that it knows."""
        return bytes(ffi.buffer(self.struct))

    def _round(self, round_: int | None) -> int:
        return self.struct.round if round_ is None else round_


@dataclass(slots=True)
class Tally:
    rounds: int = 0
    complete: int = 0  # robots that held a row of everyone, summed over rounds
    identical: int = 0  # rounds in which all did
    frames: int = 0  # RELAY
    air_us: int = 0  # STATE and RELAY, sealed
    wrong: int = 0  # rows held that are not what their robot said


class Fleet:
    """Robots in `silent` have no host, those in `dead` no radio. All may be changed between rounds.

    hears[s, h]: whether h is in reach of s.
    """

    def __init__(self, n: int, loss: float, seed: int = 1, *, m: int = 30, hidden: float = 0.0) -> None:
        self.n, self.m, self.loss = n, m, loss
        self.random = np.random.default_rng(seed)
        self.tables = [Table(robot) for robot in range(n)]
        pairs = np.triu(self.random.random((n, n)) < hidden, 1)
        self.hears = ~(pairs | pairs.T | np.eye(n, dtype=bool))
        self.digests = [DIGEST] * n
        self.silent: set[int] = set()
        self.dead: set[int] = set()
        self.number = 0
        self.said: dict[int, bytes] = {}  # rows of this round
        self.passed_on: set[tuple[int, int]] = set()  # (sender, row) of the last `run`
        self.tally = Tally()
        self._marks = random.Random(f"marks {seed}")

    def reboot(self, robot: int) -> None:
        """Its radio starts anew: the table is empty."""
        self.tables[robot] = Table(robot, self.number)

    def run(self, rounds: int) -> Tally:
        """That many rounds; what they came to."""
        self.tally = Tally()
        self.passed_on = set()
        for _ in range(rounds):
            self._round()
        return self.tally

    def _round(self) -> None:
        self.number += 1
        self.said.clear()
        for table in self.tables:
            table.begin(self.number)
        for robot in self._alive():
            if robot not in self.silent:
                self._state(robot)
        for robot in 2 * self._alive():
            self._relay(robot)
        self._count()

    def _alive(self) -> list[int]:
        return [robot for robot in range(self.n) if robot not in self.dead]

    def _state(self, robot: int) -> None:
        table = self.tables[robot]
        mark = self._marks.getrandbits(24)
        sizes = {"n": self.n, "m": self.m, "digest": self.digests[robot]}
        body = state_body(mark, **sizes, heard=table.heard_bits())
        self.said[robot] = row_bytes(robot, body)
        table.own(body)
        self._air(robot, body, lib.rc_relay_heard_state)

    def _relay(self, robot: int) -> None:
        body = self.tables[robot].fill()
        if body:
            self.tally.frames += 1
            rows_at = 2 + -(-self.n // 8)
            rows = body[rows_at :: lib.RC_RELAY_ROW_BYTES + self.m]
            self.passed_on |= {(robot, row) for row in rows}
            self._air(robot, body, lib.rc_relay_heard_relay)

    def _air(self, sender: int, body: bytes, heard: Any) -> None:
        length = lib.RC_HEADER_BYTES + len(body) + lib.RC_TAG_BYTES
        self.tally.air_us += lib.rc_airtime_us(length, RATE_MBPS)
        raw, size = exactly(body), len(body)
        got = (self.random.random(self.n) >= self.loss) & self.hears[sender]
        for receiver in np.flatnonzero(got).tolist():
            if receiver not in self.dead:
                heard(self.tables[receiver].struct, self.number, sender, raw, size)

    def _count(self) -> None:
        everyone = sum(1 << robot for robot in self.said)
        alive = self._alive()
        complete = sum(self.tables[robot].struct.held == everyone for robot in alive)
        self.tally.rounds += 1
        self.tally.complete += complete
        self.tally.identical += complete == len(alive)
        for robot in alive:
            table = self.tables[robot]
            self.tally.wrong += sum(table.row(k) != self.said.get(k) for k in table.held)

    @property
    def complete(self) -> float:
        """Share of robots and rounds of the last `run` that ended with the snapshot complete."""
        return self.tally.complete / (self.tally.rounds * len(self._alive()))

    @property
    def airtime(self) -> float:
        return self.tally.air_us / (self.tally.rounds * ROUND_US)
