"""What each agent holds of the others' rows when frames get lost: a round of the radio, as DESIGN.md has it.

Every frame reaches every other agent with probability 1 - loss, independently. A round is STATE of everybody
in order of id, then RELAY-1 and RELAY-2, as far as they fit into the round's airtime. A row that does not
arrive stays as it was last held, with its age. Who holds a task is known from the rows held; which task is in
a slot is known to all. The relays' rule is that of the firmware (relay_table.c), but the loss of a link is
known to it and not estimated. Knows no world.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hippomat_core.config import ROBOTS_PER_SECOND_OF_ROUND
from hippomat_core.errors import ConfigError
from hippomat_core.wire.other_bodies import relay_room
from hippomat_sim.learn.delivery_kernels import Air, Rows, deliver, exchange, forget, new_turns
from hippomat_sim.learn.env_arrays import Copies, Seen
from hippomat_sim.learn.problems import ProblemBatch
from hippomat_sim.learn.random_stream import streams
from hippomat_sim.learn.settings import EnvSettings

PHASES = 3  # STATE, RELAY-1, RELAY-2
_RADIO = 1  # streams of its own: other losses leave the worlds as they are


class Delivery:
    """The rows that all agents of all copies hold."""

    def __init__(self, settings: EnvSettings, copies: int, seed: int) -> None:
        agents, tasks = settings.agents, settings.tasks
        self._air = air_of(settings)
        self._random = streams(copies, seed, _RADIO)
        self._rows = _new_rows(copies, agents, tasks)
        self._turns = new_turns(agents)
        rows, views = self._rows, copies * agents
        self._views = ProblemBatch(
            costs_q=rows.costs_q.reshape(views, agents, tasks),
            available=rows.available.reshape(views, agents),
            busy=rows.busy.reshape(views, agents),
            waiting=rows.waiting.reshape(views, tasks),
            present=rows.present.reshape(views, agents),
            assigned=rows.assigned.reshape(views, agents),
            ages_rounds=rows.ages_rounds.reshape(views, agents),
        )

    def views(self) -> ProblemBatch:
        """E N views in buffers of its own: view e N + i is what agent i of copy e holds."""
        return self._views

    def memory(self) -> dict[str, NDArray[np.generic]]:
        """All that later rounds depend on, not copied."""
        return {"radio_random": self._random} | {f"row_{name}": a for name, a in self._rows._asdict().items()}

    def deliver(self, copies: Copies, seen: Seen, which: NDArray[np.int64]) -> None:
        """One more round in the copies of `which`: everybody sends its row of `seen`."""
        deliver(self._air, self._random, self._rows, self._turns, copies, seen, which)

    def forget(self, which: NDArray[np.int64]) -> None:
        """Nobody has heard anybody in these copies."""
        forget(self._rows, which)


def air_of(settings: EnvSettings) -> Air:
    """ConfigError where not even the STATEs fit into a round."""
    phases = int(PHASES * ROBOTS_PER_SECOND_OF_ROUND * settings.step_s / settings.agents + 1e-9)
    if phases < 1:
        least_s = settings.agents / (PHASES * ROBOTS_PER_SECOND_OF_ROUND)
        raise ConfigError(f"step_s = {settings.step_s}: {settings.agents} STATEs take {least_s:.3f} s of air")
    return Air(
        loss=float(settings.loss),
        relays=min(phases, PHASES) - 1 if settings.relay else 0,
        rows_per_relay=relay_room(settings.agents, settings.tasks),
        dead_rounds=settings.dead_s / settings.step_s,
    )


def held_after_a_round(settings: EnvSettings, rounds: int, seed: int) -> NDArray[np.bool_]:
    """(rounds, N, N) [holder, row] which rows of a round are held at its end; to compare with radios."""
    air, turns = air_of(settings), new_turns(settings.agents)
    random = streams(1, seed, _RADIO)
    held = np.empty((rounds, settings.agents, settings.agents), np.bool_)
    for number in range(rounds):
        exchange(air, random, 0, turns)
        held[number] = turns.held
    return held


def _new_rows(copies: int, agents: int, tasks: int) -> Rows:
    pairs = (copies, agents, agents)
    available, busy, present, assigned = (np.zeros(pairs, np.bool_) for _ in range(4))
    return Rows(
        costs_q=np.zeros((*pairs, tasks), np.uint8),
        available=available,
        busy=busy,
        waiting=np.zeros((copies, agents, tasks), np.bool_),
        present=present,
        assigned=assigned,
        ages_rounds=np.zeros(pairs, np.float32),
        slot=np.zeros(pairs, np.int64),
        generation=np.zeros(pairs, np.int64),
    )
