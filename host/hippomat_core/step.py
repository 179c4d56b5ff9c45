"""The robot core's only door: step(state, event) -> (state, effects).

Decides where each event goes; what happens when a round ends is in allocation_round.py, when time passes in
tick.py. Reads no clock, port or file and
draws no random number: the same events give the same effects, which is what replay checks.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from hippomat_core.allocation_round import round_ended
from hippomat_core.control.guard import carried_along, hidden_points, is_whole, scan_points
from hippomat_core.control.nav_state import STANDING
from hippomat_core.control.navigator import forget_path
from hippomat_core.errors import HippomatError
from hippomat_core.fleet import state as fleet_state
from hippomat_core.fleet.digest import fleet_digest
from hippomat_core.fleet.hearing import heard_relay, heard_state, heard_tasks
from hippomat_core.fleet.radio_health import judged
from hippomat_core.fleet.state import FleetState
from hippomat_core.localization import on_loops_closed, on_map, on_sweep
from hippomat_core.maps.occupancy_grid import OccupancyGrid
from hippomat_core.messages import (
    BASE,
    INFO,
    LIDAR,
    PORT_NAMES,
    RADIO,
    ROS,
    WARNING,
    AlarmRaised,
    BaseFeedback,
    Effect,
    Event,
    FrameSent,
    LaserScanReceived,
    LinkNoise,
    LoopsClosed,
    MapReceived,
    OdometryReceived,
    PortLost,
    PortOpened,
    RadioStatus,
    RelayHeard,
    RoundEnded,
    ScanReceived,
    Started,
    StateHeard,
    StopHeard,
    TasksHeard,
    Tick,
    TransformReceived,
)
from hippomat_core.planning.field_cache import Fields
from hippomat_core.planning.ground import Ground, ground_of
from hippomat_core.planning.map_change import path_holds
from hippomat_core.replaced import replace
from hippomat_core.ros.intake import laser_scan, odometry_received, ros_lost, ros_opened, transform
from hippomat_core.slam.odometry import moved
from hippomat_core.state import Scan, State, initial_state, merged_stop
from hippomat_core.tick import tick
from hippomat_core.wire.frames import STOP

__all__ = ["State", "initial_state", "step"]

JOINING_BYTES = 64  # a device that is sending already is joined in the middle of a frame

Effects = tuple[Effect, ...]
Stepped = tuple[State, Effects]


def step(state: State, event: Event) -> Stepped:
    """What one event changes and causes. Raises ConfigError or MapError for a map the robot cannot use."""
    return _HANDLERS[type(event)](state, event)


def _started(state: State, event: Started) -> Stepped:
    fleet = fleet_state.started(state.fleet, event.stamp_ns)
    return replace(state, started_ns=event.stamp_ns, fleet=fleet), ()


def _map_received(state: State, event: MapReceived) -> Stepped:
    if not state.config.ros.maps:
        return _with_map(state, event)
    try:  # it came while the robot runs: what cannot be used is refused, and the map before it holds
        return _with_map(state, event)
    except HippomatError as error:
        return state, (AlarmRaised(WARNING, "map_refused", f"the map from ROS is not used: {error}"),)


def _with_map(state: State, event: MapReceived) -> Stepped:
    cells = event.cells.reshape(event.height, event.width)
    grid = OccupancyGrid(cells, event.resolution_m, event.origin_x_m, event.origin_y_m)
    ground = ground_of(grid, event.epoch, state.config)
    sites = ground.sites.tobytes() if state.fleet.tasks.continuous else b""
    weights = b"" if state.config.fleet.policy_per_robot else state.policy_hash
    planner = state.config.planning.planner.encode()
    digest = fleet_digest(state.config.fleet, ground.c_max_s, grid.hash() + sites + planner, weights)
    fleet, effects = fleet_state.with_map(state.fleet, event.stamp_ns, ground.sites, digest)
    state = replace(_with_ground(state, ground), fleet=fleet)
    return on_map(state, ground, event.stamp_ns), tuple(effects)


def _with_ground(state: State, ground: Ground) -> State:
    """What was planned on the old map and holds on the new one is kept: fields, and the path being driven.

    A way that the new map opens is found when the next path is planned.
    """
    old, fields, navigator, outcome = state.ground, Fields({}), forget_path(state.navigator), None
    if old is not None and ground.costmap.grid.lies_as(old.costmap.grid):
        fields = state.fields.with_space(old.costmap.graph, ground.costmap.graph)
        path = state.navigator.path
        if path is not None and path_holds(ground.costmap.graph, path):
            navigator, outcome = state.navigator, state.outcome
    return replace(state, ground=ground, fields=fields, navigator=navigator, outcome=outcome)


def _port_opened(state: State, event: PortOpened) -> Stepped:
    if event.port == ROS:
        return ros_opened(state), ()
    state = _with_port(state, event.port, True)
    if event.port == RADIO:
        fleet = replace(state.fleet, clock=state.fleet.clock.new_radio())
        return replace(state, radio_heard_ns=event.stamp_ns, fleet=fleet), ()
    if event.port == BASE:  # its counters may have started anew
        return replace(state, odometry=replace(state.odometry, last=None)), ()
    return state, ()


def _port_lost(state: State, event: PortLost) -> Stepped:
    if event.port == ROS:
        return ros_lost(state), ()
    state = _with_port(state, event.port, False)
    if event.port == BASE:  # the motor guard stops it: whoever comes back starts from standing
        standing = replace(state.navigator, drive=STANDING)
        return replace(state, navigator=standing, outcome=None, held=False), ()
    return (replace(state, scan=None) if event.port == LIDAR else state), ()


def _with_port(state: State, port: int, is_open: bool) -> State:
    ports = tuple(is_open if index == port else was for index, was in enumerate(state.ports))
    return replace(state, ports=(ports[RADIO], ports[BASE], ports[LIDAR]))


def _base_feedback(state: State, event: BaseFeedback) -> Stepped:
    odometry = moved(state.odometry, event)
    if odometry.jumps == state.odometry.jumps:
        return replace(state, odometry=odometry), ()
    text = "the base's odometry jumped, as after a restart of the base: the pose goes on from where it was"
    return replace(state, odometry=odometry), (AlarmRaised(WARNING, "odometry_jump", text),)


def _scan_received(state: State, event: ScanReceived) -> Stepped:
    state = replace(state, sweeps=state.sweeps.after(event.stamp_ns, max(len(event.angle_q6), 1)))
    if not is_whole(event):
        return state, ()
    lidar, last = state.config.lidar, state.scan
    points = scan_points(event, lidar)
    if last is not None:
        before = carried_along(last.points, last.pose, state.steady_pose)
        points = np.concatenate([hidden_points(before, lidar), points])
    state = replace(state, scan=Scan(event.stamp_ns, points, state.steady_pose))
    effects: list[Effect] = []
    state = on_sweep(state, event, effects)
    return state, tuple(effects)


def _awake(state: State, event: StateHeard | RelayHeard | TasksHeard) -> FleetState:
    return fleet_state.awake(state.fleet, event.stamp_ns, event.radio_time_us)


def _state_heard(state: State, event: StateHeard) -> Stepped:
    fleet, effects = heard_state(
        _awake(state, event), event.stamp_ns, event.header, event.frame, event.rssi_dbm
    )
    sender = event.header.sender
    peer = fleet.peers[sender] if sender < len(fleet.peers) else None
    stop = merged_stop(state.stop, event.header, event.frame, peer is not None and peer.agrees)
    return replace(state, fleet=fleet, stop=stop), tuple(effects)


def _relay_heard(state: State, event: RelayHeard) -> Stepped:
    fleet, effects = heard_relay(
        _awake(state, event), event.stamp_ns, event.header, event.frame, event.rssi_dbm
    )
    return replace(state, fleet=fleet), tuple(effects)


def _tasks_heard(state: State, event: TasksHeard) -> Stepped:
    fleet, effects = heard_tasks(_awake(state, event), event.stamp_ns, event.header, event.frame)
    return replace(state, fleet=fleet), tuple(effects)


def _stop_heard(state: State, event: StopHeard) -> Stepped:
    stop, counter = state.stop, event.frame.counter
    stopped = event.header.kind == STOP
    stop = stop.raised(counter, event.header.sealed) if stopped else stop.lifted(counter)
    return replace(state, stop=stop), ()


def _radio_status(state: State, event: RadioStatus) -> Stepped:
    last = state.radio.status
    radio, effects = judged(state.radio, event, state.config)
    fleet = fleet_state.muted(state.fleet, event.stamp_ns, radio.muted(state.config))
    if last is not None and last.boot_id != event.boot_id:
        fleet = replace(fleet, clock=fleet.clock.new_radio())
        text = f"our radio restarted (reset reason {event.reset_reason}, boot id {event.boot_id:08x})"
        effects.insert(0, AlarmRaised(WARNING, "radio_restarted", text))
    stop = state.stop.merged(event.stop_counter, event.stop_resumed, not radio.is_open)
    state = replace(state, radio=radio, radio_heard_ns=event.stamp_ns, fleet=fleet, stop=stop)
    return state, tuple(effects)


def _link_noise(state: State, event: LinkNoise) -> Stepped:
    joined = event.skipped_bytes <= JOINING_BYTES and event.bad_checksums <= 1
    if "noise" in state.alarms or joined:
        return state, ()
    name = PORT_NAMES[event.port]
    text = f"{name}: {event.skipped_bytes} bytes were no frame, {event.bad_checksums} bad checksums"
    alarm = AlarmRaised(INFO, "noise", text)
    return replace(state, alarms=state.alarms | {"noise"}), (alarm,)


def _nothing(state: State, _: FrameSent) -> Stepped:
    return state, ()


_HANDLERS: dict[type, Callable[[State, Any], Stepped]] = {
    Started: _started,
    MapReceived: _map_received,
    Tick: tick,
    PortOpened: _port_opened,
    PortLost: _port_lost,
    BaseFeedback: _base_feedback,
    ScanReceived: _scan_received,
    StateHeard: _state_heard,
    RelayHeard: _relay_heard,
    TasksHeard: _tasks_heard,
    StopHeard: _stop_heard,
    FrameSent: _nothing,
    RadioStatus: _radio_status,
    RoundEnded: round_ended,
    LinkNoise: _link_noise,
    LoopsClosed: on_loops_closed,
    TransformReceived: transform,
    LaserScanReceived: laser_scan,
    OdometryReceived: odometry_received,
}
