"""hippomat-bench tables: what is measured, stored, printed and judged."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from world_samples import SMALL

from hippomat_logs.paper_values import CONTINUOUS_COST, FIXED_COST, FIXED_TIME, OURS, paper_value
from hippomat_sim.bench import tables_cells as kinds
from hippomat_sim.bench.cli import main
from hippomat_sim.bench.tables_cells import Plan
from hippomat_sim.bench.tables_command import Output, report
from hippomat_sim.bench.tables_figures import METRICS, Figure, figures_of
from hippomat_sim.bench.tables_files import CSV_COLUMNS, as_csv, as_markdown
from hippomat_sim.bench.tables_goals import Goal, goals_of, verdict
from hippomat_sim.bench.tables_layout import NOT_TRAINED, Book, number, shown
from hippomat_sim.bench.tables_measure import TEST_SPLIT, Bench
from hippomat_sim.bench.tables_run import Results, run
from hippomat_sim.bench.tables_sections import sections_of
from hippomat_sim.bench.tables_stats import Estimate
from hippomat_sim.bench.tables_store import STORE_NAME, Store
from hippomat_sim.learn.method_registry import METHODS, Sources, run_of
from hippomat_sim.learn.runs import Fleet, Run, missing
from hippomat_sim.learn.world_pool import WorldPool, make_pool

WORLD = replace(SMALL, sites=48, starts=24)


def test_the_papers_values_are_those_of_its_tables() -> None:
    assert paper_value(FIXED_COST, OURS, 20) == 327.4
    assert paper_value(CONTINUOUS_COST, "Random", 30) == 9453.2
    assert paper_value(FIXED_TIME, "Hungarian", 30) == 5.6
    assert paper_value(FIXED_COST, OURS, 30) is None
    assert paper_value(FIXED_COST, "nearest", 4) is None


def test_a_plan_measures_every_cell_once_and_what_is_compared_with() -> None:
    cells = Plan(methods=("greedy",), agents=(5,)).cells()
    assert len(cells) == len(set(cells))
    assert {cell.method for cell in cells} == {"greedy", kinds.REFERENCE, kinds.OPTIMUM}
    assert {cell.agents for cell in cells} == {5}
    timed = [cell.kind == kinds.TIME for cell in cells]
    assert timed == sorted(timed)  # alone at the end
    whole = Plan().cells()
    assert {(cell.agents, cell.tasks) for cell in whole if cell.kind == kinds.ONE_SHOT} >= {
        (4, 4), (8, 8), (12, 12), (20, 20), (5, 5), (10, 10), (30, 30), (50, 50), (50, 60)
    }  # fmt: skip
    assert {cell.loss for cell in whole if cell.kind == kinds.LOSS} == set(kinds.LOSSES)
    assert {cell.loss for cell in Plan(loss=0.2).cells()} == {0.0, 0.2}


def test_slow_methods_get_the_first_of_the_same_instances() -> None:
    counts = {cell.method: cell.count for cell in Plan(agents=(5,)).cells() if cell.kind == kinds.ONE_SHOT}
    assert counts["ipso_g"] == round(counts["greedy"] * METHODS["ipso_g"].share) < counts["greedy"]


def test_continuous_tasks_have_copies_enough_for_their_goals() -> None:
    cells = Plan().cells()
    copies = {(cell.method, cell.agents): cell.count for cell in cells if cell.kind == kinds.CONTINUOUS}
    assert copies["graphsage", 10] == copies["hungarian", 10] == 600
    assert copies["graphsage", 30] == 200
    assert copies["ipso_g", 10] == 10  # slow
    under_loss = {
        (cell.method, cell.agents): cell.count for cell in cells if cell.kind == kinds.LOSS_CONTINUOUS
    }
    assert under_loss["graphsage", 10] == 25


# --- measuring ---

PARTS_WITHOUT_LOSS = ("fixed", "continuous", "permuted", "time")
METHODS_WITHOUT_WEIGHTS = ("hungarian", "greedy", "nearest", "random", "fixed_slot", "ipso_g", "look_ahead")


@pytest.fixture(scope="module")
def pool() -> WorldPool:
    return make_pool(WORLD, TEST_SPLIT, cache=False)


def small_plan(**changes: Any) -> Plan:
    plan = Plan(methods=METHODS_WITHOUT_WEIGHTS, agents=(4,), episodes=20, parts=PARTS_WITHOUT_LOSS)
    return replace(plan, **changes)


@pytest.fixture(scope="module")
def results(pool: WorldPool, tmp_path_factory: pytest.TempPathFactory) -> Results:
    directory = tmp_path_factory.mktemp("tables")
    bench = Bench(WORLD, Sources(directory / "runs"), 0)
    return run(small_plan(), bench, pool, Store(directory, fresh=True), 1, lambda *_: None)


def test_an_interrupted_run_goes_on_and_comes_to_the_same(pool: WorldPool, tmp_path: Path) -> None:
    bench, plan = Bench(WORLD, Sources(tmp_path / "runs"), 0), small_plan(parts=("fixed",))

    def stop_after_three(_about: str, done: int, _total: int) -> None:
        if done == 3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run(plan, bench, pool, Store(tmp_path, fresh=True), 1, stop_after_three)
    told: list[int] = []
    store = Store(tmp_path, fresh=False)
    resumed = run(plan, bench, pool, store, 1, lambda _about, done, _total: told.append(done))
    assert told[0] == 3
    whole = run(plan, bench, pool, Store(tmp_path / "..", fresh=False), 1, lambda *_: None)
    assert resumed.figures.keys() == whole.figures.keys()
    for cell, figures in whole.figures.items():
        for name, values in figures.items():
            assert np.array_equal(values, resumed.figures[cell][name]), (cell, name)


def test_every_measurement_gives_all_of_its_metrics(results: Results) -> None:
    figures = figures_of(results)
    assert len(figures) == len({(one.kind, one.metric, one.method, one.agents, one.tasks) for one in figures})
    for one in figures:
        assert one.metric in METRICS[one.kind]
        assert one.estimate.low <= one.estimate.high
    book = Book(figures)
    hungarian = book.find(kinds.ONE_SHOT, "cf1", "hungarian", 4, 4)
    assert hungarian is not None
    assert hungarian.value == 100.0
    over = book.find(kinds.CONTINUOUS, "agent_s_over", "hungarian", 4, kinds.CONTINUOUS_TASKS)
    assert over is not None
    assert (over.value, over.low, over.high) == (0.0, 0.0, 0.0)
    slots = book.find(kinds.PERMUTED, "same_slot", "fixed_slot", 4, 4)
    assert slots is not None
    assert slots.value == 100.0


def test_the_report_has_a_chapter_for_everything_measured(results: Results) -> None:
    book = Book(figures_of(results), frozenset({(kinds.ONE_SHOT, "auction", 4, 4)}))
    sections = sections_of(book, goals_of(book, 20, {}), {"auction": "run the auction's training"})
    text = as_markdown("Results", "preface", sections)
    for title in (
        "Goals",
        "The paper's tables",
        "Fixed tasks",
        "Continuous tasks",
        "Slots permuted",
        "Not trained",
    ):
        assert f"## {title}" in text
    assert "20.3" in text  # the paper's, beside ours
    assert NOT_TRAINED in text
    assert "run the auction's training" in text
    for table in (table for section in sections for table in section.tables):
        assert all(len(row) == len(table.columns) for row in table.rows), table.title


def test_the_csv_has_a_line_for_every_figure(results: Results) -> None:
    figures = figures_of(results)
    lines = list(csv.DictReader(as_csv(figures).splitlines()))
    assert len(lines) == len(figures)
    assert tuple(lines[0]) == CSV_COLUMNS
    assert {line["method"] for line in lines} == set(METHODS_WITHOUT_WEIGHTS)


# --- what is said and judged ---


def test_numbers_are_shown_without_a_negative_zero() -> None:
    assert number(-0.001, 2, signed=True) == "0.00"
    assert number(1.25, 1, signed=True) == "+1.2"
    assert shown(Estimate(99.5, 99.0, 100.0, 3), 1) == "99.5 ± 0.5"
    assert shown(None, 1) == shown(Estimate(float("nan"), 0.0, 0.0, 0), 1) == "-"


def book_with(value: float) -> Book:
    estimate = Estimate(value, value - 0.1, value + 0.1, 1000)
    return Book([Figure(kinds.ONE_SHOT, "cf1", "graphsage", 5, 5, 0.0, True, estimate)])


def named(goals: list[Goal], name: str) -> Goal:
    return next(goal for goal in goals if goal.name == name)


def test_goals_are_judged_where_enough_was_measured() -> None:
    name = "fixed, ours, N = M = 5: CF1"
    good, bad = goals_of(book_with(99.6), 1000, {}), goals_of(book_with(99.4), 1000, {})
    few = goals_of(book_with(99.4), 10, {})
    assert named(good, name).met
    assert named(bad, name).missed
    assert not named(few, name).missed
    assert "fewer than" in named(few, name).not_judged
    assert named(good, "fixed, ours, N = M = 10: CF1").not_judged == "not measured"
    assert verdict(good).startswith("all 1 judged goals met")
    assert verdict(bad).startswith(f"missed: {name}")


def test_the_policys_own_manifest_says_how_long_its_training_took() -> None:
    manifest = {
        "metrics": {"collect_s": 100.0, "learn_s": 500.0, "agent_steps": 10_000_000},
        "training": {"ppo": {"epochs": 3}},
    }
    goals = goals_of(Book([]), 1000, manifest)
    took, learned = named(goals, "training of our policy"), goals[-2]
    assert (took.value, took.met) == (10.0, True)
    assert (learned.value, learned.met) == (60_000.0, True)
    assert named(goals_of(Book([]), 1000, {}), "training of our policy").not_judged == "not measured"


def test_runs_are_named_by_preset_and_fleet_and_trained_for_it_alone(tmp_path: Path) -> None:
    run = run_of("paper", Fleet(4, 4, "never"))
    assert run is not None
    assert run.name == "paper_never_4x4"
    settings = run.settings(agent_steps=1000)
    assert settings.budget.agent_steps == 1000
    assert {(one.agents, one.tasks, one.turnover) for one in settings.episodes} == {((4, 4), (4, 4), "never")}
    assert settings.ppo == Run("paper").settings().ppo  # its own hyper-parameters
    assert run_of("greedy", Fleet(4, 4, "never")) is None
    assert missing([run, run], tmp_path) == [run]
    run.policy(tmp_path).parent.mkdir()
    run.policy(tmp_path).touch()
    assert missing([run], tmp_path) == []


def test_methods_without_weights_are_listed_and_not_measured(pool: WorldPool, tmp_path: Path) -> None:
    plan = small_plan(methods=("paper", "mappo_gcn"), parts=("fixed",))
    bench = Bench(WORLD, Sources(tmp_path / "runs"), 0)
    results = run(plan, bench, pool, Store(tmp_path, fresh=True), 1, lambda *_: None)
    assert {cell.method for cell in results.missing} == {"paper", "mappo_gcn"}
    assert {cell.method for cell in results.figures} == {kinds.OPTIMUM, kinds.REFERENCE}


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--methods", "magic"], "--methods magic: unknown"),
        (["--methods", ","], "--methods"),
        (["--only", "everything"], "--only everything: unknown"),
        (["--agents", "five"], "--agents five: must be whole numbers"),
        (["--agents", "65"], "--agents 65: must be 1 to 64"),
        (["--episodes", "1"], "--episodes 1: must be at least 2"),
        (["--loss", "1"], "--loss 1: must be above 0 and below 1"),
        (["--seed", "-1"], "--seed -1"),
        (["--jobs", "0"], "--jobs 0"),
        (["--train", "-5"], "--train -5"),
        (["--worlds", "0"], "--worlds 0: must be at least 1"),
    ],
)
def test_wrong_usage_is_one_line_before_anything_runs(
    arguments: list[str], said: str, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    assert main(["tables", "--out", str(tmp_path), *arguments]) == 1
    error = capsys.readouterr().err
    assert said in error
    assert error.count("\n") == 1


def test_the_command_writes_everything_and_resumes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    plan = Plan(methods=("greedy",), agents=(3,), episodes=6, parts=("fixed", "continuous"))
    bench, output = Bench(WORLD, Sources(tmp_path / "runs"), 0), Output(tmp_path, True, True, 2)
    assert report(plan, bench, output) == 0
    first = json.loads(capsys.readouterr().out)
    assert first["met"] is True
    assert {goal["met"] for goal in first["goals"]} == {None}  # too few episodes to judge
    assert {figure["method"] for figure in first["figures"]} == {"greedy", "hungarian"}
    pictures = {"results_fixed.png", "results_continuous.png"}
    written = {path.name for path in tmp_path.iterdir()}
    assert written == {"results.md", "results.csv", "results.json", STORE_NAME} | pictures
    stored = (tmp_path / STORE_NAME).read_bytes()
    assert report(plan, bench, output) == 0
    assert json.loads(capsys.readouterr().out) == first
    assert (tmp_path / STORE_NAME).read_bytes() == stored
