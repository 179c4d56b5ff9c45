"""The same frames sent without our schedule, on the same medium: what a schedule is worth.

As many frames of the same sizes as our own run had. Jittered: each frame at a random time of its round.
Periodic: each station sends each of its frames at its own phase, round by round, by its own drifting clock.
Both are plain broadcasts; nothing is relayed or answered.
"""

from __future__ import annotations

import math
import random
from collections.abc import Iterator
from typing import Literal, TypeAlias

from hippomat_core.wire.frames import RELAY, STATE
from hippomat_sim.bench.radio_figures import DirectDelivery, Expectation, share
from hippomat_sim.bench.radio_run import Counter, OurFigures, Progress, Traffic, reach
from hippomat_sim.bench.radio_settings import RadioSettings
from hippomat_sim.medium import Medium

Habit: TypeAlias = Literal["random jitter", "periodic"]
HABITS: tuple[Habit, ...] = ("random jitter", "periodic")
LONGEST_S = 60.0
_Send: TypeAlias = tuple[int, int, bytes]  # time, station, frame


def run_plain(settings: RadioSettings, ours: OurFigures, habit: Habit, progress: Progress) -> Traffic:
    """At most LONGEST_S of it, without faults."""
    medium = Medium(settings.nodes, settings.air(), settings.seed)
    expected = Expectation(reach(settings), settings.settling_us, settings.round_us)
    for station in range(settings.nodes):
        expected.on(station, -settings.settling_us)
    expected.update(0, lambda: None)
    delivery = DirectDelivery(expected)
    rounds = round(1e6 * min(settings.seconds, LONGEST_S)) // settings.round_us
    counter = Counter(medium, 0)
    for count, (now_us, station, frame) in enumerate(sorted(_sends(settings, ours, habit, rounds))):
        while (ended := medium.pop_ended(now_us - 1)) is not None:
            delivery(ended)
        medium.send(now_us, station, frame)
        if count % 1000 == 0:
            progress(now_us / 1e6)
    while (ended := medium.pop_ended((rounds + 1) * settings.round_us)) is not None:
        delivery(ended)
    return counter.traffic(rounds * settings.round_us, settings.round_us, share(delivery.got, delivery.due))


def _sends(settings: RadioSettings, ours: OurFigures, habit: Habit, rounds: int) -> Iterator[_Send]:
    rng = random.Random(f"{habit} {settings.seed}")
    frames = [(1.0, _frame(STATE, ours.state_bytes))]
    if most := math.ceil(ours.relays_per_state):
        frames += [(ours.relays_per_state / most, _frame(RELAY, ours.relay_bytes))] * most
    round_us = settings.round_us
    for station in range(settings.nodes):
        period_us = round_us * (1 + rng.uniform(-1, 1) * settings.drift_ppm / 1e6)
        for probability, frame in frames:
            phase_us = rng.uniform(0, round_us)
            for number in range(rounds):
                if rng.random() < probability:
                    jittered_us = number * round_us + rng.uniform(0, round_us)
                    at_us = jittered_us if habit == "random jitter" else number * period_us + phase_us
                    yield int(at_us), station, frame


def _frame(kind: int, length: int) -> bytes:
    """Its first byte names the kind, as in a real frame; the rest says nothing."""
    return bytes((kind,)) + bytes(length - 1)
