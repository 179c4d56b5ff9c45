"""Everything that enters or leaves the robot core, as values.

Events enter, effects leave; `step(state, event)` is the only door. Fields of events hold exactly what the
decoded bytes said (raw device integers), so that an event can be checked against the bytes it came from.
`stamp_ns` is the robot's monotonic clock at the moment the shell read the bytes; the core has no other clock.
The log derives its message definitions from these classes: adding a field adds it to the log.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

from hippomat_core.fields import (
    F64,
    I8,
    I16,
    I32,
    I64,
    U8,
    U16,
    U32,
    U64,
    F32Array,
    F64Array,
    I8Array,
    I16Array,
    I32Array,
    U8Array,
    U16Array,
    U32Array,
)
from hippomat_core.replaced import quickly_made
from hippomat_core.wire.frames import Header, RelayFrame, StateFrame, StopFrame, TasksFrame

RADIO, BASE, LIDAR, ROS = 0, 1, 2, 3  # ports; ROS is no serial one, and may stand in for base and lidar
PORT_NAMES = ("radio", "base", "lidar", "ros")
INFO, WARNING, ERROR = 0, 1, 2  # alarm levels
NEVER_HEARD_MS = 65_535  # RoundDecided.row_age_ms of a peer that was never heard; older ones say so too


# ---- events -------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Started:
    """First event of a run. The configuration itself is in the manifest and in initial_state()."""

    stamp_ns: I64


@dataclass(frozen=True, slots=True)
class MapReceived:
    """An occupancy grid (map frame: x east, y north); cells row-major from the lower left, -1/0..100."""

    stamp_ns: I64
    epoch: U32
    width: U32
    height: U32
    resolution_m: F64
    origin_x_m: F64
    origin_y_m: F64
    cells: I8Array  # (H * W,)


@dataclass(frozen=True, slots=True)
class Tick:
    """Time passes; 20 per second while the daemon runs."""

    stamp_ns: I64


@dataclass(frozen=True, slots=True)
class PortOpened:
    """A serial port was identified and is in use."""

    stamp_ns: I64
    port: U8
    device: str  # what the device said of itself


@dataclass(frozen=True, slots=True)
class PortLost:
    """A serial port went away; the shell tries to reopen it."""

    stamp_ns: I64
    port: U8
    reason: str


@dataclass(frozen=True, slots=True)
class BaseFeedback:
    """One 0x01 frame of the base, raw integers (facts: JetBot ROS AI kit, AA 55 2D)."""

    stamp_ns: I64
    gyro: I16Array  # (3,)
    accel: I16Array  # (3,)
    attitude_ddeg: I16Array  # (3,) roll, pitch, yaw in 0.1 deg
    odom_x_mm: I16
    odom_y_mm: I16
    odom_yaw_mrad: I16
    delta_x_mm: I16
    delta_y_mm: I16
    delta_yaw_mrad: I16
    wheels: I16Array  # (4,) left, right speed; left, right set-point
    reserved: U16


@dataclass(frozen=True, slots=True)
class ScanReceived:
    """One lidar sweep, raw integers, in the lidar's own frame (clockwise angles)."""

    stamp_ns: I64  # when the sweep's last bytes were read
    quality: U8Array  # (n,) 6 bits
    angle_q6: U16Array  # (n,) degrees * 64
    distance_q2: U16Array  # (n,) millimetres * 4; 0 = no return


@dataclass(frozen=True, slots=True)
class StateHeard:
    stamp_ns: I64
    radio_time_us: U64  # the receiving radio's clock
    fleet_time_us: U64  # and its fleet clock
    rssi_dbm: I8
    header: Header
    frame: StateFrame


@dataclass(frozen=True, slots=True)
class RelayHeard:
    stamp_ns: I64
    radio_time_us: U64
    fleet_time_us: U64
    rssi_dbm: I8
    header: Header
    frame: RelayFrame


@dataclass(frozen=True, slots=True)
class TasksHeard:
    stamp_ns: I64
    radio_time_us: U64
    fleet_time_us: U64
    rssi_dbm: I8
    header: Header
    frame: TasksFrame


@dataclass(frozen=True, slots=True)
class StopHeard:
    """STOP or RESUME (header.kind says which)."""

    stamp_ns: I64
    radio_time_us: U64
    fleet_time_us: U64
    rssi_dbm: I8
    header: Header
    frame: StopFrame


@dataclass(frozen=True, slots=True)
class FrameSent:
    """The radio put one of our frames on the air; sent=False: it gave up on it."""

    stamp_ns: I64
    radio_time_us: U64
    kind: U8
    sequence: U32
    sent: bool


