"""Laws of the relay table in any order of calls: rows are those that were said, frames are valid."""

from __future__ import annotations

import dataclasses
import os

from c_values import exactly, lib
from hypothesis import given, settings
from hypothesis import strategies as st
from relay_fleet import Table, row_bytes, row_of, state_body
from wire_values import states

from hippomat_core.wire import codec
from hippomat_core.wire import frames as air

# The run under the sanitizers, several times slower, asks for fewer.
EXAMPLES = int(os.environ.get("HIPPOMAT_EXAMPLES", "150"))
thorough = settings(max_examples=EXAMPLES, deadline=None, derandomize=True)

Sizes = tuple[int, int]  # N, M
OTHER_SIZES = [(3, 4), (5, 4), (64, 80), (1, 1)]


def mostly(usual: object, *others: object) -> st.SearchStrategy[object]:
    return st.sampled_from([usual] * 12 + list(others))


@st.composite
def state_bodies(draw: st.DrawFn, sizes: Sizes) -> bytes:
    n, m = draw(mostly(sizes, *OTHER_SIZES))
    heard, digest = draw(st.integers(0, 2**n - 1)), draw(mostly(7, 8))
    return state_body(
        draw(st.integers(0, 255)), n=n, m=m, digest=digest, heard=heard, claim=draw(st.booleans())
    )


@st.composite
def relay_bodies(draw: st.DrawFn, sizes: Sizes) -> bytes:
    n, m = draw(mostly(sizes, *OTHER_SIZES))
    rows = draw(st.lists(st.tuples(st.integers(0, n - 1), st.integers(0, 255)), min_size=1, max_size=2))
    held = draw(st.integers(0, 2**n - 1))
    ages = draw(mostly(0, 1))
    said = [dataclasses.replace(row_of(k, state_body(mark, n=n, m=m)), age=ages) for k, mark in rows]
    return codec.encode_body(air.RelayFrame(n, held, tuple(said)))


@st.composite
def histories(draw: st.DrawFn) -> list[tuple[object, ...]]:
    """Calls of a Witness; the first is our own STATE."""
    n, m = sizes = draw(st.sampled_from([(5, 4), (5, 4), (5, 4), (64, 80), (1, 1)]))
    late, sender = mostly(0, 1), st.one_of(st.integers(0, n - 1), mostly(1, 63, air.OPERATOR))
    arguments = {
        "own": st.tuples(state_bodies(sizes), late),
        "state": st.tuples(sender, state_bodies(sizes), late),
        "relay": st.tuples(sender, relay_bodies(sizes), late),
        "begin": st.tuples(mostly(1, 0, 2, 31, 2**32 - 1)),
        "fill": st.just(()),
    }
    often = ["state"] * 8 + ["relay"] * 5 + ["fill"] * 3 + ["begin", "own"]
    names = draw(st.lists(st.sampled_from(often), min_size=10, max_size=40))
    first = ("own", state_body(1, n=n, m=m, digest=7), 0)
    return [first, *((name, *draw(arguments[name])) for name in names)]


class Witness:
    """All rows that the table was told in this round, and what must hold after every call."""

    def __init__(self, robot: int) -> None:
        self.table = Table(robot)
        self.told: dict[int, set[bytes]] = {}

    def call(self, name: str, *arguments: object) -> None:
        getattr(self, name)(*arguments)
        n = self.table.struct.n
        assert self.table.held <= self.told.keys()
        assert all(k < n and self.table.row(k) in self.told[k] for k in self.table.held)
        assert all(self.table.struct.miss[k][i] == 0 for k in range(n, 64) for i in range(0, 64, 9))
        assert not self.table.struct.mates >> n or n == 64

    def begin(self, step: int) -> None:
        self.table.begin((self.table.struct.round + step) % 2**32)
        self.told.clear()

    def own(self, body: bytes, late: int) -> None:
        self.table.own(body, (self.table.struct.round + late) % 2**32)
        self.tell(self.table.robot, body)

    def state(self, sender: int, body: bytes, late: int) -> None:
        self.table.state(sender, body, (self.table.struct.round + late) % 2**32)
        self.tell(sender, body)

    def tell(self, robot: int, body: bytes) -> None:
        if robot < 64:
            self.told.setdefault(robot, set()).add(row_bytes(robot, body))

    def relay(self, sender: int, body: bytes, late: int) -> None:
        self.table.relay(sender, body, (self.table.struct.round + late) % 2**32)
        for row in codec.decode_body(air.RELAY, body).rows:
            data = codec.encode_body(air.RelayFrame(64, 0, (row,)))[2 + 8 :]
            self.told.setdefault(row.robot, set()).add(data)

    def fill(self) -> None:
        held, body = self.table.held, self.table.fill()
        assert self.table.held == held
        if not body:
            return
        assert lib.rc_body_valid(air.RELAY, exactly(body), len(body))
        frame = codec.decode_body(air.RELAY, body)
        passed = [row.robot for row in frame.rows]
        assert frame.held == sum(1 << k for k in held)
        assert set(passed) <= held
        assert len(set(passed)) == len(passed)
        size = lib.RC_RELAY_ROW_BYTES + self.table.struct.m
        assert b"".join(map(self.table.row, passed)) == body[-size * len(passed) :]


@thorough
@given(mostly(0, 3, 63, air.OPERATOR), histories())
def test_any_order_of_calls_holds_what_was_said_and_sends_valid_frames(robot, calls):
    witness = Witness(robot)
    for call in calls:
        witness.call(*call)


@thorough
@given(states(), st.integers(0, 63), st.integers(0, 63))
def test_a_row_passed_on_is_byte_for_byte_what_its_owner_said(state, owner, self):
    """Direct, as the other side of the wire reads it, and through two robots."""
    n, body = len(state.endorsed), codec.encode_body(state)
    owner, self = owner % n, self % n
    first, second = Table(self), Table((self + 1) % n)
    for table in (first, second):
        table.own(body)
    if owner != self:
        first.state(owner, body)
    frame = codec.encode_body(air.RelayFrame(n, 1 << owner, (row_of(owner, body),)))
    assert first.row(owner) == frame[2 + -(-n // 8) :]
    if n > 2 and owner != second.robot:
        second.state(self, body)
        second.relay(self, frame)
        assert second.row(owner) == first.row(owner)


@given(st.integers(0, 255), st.integers(2, 64))
@thorough
def test_a_need_wears_off_however_lossy_the_link(loss, n):
    table = Table(0)
    table.own(state_body(0, n=n))
    for robot in range(1, n):
        table.state(robot, state_body(robot, n=n))
        table.struct.loss[0][robot] = loss * 257
    sent = 0
    while table.fill():
        sent += 1
        assert sent < 256 * n
