"""hippomat-sim's command line: bad input is one clear line and exit code 1, never 2."""

from __future__ import annotations

from pathlib import Path

import pytest

from hippomat_core.config import Config, parse_config
from hippomat_sim.cli import main
from hippomat_sim.daemons import DaemonOrder
from hippomat_sim.maps import find_demo_map
from hippomat_sim.run_settings import RunSettings, config_toml, run_config

MAP = str(find_demo_map())


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (["run", "--map", "nowhere.yaml"], "nowhere.yaml"),
        (["run", "--map", __file__], "test_sim_cli.py"),
        (["run", "--map", MAP, "--robots", "0"], "--robots 0 is outside 1 .. 64"),
        (["run", "--map", MAP, "--tasks", "81"], "--tasks 81 is outside 1 .. 80"),
        (["run", "--map", MAP, "--loss", "1.5"], "--loss 1.5 is outside 0.0 .. 1.0"),
        (["run", "--map", MAP, "--seconds", "nan"], "--seconds nan is outside"),
        (["run", "--map", MAP, "--speed", "99"], "--speed 99.0 is outside"),
        (["run", "--map", MAP, "--carry", "5:1:200,1.5,0"], "200,1.5 is no free place of the map"),
        (["run", "--map", MAP, "--carry", "90:1:1,1,0"], "not before the end of the run at 60 s"),
        (["run", "--map", MAP, "--config", "nowhere.toml"], "nowhere.toml: cannot be read"),
        (["run", "--map", MAP, "--robots", "64"], "robots of radius 0.12 m, 64 were asked for"),
    ],
)
def test_bad_input_is_one_line_and_exit_code_1(
    arguments: list[str], complaint: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([*arguments, "--out", str(tmp_path / "out")]) == 1
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err.startswith("hippomat-sim: ")
    assert complaint in said.err
    assert said.err.count("\n") == 1
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("arguments", [[], ["run"], ["fly"], ["run", "--map", MAP, "--robots", "five"]])
def test_wrong_usage_exits_with_1(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(arguments)
    assert ended.value.code == 1
    assert "--help" in capsys.readouterr().err


def test_a_directory_that_holds_something_is_not_overwritten(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "precious").touch()
    assert main(["run", "--map", MAP, "--out", str(tmp_path)]) == 1
    assert "is not an empty directory" in capsys.readouterr().err


def test_the_written_configuration_reads_back_equal(tmp_path: Path) -> None:
    base = tmp_path / "base.toml"
    base.write_text('[fleet]\nturnover = "on_completion"\n[limits]\naccel_mps2 = 0.3\n')
    settings = RunSettings(Path(MAP), tmp_path, robots=3, tasks=7, seed=9, speed_mps=0.3, config=base)
    config = run_config(settings)
    assert parse_config(config_toml(config)) == config
    assert (config.fleet.size, config.fleet.task_slots, config.fleet.seed) == (3, 7, 9)
    assert (config.fleet.turnover, config.limits.accel_mps2) == ("on_completion", 0.3)
    assert config.limits.speed_mps == 0.3
    assert config.lidar == Config().lidar


def test_a_daemon_is_told_everything_on_its_command_line() -> None:
    order = DaemonOrder(2, Path("p"), Path("c.toml"), Path("m.yaml"), (-1.0, 0.5, -0.25), Path("logs"))
    said = " ".join(order.command()[1:])
    assert said == (
        "-m hippomat_host --port p/radio2 --base p/base2 --lidar p/lidar2 --config c.toml --map m.yaml "
        "--robot 2 --start=-1.0000,0.5000,-0.2500 --log logs"
    )
