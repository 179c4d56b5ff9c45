"""A task goes to an idle robot that is there much sooner, once; and never has two confirmed holders."""

from __future__ import annotations

import numpy as np
import pytest
from fleet_lab import SECOND, Lab, fleet_config
from fleet_seat import Seat, air_claim, of, ready

from hippomat_core.allocation.quantise import quantise
from hippomat_core.config import config_from_dict
from hippomat_core.errors import ConfigError
from hippomat_core.fleet.inputs import Outlook
from hippomat_core.messages import ClaimChanged, RoundDecided
from hippomat_core.wire.frames import UNREACHABLE

C_MAX_S = 20.0
OWN = (10, 20, UNREACHABLE, UNREACHABLE)


def codes(*costs_s: float) -> np.ndarray:
    return quantise(np.array(costs_s), C_MAX_S)


def on_the_way(**fleet: object) -> Seat:
    """Robot 0 of three holds slot 0, confirmed; 1 and 2 vote for it and hold slots 2 and 3."""
    settings = {"turnover": "on_completion", "handover_gain_s": 2.0, "allocator": "hungarian", **fleet}
    taken = ready(3, **settings)
    for _ in range(4):
        hear(taken, 1, claim=air_claim(2))
        hear(taken, 2, claim=air_claim(3))
        end(taken)
    assert taken.fleet.own_claim.confirmed
    return taken


def hear(taken: Seat, robot: int, **row: object) -> None:
    tag = 0 if taken.fleet.own_claim is None else taken.fleet.own_claim.id.tag
    taken.hear(robot, taken.row(endorsed=tag, **row))


def end(taken: Seat, eta_s: float = 9.0, **own: object):
    outlook = Outlook(eta_s, codes(eta_s, eta_s + 5, eta_s + 5, eta_s + 5))
    given = {"c_max_s": C_MAX_S, "outlook": lambda _: outlook, **own}
    return taken.round(OWN, **given)


def change(outcome) -> ClaimChanged | None:
    return next(iter(of(ClaimChanged, outcome.effects)), None)


def test_a_claim_goes_to_an_idle_robot_that_is_there_much_sooner():
    taken = on_the_way()
    hear(taken, 1, costs=np.array([*codes(4.0), UNREACHABLE, UNREACHABLE, UNREACHABLE]))
    hear(taken, 2, claim=air_claim(3))
    outcome = end(taken)
    assert (change(outcome).what, change(outcome).cause) == ("released", "handed over to robot 1")
    assert of(RoundDecided, outcome.effects)[0].action == 0, "it asks for nothing in the same round"
    assert outcome.state_frame.costs[0] == UNREACHABLE, "it leaves the task to the heir"
    assert outcome.state_frame.costs[1] == OWN[1]


@pytest.mark.parametrize(
    ("what", "row", "own"),
    [
        ("gains less than handover_gain_s", {"costs": [8.0, None]}, {}),
        ("has another task to ask for", {"costs": [4.0, 6.0]}, {}),
        ("is not free", {"costs": [4.0, None], "claim": air_claim(2)}, {}),
        ("cannot get there", {"costs": [None, None]}, {}),
        ("knows other generations", {"costs": [4.0, None], "generations_digest": 7}, {}),
        ("comes too late: we have arrived", {"costs": [4.0, None]}, {"arrived": True}),
    ],
)
def test_a_claim_is_kept_where_the_other(what, row, own):  # noqa: ARG001
    taken = on_the_way()
    first = [codes(np.inf if cost is None else cost).item() for cost in row["costs"]]
    hear(taken, 1, **{**row, "costs": np.array([*first, UNREACHABLE, UNREACHABLE], np.uint8)})
    hear(taken, 2, claim=air_claim(3))
    end(taken, **own)
    assert taken.fleet.own_claim is not None


def test_a_row_of_an_earlier_round_is_no_reason():
    taken = on_the_way()
    hear(taken, 2, claim=air_claim(3))
    end(taken)
    hear(taken, 2, claim=air_claim(3))
    end(taken)
    assert taken.fleet.own_claim is not None


def test_without_a_gain_set_whoever_claims_a_task_serves_it():
    taken = on_the_way(handover_gain_s=0.0)
    hear(taken, 1, costs=np.array([*codes(0.5), UNREACHABLE, UNREACHABLE, UNREACHABLE]))
    end(taken)
    assert taken.fleet.own_claim is not None


def test_a_task_is_handed_over_once_by_one_robot():
    taken = on_the_way()
    idle = np.array([*codes(4.0), UNREACHABLE, UNREACHABLE, UNREACHABLE])
    hear(taken, 1, costs=idle)
    hear(taken, 2, claim=air_claim(3))
    end(taken)
    for _ in range(60):  # robot 1 never asks for it, and is bored
        hear(taken, 1, costs=idle, claim=air_claim(2))
        hear(taken, 2, claim=air_claim(3))
        outcome = taken.round((10, UNREACHABLE, UNREACHABLE, UNREACHABLE))
    assert taken.fleet.own_claim is not None, "the task is ours again after a while"
    assert taken.fleet.own_claim.confirmed
    for _ in range(5):
        hear(taken, 1, costs=idle)
        hear(taken, 2, claim=air_claim(3))
        outcome = end(taken)
    assert taken.fleet.own_claim is not None
    assert outcome.has_claim


def test_a_handover_where_tasks_leave_their_slots_is_refused_by_name():
    with pytest.raises(ConfigError, match=r"handover_gain_s = 2\.0 needs a task that stays in its slot"):
        config_from_dict({"fleet": {"handover_gain_s": 2.0}})
    config_from_dict({"fleet": {"handover_gain_s": 2.0, "turnover": "never"}})


# ---- as a fleet lives it ----


def served(gain_s: float, seed: int, loss: float, seconds: float, watchful: bool = False) -> Lab:
    config = fleet_config(6, 4, turnover="on_completion", handover_gain_s=gain_s, allocator="hungarian")
    lab = Lab(config, seed, loss, speed_mps=0.6, watchful=watchful)
    lab.run(seconds)
    assert not lab.twice_completed()
    return lab


@pytest.mark.parametrize("loss", [0.0, 0.3, 0.5])
def test_handovers_under_loss_never_give_a_task_two_holders_and_starve_nobody(loss):
    lab = served(1.0, 3, loss, 30, watchful=True)
    assert lab.changes("released"), "there was something to hand over"
    released = [(robot, e.slot, e.generation) for _, robot, e in lab.effects if is_release(e)]
    assert len(released) == len(set(released)), "at most one of a robot and a task"
    latest = {slot: max(generation for s, generation in lab.completed if s == slot) for slot in range(4)}
    for slot, generation in latest.items():
        assert all((slot, k) in lab.completed for k in range(generation)), "every task is served"
    assert max(times[0][0] for times in lab.completed.values()) > 26 * SECOND, "to the end"


def is_release(effect: object) -> bool:
    return isinstance(effect, ClaimChanged) and effect.what == "released"


@pytest.mark.parametrize("loss", [0.0, 0.3])
def test_a_fleet_that_hands_over_serves_no_fewer_tasks(loss):
    with_it = sum(len(served(1.0, seed, loss, 25).completed) for seed in range(3))
    without = sum(len(served(0.0, seed, loss, 25).completed) for seed in range(3))
    assert with_it >= without
