"""A million frames that a radio with a key must not believe, and the genuine ones between them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator

import numpy as np
import pytest
from radio_desk import a_radio, a_state, mac_of, messages
from sealed_desk import FLEET, KEY, Receiver, Sender, sealed_frame

from hippomat_core.wire import codec, link
from hippomat_core.wire import frames as air

US = 3  # our own id
ROBOTS = (0, 1, 2, 4, 5)
OPERATOR_MAC = mac_of(200)
BATCHES = 1000
BATCH_US = 10_000
A_TASK = air.TasksFrame((air.TaskSlot(0, 4, 1, 2, 3, 4),))
CAUSES = ("foreign", "malformed", "seal", "forged", "replayed", "impostor", "babble")
Shot = tuple[bytes, bytes]  # MAC, frame


class Fleet:
    """Five robots and an operator, who send genuine frames in turn; each loses some before they reach us."""

    def __init__(self) -> None:
        self.senders = [Sender(mac_of(robot), 100 + robot) for robot in ROBOTS]
        self.senders.append(Sender(OPERATOR_MAC, 77))
        self.ids = (*ROBOTS, air.OPERATOR)
        self.receiver = Receiver({(robot, s.mac): s for robot, s in zip(self.ids, self.senders, strict=True)})
        self.past: list[Shot] = []

    def next_frame(self, turn: int, now_us: int, key: bytes = KEY, fleet: int = FLEET) -> Shot:
        """The frame that the next sender will send, and would in another fleet or with another key."""
        k = turn % len(self.ids)
        sender, body = self.senders[k], A_TASK if self.ids[k] == air.OPERATOR else a_state(turn % 1000)
        sequence = sender.highest + 1 + turn % 3
        frame = sealed_frame(
            *(self.ids[k], sender.boot, sequence, body),
            mac=sender.mac,
            key=key,
            fleet=fleet,
            time_us=now_us,
        )
        return sender.mac, frame

    def heard(self, shot: Shot) -> None:
        mac, frame = shot
        self.receiver.senders[frame[2], mac].hear(int.from_bytes(frame[7:10], "little"))
        self.past.append(shot)


def of_noise(rng: np.random.Generator, count: int) -> Iterator[Shot]:
    """Random bytes of any length; every fourth with a right version and fleet."""
    noise = rng.bytes(256 * count)
    for k in range(count):
        frame, length, robot = noise[256 * k : 256 * k + 254], noise[256 * k + 254], noise[256 * k + 255] % 8
        if k % 4 == 0:
            frame = bytes([0x20 | frame[0] & 15, FLEET]) + frame[2:]
        yield mac_of(robot), frame[:length]


def of_flips(rng: np.random.Generator, count: int, shots: list[Shot]) -> Iterator[Shot]:
    """Genuine frames that were not heard yet, with one bit changed."""
    for pick, at in rng.integers(0, (len(shots), 8 * 250), (count, 2)).tolist():
        mac, frame = shots[pick]
        bit = at % (8 * len(frame))
        changed = bytearray(frame)
        changed[bit // 8] ^= 1 << bit % 8
        yield mac, bytes(changed)


def of_replays(rng: np.random.Generator, count: int, past: list[Shot]) -> Iterator[Shot]:
    """Frames that were heard, old and young, in any order; every tenth from another MAC."""
    for k, pick in enumerate(rng.integers(0, len(past), count).tolist()):
        mac, frame = past[pick]
        yield (mac_of(99) if k % 10 == 0 else mac), frame


def of_wrong_lengths(rng: np.random.Generator, count: int, shots: list[Shot]) -> Iterator[Shot]:
    for pick, length in rng.integers(0, (len(shots), 300), (count, 2)).tolist():
        mac, frame = shots[pick]
        if length == len(frame):
            length += 1
        yield mac, frame[:length] + bytes(max(0, length - len(frame)))


def repeated(count: int, shots: list[Shot]) -> Iterator[Shot]:
    return (shots[k % len(shots)] for k in range(count))


def hostile(rng: np.random.Generator, fleet: Fleet, now_us: int) -> Iterator[Shot]:
    """A thousand frames, none of which is genuine and new."""
    turns = range(len(fleet.ids))
    fresh = [fleet.next_frame(turn, now_us) for turn in turns]
    other_key = [fleet.next_frame(turn, now_us, key=bytes(16)) for turn in turns]
    other_fleet = [fleet.next_frame(turn, now_us, fleet=8) for turn in turns]
    plain = [(mac, bytes([frame[0] & ~8]) + frame[1:-8]) for mac, frame in fresh]
    ours = [(mac_of(90), frame[:2] + bytes([US]) + frame[3:]) for mac, frame in fresh]
    yield from of_noise(rng, 200)
    yield from of_flips(rng, 250, fresh)
    yield from of_replays(rng, 200, fleet.past)
    yield from of_wrong_lengths(rng, 100, fresh)
    yield from repeated(80, other_fleet)
    yield from repeated(100, other_key)
    yield from repeated(50, plain)
    yield from repeated(20, ours)


@pytest.mark.timeout(300)
def test_of_a_million_forged_replayed_or_foreign_frames_none_is_accepted_and_each_is_counted_by_cause():
    radio = a_radio(robot=US, fleet=FLEET, key=KEY)
    fleet, rng = Fleet(), np.random.default_rng(20_26)
    shown: list[bytes] = []
    genuine: list[bytes] = []
    fired: Counter[str] = Counter()
    for batch in range(-len(fleet.ids), BATCHES):
        now_us = 1_000_000 + batch * BATCH_US
        shot = fleet.next_frame(batch, now_us)
        radio.air_rx(now_us, -50, *shot)
        fleet.heard(shot)
        genuine.append(shot[1])
        for mac, frame in hostile(rng, fleet, now_us) if batch >= 0 else ():
            fired[fleet.receiver.cause(mac, frame)] += 1
            radio.air_rx(now_us + 1, -50, mac, frame)
        shown += [message.frame for message in messages(radio, link.Heard)]
        radio.tick(now_us + 2)
    counters, condition = radio.counters, radio.condition(now_us)
    assert sum(fired.values()) == 1_000_000
    assert {name: getattr(counters, f"dropped_{name}") for name in CAUSES} == {
        name: fired[f"dropped_{name}"] for name in CAUSES
    }
    assert min(fired[f"dropped_{name}"] for name in CAUSES[:5]) > 10_000
    assert counters.received == len(genuine) == BATCHES + len(fleet.ids)
    assert [frame[:16] for frame in shown] == [frame[:16] for frame in genuine]
    assert all(codec.decode_frame(frame)[0].sealed for frame in shown)
    assert condition.flags & (link.FLAG_PASSIVE | link.FLAG_STOPPED) == 0
    assert (condition.duplicate, condition.babbling) == (0, 0)
    assert abs(condition.fleet_time_us - now_us) < 2_000
    boots = dict(enumerate(radio.memory.peer_boots))
    assert {robot: boot for robot, boot in boots.items() if boot} == {robot: 100 + robot for robot in ROBOTS}
