"""The air frames as values. Byte tables: esp32_firmware/lib/radio_core/README.md; both must agree.

Knows bytes and integers only: no metres, no clock. Encoding and decoding are in wire/codec.py.
"""

from __future__ import annotations

from dataclasses import dataclass

from hippomat_core.fields import I16, U8, U16, U32, U64, U8Array
from hippomat_core.replaced import quickly_made

PROTOCOL_VERSION = 2
MAX_FRAME = 250  # ESP-NOW v1
HEADER_BYTES = 16
TAG_BYTES = 8  # AES-128-CCM, kept free in every frame's worst case
MAX_BODY = MAX_FRAME - HEADER_BYTES - TAG_BYTES
OPERATOR = 255  # sender of an operator's radio: TASKS, STOP and RESUME only
NO_SLOT = 255
UNREACHABLE = 255  # cost code
MAX_INTENT_STEPS = 12

STATE, RELAY, TASKS, STOP, RESUME = 1, 2, 3, 4, 5
LAST_STOP = 65_535  # this counter is never resumed: no later STOP could be told from it

# StateFrame.status
IDLE, ASSIGNED, SERVING, OBSERVING, BLOCKED, LOST = range(6)
# StateFrame.flags
FLAG_STOPPED, FLAG_LOCALIZED, FLAG_GUARD, FLAG_BATTERY_LOW, FLAG_SATURATED = 1, 2, 4, 8, 16
# task states, 2 bits each
INACTIVE, WAITING, CLAIMED, DONE = range(4)


@dataclass(frozen=True, slots=True)
class Header:
    """First 16 bytes of every frame; the radio fills in boot, sequence and fleet time."""

    kind: U8
    sealed: bool  # it came encrypted and authenticated; the radio has opened it
    fleet: U8
    sender: U8  # robot id, or OPERATOR
    boot: U32  # boot counter of the sender's radio
    sequence: U32  # 24 bits, per sender and boot
    fleet_time_us: U64  # 48 bits


@quickly_made
@dataclass(frozen=True, slots=True)
class AirClaim:
    """The claim a robot holds; slot == NO_SLOT means none and all other fields are 0.

    tag: 1..3, names this claim among the sender's recent ones (see fleet/claims.py); endorsements quote it.
    Destination in centimetres, fleet frame; ETA in tenths of a second.
    """

    slot: U8
    generation: U16
    cost: U8
    round: U16
    confirmed: bool
    tag: U8
    x_cm: I16
    y_cm: I16
    z_cm: I16
    eta_ds: U16


NO_CLAIM = AirClaim(NO_SLOT, 0, 0, 0, False, 0, 0, 0, 0, 0)


@quickly_made
@dataclass(frozen=True, slots=True)
class StateFrame:
    """STATE, one per round and robot. M = len(costs), N = len(endorsed)."""

    status: U8
    flags: U8
    x_cm: I16
    y_cm: I16
    z_cm: I16
    yaw_256: U8  # yaw in 1/256 turns, counter-clockwise from map x
    speed_2cmps: U8
    claim: AirClaim
    costs: U8Array  # (M,) quantised travel costs, 255 = unreachable
    task_states: U8Array  # (M,) INACTIVE..DONE
    intent_ix: U16  # map cell of the first intent cell
    intent_iy: U16
    intent_iz: U8
    intent_steps: U8Array  # (<= 12,) moves 0..26: (dx+1) + 3 (dy+1) + 9 (dz+1); 13 = stay
    heard: U64  # bit k: robot k was heard directly; the radio writes it when it sends, the host gives 0
    endorsed: U8Array  # (N,) claim tag of robot k that the sender endorses, 0 = none
    fleet_digest: U32
    generations_digest: U32
    stop_counter: U16


@dataclass(frozen=True, slots=True)
class RelayRow:
    """One robot's row as the relaying robot holds it; age in rounds before that of the frame's fleet time.

    slot == NO_SLOT: no claim; generation, cost, confirmed, tag, place and ETA are 0.
    """

    robot: U8
    age: U8
    status: U8
    slot: U8
    generation: U16
    cost: U8
    confirmed: bool
    tag: U8
    localized: bool
    stopped: bool
    x_cm: I16  # of the claim's destination
    y_cm: I16
    z_cm: I16
    eta_s: U8
    costs: U8Array  # (M,)


@dataclass(frozen=True, slots=True)
class RelayFrame:
    """RELAY, two per round: rows that others miss; at most 5 at M = 30 and N <= 32."""

    n: U8
    held: U64  # bit k: the sender holds row k of this round, its own included
    rows: tuple[RelayRow, ...]


@quickly_made
@dataclass(frozen=True, slots=True)
class TaskSlot:
    """One task slot: generation, position (fleet frame) and state."""

    slot: U8
    generation: U16
    state: U8
    x_cm: I16
    y_cm: I16
    z_cm: I16


@dataclass(frozen=True, slots=True)
class TasksFrame:
    """TASKS, sent by whoever hears a generation digest that differs; at most 22 slots."""

    slots: tuple[TaskSlot, ...]


@dataclass(frozen=True, slots=True)
class StopFrame:
    """STOP and RESUME: the counter raised (from 1) or answered, its origin (255 = operator), a reason."""

    counter: U16
    origin: U8
    reason: U8
