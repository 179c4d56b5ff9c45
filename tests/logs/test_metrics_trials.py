"""Many trials: which logs are one, what their tables say, and how sure that is."""

from __future__ import annotations

import csv
import io
import json
import math
import re
from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from fleet_logs import FLEET, S, claim, write_log
from hypothesis import given
from hypothesis import strategies as st
from recorded_run import WALL_NS

from hippomat_core import messages as m
from hippomat_core.errors import HippomatError
from hippomat_logs.cli import main
from hippomat_logs.metrics.comparison import Trial, compare
from hippomat_logs.metrics.figures import FIGURES, number
from hippomat_logs.metrics.grouping import LoggedRun, by_time
from hippomat_logs.metrics.intervals import mean_interval
from hippomat_logs.metrics.trial_tables import latex_text
from hippomat_logs.metrics.trials import BY_DIRECTORY, BY_TIME, find_trials

KEY = "completed"


def trial(
    directory: Path, method: str, seed: int, tasks: int, *, begin_s: float = 0.0, robots: int = 1
) -> None:
    """One fleet's logs: `tasks` are completed, a second each."""
    fleet = replace(FLEET, allocator=method, seed=seed)
    for robot in range(robots):
        done = [(1.0 + k, claim("completed", k % 4, k)) for k in range(robot, tasks, robots)]
        stamped = [(0.0, m.Tick(0)), *done, (60.0, m.Tick(0))]
        session = f"{seed:04d}{robot:04d}{method}"[:12]
        write_log(
            directory, robot, stamped, fleet=fleet, session=session, wall_ns=WALL_NS + round(begin_s * S)
        )


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """greedy and hungarian on the seeds 1, 2, 3, all at the same time; greedy on a fourth, later."""
    root = tmp_path_factory.mktemp("runs")
    for method, more in (("greedy", 0), ("hungarian", 2)):
        for seed in (1, 2, 3):
            robots = 2 if seed == 1 else 1  # writing a log takes its time
            trial(root / method / f"seed{seed}", method, seed, 4 + seed + more, robots=robots)
    trial(root / "greedy" / "seed4", "greedy", 4, 20, begin_s=1000.0)
    return root


def test_trials_run_side_by_side_stay_apart_by_their_directories(runs: Path) -> None:
    found = find_trials([runs])
    assert [one.name for one in found.trials] == [
        *(f"greedy/seed{k}" for k in (1, 2, 3, 4)),
        *(f"hungarian/seed{k}" for k in (1, 2, 3)),
    ]
    assert {one.fact("dir") for one in found.trials} == {"greedy", "hungarian"}
    assert [one.robots for one in found.trials] == [2, 1, 1, 1, 2, 1, 1]
    given_apart = find_trials([runs / "greedy", runs / "hungarian"])
    assert [one.fact("dir") for one in given_apart.trials] == [one.fact("dir") for one in found.trials]


def test_one_directory_per_robot_and_several_trials_in_each(tmp_path: Path) -> None:
    for robot in (0, 1):
        for which, begin_s in enumerate((0.0, 100.0)):
            ticks = [(0.0, m.Tick(0)), (50.0, m.Tick(0))]
            begin_ns = WALL_NS + round((begin_s + 3.0 * robot) * S)
            write_log(tmp_path / f"robot{robot}", robot, ticks, session=f"{which}{robot}", wall_ns=begin_ns)
    found = find_trials([tmp_path]).trials
    assert [one.robots for one in found] == [2, 2]
    assert all(one.name.startswith(tmp_path.name + " 20") for one in found)  # and when it began
    assert len({one.name for one in found}) == 2


