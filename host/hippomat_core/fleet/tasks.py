"""The task slots as one robot knows them: generation, state and position of each. Knows no claims.

A slot's generation advances only through an allocation or a service, so robots merge by maximum: whatever
one of them has seen is never undone. The digest in every STATE shows who differs; TASKS frames settle it.
"""

from __future__ import annotations

import zlib
from dataclasses import dataclass
from functools import cached_property
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hippomat_core.config import FleetConfig
from hippomat_core.fleet.sites import check_sites, slot_site
from hippomat_core.messages import TaskTurned
from hippomat_core.replaced import replace
from hippomat_core.wire.frames import CLAIMED, DONE, INACTIVE, WAITING, TasksFrame, TaskSlot

MAX_GENERATION = 65535
SLOTS_PER_FRAME = 22
CONTINUOUS = "continuous"

T = TypeVar("T", bound=np.generic)


@dataclass(frozen=True, eq=False)  # without slots: what follows from them all is kept
class Tasks:
    """M slots. Arrays are never written to after they are stored."""

    seed: int
    refills: bool  # a served or claimed slot gets a new task by itself
    continuous: bool  # positions follow from seed, slot and generation; otherwise they come by TASKS
    generations: NDArray[np.uint16]  # (M,)
    states: NDArray[np.uint8]  # (M,) INACTIVE, WAITING or DONE; who claims them is in the rows
    positions_cm: NDArray[np.int16]  # (M, 3) fleet frame
    changed_ns: NDArray[np.int64]  # (M,) when this robot learnt of the generation

    @staticmethod
    def empty(config: FleetConfig) -> Tasks:
        """Before the map is known: every slot inactive."""
        m = config.task_slots
        return Tasks(
            config.seed,
            config.task_source == CONTINUOUS and config.turnover != "never",
            config.task_source == CONTINUOUS,
            _frozen(np.zeros(m, np.uint16)),
            _frozen(np.full(m, INACTIVE, np.uint8)),
            _frozen(np.zeros((m, 3), np.int16)),
            _frozen(np.full(m, -(10**18), np.int64)),
        )

    @staticmethod
    def start(config: FleetConfig, sites: NDArray[np.int16]) -> Tasks:
        """Generation 0 of every slot; open at once in continuous mode, else inactive until an order comes."""
        tasks = Tasks.empty(config)
        if not tasks.continuous:
            return tasks
        check_sites(sites, config.task_slots)
        m = config.task_slots
        places = [slot_site(sites, config.seed, m, slot, 0) for slot in range(m)]
        positions_cm = _frozen(np.asarray(places, np.int16))
        return replace(tasks, states=_frozen(np.full(m, WAITING, np.uint8)), positions_cm=positions_cm)

    @cached_property
    def digest(self) -> int:
        """32 bits over generations and states, for STATE."""
        return zlib.crc32(self.states.tobytes(), zlib.crc32(self.generations.astype("<u2").tobytes()))

    @cached_property
    def keys(self) -> tuple[tuple[int, int], ...]:
        """(slot, generation) of every slot, in their order."""
        return tuple(enumerate(self.generations.tolist()))

    @cached_property
    def open_keys(self) -> frozenset[tuple[int, int]]:
        """Those of the slots that are not inactive."""
        return frozenset(key for key in self.keys if self.states[key[0]] != INACTIVE)

    def positions_m(self) -> NDArray[np.float64]:
        """(M, 3) fleet frame."""
        return self.positions_cm / 100.0

    def slot(self, slot: int) -> TaskSlot:
        x_cm, y_cm, z_cm = self.positions_cm[slot].tolist()
        generation, state = int(self.generations[slot]), int(self.states[slot])
        return TaskSlot(slot, generation, state, x_cm, y_cm, z_cm)

    def turned(self, slot: int, sites: NDArray[np.int16], stamp_ns: int) -> Tasks:
        """The slot's task was allocated or served: its next generation, with a new task or none."""
        generation = int(self.generations[slot]) + 1
        if generation > MAX_GENERATION:  # the counter must not wrap: its maximum is what robots agree on
            return replace(self, states=_with(self.states, slot, DONE))
        return self._set(slot, generation, WAITING if self.refills else DONE, None, sites, stamp_ns)

    def merged(self, frame: TasksFrame, sites: NDArray[np.int16], stamp_ns: int) -> Tasks:
        """With whatever is newer in a TASKS frame; slots that this fleet does not have are ignored."""
        tasks = self
        for heard in frame.slots:
            if heard.slot < len(self.generations):
                tasks = tasks.advanced(heard, sites, stamp_ns)
        return tasks

    def advanced(self, heard: TaskSlot, sites: NDArray[np.int16], stamp_ns: int) -> Tasks:
        """With one slot as a peer knows it, if that is newer (larger generation, then larger state)."""
        known = int(self.generations[heard.slot]), int(self.states[heard.slot])
        state = WAITING if heard.state == CLAIMED else heard.state  # who claims it is in the rows
        if (heard.generation, state) <= known:
            return self
        place = (heard.x_cm, heard.y_cm, heard.z_cm)
        return self._set(heard.slot, heard.generation, state, place, sites, stamp_ns)

    def _set(
        self,
        slot: int,
        generation: int,
        state: int,
        place_cm: tuple[int, int, int] | None,
        sites: NDArray[np.int16],
        stamp_ns: int,
    ) -> Tasks:
        if self.continuous and len(sites):  # never a peer's word where the place can be computed
            place = slot_site(sites, self.seed, len(self.generations), slot, generation)
        else:
            place = np.asarray(self.positions_cm[slot] if place_cm is None else place_cm, np.int16)
        return replace(
            self,
            generations=_with(self.generations, slot, generation),
            states=_with(self.states, slot, state),
            positions_cm=_with(self.positions_cm, slot, place),
            changed_ns=_with(self.changed_ns, slot, stamp_ns),
        )

    def frame(self, cursor: int) -> TasksFrame:
        """At most 22 slots: half of them those that changed last, the rest in turn from `cursor` on."""
        m = len(self.generations)
        newest = np.lexsort((np.arange(m), -self.changed_ns))[: SLOTS_PER_FRAME // 2].tolist()
        chosen = set(newest)
        for step in range(m):
            if len(chosen) < SLOTS_PER_FRAME:
                chosen.add((cursor + step) % m)
        return TasksFrame(tuple(self.slot(slot) for slot in sorted(chosen)))


def turned_effects(before: Tasks, after: Tasks, cause: str) -> list[TaskTurned]:
    """One TaskTurned for every slot whose generation or state differs."""
    differs = (before.generations != after.generations) | (before.states != after.states)
    turned = []
    for slot in np.flatnonzero(differs).tolist():
        task = after.slot(slot)
        turned.append(TaskTurned(slot, task.generation, task.x_cm, task.y_cm, task.z_cm, cause))
    return turned


def _with(array: NDArray[T], index: int, value: ArrayLike) -> NDArray[T]:
    changed = array.copy()
    changed[index] = value
    return _frozen(changed)


def _frozen(array: NDArray[T]) -> NDArray[T]:
    array.flags.writeable = False
    return array
