"""The fleet as one robot knows it: peers, task slots, votes, its own claim. A value.

What a heard frame changes is in hearing.py, what a round end does in rounds.py. Knows no clock, map or motor:
time is the stamp of the event, task sites and the fleet digest are given once the map is known.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hippomat_core.allocation.factory import make_allocator
from hippomat_core.allocation.port import Allocator
from hippomat_core.config import Config, FleetConfig
from hippomat_core.fleet.claims import TAGS, OwnClaim
from hippomat_core.fleet.peers import Peer
from hippomat_core.fleet.round_clock import NEVER, RoundClock
from hippomat_core.fleet.rows import Relayed, Row, claim_news, newest_row, newest_rows
from hippomat_core.fleet.tasks import Tasks, turned_effects
from hippomat_core.fleet.timing import Timing
from hippomat_core.fleet.votes import Votes
from hippomat_core.messages import Effect
from hippomat_core.replaced import replace
from hippomat_core.wire.frames import StateFrame


@dataclass(frozen=True, slots=True, eq=False)
class FleetState:
    """Everything rule F and the allocation round remember. Start with `initial`, then `with_map`."""

    config: FleetConfig
    robot: int  # -1: observes only
    allocator: Allocator
    timing: Timing
    tasks: Tasks
    peers: tuple[Peer | None, ...]  # (N,) by id; our own place stays empty
    relayed: tuple[Relayed | None, ...]  # (N,) where one is newer than the peer's own row
    sites: NDArray[np.int16]  # (S, 3)
    clock: RoundClock
    digest: int | None = None  # fleet digest; None until the map is known
    silent_from_ns: int | None = None  # the silence after a boot counts from here
    in_step: bool = False  # the silence is over
    last_stamp_ns: int = NEVER
    trusted_from_ns: int = NEVER  # after a hold-up, rows heard before this may be old
    votes: Votes = ()
    own_claim: OwnClaim | None = None
    tag_free_ns: tuple[int, ...] = (NEVER,) * TAGS
    shunned: tuple[tuple[int, int, int], ...] = ()  # (slot, generation, until_ns): refused lately
    handed_over: frozenset[tuple[int, int]] = frozenset()  # (slot, generation): by us, once
    sent: StateFrame | None = None  # our last STATE: the row that others decide on
    sent_generations: NDArray[np.uint16] | None = None  # (M,) that its costs were for
    self_turned_ns: int = NEVER
    tasks_cursor: int = 0
    passive: str = ""  # why we take no part for the rest of the run
    muted: str = ""  # why we take no part while our radio is as it is
    mismatched: frozenset[int] = frozenset()
    alarmed: frozenset[str] = frozenset()

    @property
    def barred(self) -> str:
        """Why we take no part; empty: we do."""
        return self.passive or self.muted

    def row(self, robot: int) -> Row | None:
        """The newest that is known of it."""
        return newest_row(self.peers[robot], self.relayed[robot])

    def rows(self) -> tuple[Row, ...]:
        """The newest of everybody else, in id order."""
        return newest_rows(self.peers, self.relayed)

    def alive_peers(self, stamp_ns: int) -> list[Peer]:
        """Peers of our fleet whose own row is held, and heard of within T_dead."""
        dead_ns = self.timing.dead_ns
        return [p for p in self.peers if p is not None and p.agrees and stamp_ns - p.alive_ns <= dead_ns]

    def alive(self, stamp_ns: int) -> int:
        """How many robots of our fleet live: heard of within T_dead, if only through others; and we."""
        dead_ns = self.timing.dead_ns
        return 1 + sum(row.agrees and stamp_ns - row.alive_ns <= dead_ns for row in self.rows())


Heard = tuple[FleetState, list[Effect]]


def initial(config: Config, allocator: Allocator | None = None) -> FleetState:
    """Before anything was heard. allocator: needed where it has weights, else made by its name."""
    fleet = config.fleet
    timing = Timing.of(fleet)
    return FleetState(
        config=fleet,
        robot=config.robot.id,
        allocator=allocator or make_allocator(fleet.allocator, None, fleet.size, fleet.task_slots),
        timing=timing,
        tasks=Tasks.empty(fleet),
        peers=(None,) * fleet.size,
        relayed=(None,) * fleet.size,
        sites=np.zeros((0, 3), np.int16),
        clock=RoundClock(timing.round_ns),
    )


def started(fleet: FleetState, stamp_ns: int) -> FleetState:
    """Rounds count from here."""
    return replace(fleet, clock=fleet.clock.started(stamp_ns), last_stamp_ns=stamp_ns)


def with_map(fleet: FleetState, stamp_ns: int, sites: NDArray[np.int16], digest: int) -> Heard:
    """The map is known: open the task slots and begin to listen. A new map drops claim, votes and tasks.

    Rows heard before count for nothing until their senders say the same digest.
    sites: (S, 3) from task_sites.  digest: from fleet_digest.  Raises ConfigError if sites are too few.
    """
    tasks = Tasks.start(fleet.config, sites)
    effects: list[Effect] = list(turned_effects(Tasks.empty(fleet.config), tasks, "start"))
    tag_free_ns = fleet.tag_free_ns
    peers = tuple(None if peer is None else replace(peer, agrees=False) for peer in fleet.peers)
    for row in fleet.rows():
        effects += claim_news(row, None)
    if fleet.own_claim is not None:
        effects.insert(0, fleet.own_claim.changed("dropped", "map changed"))
        tag_free_ns = (stamp_ns + fleet.timing.tag_reuse_ns,) * TAGS
    fleet = replace(
        fleet,
        tasks=tasks,
        peers=peers,
        relayed=(None,) * len(peers),
        sites=sites,
        digest=digest,
        silent_from_ns=stamp_ns,
        in_step=False,
        votes=(),
        own_claim=None,
        tag_free_ns=tag_free_ns,
        shunned=(),
        handed_over=frozenset(),
        sent=None,
        sent_generations=None,
    )
    return fleet, effects


def muted(fleet: FleetState, stamp_ns: int, why: str) -> FleetState:
    """Our radio cannot speak for us; empty: it can. Whoever comes back listens first, as after a boot."""
    if why == fleet.muted:
        return fleet
    listening = fleet.silent_from_ns if why or fleet.silent_from_ns is None else stamp_ns
    return replace(fleet, muted=why, silent_from_ns=listening, in_step=fleet.in_step and bool(why))


def awake(fleet: FleetState, stamp_ns: int, radio_time_us: int | None = None) -> FleetState:
    """Notices a hold-up: what is read right after it may have waited in a buffer; trusts a round later.

    radio_time_us: when our radio heard what is told now; a hold-up between it and us shows by that alone.
    """
    if stamp_ns == fleet.last_stamp_ns and radio_time_us is None:  # as it was noticed a moment ago
        return fleet
    if fleet.clock.start_ns is None:
        fleet = started(fleet, stamp_ns)
    held_ns = stamp_ns - fleet.last_stamp_ns
    if radio_time_us is not None:
        held_ns = max(held_ns, fleet.clock.late_ns(stamp_ns, radio_time_us))
    trusted_ns = stamp_ns + fleet.timing.round_ns
    return replace(
        fleet,
        last_stamp_ns=stamp_ns,
        trusted_from_ns=trusted_ns if held_ns > fleet.timing.hold_ns else fleet.trusted_from_ns,
    )
