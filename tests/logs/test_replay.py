"""hippomat-replay finds what it must find, names it, and answers with the right exit code."""

from __future__ import annotations

import dataclasses
import json
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import pytest
from mcap.reader import make_reader
from mcap.writer import Writer
from recorded_run import recorded_log

from hippomat_core import messages as m
from hippomat_core.config import Config, config_from_dict, parse_config
from hippomat_core.errors import HippomatError
from hippomat_core.state import State
from hippomat_core.step import step
from hippomat_logs import level2
from hippomat_logs.daemon_process import to_toml
from hippomat_logs.level2 import EffectComparison
from hippomat_logs.reader import open_runs
from hippomat_logs.replay import ReplayOptions, replay_run
from hippomat_logs.replay_cli import main
from hippomat_logs.schema import CLASSES, TOPICS, MessageStore

STORE = MessageStore()
GOLDEN = Path(__file__).parent.parent / "golden" / "runs"
QUICK = ["--levels", "L0,L1,L2", "--json"]


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return recorded_log(tmp_path_factory.mktemp("log"), ticks=40)


def quick_report(path: Path) -> Any:
    (run,) = open_runs([path])
    return replay_run(run, ReplayOptions(levels=("L0", "L1", "L2")))


def rewrite(source: Path, target: Path, change: Callable[[int, Any], Any]) -> None:
    """The same log with valid checksums and other contents, as any MCAP tool could write it."""
    with source.open("rb") as old, target.open("wb") as new:
        reader = make_reader(old, validate_crcs=True)
        writer: Any = Writer(new, enable_data_crcs=True)
        metadata = list(reader.iter_metadata())
        writer.start(profile="ros2")
        writer.add_metadata(metadata[0].name, metadata[0].metadata)
        schemas: dict[int, int] = {}
        channels: dict[int, int] = {}
        summary = reader.get_summary()
        assert summary is not None
        for schema in summary.schemas.values():
            schemas[schema.id] = writer.register_schema(schema.name, schema.encoding, schema.data)
        for channel in summary.channels.values():
            channels[channel.id] = writer.register_channel(
                channel.topic, channel.message_encoding, schemas[channel.schema_id], channel.metadata
            )
        by_topic = {channel.topic: channels[channel.id] for channel in summary.channels.values()}
        for _, channel, message in reader.iter_messages(log_time_order=False):
            kind = CLASSES.get(channel.topic)
            data = message.data
            if kind is not None:
                changed = change(message.sequence, STORE.decode(kind, data))
                if changed is None:
                    continue
                data, target_id = STORE.encode(changed), by_topic[TOPICS[type(changed)]]
            else:
                target_id = channels[channel.id]
            writer.add_message(target_id, message.log_time, data, message.publish_time, message.sequence)
        for extra in metadata[1:]:
            writer.add_metadata(extra.name, extra.metadata)
        writer.finish()


