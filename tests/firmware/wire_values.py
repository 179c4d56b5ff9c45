"""Hypothesis strategies for every air frame and USB message, and equality for values that hold arrays."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
from hypothesis import strategies as st

from hippomat_core.wire import frames as air
from hippomat_core.wire import link

u8, u16, u32 = (st.integers(0, 2**bits - 1) for bits in (8, 16, 32))
u24, u48, u64 = (st.integers(0, 2**bits - 1) for bits in (24, 48, 64))
i8, i16 = st.integers(-(2**7), 2**7 - 1), st.integers(-(2**15), 2**15 - 1)
robots = st.integers(0, 63)
statuses = st.integers(air.IDLE, air.LOST)


def arrays(count: int, high: int) -> st.SearchStrategy[np.ndarray]:
    values = st.lists(st.integers(0, high), min_size=count, max_size=count)
    return values.map(lambda items: np.array(items, np.uint8))


def claims(m: int) -> st.SearchStrategy[air.AirClaim]:
    held = st.builds(
        air.AirClaim,
        slot=st.integers(0, m - 1),
        generation=u16,
        cost=u8,
        round=u16,
        confirmed=st.booleans(),
        tag=st.integers(1, 3),
        x_cm=i16,
        y_cm=i16,
        z_cm=i16,
        eta_ds=u16,
    )
    return st.one_of(st.just(air.NO_CLAIM), held)


@st.composite
def states(draw: st.DrawFn) -> air.StateFrame:
    n, m = draw(st.integers(1, 64)), draw(st.integers(1, 80))
    return air.StateFrame(
        status=draw(statuses),
        flags=draw(st.integers(0, 31)),
        x_cm=draw(i16),
        y_cm=draw(i16),
        z_cm=draw(i16),
        yaw_256=draw(u8),
        speed_2cmps=draw(u8),
        claim=draw(claims(m)),
        costs=draw(arrays(m, 255)),
        task_states=draw(arrays(m, 3)),
        intent_ix=draw(u16),
        intent_iy=draw(u16),
        intent_iz=draw(u8),
        intent_steps=draw(st.integers(0, 12).flatmap(lambda count: arrays(count, 26))),
        heard=draw(st.integers(0, 2**n - 1)),
        endorsed=draw(arrays(n, 3)),
        fleet_digest=draw(u32),
        generations_digest=draw(u32),
        stop_counter=draw(u16),
    )


def relay_rows(n: int, m: int) -> st.SearchStrategy[air.RelayRow]:
    no_claim = st.just(((air.NO_SLOT, 0, 0, False, 0), (0, 0, 0, 0)))
    claim = st.tuples(
        st.tuples(st.integers(0, m - 1), u16, u8, st.booleans(), st.integers(1, 3)),
        st.tuples(i16, i16, i16, u8),
    )
    return st.builds(
        lambda robot, age, status, claim, localized, stopped, costs: air.RelayRow(
            *(robot, age, status, *claim[0], localized, stopped, *claim[1], costs)
        ),
        *(st.integers(0, n - 1), u8, statuses, st.one_of(no_claim, claim)),
        *(st.booleans(), st.booleans(), arrays(m, 255)),
    )


@st.composite
def relays(draw: st.DrawFn) -> air.RelayFrame:
    n, m = draw(st.integers(1, 64)), draw(st.integers(1, 80))
    room = (224 - -(-n // 8)) // (14 + m)
    rows = draw(st.lists(relay_rows(n, m), min_size=1, max_size=room))
    return air.RelayFrame(n, draw(st.integers(0, 2**n - 1)), tuple(rows))


task_slots = st.builds(air.TaskSlot, st.integers(0, 79), u16, st.integers(0, 3), i16, i16, i16)
tasks = st.lists(task_slots, min_size=1, max_size=22).map(lambda slots: air.TasksFrame(tuple(slots)))
stops = st.builds(air.StopFrame, u16, u8, u8)


def headers(kinds: st.SearchStrategy[int]) -> st.SearchStrategy[air.Header]:
    def of(kind: int) -> st.SearchStrategy[air.Header]:
        senders = st.one_of(robots, st.just(air.OPERATOR)) if kind >= air.TASKS else robots
        return st.builds(air.Header, st.just(kind), st.booleans(), u8, senders, u32, u24, u48)

    return kinds.flatmap(of)


def _with_header(kinds: tuple[int, ...], bodies: st.SearchStrategy[Any]) -> st.SearchStrategy[Any]:
    return st.tuples(headers(st.sampled_from(kinds)), bodies)


air_frames = st.one_of(
    _with_header((air.STATE,), states()),
    _with_header((air.RELAY,), relays()),
    _with_header((air.TASKS,), tasks),
    _with_header((air.STOP, air.RESUME), stops),
)

identities = st.one_of(robots, st.just(255))
who = (identities, u8, st.integers(1, 14))  # robot, fleet, channel
rates = st.sampled_from(link.RATES_MBPS)
flags = st.integers(0, 63)
macs = st.binary(min_size=6, max_size=6)
keys = st.one_of(st.just(link.OPEN_KEY), st.binary(min_size=16, max_size=16).filter(any))
schedules = st.integers(50, 1000).flatmap(
    lambda round_ms: st.tuples(st.just(round_ms), st.integers(1, min(64, round_ms * 1000 // 3120)))
)


def texts(size: int) -> st.SearchStrategy[str]:
    return st.text(st.characters(min_codepoint=32, max_codepoint=126), max_size=size)


def with_schedule(kind: type, before: tuple[Any, ...], after: tuple[Any, ...] = ()) -> st.SearchStrategy[Any]:
    """kind(*before, round_ms, slots, *after)."""
    return st.builds(
        lambda head, schedule, tail: kind(*head, *schedule, *tail),
        *(st.tuples(*before), schedules, st.tuples(*after)),
    )


from_host = st.one_of(
    with_schedule(link.Hello, (u8, *who)),
    st.builds(link.SendBody, st.sampled_from([air.STATE, air.TASKS]), st.binary(min_size=1, max_size=226)),
    st.builds(link.Provision, u8, *who, rates, keys, u32),
    st.builds(link.Command, st.just(air.STOP), st.just(0), u8),
    st.builds(link.Command, st.just(air.RESUME), u16, u8),
    st.just(link.AskPeers()),
)
to_host = st.one_of(
    with_schedule(
        *(link.HelloReply, (u8, u8, u32, u32, u8, macs, *who, rates, flags)),
        (texts(16), texts(8)),
    ),
    with_schedule(
        *(link.Status, (u32, u32, u8, u64, *who, rates, flags)),
        (u64, u16, u16, u64, u64, u64, u64, *[u32] * 13, texts(16), texts(8)),
    ),
    st.builds(link.Heard, u64, u64, i8, st.binary(min_size=16, max_size=242)),
    st.builds(link.Sent, u64, st.integers(1, 5), u24, st.booleans()),
    st.builds(link.Provisioned, st.booleans(), u32),
    st.builds(link.PeerReport, identities, macs, u32, u24, i8, u32, u32, u8, st.integers(0, 7)),
    st.builds(link.Round, u32, u64, u64, u64, st.booleans()),
)
link_messages = st.one_of(from_host, to_host)


def plain(value: Any) -> Any:
    """A value with its arrays as lists: comparable with == and writable as JSON."""
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, bytes):
        return value.hex()
    if dataclasses.is_dataclass(value):
        return {f.name: plain(getattr(value, f.name)) for f in dataclasses.fields(value)}
    if isinstance(value, tuple):
        return [plain(item) for item in value]
    return value
