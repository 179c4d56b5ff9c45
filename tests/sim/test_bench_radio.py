"""hippomat-bench radio: what it prints, when it fails, and that it tells good schedules from bad ones."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hippomat_sim.bench.cli import main
from hippomat_sim.bench.radio_faults import faults_of
from hippomat_sim.bench.radio_figures import Expectation, kept
from hippomat_sim.bench.radio_report import verdict
from hippomat_sim.bench.radio_run import RadioRun, stop_took_ms
from hippomat_sim.bench.radio_settings import RadioSettings
from hippomat_sim.bench.radio_targets import Target, targets_of

SHORT = ["radio", "--nodes", "12", "--seconds", "5", "--stops", "1", "--json"]


def figures(arguments: list[str], capsys: pytest.CaptureFixture[str], expected: int = 0) -> dict[str, Any]:
    assert main(arguments) == expected
    return json.loads(capsys.readouterr().out)  # type: ignore[no-any-return]


def test_a_clean_channel_meets_all_targets_and_says_everything(capsys: pytest.CaptureFixture[str]) -> None:
    said = figures([*SHORT, "--seed", "3"], capsys)
    assert said["met"] is True
    assert said["settings"] | {"nodes": 12, "seconds": 5.0, "seed": 3} == said["settings"]
    ours = said["ours"]
    assert ours["traffic"]["direct"] == {"mean": 1.0, "worst": 1.0}
    assert ours["rows"] == {"mean": 1.0, "worst": 1.0}
    assert ours["complete"] == ours["identical"] == 1.0
    assert ours["judged"] == pytest.approx(12 * 50, abs=12)
    assert ours["traffic"]["frames_per_round"] >= 12
    assert 0 < ours["traffic"]["airtime"] < 0.4
    assert 0 < max(ours["agreement_us"]) <= 300
    assert (ours["steps_back"], ours["wrong_rows"], ours["faults"]) == (0, 0, 0)
    assert len(ours["stop_ms"]) == 1
    assert 0 < ours["stop_ms"][0] <= 300
    assert set(said["plain"]) == {"random jitter", "periodic"}
    assert {target["name"] for target in said["targets"]} > {"airtime", "complete snapshots"}


def test_with_hidden_pairs_only_the_schedule_does_without_collisions(
    capsys: pytest.CaptureFixture[str],
) -> None:
    said = figures([*SHORT, "--nodes", "30", "--hidden", "0.2"], capsys)
    ours = said["ours"]["traffic"]
    assert ours["collided"] == 0
    assert ours["direct"]["mean"] == 1.0
    for plain in said["plain"].values():
        assert plain["collided"] > 0
        assert plain["direct"]["mean"] < ours["direct"]["mean"]
        assert plain["direct"]["worst"] < plain["direct"]["mean"]
        assert plain["frames_per_round"] == pytest.approx(ours["frames_per_round"], rel=0.05)
        assert plain["airtime"] == pytest.approx(ours["airtime"], rel=0.05)
    assert said["ours"]["rows"]["worst"] >= 0.95  # of the hidden ones too: by relay


def test_relays_complete_the_snapshots_where_a_third_of_the_frames_is_lost(
    capsys: pytest.CaptureFixture[str],
) -> None:
    ours = figures([*SHORT, "--loss", "0.3", "--no-plain"], capsys)["ours"]
    assert ours["traffic"]["direct"]["mean"] == pytest.approx(0.7, abs=0.03)
    assert ours["rows"]["mean"] > 0.999
    assert ours["relays_per_state"] > 0


def test_a_missed_target_is_exit_code_2_and_named(capsys: pytest.CaptureFixture[str]) -> None:
    # Hosts that answer when the STATE phase is over: their rows come a phase late or not at all.
    late = ["radio", "--nodes", "30", "--seconds", "5", "--stops", "0", "--no-plain", "--answer-ms", "95"]
    assert main(late) == 2
    assert "missed:" in capsys.readouterr().out


def test_the_same_seed_gives_the_same_figures_and_another_seed_others(
    capsys: pytest.CaptureFixture[str],
) -> None:
    air = ["--loss", "0.2", "--hidden", "0.1", "--late", "0.1", "--bursts", "link"]
    arguments = [*SHORT, *air, "--seconds", "10", "--reboots", "1", "--partitions", "1"]
    assert main([*arguments, "--seed", "5"]) in (0, 2)
    first = capsys.readouterr().out
    assert json.loads(first)["ours"]["faults"] == 3
    assert main([*arguments, "--seed", "5"]) in (0, 2)
    assert capsys.readouterr().out == first
    assert main([*arguments, "--seed", "6"]) in (0, 2)
    assert json.loads(capsys.readouterr().out)["ours"] != json.loads(first)["ours"]


def test_faults_are_played_and_the_others_go_on(capsys: pytest.CaptureFixture[str]) -> None:
    faults = ["--deaths", "2", "--reboots", "2", "--partitions", "1", "--late", "0.1"]
    ours = figures([*SHORT, "--seconds", "20", "--no-plain", *faults], capsys)["ours"]
    assert ours["faults"] == 2 + 2 + 2  # a partition begins and ends
    assert ours["complete"] >= 0.999
    assert max(ours["agreement_us"]) <= 300
    assert ours["steps_back"] == 0


def test_the_table_names_what_is_measured(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    plot = tmp_path / "agreement.png"
    assert main([*SHORT[:-1], "--plot", str(plot)]) == 0
    said = capsys.readouterr().out.replace("\n", " ").replace("  ", " ")
    for words in (
        "ours",
        "random jitter",
        "periodic",
        "airtime",
        "STOP",
        "judged targets met",
        f"written: {plot}",
    ):
        assert words in said
    assert plot.read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (["--nodes", "1"], "--nodes 1 is outside 2 .. 64"),
        (["--nodes", "45"], "--rate 5 or less"),
        (["--nodes", "60"], "--nodes 60 do not fit into a round of 100 ms, which holds 32: --rate 5 or less"),
        (["--rate", "0"], "--rate 0 is outside"),
        (["--rate", "7"], "--rate 7: a round must take whole milliseconds"),
        (["--loss", "1.5"], "--loss 1.5 is outside"),
        (["--seconds", "nan"], "--seconds nan is outside"),
        (["--deaths", "30"], "--deaths 30 is outside 0 .. 28: two of --nodes 30 must live on"),
        (["--reboots", "61"], "--reboots 61 is outside 0 .. 60: one a second of --seconds 60"),
        (["--seed", "99999999999"], "--seed 99999999999 is outside 0 .. 2147483647"),
        (["--plot", "/nowhere/a.png"], "there is no directory /nowhere"),
        (["--plot", "a.txt"], "--plot a.txt: the name must end in .png, .pdf, .svg"),
        (["--plot", "."], "--plot .: the name must end in"),
        (["--plot", "/proc/a.png"], "--plot /proc/a.png: cannot write into /proc"),
    ],
)
def test_bad_values_are_one_line_and_exit_code_1(
    arguments: list[str], complaint: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["radio", *arguments]) == 1
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err.startswith("hippomat-bench: ")
    assert complaint in said.err
    assert said.err.count("\n") == 1


@pytest.mark.parametrize("arguments", [[], ["fly"], ["radio", "--nodes", "many"]])
def test_wrong_usage_exits_with_1(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(arguments)
    assert ended.value.code == 1
    assert "--help" in capsys.readouterr().err


def test_help_has_examples_and_exit_codes(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["radio", "--help"])
    said = capsys.readouterr().out
    assert "exit codes:" in said
    assert "hippomat-bench radio --loss 0.3 --json" in said


def test_what_was_not_measured_meets_no_target() -> None:
    nan = float("nan")
    assert not Target("STOP", nan, 300.0, False, "ms").met
    assert not Target("delivery", nan, 99.5, True, "%").met


def test_the_defaults_are_those_of_the_issue() -> None:
    settings = RadioSettings()
    assert (settings.nodes, settings.rate_hz, settings.tasks, settings.seconds) == (30, 10.0, 30, 60.0)


def test_what_is_not_judged_is_listed_with_the_reason(capsys: pytest.CaptureFixture[str]) -> None:
    said = figures([*SHORT, "--loss", "0.4", "--stops", "0", "--no-plain"], capsys)
    reasons = {target["name"]: target["not_judged"] for target in said["targets"]}
    assert reasons["delivery, direct"] == "loss > 0"
    assert reasons["STOP reaches everyone"] == "no STOP was raised"
    assert reasons["complete snapshots"] == ""
    assert {target["met"] for target in said["targets"] if target["not_judged"]} == {None}


def test_the_verdict_counts_what_was_judged() -> None:
    met, missed = Target("a, b", 1.0, 1.0, True, "%"), Target("c", 0.0, 1.0, True, "%")
    unjudged = Target("d", 0.0, 1.0, True, "%", "loss > 0")
    assert verdict([met]) == "all 1 judged targets met"
    assert verdict([met, unjudged]) == "all 1 judged targets met; not judged: d (loss > 0)"
    assert verdict([met, missed, missed, unjudged]) == "missed: c; c; not judged: d (loss > 0)"


def test_a_stop_that_was_latched_before_does_not_count_as_reached() -> None:
    assert stop_took_ms([5000, 7000], 4000) == 3.0
    assert math.isnan(stop_took_ms([3999, 7000], 4000))
    assert math.isnan(stop_took_ms([None, 7000], 4000))


def test_a_stop_that_does_not_reach_everyone_is_a_miss_at_any_loss() -> None:
    settings = RadioSettings(nodes=2, seconds=5, stops=2, loss=0.99)
    ours = RadioRun(settings, lambda _: None).execute()
    for times_ms, missed in (((10.0, 900.0), False), ((10.0, math.nan), True), ((), False)):
        *_, stop = targets_of(settings, replace(ours, stop_ms=times_ms))
        assert stop.missed is missed
    *_, slow = targets_of(replace(settings, loss=0.3), replace(ours, stop_ms=(10.0, 900.0)))
    assert slow.missed


def test_rounds_that_are_never_told_are_missed() -> None:
    """Two stations are on for ten seconds; the second is told of no round."""
    expected = Expectation(~np.eye(2, dtype=bool), settling_us=2_000_000, round_us=100_000)
    expected.on(0, 0)
    expected.on(1, 0)
    for now_us in range(0, 12_000_001, 20_000):
        expected.update(now_us, lambda: None)
    due = expected.rounds_due(12_000_000)
    assert due.tolist() == [99, 99]
    assert (kept(np.array([120, 0]), due).mean, kept(np.array([120, 0]), due).worst) == (0.5, 0.0)
    expected.off(1)
    expected.update(12_000_000, lambda: None)
    expected.update(15_000_000, lambda: None)
    assert expected.rounds_due(15_000_000).tolist() == [129, 99]


@pytest.mark.parametrize("seed", range(20))
def test_nobody_who_died_for_good_is_booted(seed: int) -> None:
    settings = RadioSettings(nodes=6, seconds=200, deaths=4, reboots=50, script=True, seed=seed)
    faults = faults_of(settings, 0, 200_000_000)
    last = {station: fault.kind for fault in faults if fault.kind != "part" for station in fault.stations}
    assert sum(kind == "kill" for kind in last.values()) == 4


def test_faults_after_the_end_are_not_counted(capsys: pytest.CaptureFixture[str]) -> None:
    assert figures([*SHORT, "--seconds", "6", "--faults", "--no-plain"], capsys)["ours"]["faults"] == 1


def test_a_channel_of_long_rounds_meets_its_targets(capsys: pytest.CaptureFixture[str]) -> None:
    said = figures(["radio", "--rate", "1", "--seconds", "10", "--no-plain", "--json"], capsys)
    assert said["ours"]["complete"] == 1.0
    assert max(said["ours"]["agreement_us"]) < 1000
    (time,) = (target for target in said["targets"] if target["name"] == "fleet time, widest difference")
    assert time["not_judged"] == "rounds longer than 0.5 s"


def test_nothing_is_cut_on_a_narrow_terminal_and_nothing_is_nan(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "60")
    assert main([*SHORT[:-1], "--hidden", "1"]) == 2
    said = capsys.readouterr().out
    assert "\u2026" not in said
    assert "nan" not in said
    assert max(map(len, said.splitlines())) <= 60
    assert "random jitter" in said
    assert "not judged" in said
    assert "The two others" in said.replace("\n", " ")
