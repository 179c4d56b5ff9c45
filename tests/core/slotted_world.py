"""The fleet of fleet_world.py with radios that agree on fleet time: STATE in slots, relays, rounds told."""

from __future__ import annotations

from fleet_world import TICK_NS, FleetWorld
from slotted_lab import row_of

from hippomat_core.messages import (
    RelayHeard,
    RoundEnded,
    SendState,
    SendTasks,
    StateHeard,
    TasksHeard,
)
from hippomat_core.wire.frames import (
    RELAY,
    STATE,
    TASKS,
    Header,
    RelayFrame,
    StateFrame,
    TasksFrame,
)

ROUND_NS = 2 * TICK_NS
FRAME_NS = 200_000


class SlottedWorld(FleetWorld):
    """Every row that somebody lacks is passed on by everybody who holds it, in a round's two relay phases."""

    def __init__(self, robots: int = 3, loss: float = 0.0, seed: int = 1, **others: object):
        super().__init__(robots, loss, seed, **others)  # type: ignore[arg-type]
        self.states: dict[int, StateFrame] = {}  # wait for their slots
        self.tasks: list[tuple[int, TasksFrame]] = []
        self.hears = lambda sender, receiver: sender != receiver

    def tick(self) -> None:
        super().tick()
        if self.now_ns % ROUND_NS == 0:
            self._round(self.now_ns // ROUND_NS)

    def _broadcast(self, sender: int, effect: SendState | SendTasks, _stamp_ns: int) -> None:
        """To the radio, which sends it in the next round."""
        if isinstance(effect, SendState):
            self.states[sender] = effect.frame
        else:
            self.tasks.append((sender, effect.frame))

    def _round(self, number: int) -> None:
        """Everything that is on the air in a round, and its end."""
        states, self.states = self.states, {}
        tasks, self.tasks = self.tasks, []
        rows = {k: row_of(k, frame) for k, frame in states.items()}
        held = [{k} & rows.keys() for k in range(len(self.bodies))]
        for sender, frame in states.items():
            self._on_air(sender, STATE, frame, held)
        for _ in range(2):
            for sender in range(len(self.bodies)):
                needed = tuple(rows[k] for k in sorted(held[sender]) if any(k not in has for has in held))[:5]
                if needed:
                    self._on_air(sender, RELAY, RelayFrame(len(held), 0, needed), held)
        for sender, orders in tasks:
            self._on_air(sender, TASKS, orders, held)
        for robot, body in enumerate(self.bodies):
            at_ns = self._next_ns(robot)
            ended = RoundEnded(at_ns, number, at_ns // 1000, at_ns // 1000, 0, True)
            self._act(robot, body.take(ended), at_ns)

    def _on_air(
        self, sender: int, kind: int, frame: StateFrame | RelayFrame | TasksFrame, held: list[set[int]]
    ) -> None:
        self.bodies[sender].sequence += 1
        header = Header(kind, False, 1, sender, 1, self.bodies[sender].sequence, self.now_ns // 1000)
        for receiver, body in enumerate(self.bodies):
            if not self.hears(sender, receiver) or self.random.random() < self.loss:
                continue
            at_ns = self._next_ns(receiver)
            at = (at_ns, at_ns // 1000, at_ns // 1000, -50, header)
            if isinstance(frame, StateFrame):
                held[receiver].add(sender)
                body.take(StateHeard(*at, frame))
            elif isinstance(frame, RelayFrame):
                held[receiver] |= {row.robot for row in frame.rows}
                body.take(RelayHeard(*at, frame))
            else:
                body.take(TasksHeard(*at, frame))

    def _next_ns(self, robot: int) -> int:
        return max(self.now_ns + robot * 1_000_000, self.bodies[robot].events[-1].stamp_ns) + FRAME_NS