@dataclass(frozen=True, slots=True)
class RadioStatus:
    """1 Hz status of our radio; a changed boot_id means that it rebooted. Bitmaps by robot id."""

    stamp_ns: I64
    boot_id: U32  # random, new at each boot
    boot_counter: U32
    reset_reason: U8  # esp_reset_reason()
    uptime_us: U64
    robot: U8  # 255: listens only
    fleet: U8
    channel: U8
    rate_mbps: U8
    flags: U16  # link.FLAG_OPEN ..
    round_ms: U16
    slots: U8
    fleet_time_us: U64
    stop_counter: U16  # of the highest STOP known
    stop_resumed: U16  # and of the highest one answered
    alive: U64  # heard within 3 s
    rebooted: U64  # since the last status
    babbling: U64  # sends too many frames
    duplicate: U64  # its id is used by two radios
    sent: U32
    received: U32
    relays: U32  # of those sent
    replaced: U32  # STATE overwritten in the mailbox before it was sent
    send_failed: U32
    dropped_foreign: U32  # other protocol version or fleet
    dropped_malformed: U32
    dropped_seal: U32  # sealed without our having a key, or the other way round
    dropped_forged: U32  # the tag is wrong
    dropped_replayed: U32  # heard before, or of an older boot
    dropped_impostor: U32  # another radio under the id of one that is alive
    dropped_babble: U32  # of a sender with too many frames
    dropped_usb: U32  # messages lost between radio and host, either way
    firmware: str
    git_hash: str


@dataclass(frozen=True, slots=True)
class RoundEnded:
    """The last slot of a round is over and all that was heard in it has been handed on: decide now."""

    stamp_ns: I64
    round: U32  # of fleet time
    fleet_time_us: U64
    radio_time_us: U64
    held: U64  # bit k: row k of this round was heard, relayed ones and our own included
    agreed: bool  # fleet time is


@dataclass(frozen=True, slots=True)
class LinkNoise:
    """Bytes on a serial port that were no frame; counted since the port was opened."""

    stamp_ns: I64
    port: U8
    skipped_bytes: U32
    bad_checksums: U32


@dataclass(frozen=True, slots=True)
class LoopsClosed:
    """A solver outside the core answered to LoopsDue: poses, loop links, the map anew (slam/solution.py)."""

    stamp_ns: I64
    epoch: U32
    searched: U32  # keyframes whose loops were looked for
    poses: F64Array  # (n * 3,) of the first n keyframes; empty: there is no answer, `text` says why
    loop_first: I32Array  # (k,)
    loop_second: I32Array  # (k,)
    loop_motion: F64Array  # (k * 3,)
    loop_information: F64Array  # (k * 9,)
    resolution_m: F64
    left: I32
    low: I32
    width: U32
    height: U32
    log_odds: I32Array  # (height * width,)
    text: str


@dataclass(frozen=True, slots=True)
class TransformReceived:
    """One transform of ROS's /tf or /tf_static: the child frame's pose in the parent frame."""

    stamp_ns: I64
    ros_ns: I64  # its header's stamp, ROS's clock
    parent: str
    child: str
    fixed: bool  # of /tf_static: holds for ever
    x_m: F64
    y_m: F64
    z_m: F64
    qx: F64
    qy: F64
    qz: F64
    qw: F64


@dataclass(frozen=True, slots=True)
class LaserScanReceived:
    """A sensor_msgs/LaserScan without its intensities, in `frame`; angles count counter-clockwise."""

    stamp_ns: I64
    ros_ns: I64  # of the first ray, ROS's clock
    frame: str
    angle_min_rad: F64
    angle_increment_rad: F64
    time_increment_s: F64  # between rays
    range_min_m: F64
    range_max_m: F64
    ranges_m: F32Array  # (n,) inf: no return


@dataclass(frozen=True, slots=True)
class OdometryReceived:
    """The measured speed of a nav_msgs/Odometry, base frame; its pose is a transform as well."""

    stamp_ns: I64
    ros_ns: I64
    v_mps: F64
    wz_radps: F64


Event: TypeAlias = (
    Started
    | MapReceived
    | Tick
    | PortOpened
    | PortLost
    | BaseFeedback
    | ScanReceived
    | StateHeard
    | RelayHeard
    | TasksHeard
    | StopHeard
    | FrameSent
    | RadioStatus
    | RoundEnded
    | LinkNoise
    | LoopsClosed
    | TransformReceived
    | LaserScanReceived
    | OdometryReceived
)


# ---- effects ------------------------------------------------------------------------------------


@quickly_made
@dataclass(frozen=True, slots=True)
class SendState:
    """Our STATE for this round; replaces an unsent one in the radio."""

    frame: StateFrame


@dataclass(frozen=True, slots=True)
class SendTasks:
    frame: TasksFrame


@dataclass(frozen=True, slots=True)
class Drive:
    """Velocity for the base: forward speed and turn rate, base frame (x forward, z up)."""

    v_mps: F64
    wz_radps: F64
    reason: str  # follow, rotate, hold, guard, recover:<step>, stop:<cause>


@dataclass(frozen=True, slots=True)
class GuardLimited:
    """Why the scan guard commands less than was wanted: the Drive effect beside it is what it let through."""

    wanted_v_mps: F64
    wanted_wz_radps: F64
    nearest_m: F64  # from the footprint to the nearest thing seen; inf: nothing, or no number was wanted
    free_m: F64  # along the wanted way, before something is nearer than guard.margin_m
    stop_m: F64  # what stopping takes, latency included
    scan_age_s: F64


