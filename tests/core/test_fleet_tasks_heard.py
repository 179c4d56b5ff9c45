"""Tasks and generations on the air, driven by hand."""

from __future__ import annotations

from dataclasses import replace

from fleet_seat import (
    air_claim,
    claimed_slot,
    of,
    ready,
    requesting,
    serve,
)

from hippomat_core.config import FleetConfig
from hippomat_core.fleet.digest import fleet_digest
from hippomat_core.messages import (
    ClaimChanged,
    TaskTurned,
)
from hippomat_core.wire.frames import (
    DONE,
    WAITING,
    TaskSlot,
)


def test_newer_generations_are_learnt_from_tasks_and_from_claims():
    taken = ready()
    (turned,) = taken.hear_tasks(1, TaskSlot(2, 5, WAITING, 1, 2, 0), TaskSlot(60, 9, WAITING, 0, 0, 0))
    assert (turned.slot, turned.generation, turned.cause) == (2, 5, "heard")  # type: ignore[union-attr]
    assert taken.hear_tasks(1, TaskSlot(2, 4, WAITING, 1, 2, 0)) == []
    news = taken.hear(1, taken.row(air_claim(3, generation=2)))
    assert [(turn.slot, turn.generation) for turn in of(TaskTurned, news)] == [(3, 2)]
    assert taken.fleet.tasks.generations.tolist() == [0, 0, 5, 2]


def test_tasks_of_strangers_are_not_believed():
    taken = ready()
    assert taken.hear_tasks(60, TaskSlot(2, 5, WAITING, 1, 2, 0)) == []
    taken.hear(1, taken.row(fleet_digest=1))
    assert taken.hear_tasks(1, TaskSlot(2, 5, WAITING, 1, 2, 0)) == []


def test_a_newer_generation_supersedes_our_unconfirmed_claim():
    taken, _ = requesting()
    slot = claimed_slot(taken)
    taken.hear_tasks(1, TaskSlot(slot, 1, WAITING, 1, 2, 0))
    outcome = taken.round()
    assert of(ClaimChanged, outcome.effects)[0].cause == "superseded"


def test_a_differing_digest_is_answered_with_tasks_in_turn_and_an_equal_one_is_not():
    taken = ready(3, 1, 2)
    assert all(outcome.tasks_frames == () for outcome in taken.rounds(0.5, 1, 2))
    answers = []
    for _ in range(5):
        taken.hear(1, taken.row(generations_digest=99))
        answers.append(len(taken.round().tasks_frames))
    assert answers == [1] * 5


def test_orders_open_slots_and_end_with_their_service():
    taken = ready(task_source="orders", turnover="on_completion")
    assert not any(outcome.has_claim for outcome in taken.rounds(1.0, 1, 2))
    taken.hear_tasks(255, TaskSlot(1, 1, WAITING, 123, -45, 0))
    outcome = taken.rounds(0.4, 1, 2)[-1]
    assert outcome.destination == (1.23, -0.45, 0.0)
    serve(taken, outcome)
    assert taken.fleet.tasks.slot(1) == TaskSlot(1, 2, DONE, 123, -45, 0)


def test_every_setting_of_the_fleet_enters_its_digest_but_not_the_path_of_the_policy():
    base = FleetConfig()
    first = fleet_digest(base, 20.0, b"map")
    others = [
        fleet_digest(replace(base, task_slots=13), 20.0, b"map"),
        fleet_digest(replace(base, seed=2), 20.0, b"map"),
        fleet_digest(replace(base, turnover="never"), 20.0, b"map"),
        fleet_digest(base, 20.1, b"map"),
        fleet_digest(base, 20.0, b"other map"),
        fleet_digest(base, 20.0, b"map", b"weights"),
    ]
    assert len({first, *others}) == 7
    assert fleet_digest(replace(base, policy="elsewhere.safetensors"), 20.0, b"map") == first
    assert fleet_digest(replace(base, c_max_s=3.0), 20.0, b"map") == first, "the c_max in use counts"
