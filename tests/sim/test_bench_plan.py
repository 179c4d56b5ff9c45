"""hippomat-bench plan: scenarios as published, judged, and what it says of files that are none."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from recorded_data import data_folder

from hippomat_core.errors import MapError
from hippomat_core.planning.graph import cell_plane
from hippomat_sim.bench import plan_peers
from hippomat_sim.bench.cli import main
from hippomat_sim.bench.plan_matrix import run_matrix
from hippomat_sim.bench.plan_plain import plain_path
from hippomat_sim.bench.plan_run import PLAIN, run_file, sampled
from hippomat_sim.maps.movingai import Query, load_map, load_scenario

MAP = "type octile\nheight 3\nwidth 4\nmap\n....\n.@T.\n.G.S\n"
SCEN = "version 1\n0\troom.map\t4\t3\t0\t0\t3\t0\t3.0\n0\troom.map\t4\t3\t0\t1\t3\t1\t5.0\n"


def nothing(_what: str, _done: int, _of: int) -> None:
    """No bar."""


@pytest.fixture
def room(tmp_path: Path) -> Path:
    (tmp_path / "room.map").write_text(MAP)
    (tmp_path / "room.map.scen").write_text(SCEN)
    return tmp_path / "room.map.scen"


@pytest.mark.parametrize("name", ["arena", "den011d", "AR0011SR"])
def test_published_lengths_are_matched_by_feasible_paths(name: str) -> None:
    scenario = load_scenario(data_folder() / "movingai" / f"{name}.map.scen")
    result = run_file(scenario, [], 3, nothing)
    assert result.ours.queries == len(scenario.queries) >= 130
    assert (result.ours.wrong, result.ours.infeasible) == (0, 0)
    plain = result.others[0]
    assert (plain.planner, plain.wrong, plain.infeasible) == (PLAIN, 0, 0)


def test_peers_that_cut_corners_are_found_out_and_scipy_is_exact() -> None:
    pytest.importorskip("pyastar2d")
    pytest.importorskip("tcod")
    scenario = load_scenario(data_folder() / "movingai" / "den011d.map.scen")
    result = run_file(scenario, ["pyastar2d", "tcod", "scipy"], 12, nothing)
    by_name = {answers.planner: answers for answers in result.others}
    assert by_name["pyastar2d"].infeasible > 0
    assert by_name["tcod"].infeasible > 0
    assert (by_name["scipy"].wrong, by_name["scipy"].infeasible) == (0, -1)


def test_a_peer_that_is_not_installed_is_named(room: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def absent(_free: object) -> None:
        raise ImportError("no module named fast")

    monkeypatch.setattr(plan_peers, "peers", lambda: {"fast": plan_peers.Peer(absent)})
    monkeypatch.setattr("hippomat_sim.bench.plan_run.peers", plan_peers.peers)
    assert run_file(load_scenario(room), ["fast"], 5, nothing).missing == ["fast"]


def test_the_plain_astar_of_the_air_and_the_fields_give_equal_values() -> None:
    result = run_matrix(12, nothing)
    assert (result.pairs, result.wrong, result.infeasible, result.sampled) == (12, 0, 0, True)


def test_the_plain_astar_cuts_no_corner() -> None:
    free = np.ones((2, 2), bool)
    free[0, 1] = False
    assert plain_path(free.tolist(), (0, 0), (1, 1)) == [(0, 0), (0, 1), (1, 1)]
    assert cell_plane(free).cells.tolist() == [[0, 0], [0, 1], [1, 1]]


def test_a_sample_holds_short_and_long_queries_alike_and_is_always_the_same() -> None:
    queries = [Query(bucket, (bucket, 0), (0, 0), 4.0 * bucket, 0.5) for bucket in range(200)]
    chosen = sampled(queries, 20)
    assert len(chosen) == 20
    assert {query.bucket // 10 for query in chosen} == set(range(20))
    assert sampled(queries, 20) == chosen
    assert len(sampled(queries, 1000)) == 200


def test_a_wrong_answer_is_exit_code_2_and_json_names_it(
    room: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    room.write_text(SCEN.replace("5.0", "4.0"))
    assert main(["plan", str(room), "--peers", "none", "--json"]) == 2
    found = json.loads(capsys.readouterr().out)
    assert found["files"][0]["ours"]["wrong"] == 1
    wrong = found["targets"][0]
    assert (wrong["name"], wrong["value"], wrong["met"]) == ("wrong lengths", 1, False)


def test_a_rounded_length_is_no_wrong_one(room: Path) -> None:
    room.write_text("version 1.0\n0 my room.map 4 3 0 0 1 0 1\n0 my room.map 4 3 1 0 0 1 1.99\n")
    (room.parent / "room.map").rename(room.parent / "my room.map")
    result = run_file(load_scenario(room), [], 1, nothing)
    assert result.ours.wrong == 1  # 1.99 is not 2 to its last digit
    room.write_text("version 1.0\n0 my room.map 4 3 0 0 1 0 1\n0 my room.map 4 3 1 0 0 1 2.0\n")
    assert run_file(load_scenario(room), [], 1, nothing).ours.wrong == 0


@pytest.mark.parametrize(
    ("scen", "said"),
    [
        ("0\troom.map\t4\t3\t0\t0\t3\t0\t3\n", "expected `version 1` in line 1"),
        ("", "expected `version 1` in line 1, found ''"),
        ("version 1\n", "found 0 maps"),
        (SCEN.replace("\t4\t3\t", "\t8\t6\t"), "scaled to (8, 6), its map has (4, 3)"),
        (SCEN + "0\troom.map\t4\t3\t0\t0\t3\n", "line 4: expected bucket, map"),
        (SCEN + "0\troom.map\t4\t3\t0\t0\t1\t1\t1.4\n", "cell (1, 1) of a query is not free"),
        (SCEN + "0\troom.map\t4\t3\t0\t0\t4\t1\t1.4\n", "cell (4, 1) of a query is not free"),
        (SCEN.replace("room.map", "hall.map"), ""),
    ],
)
def test_a_scenario_that_cannot_be_used_is_one_line(
    room: Path, capsys: pytest.CaptureFixture[str], scen: str, said: str
) -> None:
    room.write_text(scen)
    if not said:  # the map of the same name beside it is the one meant
        assert len(load_scenario(room).queries) == 2
        return
    assert main(["plan", str(room)]) == 1
    line = capsys.readouterr().err
    assert said in line
    assert str(room) in line
    assert line.count("\n") == 1


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("height 3\n", "expected the lines type octile"),
        (MAP.replace("height 3", "height 9"), "fewer cells than height 9, width 4"),
        (MAP.replace("height 3", "height x"), "fewer cells than height x"),
        (MAP.replace("T", "?"), "'?' in row 1 is no terrain"),
    ],
)
def test_a_map_that_cannot_be_used_is_one_line(tmp_path: Path, text: str, said: str) -> None:
    (tmp_path / "room.map").write_text(text)
    with pytest.raises(MapError, match=r"room\.map") as refused:
        load_map(tmp_path / "room.map")
    assert said in str(refused.value)


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ([], "nothing to do"),
        (["gone.scen"], "gone.scen: cannot be read: No such file"),
        (["--matrix", "--limit", "0"], "--limit 0: at least 1"),
        (["--matrix", "--peers", "best"], "--peers 'best' is not known"),
    ],
)
def test_wrong_usage_is_one_line_and_exit_code_1(
    capsys: pytest.CaptureFixture[str], arguments: list[str], said: str
) -> None:
    assert main(["plan", *arguments]) == 1
    assert said in capsys.readouterr().err
