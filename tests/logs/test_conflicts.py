"""Conflicts out of logs: every one is found, and its cause is the one that the test brought about."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from itertools import combinations
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from recorded_fleet import FIRST_REQUEST_S, OPERATED, RecordedFleet

from hippomat_core import messages as m
from hippomat_logs.cli import main
from hippomat_logs.fleet_story.conflicts import (
    DOUBLE_CLAIM,
    DOUBLE_REQUEST,
    DOUBLY_CONFIRMED,
    Conflict,
    conflict_free_rate,
    conflicts_in,
    conflicts_of,
    price,
)
from hippomat_logs.fleet_story.story import fleet_story
from hippomat_logs.reader import open_runs

ONE_TASK = {**OPERATED, "task_slots": 1}
ABOVE_ROBOT_0 = [(0.6, 2.0)]


def only(fleet: RecordedFleet) -> Conflict:
    (conflict,) = conflicts_of(fleet.runs())
    return conflict


# ---- each cause, brought about ----


def test_a_lost_row_that_changed_the_decision_is_loss() -> None:
    """Robot 1 never hears robot 0, and so takes the task that both know to be nearer to robot 0."""
    fleet = RecordedFleet(3, relays=False, starts=[(0.6, 0.6), (1.3, 0.6), (4.4, 4.4)], **ONE_TASK)
    fleet.delivers = lambda sender, receiver: (sender, receiver) != (0, 1)
    fleet.order(ABOVE_ROBOT_0)
    fleet.run(FIRST_REQUEST_S + 0.5)
    found = only(fleet)
    assert (found.cause, found.kind, found.robots) == ("loss", DOUBLE_REQUEST, (0, 1))
    assert "robot 1 had never heard robot 0; robot 0 sent its STATE of round" in found.evidence[0]
    assert "robot 1 asks for nothing" in found.evidence[-1]


def test_the_lost_row_of_a_third_robot_is_staleness() -> None:
    """Robot 1 does not know that robot 2 takes the far task, and so leaves it to robot 0."""
    starts = [(2.0, 0.6), (0.8, 0.6), (4.2, 0.6)]
    fleet = RecordedFleet(3, relays=False, starts=starts, **{**OPERATED, "task_slots": 2})
    fleet.delivers = lambda sender, receiver: (sender, receiver) != (2, 1)
    fleet.order([(1.5, 0.6), (3.5, 0.6)])
    fleet.run(FIRST_REQUEST_S + 0.3)
    found = conflicts_of(fleet.runs())[0]
    assert (found.cause, found.task, found.robots) == ("staleness", (0, 1), (0, 1))
    assert "robot 1 had never heard robot 2; robot 2 sent its STATE" in found.evidence[0]


@pytest.mark.parametrize(("place", "cause"), [((2.5, 4.0), "tie"), ((1.0, 4.0), "policy")])
def test_two_that_ask_on_equal_rows_do_so_by_tie_or_policy(place: tuple[float, float], cause: str) -> None:
    starts = [(1.01, 1.01), (3.99, 1.01)]
    fleet = RecordedFleet(2, starts=starts, allocator="nearest", **ONE_TASK)
    fleet.order([place])
    fleet.run(FIRST_REQUEST_S + 0.3)
    found = only(fleet)
    assert found.cause == cause
    assert (found.codes[0] == found.codes[1]) == (cause == "tie")
    assert "equal rows" in found.evidence[0]
    assert not found.misjudged


def test_a_row_that_was_lost_but_changed_nothing_is_no_loss() -> None:
    """The core can only see that a row is late; its owner's log shows that it said the same as before."""
    fleet = RecordedFleet(3, relays=False, allocator="nearest", **ONE_TASK)
    fleet.order(ABOVE_ROBOT_0)
    fleet.run(FIRST_REQUEST_S - 0.2)
    fleet.delivers = lambda sender, receiver: {sender, receiver} != {0, 1}
    fleet.run(0.4)
    found = next(one for one in conflicts_of(fleet.runs()) if one.robots == (0, 1))
    assert found.cause == "policy"
    assert found.misjudged or not found.guesses


def test_a_claim_whose_frames_were_lost_is_loss_with_rounds_and_sequences() -> None:
    fleet = RecordedFleet(3, relays=False, **ONE_TASK)
    fleet.run(4.0)
    fleet.delivers = lambda sender, _: sender != 0
    fleet.order(ABOVE_ROBOT_0, 0)
    fleet.run(0.2)
    fleet.order(ABOVE_ROBOT_0, 1, 2)
    fleet.run(0.4)
    found = next(one for one in conflicts_of(fleet.runs()) if one.robots == (0, 1))
    first, second = found.requested
    assert found.cause == "loss"
    assert first < second
    rounds = f"rounds {first + 1} (sequence "
    assert rounds in found.evidence[0]
    assert "heard none, directly or relayed" in found.evidence[0]


