"""A short run of the core, recorded as the daemon does: bytes, the events in them, effects, bytes again."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from radio_samples import hello_of_robot, reply_of

from hippomat_core import messages as m
from hippomat_core.config import Config, FleetConfig, RobotConfig, SlamConfig
from hippomat_core.step import initial_state, step
from hippomat_core.wire import codec, frames, jetbot_base, link, rplidar
from hippomat_core.wire.device_commands import command_of
from hippomat_core.wire.device_events import decoder_for
from hippomat_logs.manifest import run_manifest
from hippomat_logs.recorder import Recorder

CONFIG = Config(
    fleet=FleetConfig(size=3, task_slots=4, allocator="hungarian"),
    robot=RobotConfig(id=0, start_x_m=1.0, start_y_m=1.0, start_known=True),
    slam=SlamConfig(mode="odometry"),
)
WALL_NS, START_NS = 1_700_000_000_000_000_000, 5_000_000_000


def room() -> m.MapReceived:
    """5 m by 5 m, walls around."""
    cells = np.zeros((100, 100), np.int8)
    cells[:2], cells[-2:], cells[:, :2], cells[:, -2:] = 100, 100, 100, 100
    return m.MapReceived(START_NS, 1, 100, 100, 0.05, 0.0, 0.0, cells.ravel())


class RecordedRun:
    """Feeds the core and a recorder alike, as one daemon would."""

    def __init__(
        self,
        directory: Path,
        config: Config = CONFIG,
        policy: bytes | None = None,
        recorded_policy: bytes | None = None,
        **options: Any,
    ) -> None:
        manifest = run_manifest(config, session_id="0000abcd", policy=policy)
        self.recorder = Recorder(
            directory,
            manifest,
            config=config,
            wall_ns=WALL_NS,
            stamp_ns=START_NS,
            lossless=True,
            policy=recorded_policy if recorded_policy is not None else policy or b"",
            **options,
        )
        self._state = initial_state(config, policy)
        self._decoders = {port: decoder_for(port) for port in range(3)}
        self.decisions = 0

    def event(self, event: m.Event) -> None:
        self.recorder.put(event.stamp_ns, event)
        self._state, effects = step(self._state, event)
        for effect in effects:
            self.recorder.put(event.stamp_ns, effect)
            self.decisions += isinstance(effect, m.RoundDecided)
            self._write(event.stamp_ns, effect)

    def _write(self, stamp_ns: int, effect: m.Effect) -> None:
        command = command_of(effect)
        if command is not None:
            port, data = command
            self.recorder.serial(stamp_ns, port, 1, 1, data)

    def read(self, stamp_ns: int, port: int, data: bytes) -> None:
        self.recorder.serial(stamp_ns, port, 0, 1, data)
        for event in self._decoders[port].events(stamp_ns, data):
            self.event(event)

    def identify(self, stamp_ns: int) -> None:
        """What the three devices said of themselves."""
        hello = link.encode_message(hello_of_robot(CONFIG.robot.id))
        reply = reply_of(boot_id=77, robot=CONFIG.robot.id)
        info = rplidar.encode_info(rplidar.Info(24, 29, 1, 7, bytes(16)))
        self.recorder.serial(stamp_ns, m.RADIO, 1, 0, hello)
        self.recorder.serial(stamp_ns, m.RADIO, 0, 0, link.encode_message(reply))
        self.recorder.serial(stamp_ns, m.BASE, 0, 0, jetbot_base.encode_feedback(jetbot_base.Feedback()))
        self.recorder.serial(stamp_ns, m.LIDAR, 1, 0, rplidar.request(rplidar.GET_INFO))
        self.recorder.serial(stamp_ns, m.LIDAR, 0, 0, info)


def record_run(directory: Path, ticks: int = 40, close: bool = True, **options: Any) -> RecordedRun:
    """`ticks` * 50 ms: a robot in a room hears one peer in its radio's rounds; the same every time."""
    run = RecordedRun(directory, **options)
    run.identify(START_NS)
    run.event(m.Started(START_NS))
    run.event(room())
    for port in range(3):
        run.event(m.PortOpened(START_NS, port, m.PORT_NAMES[port]))
    sweep = sweep_bytes()
    for k in range(ticks):
        stamp_ns = START_NS + k * 50_000_000
        forward = jetbot_base.Feedback(delta_x_mm=3, odom_x_mm=3 * k % 30000, wheels=(5, 5, 5, 5))
        run.read(stamp_ns, m.BASE, jetbot_base.encode_feedback(forward))
        if k % 2 == 0:
            run.read(stamp_ns + 5_000_000, m.RADIO, peer_bytes(k))
        half = len(sweep) // 2
        run.read(stamp_ns + 6_000_000, m.LIDAR, sweep[:half] if k % 2 == 0 else sweep[half:])
        run.event(m.Tick(stamp_ns + 10_000_000))
        run.recorder.timing(stamp_ns + 10_000_000, 900_000, 1000)
    if close:
        run.recorder.close()
    return run


def recorded_log(directory: Path, ticks: int = 40) -> Path:
    """The one file of such a run."""
    record_run(directory, ticks)
    (path,) = directory.glob("*.mcap")
    return path


def sweep_bytes() -> bytes:
    start = np.zeros(90, np.bool_)
    start[0] = True
    angle = np.arange(90, dtype=np.uint16) * 256
    return rplidar.encode_samples(np.full(90, 20, np.uint8), angle, np.full(90, 4 * 1500, np.uint16), start)


def peer_bytes(k: int) -> bytes:
    """A round of the radio: a peer's STATE and RELAY, and the end."""
    none = frames.AirClaim(frames.NO_SLOT, 0, 0, 0, False, 0, 0, 0, 0, 0)
    blank = np.zeros(4, np.uint8)
    state = frames.StateFrame(
        frames.IDLE, frames.FLAG_LOCALIZED, 300, 300, 0, 0, 0, none, blank + 9, blank, 60, 60, 0,
        blank[:0], 1, blank[:3], 1, 1, 0,
    )  # fmt: skip
    at_us = 50_000 * k
    header = frames.Header(frames.STATE, False, CONFIG.fleet.id, 1, 9, 2 * k + 1, at_us)
    third = frames.RelayRow(2, 0, frames.IDLE, frames.NO_SLOT, 0, 0, False, 0, True, False, 0, 0, 0, 0, blank)
    relay = frames.RelayFrame(3, 0b110, (third,))
    passing = frames.Header(frames.RELAY, False, CONFIG.fleet.id, 1, 9, 2 * k + 2, at_us)
    heard = [codec.encode_frame(header, state), codec.encode_frame(passing, relay)]
    messages: list[link.LinkMessage] = [link.Heard(at_us, at_us, -50, frame) for frame in heard]
    messages.append(link.Round(k // 2, at_us, at_us, 0b110, True))
    return b"".join(link.encode_message(message) for message in messages)