def test_a_whole_run_is_reproduced_bit_for_bit(log: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([str(log), *QUICK]) == 0
    (report,) = json.loads(capsys.readouterr().out)
    assert report["verdict"] == "reproduced L0 L1 L2"
    by_level = {result["level"]: result for result in report["results"]}
    assert by_level["L2"]["compared"] == 20
    assert "bit-equal" in by_level["L2"]["detail"]


def test_the_real_daemon_on_fake_ports_decides_as_recorded(log: Path) -> None:
    (run,) = open_runs([log])
    report = replay_run(run, ReplayOptions(levels=("L0", "daemon")))
    assert report.verdict == "reproduced L0 daemon", report.results
    assert report.results[-1].compared == 20


def test_one_changed_cost_diverges_and_names_robot_tick_and_field(
    log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    decided = 0

    def change(_: int, message: Any) -> Any:
        nonlocal decided
        if isinstance(message, m.RoundDecided):
            decided += 1
            if decided == 7:
                costs = np.array(message.costs)
                costs[2] ^= 1
                return dataclasses.replace(message, costs=costs)
        return message

    rewrite(log, tmp_path / "changed.mcap", change)
    assert main([str(tmp_path / "changed.mcap"), "--levels", "L0,L1,L2"]) == 2
    out = " ".join(capsys.readouterr().out.split())
    assert "robot 0, tick 12 (record" in out
    assert "RoundDecided.costs[2]: recorded" in out


def test_a_changed_event_diverges_from_its_bytes(log: Path, tmp_path: Path) -> None:
    changed = False

    def change(_: int, message: Any) -> Any:
        nonlocal changed
        if isinstance(message, m.StateHeard) and not changed:
            changed = True
            return dataclasses.replace(message, rssi_dbm=message.rssi_dbm - 1)
        return message

    rewrite(log, tmp_path / "changed.mcap", change)
    report = quick_report(tmp_path / "changed.mcap")
    assert report.exit_code == 2
    assert report.results[1].divergence.field == "StateHeard.rssi_dbm"


@pytest.mark.parametrize("what", [m.RoundDecided, m.PoseEstimated])
def test_a_missing_effect_diverges(log: Path, tmp_path: Path, what: type) -> None:
    left_out: list[int] = []

    def change(number: int, message: Any) -> Any:
        if isinstance(message, what) and not left_out:
            left_out.append(number)
            return m.AlarmCleared("nothing")
        return message

    rewrite(log, tmp_path / "changed.mcap", change)
    report = quick_report(tmp_path / "changed.mcap")
    assert report.exit_code == 2
    assert report.results[2].divergence.record == left_out[0]


def test_serial_bytes_changed_with_valid_file_checksums_are_damage(log: Path, tmp_path: Path) -> None:
    def change(number: int, message: Any) -> Any:
        if number == 40 and hasattr(message, "data"):
            return dataclasses.replace(message, data=message.data[:-1] + b"\x55")
        return message

    first_serial = next(
        r.number
        for r in open_runs([log])[0].records_in_order()
        if r.topic == "/hippo/serial" and r.number > 30
    )
    rewrite(log, tmp_path / "x.mcap", lambda n, message: change(40 if n == first_serial else 0, message))
    for levels in ("L0,L1,L2", "L0,L2", "L0"):  # read by different ways
        assert main([str(tmp_path / "x.mcap"), "--levels", levels, "--json"]) == 3


def test_a_missing_record_is_damage(log: Path, tmp_path: Path) -> None:
    rewrite(log, tmp_path / "gap.mcap", lambda number, message: None if number == 100 else message)
    report = quick_report(tmp_path / "gap.mcap")
    assert report.exit_code == 3
    assert "record 100 is missing" in report.results[0].detail


def test_any_flipped_byte_is_damage(log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    whole = log.read_bytes()
    rng = np.random.default_rng(5)
    ends = [*range(12), *range(len(whole) - 60, len(whole), 3)]
    offsets = sorted({*ends, *rng.integers(0, len(whole), 130).tolist()})
    assert len(offsets) >= 150
    path = tmp_path / "flipped.mcap"
    for offset in offsets:
        broken = bytearray(whole)
        broken[offset] ^= 1 << int(rng.integers(0, 8))
        path.write_bytes(broken)
        assert main([str(path), *QUICK]) == 3, f"byte {offset} of {len(whole)}"
    capsys.readouterr()


def test_any_cut_is_damage(log: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    whole = log.read_bytes()
    for length in (0, 4, 8, 100, len(whole) // 2, len(whole) - 1):
        (tmp_path / "cut.mcap").write_bytes(whole[:length])
        assert main([str(tmp_path / "cut.mcap"), *QUICK]) == 3
    (tmp_path / "long.mcap").write_bytes(whole + b"\0")
    assert main([str(tmp_path / "long.mcap"), *QUICK]) == 3
    capsys.readouterr()


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ([], "RUN.mcap"),
        (["x.mcap", "--bogus"], "bogus"),
        (
            ["x.mcap", "--levels", "L9"],
            "there is no L9; the levels are L0, L1, L2, daemon, L3, and L4, which",
        ),
        (["x.mcap", "--levels", "L0,L4"], "L4 is of a fleet, not of one log: --closed-loop runs it"),
        (["x.mcap", "--levels", "L0,L4,L7"], "there is no L7; the levels are"),
        (["x.mcap", "--levels", ""], "there is no empty name"),
        (["x.mcap", "--sim", "--levels", "L1"], "--sim and --levels: choose one"),
        (["x.mcap", "--plots", "out", "--levels", "L2"], "--plots out: only L3 and --closed-loop draw"),
        (["/no/such/log.mcap"], "/no/such/log.mcap: no such file"),
    ],
)
def test_a_usage_error_is_exit_code_1(
    arguments: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    try:
        code: Any = main(arguments)
    except SystemExit as error:
        code = error.code
    captured = capsys.readouterr()
    assert code == 1
    assert said in captured.out + captured.err


def test_a_log_still_being_recorded_is_told_apart(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "a.mcap.active").write_bytes(b"x")
    assert main([str(tmp_path / "a.mcap.active")]) == 3
    assert "hippomat-logs recover" in capsys.readouterr().err


def test_nothing_compared_is_a_failure(log: Path, tmp_path: Path) -> None:
    """A log with its decisions cut away and renumbered must not pass as reproduced."""
    number = 0

    def rounds_and_ticks_out(_: int, message: Any) -> Any:
        nonlocal number
        number += 1
        return message if number < 4 else None

    rewrite(log, tmp_path / "short.mcap", rounds_and_ticks_out)
    assert quick_report(tmp_path / "short.mcap").exit_code == 3  # the end mark tells


def test_another_machine_may_differ_in_the_last_bits_and_at_near_ties_only() -> None:
    exact, tolerant = EffectComparison(STORE, True), EffectComparison(STORE, False)
    drive, other = m.Drive(0.1, 0.2, "follow"), m.Drive(0.1 + 1e-9, 0.2, "follow")
    assert exact.first_difference(drive, other) is not None
    assert tolerant.first_difference(drive, other) is None
    assert tolerant.first_difference(drive, m.Drive(0.11, 0.2, "follow")) is not None
    sure, tie = decided([3.0, 1.0], 0), decided([3.0, 3.00005], 1)
    assert tolerant.first_difference(sure, dataclasses.replace(sure, action=1)) is not None
    assert tolerant.first_difference(tie, dataclasses.replace(tie, action=0)) is None
    assert tolerant.near_ties == 1
    idle = dataclasses.replace(tie, action=0, reason="none is worth it")
    assert tolerant.first_difference(tie, idle) is None


@pytest.mark.parametrize("action", [-1, 2, 3])
def test_a_near_tie_of_two_actions_excuses_no_third(action: int) -> None:
    tie = decided([3.0, 3.00005, -1e30], 1)
    said = EffectComparison(STORE, False).first_difference(tie, dataclasses.replace(tie, action=action))
    assert said == ("RoundDecided.action", 1, action)


def test_a_core_whose_effect_no_log_can_hold_diverges_and_names_the_field(
    log: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def too_large(state: State, event: m.Event) -> tuple[State, tuple[m.Effect, ...]]:
        state, effects = step(state, event)
        return state, tuple(
            dataclasses.replace(effect, action=2**40) if isinstance(effect, m.RoundDecided) else effect
            for effect in effects
        )

    monkeypatch.setattr(level2, "step", too_large)
    report = quick_report(log)
    (divergence,) = [result.divergence for result in report.results if result.divergence]
    assert (report.exit_code, divergence.level) == (2, "L2")
    assert (divergence.field, divergence.replayed) == ("RoundDecided.action", 2**40)


def decided(logits: list[float], action: int) -> m.RoundDecided:
    none = np.zeros(1, np.uint8)
    wide = np.zeros(1, np.uint32)
    return m.RoundDecided(
        1, "x", wide, wide, none.astype(np.uint16), none.astype(np.int8), none, none, none, none, none,
        none.astype(np.uint16), none, np.array(logits, np.float32), action, "requested",
    )  # fmt: skip


def test_the_configuration_survives_as_toml() -> None:
    config = config_from_dict({"fleet": {"policy": 'a "b"\\c'}, "robot": {"id": 3, "start_x_m": -1e-7}})
    assert parse_config(to_toml(config)) == config
    assert parse_config(to_toml(Config())) == Config()
    outline = parse_config("[robot]\nfootprint = [[0.1, 0.0], [-0.1, 0.05], [-0.1, -0.05]]\n")
    assert parse_config(to_toml(outline)) == outline


def test_ctrl_c_ends_a_replay_with_one_line_and_leaves_nobody_behind(log: Path) -> None:
    start = "import sys; from hippomat_logs.entry import replay; sys.exit(replay())"
    process = subprocess.Popen([sys.executable, "-c", start, str(log)], stderr=subprocess.PIPE, text=True)
    until_s = time.monotonic() + 30.0
    while len(workers := psutil.Process(process.pid).children()) < 2 and time.monotonic() < until_s:
        time.sleep(0.01)  # the worker and multiprocessing's tracker: the replay is under way
    process.send_signal(signal.SIGINT)
    _, said = process.communicate(timeout=20)
    assert (process.returncode, said) == (1, "hippomat-replay: interrupted\n")
    assert not psutil.wait_procs(workers, timeout=5.0)[1]


def test_runs_of_one_robot_are_told_apart_and_fit_80_columns(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    logs = [GOLDEN / name for name in ("one_slam/robot00", "three_wheels/robot00", "three_wheels/robot01")]
    assert main([*(f"{path}.mcap" for path in logs), "--levels", "L0,L1,L2"]) == 0
    out = capsys.readouterr().out
    assert all(len(line) <= 80 for line in out.splitlines())
    for robot, name in ((0, "one_slam/robot00"), (0, "three_wheels/robot00"), (1, "robot01")):
        assert f"robot {robot}: {name}\n" in out
        assert f"{name}: reproduced L0 L1 L2\n" in out
    assert len([line for line in out.splitlines() if line.strip()]) == 3 + 9 + 3  # no level has a second line


def test_a_copy_of_a_log_counts_once_and_another_version_of_it_is_refused(log: Path, tmp_path: Path) -> None:
    copy = tmp_path / "copy.mcap"
    copy.write_bytes(log.read_bytes())
    (run,) = open_runs([log, copy])
    assert len(run.paths) == 1
    assert (
        quick_report(log).results[0].compared == replay_run(run, ReplayOptions(("L0",))).results[0].compared
    )
    copy.unlink()
    rewrite(log, copy, lambda _, message: message)
    with pytest.raises(HippomatError, match="are the same part of one run, and differ: give one of them"):
        open_runs([log, copy])