def test_a_claim_that_left_too_late_is_clock() -> None:
    fleet = RecordedFleet(3, relays=False, **ONE_TASK)
    fleet.run(4.0)
    fleet.mute = {0}
    fleet.delivers = lambda sender, _: sender != 0
    fleet.order(ABOVE_ROBOT_0, 0)
    fleet.run(0.1)
    fleet.order(ABOVE_ROBOT_0, 1, 2)
    fleet.run(0.3)
    fleet.mute = set()
    fleet.run(0.3)
    found = next(one for one in conflicts_of(fleet.runs()) if one.robots == (0, 1))
    assert found.cause == "clock"
    assert "deadline missed" in found.evidence[0]


def test_a_robot_that_counts_rounds_alone_is_clock() -> None:
    fleet = RecordedFleet(2, allocator="nearest", **ONE_TASK)
    fleet.run(4.0)
    fleet.deafen_to_rounds(1)
    fleet.delivers = lambda sender, _: sender != 1
    fleet.run(0.4)
    fleet.order(ABOVE_ROBOT_0)
    fleet.run(0.6)
    found = only(fleet)
    assert found.cause == "clock"
    assert "robot 1 ended round" in found.evidence[0]
    assert "by its own count" in found.evidence[0]


def test_where_counts_of_rounds_lie_apart_the_robots_own_word_tells_of_the_conflict() -> None:
    """Fleet time of robot 1 is not agreed and 40 rounds behind: no two of its rounds are anybody else's."""
    fleet = RecordedFleet(2, allocator="nearest", **ONE_TASK)
    fleet.order(ABOVE_ROBOT_0)
    fleet.run(FIRST_REQUEST_S + 0.5)
    fleet.bodies[1].trace = [(at_ns, set_back(one, 40)) for at_ns, one in fleet.bodies[1].trace]
    found = only(fleet)
    assert (found.cause, found.kept_by) == ("clock", 0)
    assert "fleet time not agreed" in found.evidence[0]


def set_back(message: object, rounds: int) -> object:
    if isinstance(message, m.RoundEnded):
        return replace(message, round=message.round - rounds, agreed=False)
    return replace(message, round=message.round - rounds) if isinstance(message, m.RoundDecided) else message


# ---- how it ends ----


def test_of_two_requests_the_cheaper_is_kept_and_the_other_pays() -> None:
    fleet = RecordedFleet(2, allocator="nearest", **ONE_TASK)
    fleet.order(ABOVE_ROBOT_0)
    fleet.run(FIRST_REQUEST_S + 0.5)
    found = only(fleet)
    assert (found.kept_by, found.rounds) == (0, 1)
    (paid,) = found.given_up
    assert paid.robot == 1
    assert price([found, found]) == (paid.held_s, paid.driven_m), "a claim that is given up is paid once"
    assert paid.held_s == pytest.approx(0.1, abs=0.01)
    assert "robot 1 dropped it" in found.ending


