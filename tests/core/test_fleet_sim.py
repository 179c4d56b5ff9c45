"""Rule F and the allocation as a fleet lives them, where every robot ends its own rounds (fleet_lab.py)."""

from __future__ import annotations

import pytest
from fleet_lab import SECOND, Lab, draws, fleet_config

from hippomat_core.allocation.factory import make_allocator
from hippomat_core.config import FleetConfig
from hippomat_logs.policy_files import policy_of


def test_a_quiet_air_gives_every_robot_work_without_one_conflict_lost():
    lab = Lab(fleet_config(turnover="on_completion"), seed=1, wire=True)
    lab.run(25)
    assert sum(lab.served_by.values()) >= 40
    assert min(lab.served_by.values()) >= 5
    assert len(lab.served_by) == 5
    assert not lab.twice_completed()


@pytest.mark.parametrize("turnover", ["on_claim", "on_completion"])
@pytest.mark.parametrize("loss", [0.1, 0.3, 0.5])
def test_tasks_are_served_steadily_and_once_under_loss(turnover, loss):
    lab = Lab(fleet_config(turnover=turnover), seed=round(loss * 10), loss=loss)
    lab.run(24)
    assert not lab.twice_completed()
    assert len(lab.served_by) == 5
    assert min(lab.served_by.values()) >= 3
    assert sum(lab.served_by.values()) >= 30
    for second in range(8, 24, 4):  # no pause longer than four seconds
        times = [at_ns for times in lab.completed.values() for at_ns, _ in times]
        assert any(second <= at_ns / SECOND < second + 4 for at_ns in times)


@pytest.mark.parametrize("name", ["graphsage", "look_ahead", "auction"])
def test_a_fleet_serves_its_tasks_once_whichever_way_it_chooses_them(name):
    policy = policy_of(FleetConfig(allocator=name))
    allocator = make_allocator(name, policy, 5, 6)
    lab = Lab(fleet_config(5, 6, allocator=name), seed=2, loss=0.2, allocator=allocator)
    lab.run(16)
    assert not lab.twice_completed()
    assert len(lab.served_by) == 5
    assert sum(lab.served_by.values()) >= 15


def test_few_tasks_for_many_robots_are_served_once_each_under_loss():
    lab = Lab(fleet_config(7, 3, turnover="on_completion"), seed=4, loss=0.3, speed_mps=3.0)
    lab.run(20)
    assert sum(lab.served_by.values()) >= 12
    assert not lab.twice_completed()


def test_a_fixed_set_of_tasks_is_served_once_each_and_then_never_again():
    lab = Lab(fleet_config(5, 8, turnover="never"), seed=3, loss=0.3, speed_mps=2.0)
    lab.run(20)
    assert sorted(lab.completed) == [(slot, 0) for slot in range(8)]
    assert not lab.twice_completed()


@pytest.mark.parametrize("turnover", ["on_claim", "on_completion"])
@pytest.mark.parametrize(("seed", "size", "loss"), [(1, 4, 0.1), (2, 5, 0.5)])
def test_partitions_never_give_one_task_two_confirmed_holders(turnover, seed, size, loss):
    def hears(sender: int, receiver: int, second: float) -> bool:
        cut = draws(seed, int(second // 9))
        part = [cut.random() < 0.5 for _ in range(size)]
        return second % 9 < 4.5 or part[sender] == part[receiver]

    lab = Lab(fleet_config(size, 5, turnover=turnover), seed, loss, speed_mps=3.0, hears=hears)
    lab.run(30)
    assert sum(lab.served_by.values()) >= 20
    assert not lab.twice_completed()


@pytest.mark.parametrize("turnover", ["on_claim", "on_completion"])
@pytest.mark.parametrize(("seed", "size", "loss"), [(1, 4, 0.1), (2, 5, 0.5)])
def test_links_that_work_one_way_only_never_give_a_task_two_confirmed_holders(turnover, seed, size, loss):
    def hears(sender: int, receiver: int, second: float) -> bool:
        return draws(seed, int(second // 4), sender, receiver).random() > 0.35

    lab = Lab(fleet_config(size, 5, turnover=turnover), seed, loss, speed_mps=3.0, hears=hears)
    lab.run(30)
    assert sum(lab.served_by.values()) >= 8
    assert not lab.twice_completed()


@pytest.mark.parametrize("turnover", ["on_claim", "on_completion"])
def test_robots_that_reboot_never_give_a_task_two_confirmed_holders(turnover):
    reboots: dict[int, list[tuple[float, float]]] = {}
    for robot in range(5):
        chance, at_s = draws(robot), 5.0
        while (at_s := at_s + 3 + 12 * chance.random()) < 30:
            reboots.setdefault(robot, []).append((at_s, 0.3 + 5 * chance.random()))
            at_s += reboots[robot][-1][1]
    lab = Lab(fleet_config(5, 6, turnover=turnover), 5, 0.3, speed_mps=3.0, reboots=reboots)
    lab.run(35)
    assert sum(lab.served_by.values()) >= 10
    assert not lab.twice_completed()


@pytest.mark.parametrize("seed", range(6))
def test_a_holder_that_only_hears_is_unconfirmed_before_another_is_confirmed(seed):
    """The overlap of the dead man: his votes still count where the voters no longer hear him."""

    def hears(sender: int, _: int, second: float) -> bool:
        return not (8 < second < 16 and sender in mute)

    config = fleet_config(5, 1, turnover="on_completion")
    mute: set[int] = set()
    lab = Lab(config, seed, 0.1 * (seed % 2), speed_mps=0.01, hears=hears, watchful=True)
    lab.run(7.5)
    holders = [robot.id for robot in lab.robots if robot.fleet.own_claim is not None]
    assert len(holders) == 1
    mute.update(holders)
    lab.run(6.5)
    confirmed = lab.confirmed_holders()
    assert len(confirmed) == 1
    assert confirmed != holders, "the task went back to the pool"


@pytest.mark.parametrize("seed", range(4))
def test_a_vote_never_counts_for_the_claimants_next_claim(seed):
    """The trap of the tags: voters who do not hear that a claim ended go on quoting it."""

    def hears(sender: int, receiver: int, second: float) -> bool:
        return not (second > 6 and sender == 0 and receiver in (1, 2) and second % 5 < 4)

    config = fleet_config(4, 8, turnover="on_completion", allocator="greedy")
    lab = Lab(config, seed, 0.1, speed_mps=8.0, hears=hears, watchful=True)
    lab.run(20)
    assert not lab.twice_completed()
    assert lab.served_by[0] >= 1


def test_the_same_seed_gives_the_same_run():
    runs = []
    for _ in range(2):
        lab = Lab(fleet_config(3, 6), seed=8, loss=0.3)
        lab.run(8)
        runs.append((repr(lab.effects), lab.completed))
    assert runs[0] == runs[1]
