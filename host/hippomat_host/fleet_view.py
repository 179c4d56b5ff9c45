"""What a person wants to see of a running robot and its fleet, gathered from events and effects. Pure."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from hippomat_core.messages import (
    AlarmCleared,
    AlarmRaised,
    ClaimChanged,
    Drive,
    Effect,
    Event,
    LaserScanReceived,
    Localized,
    PortLost,
    PortOpened,
    PoseEstimated,
    RadioStatus,
    RelayHeard,
    RoundDecided,
    ScanReceived,
    StateHeard,
    StopHeard,
    TasksHeard,
)
from hippomat_core.wire.frames import OPERATOR, STOP, Header, StateFrame

RATE_WINDOW = 64  # frames over which a peer's loss is told


@dataclass(frozen=True, slots=True)
class Peer:
    """One robot as we hear it; loss counts missing sequence numbers among about the last RATE_WINDOW."""

    robot: int
    fleet: int
    stamp_ns: int
    rssi_dbm: int
    boot: int
    sequence: int
    received: float
    lost: float
    frame: StateFrame | None = None

    @property
    def loss(self) -> float:
        return self.lost / (self.received + self.lost)


@dataclass(slots=True)
class FleetView:
    """Mutable, owned by the daemon's loop; the screen gets copies made by snapshot()."""

    peers: dict[int, Peer] = field(default_factory=dict)
    ports: dict[int, str] = field(default_factory=dict)  # what runs: port -> device
    alarms: dict[str, AlarmRaised] = field(default_factory=dict)
    radio: RadioStatus | None = None
    stop: StopHeard | None = None  # the last STOP, not RESUME
    pose: PoseEstimated | None = None
    place: Localized | None = None  # what the last sweep said of it
    drive: Drive | None = None
    claim: ClaimChanged | None = None
    decided: RoundDecided | None = None
    completed: int = 0
    scans: int = 0
    now_ns: int = 0

    def snapshot(self, now_ns: int) -> FleetView:
        """A copy that the loop does not touch again."""
        copy = replace(self, now_ns=now_ns)
        copy.peers, copy.ports, copy.alarms = dict(self.peers), dict(self.ports), dict(self.alarms)
        return copy

    def event(self, event: Event) -> None:
        if isinstance(event, StateHeard):
            self._heard(event.stamp_ns, event.rssi_dbm, event.header, event.frame)
        elif isinstance(event, RelayHeard | TasksHeard | StopHeard):
            self._heard(event.stamp_ns, event.rssi_dbm, event.header, None)
            if isinstance(event, StopHeard) and event.header.kind == STOP:
                self.stop = event
        elif isinstance(event, RadioStatus):
            self.radio = event
        elif isinstance(event, PortOpened):
            self.ports[event.port] = event.device
        elif isinstance(event, PortLost):
            self.ports.pop(event.port, None)
        elif isinstance(event, ScanReceived | LaserScanReceived):
            self.scans += 1

    def effect(self, effect: Effect) -> None:
        if isinstance(effect, PoseEstimated):
            self.pose = effect
        elif isinstance(effect, Localized):
            self.place = effect
        elif isinstance(effect, Drive):
            self.drive = effect
        elif isinstance(effect, RoundDecided):
            self.decided = effect
        elif isinstance(effect, ClaimChanged):
            self.completed += effect.what == "completed"
            ended = effect.what in ("dropped", "released", "completed")
            self.claim = None if ended else effect
        elif isinstance(effect, AlarmRaised):
            self.alarms[effect.code] = effect
        elif isinstance(effect, AlarmCleared):
            self.alarms.pop(effect.code, None)

    def _heard(self, stamp_ns: int, rssi_dbm: int, header: Header, frame: StateFrame | None) -> None:
        if header.sender == OPERATOR:  # several may send under it: nobody's row
            return
        before = self.peers.get(header.sender)
        received, lost = 1.0, 0.0
        if before is not None:
            keep = 1 - 1 / RATE_WINDOW
            gap = max(0, header.sequence - before.sequence - 1) if header.boot == before.boot else 0
            received, lost = before.received * keep + 1, before.lost * keep + min(gap, RATE_WINDOW)
            frame = frame or before.frame
        self.peers[header.sender] = Peer(
            header.sender,
            header.fleet,
            stamp_ns,
            rssi_dbm,
            header.boot,
            header.sequence,
            received,
            lost,
            frame,
        )