def test_two_confirmed_at_once_are_shouted_and_exit_2(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Forged: what rule F forbids, written into the logs of a fleet that kept it."""
    fleet = RecordedFleet(3, **ONE_TASK)
    fleet.order(ABOVE_ROBOT_0)
    fleet.run(FIRST_REQUEST_S + 1.0)
    claim = next(change for change in fleet.bodies[0].claims("confirmed"))
    at = next(k for k, (_, one) in enumerate(fleet.bodies[1].trace) if _is_decision_of(one, claim.round + 3))
    stamp_ns = fleet.bodies[1].trace[at][0]
    forged = [m.ClaimChanged(what, "", *claim_of(claim)) for what in ("requested", "confirmed")]
    fleet.bodies[1].trace[at + 1 : at + 1] = [(stamp_ns, one) for one in forged]
    (found,) = conflicts_of(fleet.runs())
    assert found.kind == DOUBLY_CONFIRMED
    assert main(["conflicts", str(fleet.write(tmp_path))]) == 2
    assert "BROKEN PROMISE: robots 0, 1" in capsys.readouterr().out
    assert main(["conflicts", "--json", str(tmp_path)]) == 2
    assert json.loads(capsys.readouterr().out)["promise_broken"]


def claim_of(change: m.ClaimChanged) -> tuple[object, ...]:
    return (change.slot, change.generation, 3, change.cost, change.round + 3, change.x_m, change.y_m, 0.0)


def _is_decision_of(message: object, number: int) -> bool:
    return isinstance(message, m.RoundDecided) and message.round == number


# ---- laws ----

seeds = st.integers(0, 10_000)
quick = settings(max_examples=5, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))


@quick
@given(seeds, st.sampled_from(["nearest", "hungarian", "greedy", "random"]), st.sampled_from([0.2, 0.5, 0.8]))
def test_every_pair_that_claims_one_task_at_once_is_found_whatever_the_order_of_the_logs(
    seed: int, allocator: str, loss: float
) -> None:
    fleet = RecordedFleet(4, loss, seed, allocator=allocator, relays=seed % 2 == 0, task_slots=3)
    fleet.run(6.0)
    found = conflicts_of(fleet.runs())
    assert {(one.task, frozenset(one.robots)) for one in found} == pairs_by_brute_force(fleet)
    assert conflicts_of(fleet.runs()[::-1]) == found
    for one in found:
        assert one.kind in (DOUBLE_REQUEST, DOUBLE_CLAIM)
        assert one.evidence
        assert one.cause != "unknown"


def pairs_by_brute_force(fleet: RecordedFleet) -> set[tuple[tuple[int, int], frozenset[int]]]:
    """Round by round, who claims what: read off the cores themselves while their rounds are common."""
    holders: dict[tuple[int, int, int], set[int]] = {}
    for robot, body in enumerate(fleet.bodies):
        task: tuple[int, int] | None = None
        for _, effect in body.effects:
            if isinstance(effect, m.ClaimChanged) and effect.what in ("dropped", "released", "completed"):
                task = None
            elif isinstance(effect, m.RoundDecided):
                if effect.action > 0:
                    task = effect.action - 1, int(effect.generations[effect.action - 1])
                if task is not None:
                    holders.setdefault((effect.round, *task), set()).add(robot)
    return {
        ((slot, generation), frozenset(pair))
        for (_, slot, generation), robots in holders.items()
        for pair in combinations(sorted(robots), 2)
    }


@quick
@given(seeds, st.sampled_from(["hungarian", "greedy", "look_ahead", "auction"]))
def test_without_loss_allocators_that_coordinate_have_no_conflict(seed: int, allocator: str) -> None:
    fleet = RecordedFleet(4, 0.0, seed, allocator=allocator, task_slots=3)
    fleet.run(5.5)
    story = fleet_story(fleet.runs())
    assert len(story.claims) >= 3
    assert not conflicts_in(story)
    assert conflict_free_rate(story.claims) == 1.0


# ---- what is missing, and the command line ----


@pytest.fixture(scope="module")
def contested(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Four robots that all ask for the nearest task, at heavy loss."""
    fleet = RecordedFleet(4, 0.5, 3, allocator="nearest", task_slots=3)
    fleet.run(6.0)
    return fleet.write(tmp_path_factory.mktemp("contested"))


def test_written_and_read_the_conflicts_are_the_same(contested: Path) -> None:
    fleet = RecordedFleet(4, 0.5, 3, allocator="nearest", task_slots=3)
    fleet.run(6.0)
    assert conflicts_of(open_runs([contested])) == conflicts_of(fleet.runs())


def test_the_table_fits_a_terminal_and_json_has_the_same(
    contested: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["conflicts", str(contested)]) == 0
    out = capsys.readouterr().out
    assert "by cause:" in out
    table = out[out.index("round") : out.index("by cause")]
    assert max(map(len, table.splitlines())) <= 80
    assert "…" not in out
    assert main(["conflicts", "--json", str(contested)]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert sum(facts["by_cause"].values()) == len(facts["conflicts"]) > 3
    assert not facts["promise_broken"]


def test_a_robot_without_a_log_is_named_and_nothing_is_guessed_of_it(
    contested: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    logs = sorted(map(str, contested.glob("*.mcap")))
    assert main(["conflicts", *logs[:3]]) == 0
    out = capsys.readouterr().out
    assert "no log of robot 3" in out
    assert "saw a conflict with robot 3" in out
    assert main(["conflicts", "--json", logs[0]]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert facts["without_log"] == [1, 2, 3]
    assert facts["conflicts"] == []


def test_the_picture_is_written_and_its_name_is_checked(
    contested: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["conflicts", str(contested), "-o", str(tmp_path / "conflicts.png")]) == 0
    assert (tmp_path / "conflicts.png").stat().st_size > 10_000
    assert main(["conflicts", str(contested), "-o", str(tmp_path / "conflicts.txt")]) == 1
    assert "ends in .png" in capsys.readouterr().err.replace("\n", " ")


def test_logs_of_different_fleets_are_refused(contested: Path, capsys: pytest.CaptureFixture[str]) -> None:
    other = RecordedFleet(2, task_slots=2)
    other.run(1.0)
    mixed = contested.parent / "mixed"
    other.write(mixed)
    assert main(["conflicts", str(contested), str(mixed)]) == 1
    assert "give the logs of one fleet" in capsys.readouterr().err.replace("\n", " ")


def test_a_fleet_that_requested_nothing_has_no_rate(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    fleet = RecordedFleet(2)
    fleet.run(1.0)
    assert math.isnan(conflict_free_rate(fleet_story(fleet.runs()).claims))
    assert main(["conflicts", str(fleet.write(tmp_path))]) == 0
    assert "no conflicts" in capsys.readouterr().out