@pytest.mark.parametrize("by", [BY_TIME, BY_DIRECTORY])
def test_robots_whose_clocks_are_years_apart_are_one_trial(tmp_path: Path, by: str) -> None:
    for which, robots in (("one", (0, 1)), ("two", (0, 1, 2))):
        for robot in robots:
            ticks = [(0.0, m.Tick(0)), (50.0 - robot, m.Tick(0))]
            wall_ns = WALL_NS + robot * 10**17
            write_log(tmp_path / which / f"robot{robot}", robot, ticks, wall_ns=wall_ns, session=which)
    found = find_trials([tmp_path], by).trials
    assert [(one.name, one.robots) for one in found] == [("one", 2), ("two", 3)]


def test_a_trial_with_clocks_years_apart_swallows_no_trial_in_between(tmp_path: Path) -> None:
    for place, apart_ns in (("good", 0), ("wrong", 10**17)):
        for robot in (0, 1):
            wall_ns = WALL_NS + (2 * robot - 1) * apart_ns
            ticks = [(0.0, m.Tick(0)), (50.0, m.Tick(0))]
            write_log(tmp_path / place, robot, ticks, wall_ns=wall_ns, session=place)
    assert [(one.name, one.robots) for one in find_trials([tmp_path]).trials] == [("good", 2), ("wrong", 2)]


