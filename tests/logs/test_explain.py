"""explain: what it says of a decision is what was decided, and what it calls lost was lost."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from recorded_fleet import FIRST_REQUEST_S, OPERATED, MemoryRun, RecordedFleet

from hippomat_core import messages as m
from hippomat_core.allocation.port import Allocator, Decision, Problem
from hippomat_core.errors import HippomatError
from hippomat_core.wire.frames import STATE
from hippomat_logs.cli import main
from hippomat_logs.fleet_story.causes import missing_row
from hippomat_logs.fleet_story.conflicts import conflicts_of
from hippomat_logs.fleet_story.decision_view import decision_view
from hippomat_logs.fleet_story.rerun import Rerun, newest_of_both, with_fresh_rows
from hippomat_logs.fleet_story.story import FleetStory, fleet_story
from hippomat_logs.fleet_story.task_life import task_life
from hippomat_logs.policy_files import packaged_policy
from hippomat_logs.reader import Run

EVERY_ROUND = range(1 << 32)
ONE_TASK = {**OPERATED, "task_slots": 1}
ABOVE_ROBOT_0 = [(0.6, 2.0)]
FIELDS = ("costs_q", "available", "busy", "waiting", "present", "assigned", "ages_rounds")

seeds = st.integers(0, 10_000)
quick = settings(max_examples=4, deadline=None, derandomize=True, suppress_health_check=list(HealthCheck))


@dataclass
class Spy:
    """An allocator that remembers what it was given."""

    inner: Allocator
    given: dict[int, Problem]

    @property
    def name(self) -> str:
        return self.inner.name

    def allocate(self, problem: Problem) -> Decision:
        self.given[problem.round] = problem
        return self.inner.allocate(problem)

    def actions(self, problem: Problem) -> NDArray[np.int64]:
        return self.inner.actions(problem)


def spied(fleet: RecordedFleet) -> list[dict[int, Problem]]:
    """Per robot, the problem of every round in which its allocator was asked."""
    given: list[dict[int, Problem]] = []
    for body in fleet.bodies:
        given.append({})
        spy = Spy(body.state.fleet.allocator, given[-1])
        body.state = replace(body.state, fleet=replace(body.state.fleet, allocator=spy))
    return given


def whole_story(runs: Sequence[Run]) -> FleetStory:
    return fleet_story(runs, keep=lambda *_: True, said_in=EVERY_ROUND)


# ---- laws: decisions out of the log are the decisions that were made ----


@quick
@given(seeds, st.sampled_from([0.0, 0.3, 0.7]), st.booleans())
def test_the_problem_out_of_the_log_is_the_one_that_the_allocator_was_given(
    seed: int, loss: float, relays: bool
) -> None:
    fleet = RecordedFleet(4, loss, seed, relays=relays, task_slots=3)
    given = spied(fleet)
    fleet.run(7.0)
    story = whole_story(fleet.runs())
    rerun = Rerun(story)
    assert sum(map(len, given)) > 4
    for robot, problems in enumerate(given):
        for number, problem in problems.items():
            again = rerun.problem(story.robots[robot].decisions[number])
            for name in FIELDS:
                assert np.array_equal(getattr(again, name), getattr(problem, name)), (robot, number, name)


@pytest.mark.parametrize("allocator", ["graphsage", "nearest", "random"])
def test_every_decision_can_be_made_again_from_the_log(allocator: str) -> None:
    policy = packaged_policy() if allocator == "graphsage" else None
    fleet = RecordedFleet(3, 0.5, 4, allocator=allocator, policy=policy)
    given = spied(fleet)
    fleet.run(6.0)
    story = whole_story(fleet.runs())
    rerun = Rerun(story)
    for robot, problems in enumerate(given):
        for number in problems:
            assert rerun.refusal(story.robots[robot].decisions[number]) == ""
    assert any(given)


@quick
@given(seeds, st.sampled_from([0.3, 0.7]))
def test_what_is_called_lost_was_sent_and_not_heard(seed: int, loss: float) -> None:
    fleet = RecordedFleet(3, loss, seed, relays=loss > 0.5)
    fleet.run(4.0)
    story = whole_story(fleet.runs())
    sent = [sequences(body.events, m.FrameSent) for body in fleet.bodies]
    checked = 0
    for told in story.robots.values():
        heard = {
            (event.header.sender, event.header.sequence)
            for event in fleet.bodies[told.robot].events
            if isinstance(event, m.StateHeard)
        }
        for seen in told.decisions.values():
            for robot in np.flatnonzero(seen.late).tolist():
                found = re.search(
                    r"sent its STATE of round \d+ \(sequence (\d+)\)", missing_row(story, seen, robot)
                )
                if robot != told.robot and found is not None:
                    checked += 1
                    assert int(found[1]) in sent[robot]
                    assert (robot, int(found[1])) not in heard
    assert checked > 10


def sequences(events: Sequence[m.Event], kind: type[m.FrameSent]) -> set[int]:
    return {event.sequence for event in events if isinstance(event, kind) and event.kind == STATE}


@quick
@given(seeds)
def test_without_loss_fresh_rows_are_the_rows_held(seed: int) -> None:
    fleet = RecordedFleet(3, 0.0, seed)
    given = spied(fleet)
    fleet.run(6.0)
    story = whole_story(fleet.runs())
    rerun = Rerun(story)
    for robot, problems in enumerate(given):
        for number in problems:
            seen = story.robots[robot].decisions[number]
            view = decision_view(story, seen)
            assert view.same
            assert not view.unknown
            assert not any(row.differs or row.stale for row in view.rows)
            said = {k: told.said[number] for k, told in story.robots.items()}
            ours = np.asarray(seen.decided.generations, np.int64)
            fresh, held = with_fresh_rows(seen, said, ours, 1), rerun.problem(seen)
            for name in ("available", "busy", "assigned", "waiting"):
                assert np.array_equal(getattr(fresh, name), getattr(held, name))


@quick
@given(seeds, st.sampled_from([0.3, 0.7]))
def test_the_newest_of_two_snapshots_is_the_same_whichever_comes_first(seed: int, loss: float) -> None:
    fleet = RecordedFleet(3, loss, seed, relays=False)
    fleet.run(4.5)
    story = whole_story(fleet.runs())
    for number, one in story.robots[0].decisions.items():
        two = story.robots[1].decisions.get(number)
        if two is not None:
            here, there = newest_of_both(one, two, 1), newest_of_both(two, one, 1)
            for name in (name for name in FIELDS if name != "ages_rounds"):
                assert np.array_equal(getattr(here, name), getattr(there, name))


# ---- a task ----


@pytest.fixture(scope="module")
def served() -> RecordedFleet:
    """One task, taken by the robot that is nearest to it, and served."""
    fleet = RecordedFleet(3, **ONE_TASK)
    fleet.run(4.0)
    fleet.order(ABOVE_ROBOT_0)
    fleet.run(12.0)
    return fleet


def test_a_task_is_followed_from_its_opening_to_its_service(served: RecordedFleet) -> None:
    life = task_life(whole_story(served.runs()), (0, 1))
    assert life.place_m == (0.6, 2.0, 0.0)
    assert {one.robot: one.cause for one in life.learnt} == {0: "heard", 1: "heard", 2: "heard"}
    (request,) = life.requests
    body = served.bodies[0]
    (made,), (done,) = body.claims("requested"), body.claims("completed")
    assert (request.robot, request.round, request.code) == (0, made.round, made.cost)
    assert (request.end, request.why) == ("completed", done.cause)
    assert [robot for robot, _ in request.votes] == [1, 2]
    assert all(number > request.round for _, number in request.votes)
    assert request.confirmed[0][0] == "confirmed"
    assert request.on_air == request.round + 1
    assert request.driven_m == pytest.approx(1.4, abs=0.25)
    costs = next(row.codes for row in life.costs if row.round == request.round)
    assert costs[0] == request.code < costs[1] < costs[2]
    assert not life.conflicts
    assert life.replaced is not None


def test_the_command_prints_the_life_and_the_same_as_json(
    served: RecordedFleet, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    logs = str(served.write(tmp_path))
    assert main(["explain", "--task", "0:1", logs]) == 0
    out = capsys.readouterr().out
    for said in ("robot 0 asked for it", "endorsed by robot 1", "confirmed in round", "completed in round"):
        assert said in out
    assert main(["explain", "--task", "0", logs]) == 0
    out = capsys.readouterr().out
    assert "robot 0 asked for it" in out, "the last task that was requested"
    assert "slot 0 had generations 1 to 2: --task 0:1, or 0:all" in out
    assert main(["explain", "--task", "0:all", "--json", logs]) == 0
    tasks = json.loads(capsys.readouterr().out)["tasks"]
    assert [life["generation"] for life in tasks] == [1, 2]
    assert tasks[0]["requests"][0]["robot"] == 0
    only_the_third = next(map(str, tmp_path.glob("robot02*.mcap")))
    assert main(["explain", "--task", "0:1", only_the_third]) == 0
    out = capsys.readouterr().out
    assert "robot 0 has no log; others heard its claim: confirmed in round" in out
    assert "no log of robot 0, 1" in out


# ---- a decision ----


@pytest.fixture(scope="module")
def deaf(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, int]:
    """Robot 1 never hears robot 0, and takes its task; the round in which it did."""
    fleet = RecordedFleet(3, relays=False, starts=[(0.6, 0.6), (1.3, 0.6), (4.4, 4.4)], **ONE_TASK)
    fleet.delivers = lambda sender, receiver: (sender, receiver) != (0, 1)
    fleet.order(ABOVE_ROBOT_0)
    fleet.run(FIRST_REQUEST_S + 0.5)
    decided = next(
        effect
        for _, effect in fleet.bodies[1].effects
        if isinstance(effect, m.RoundDecided) and effect.action > 0
    )
    return fleet.write(tmp_path_factory.mktemp("deaf")), decided.round


def test_a_decision_shows_what_was_missing_and_what_it_would_have_changed(
    deaf: tuple[Path, int], capsys: pytest.CaptureFixture[str]
) -> None:
    logs, number = deaf
    assert main(["explain", "--robot", "1", "--round", str(number), str(logs)]) == 0
    out = capsys.readouterr().out
    assert "robot 1 had never heard robot 0; robot 0 sent its STATE" in out
    assert "with every row fresh: it would have asked for nothing INSTEAD" in out
    table = out[out.index("row  came") : out.index("stale:")]
    assert max(map(len, table.splitlines())) <= 80
    assert "cheapest open tasks [s]" in out
    assert main(["explain", "--robot", "1", "--round", str(number), "--json", str(logs)]) == 0
    facts = json.loads(capsys.readouterr().out)
    assert (facts["request"], facts["fresh"], facts["same"]) == ([0, 1], None, False)


def test_with_one_log_alone_what_others_sent_is_not_known(
    deaf: tuple[Path, int], capsys: pytest.CaptureFixture[str]
) -> None:
    logs, number = deaf
    alone = next(map(str, logs.glob("robot01*.mcap")))
    assert main(["explain", "--robot", "1", "--round", str(number), alone]) == 0
    out = capsys.readouterr().out
    assert "robot 0's log is missing: unknown whether it sent one" in out
    assert "robot 0, 2: not known what it had on the air; taken as held" in out
    assert "INSTEAD" not in out


def test_a_time_names_the_round_that_had_ended_last(
    deaf: tuple[Path, int], capsys: pytest.CaptureFixture[str]
) -> None:
    logs, number = deaf
    view = ["explain", "--json", "--robot", "1", str(logs)]
    assert main([*view, "--round", str(number)]) == 0
    at_s = json.loads(capsys.readouterr().out)["time_s"]
    for time_s, expected in ((at_s + 0.01, number), (at_s - 0.01, number - 1)):
        assert main([*view, "--time", str(time_s)]) == 0
        assert json.loads(capsys.readouterr().out)["round"] == expected


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ("", "say what to explain"),
        ("--task 0 --robot 1", "say what to explain"),
        ("--task 0 --round 3", "belong to --robot"),
        ("--task x", "give a slot"),
        ("--task 7", "no log knows a task in slot 7; slots 0 to 0 have one"),
        ("--task 0:9", "slot 0 had generations 1 to 1"),
        ("--robot 1", "needs --round"),
        ("--robot 9 --round 40", "of robots 0, 1, 2"),
        ("--robot 1 --round 9999", "robot 1 ended rounds"),
        ("--robot 1 --time 9999", "robot 1 ended rounds until"),
    ],
)
def test_what_cannot_be_explained_is_one_clear_line(
    deaf: tuple[Path, int], arguments: str, said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["explain", *arguments.split(), str(deaf[0])]) == 1
    assert said in capsys.readouterr().err.replace("\n", " ")


# ---- logs that are cut, or of a robot that was restarted ----


def test_a_recovered_log_tells_what_it_has_and_says_where_it_ends(
    served: RecordedFleet, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = next(served.write(tmp_path).glob("robot00*.mcap"))
    data = path.read_bytes()
    path.unlink()
    (tmp_path / f"{path.name}.active").write_bytes(data[: len(data) * 2 // 3])
    assert main(["recover", str(tmp_path)]) == 0
    capsys.readouterr()
    assert main(["conflicts", str(tmp_path)]) == 0
    assert "robot 0's log was recovered after a crash: it ends with round" in capsys.readouterr().out


def test_a_robot_that_was_restarted_has_one_story(served: RecordedFleet) -> None:
    runs = served.runs()
    first = runs[0]
    assert isinstance(first, MemoryRun)
    middle = next(
        k
        for k, one in enumerate(first.kept)
        if isinstance(one.message, m.RoundEnded) and one.message.round > 30
    )
    parts = [replace(first, kept=first.kept[:middle]), replace(first, kept=first.kept[middle:])]
    whole, again = fleet_story(runs), fleet_story([*parts[::-1], *runs[1:]])
    assert [claim.task for claim in again.claims] == [claim.task for claim in whole.claims]
    assert again.robots[0].rounds == whole.robots[0].rounds
    with pytest.raises(HippomatError, match="are both of robot 0"):
        conflicts_of([first, *runs])