@dataclass(frozen=True, slots=True)
class RecoveryChanged:
    """A robot that was stuck tries something, gives up, or is free again (control/recovery.py)."""

    step: str  # clear, back_up, turn, wait, give_up: begun; drive: the attempt is over; free: it moves again
    cause: str  # guard, blocked, wheels, slip, no_nearer, waiting; what keeps it
    stalled_s: F64  # time without progress that led here
    x_m: F64
    y_m: F64
    yaw_rad: F64


@quickly_made
@dataclass(frozen=True, slots=True)
class PoseEstimated:
    """Where the robot believes it is (map frame), once per tick."""

    x_m: F64
    y_m: F64
    yaw_rad: F64
    v_mps: F64
    wz_radps: F64
    source: str  # odometry, slam, ros


@dataclass(frozen=True, slots=True)
class Localized:
    """What one sweep says of where the robot is in the map; its pose near the sweep's end (map frame).

    covariance: (9,) row by row, of x, y [m] and yaw [rad]. The counts are of the sweep's returns.
    """

    stamp_ns: I64  # of the pose: a sweep ends before its last bytes are read
    phase: str  # checking, localized, lost; while a map is made: mapping, unmatched
    x_m: F64
    y_m: F64
    yaw_rad: F64
    score: F64  # 0 .. 1
    covariance: F64Array
    on_walls: U16
    through_walls: U16
    unexplained: U16
    masked: U16  # on peers, left out


@dataclass(frozen=True, slots=True)
class LoopsDue:
    """The map in the making has enough new keyframes: somebody outside shall close its loops."""

    epoch: U32
    keyframes: U32


@dataclass(frozen=True, slots=True)
class MapDrawn:
    """The map in the making; its epoch goes up when loops are closed. Cells as in MapReceived."""

    epoch: U32
    keyframes: U32
    width: U32
    height: U32
    resolution_m: F64
    origin_x_m: F64
    origin_y_m: F64
    cells: I8Array  # (H * W,)


@quickly_made
@dataclass(frozen=True, slots=True)
class RoundDecided:
    """One decision with everything it was made from: the snapshot and the delivery ledger.

    N rows in id order, M task slots. A peer never heard has row_age_ms NEVER_HEARD_MS and unreachable costs.
    """

    round: U32
    allocator: str
    row_sequence: U32Array  # (N,) this, boot and RSSI: of the frame that brought the row
    row_boot: U32Array  # (N,)
    row_age_ms: U16Array  # (N,) on our monotonic clock
    row_rssi_dbm: I8Array  # (N,)
    row_via: U8Array  # (N,) 255: it came in its owner's STATE; else in the RELAY of this robot
    row_available: U8Array  # (N,) 1: takes part in this allocation
    row_busy: U8Array  # (N,) 1: holds a claim and takes part once it is served; its costs begin there
    row_slot: U8Array  # (N,) slot of the row's claim, 255 none
    costs: U8Array  # (N * M,) quantised
    generations: U16Array  # (M,)
    task_states: U8Array  # (M,)
    logits: F32Array  # (M + 1,) or empty
    action: I16  # 0 = no request, j = task slot j - 1
    reason: str  # why nothing was requested, or "requested"


@dataclass(frozen=True, slots=True)
class ClaimChanged:
    """Our claim's life: requested, confirmed, unconfirmed, dropped, released, completed."""

    what: str
    cause: str
    slot: U8
    generation: U16
    tag: U8
    cost: U8
    round: U32
    x_m: F64
    y_m: F64
    z_m: F64


@dataclass(frozen=True, slots=True)
class ConflictSeen:
    """Two robots wanted one task; cause: loss, staleness, tie, policy."""

    slot: U8
    generation: U16
    other: U8
    kept: bool
    cause: str


@dataclass(frozen=True, slots=True)
class PeerClaimSeen:
    """A peer's claim appeared, was confirmed, or went away, as far as we heard."""

    robot: U8
    slot: U8
    generation: U16
    what: str  # requested, confirmed, gone, expired


@dataclass(frozen=True, slots=True)
class TaskTurned:
    """A slot has a new generation: the task now open there (fleet frame, centimetres)."""

    slot: U8
    generation: U16
    x_cm: I16
    y_cm: I16
    z_cm: I16
    cause: str  # start, claimed, completed, heard


@dataclass(frozen=True, slots=True)
class PathPlanned:
    """Cells of the planned path on the map grid, start to goal; empty = no path."""

    map_epoch: U32
    ix: U16Array
    iy: U16Array
    length_m: F64
    cause: str  # new, blocked, map, gone


@dataclass(frozen=True, slots=True)
class AlarmRaised:
    level: U8
    code: str
    text: str


@dataclass(frozen=True, slots=True)
class AlarmCleared:
    code: str


Effect: TypeAlias = (
    SendState
    | SendTasks
    | Drive
    | GuardLimited
    | RecoveryChanged
    | PoseEstimated
    | Localized
    | LoopsDue
    | MapDrawn
    | RoundDecided
    | ClaimChanged
    | ConflictSeen
    | PeerClaimSeen
    | TaskTurned
    | PathPlanned
    | AlarmRaised
    | AlarmCleared
)