def test_runs_that_share_neither_time_nor_frames_are_doubted(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for robot in (0, 1):
        write_log(tmp_path, robot, [(0.0, m.Tick(0)), (50.0, m.Tick(0))], wall_ns=WALL_NS + robot * 10**12)
    assert main(["metrics", str(tmp_path)]) == 0
    assert "runs lie 950 s apart" in " ".join(capsys.readouterr().out.split())


def test_clocks_years_apart_leave_a_choice_where_a_robot_is_there_twice(tmp_path: Path) -> None:
    for which, robot in enumerate((0, 0, 1)):
        ticks = [(0.0, m.Tick(0)), (50.0, m.Tick(0))]
        write_log(tmp_path, robot, ticks, wall_ns=WALL_NS + which * 10**17, session=f"s{which}")
    assert [one.robots for one in find_trials([tmp_path]).trials] == [1, 1, 1]


def test_a_fleet_has_no_more_robots_than_its_settings_say_and_they_took_equally_long(tmp_path: Path) -> None:
    for place, robots, length_s in (("four", (0, 1, 2, 3), 50.0), ("short", (0, 1), 2.0)):
        for robot in robots:
            ticks = [(0.0, m.Tick(0)), (length_s if robot else 50.0, m.Tick(0))]
            write_log(tmp_path / place, robot, ticks, wall_ns=WALL_NS + robot * 10**17)
    assert len(find_trials([tmp_path / "four"]).trials) == 4  # FLEET has three
    assert len(find_trials([tmp_path / "short"]).trials) == 2


def runs_at(robots: list[tuple[int, int, int]]) -> list[LoggedRun]:
    """(robot, begin, length) in one directory."""
    manifest = {"fleet": "1", "session_id": "x"}
    return [
        LoggedRun((Path(f"/r/{k}.mcap"),), {**manifest, "robot": str(robot)}, begun, begun + length)
        for k, (robot, begun, length) in enumerate(robots)
    ]


@given(st.lists(st.tuples(st.integers(0, 3), st.integers(0, 500), st.integers(1, 100)), max_size=12))
def test_every_run_is_in_one_trial_and_no_robot_in_it_twice_at_a_time(
    robots: list[tuple[int, int, int]],
) -> None:
    given_runs = runs_at(robots)
    groups = by_time(given_runs, Path("/r"))
    assert sorted(run.paths for group in groups for run in group) == sorted(run.paths for run in given_runs)
    for group in groups:
        for robot in range(4):
            spans = sorted((run.begun_ns, run.ended_ns) for run in group if run.robot == robot)
            assert all(before[1] <= after[0] for before, after in pairwise(spans))


def test_a_robot_that_restarted_is_still_in_its_trial() -> None:
    groups = by_time(runs_at([(0, 0, 100), (1, 0, 40), (1, 50, 50)]), Path("/r"))
    assert [len(group) for group in groups] == [3]


# ---- intervals ----


@pytest.mark.parametrize("n", [3, 5, 20])
def test_intervals_cover_the_mean_in_95_of_100_cases(n: int) -> None:
    covered = []
    for row in np.random.default_rng(n).normal(7.0, 2.0, (2000, n)):
        found = mean_interval(row.tolist())
        covered.append(abs(found.mean - 7.0) <= found.half)
    assert np.mean(covered) == pytest.approx(0.95, abs=0.015)


def test_one_value_has_no_interval_and_none_has_no_mean() -> None:
    assert (mean_interval([3.0]).mean, mean_interval([3.0]).n) == (3.0, 1)
    assert math.isnan(mean_interval([3.0]).half)
    assert math.isnan(mean_interval([math.nan]).mean)
    assert mean_interval([2.0, math.nan, 4.0]).n == 2
    by_hand = 12.706204736 * math.sqrt(2) / math.sqrt(2)  # t(0.975, 1) s / sqrt(n)
    assert mean_interval([2.0, 4.0]).half == pytest.approx(by_hand)


def made(method: str, seed: int, value: float) -> Trial:
    return Trial(f"{method}{seed}", (method,), (str(seed),), {KEY: value})


@given(st.lists(st.tuples(st.floats(-100, 100), st.floats(-100, 100)), min_size=2, max_size=8))
def test_a_shift_that_all_instances_share_has_no_error_of_its_own(values: list[tuple[float, float]]) -> None:
    base = [made("base", k, value) for k, (value, _) in enumerate(values)]
    shifted = [made("other", k, value + 5.0) for k, (value, _) in enumerate(values)]
    _, other = compare([*base, *shifted], "base")
    assert other.difference(KEY).mean == pytest.approx(5.0)
    assert other.difference(KEY).half == pytest.approx(0.0, abs=1e-6)
    _, reversed_ = compare([*reversed(base), *reversed(shifted)], "base")
    assert reversed_.difference(KEY).mean == pytest.approx(other.difference(KEY).mean)


def test_only_instances_that_both_have_are_paired() -> None:
    values = (("a", 1, 10.0), ("a", 2, 20.0), ("b", 2, 23.0), ("b", 2, 25.0), ("b", 3, 0.0))
    trials = [made(*one) for one in values]
    _, other = compare(trials, "a")
    assert (other.difference(KEY).mean, other.difference(KEY).n) == (4.0, 1)
    with pytest.raises(HippomatError, match=r"--baseline c: .* a, b"):
        compare(trials, "c")


# ---- the command ----


def test_groups_with_paired_differences_as_json(runs: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["metrics", str(runs), "--by", "method", "--baseline", "greedy", "--json"]) == 0
    greedy, hungarian = json.loads(capsys.readouterr().out)["groups"]
    assert greedy["by"] == {"method": "greedy"}
    assert greedy["figures"]["completed"]["mean"] == pytest.approx((5 + 6 + 7 + 20) / 4)
    assert hungarian["figures"]["completed"]["n"] == 3
    low, high = (hungarian["figures"]["completed"][name] for name in ("low", "high"))
    assert (low, high) == pytest.approx((8 - 4.302652730 / math.sqrt(3), 8 + 4.302652730 / math.sqrt(3)))
    difference = hungarian["differences"]["completed"]
    assert (difference["mean"], difference["low"], difference["high"], difference["n"]) == (2.0, 2.0, 2.0, 3)
    assert greedy["differences"] == {}
    assert greedy["figures"]["rssi"] == {"unit": "dBm", "n": 0, "mean": None, "low": None, "high": None}


def test_without_pairs_there_is_no_table_of_differences(
    runs: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["metrics", str(runs), "--by", "seed", "--baseline", "1", "--markdown"]) == 0
    out = capsys.readouterr().out
    assert "o trial pairs with one of 1" in out
    assert out.count("| --- |") == 1


def test_csv_has_a_line_per_group_and_figure(runs: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["metrics", str(runs), "--by", "method,seed", "--csv", "--figures", "completed,cf1"]) == 0
    rows = list(csv.DictReader(io.StringIO(capsys.readouterr().out)))
    assert len(rows) == 7 * 2
    assert [row["mean"] for row in rows if row["method"] == "hungarian" and row["figure"] == "completed"] == [
        "7.0",
        "8.0",
        "9.0",
    ]
    assert {row["low"] for row in rows} == {""}  # one trial each


def latex_rows(text: str) -> Iterator[list[str]]:
    for line in text.splitlines():
        if line.endswith(r"\\"):
            yield re.split(r"(?<!\\)&", line.removesuffix(r"\\"))


def test_latex_is_a_booktabs_table_that_is_well_formed(
    runs: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["metrics", str(runs), "--by", "dir", "--latex", "--baseline", "greedy"]) == 0
    out = capsys.readouterr().out
    assert out.count(r"\begin{table}") == out.count(r"\end{table}") == 2
    for block in out.split(r"\begin{table}")[1:]:
        columns = re.search(r"\\begin\{tabular\}\{([lr]+)\}", block)
        assert columns is not None
        assert {len(row) for row in latex_rows(block)} == {len(columns[1])}
        order = [block.index(word) for word in (r"\toprule", r"\midrule", r"\bottomrule", r"\end{tabular}")]
        assert order == sorted(order)
    assert out.count("{") == out.count("}")
    assert out.count("$") % 2 == 0
    assert r"$8 \pm 2$" in out
    assert "±" not in out
    assert not re.search(r"(?<!\\)%(?! needs)", out)


def test_names_mean_nothing_to_latex() -> None:
    assert latex_text(r"50 % of a_b & {c} ~ \d ^#$") == (
        r"50 \% of a\_b \& \{c\} \textasciitilde{} \textbackslash{}d \textasciicircum{}\#\$"
    )


def test_many_trials_without_a_key_are_shown_one_by_one_within_80_columns(
    runs: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["metrics", str(runs)]) == 0
    out = capsys.readouterr().out
    assert max(map(len, out.splitlines())) <= 80
    assert re.search(r"greedy/seed1 .*greedy/seed2", out)
    assert re.search(r"all\s", out)


def test_a_damaged_trial_is_left_out_by_name(
    runs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    trial(tmp_path / "good", "greedy", 1, 3)
    trial(tmp_path / "bad", "greedy", 2, 3)
    path = next((tmp_path / "bad").glob("*.mcap"))
    data = bytearray(path.read_bytes())
    data[data.find(b"zstd") + 300] ^= 4
    path.write_bytes(data)
    (tmp_path / "good" / "merged.mcap").write_bytes(b"no log")
    assert main(["metrics", str(tmp_path), "--by", "method"]) == 3
    told = capsys.readouterr()
    assert "left out: trial bad" in told.err
    assert "merged.mcap" in told.err.replace("\n", "")
    assert "greedy" in told.out
    assert runs.is_dir()


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--by", "fleet.nonsense"], "--by fleet.nonsense"),
        (["--by", "method", "--figures", "speed"], "--figures speed"),
        (["--by", "method", "--baseline", "magic"], "--baseline magic"),
        (["--by", "method", "--truth", "x.csv"], "--truth x.csv goes with one trial"),
    ],
)
def test_what_is_not_there_is_named(
    runs: Path, arguments: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["metrics", str(runs), *arguments]) == 1
    assert said in capsys.readouterr().err.replace("\n", " ")


def test_every_figure_has_a_name_of_its_own_and_nothing_is_invented() -> None:
    assert len({figure.key for figure in FIGURES}) == len(FIGURES)
    assert number(math.nan, 2) == "-"
    assert (number(-0.001, 2), number(1234.5, 0), number(-2.0, 1)) == ("0.00", "1,234", "-2.0")
