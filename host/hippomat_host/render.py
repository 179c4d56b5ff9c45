"""A FleetView as a rich table for a terminal, or as one plain line. Pure: view in, text out."""

from __future__ import annotations

import math

from rich.console import Group, RenderableType
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from hippomat_core.messages import ERROR, PORT_NAMES, ROS, WARNING
from hippomat_core.wire.frames import FLAG_STOPPED, NO_SLOT, AirClaim
from hippomat_core.wire.link import FLAG_OPEN
from hippomat_host import radio_view
from hippomat_host.advice import Given
from hippomat_host.fleet_view import FleetView, Peer

STATUS = ("idle", "assigned", "serving", "observing", "blocked", "lost")
STALE_NS = 1_000_000_000
GONE_NS = 3_000_000_000
_COLOURS = {WARNING: "yellow", ERROR: "red"}


def picture(view: FleetView, given: Given, log: str) -> RenderableType:
    """The whole screen."""
    who = "observing" if given.observes else f"robot {given.robot}"
    parts: list[RenderableType] = [_own(view, given, log), _fleet_table(view)]
    for alarm in view.alarms.values():
        parts.append(Text(f" {alarm.code}: {alarm.text}", style=_COLOURS.get(alarm.level, "")))
    if given.missing:
        advice = Table.grid(padding=(0, 1))
        advice.add_row(" missing", Text(", ".join(given.missing), style="yellow"))
        advice.add_row(" next", given.next_command())
        parts.append(advice)
    return Panel(Group(*parts), title=f"hippomat-host · {who}", title_align="left", expand=True)


def plain(view: FleetView, given: Given) -> str:
    """One line of status."""
    alive = [str(peer.robot) for peer in _sorted(view) if view.now_ns - peer.stamp_ns < GONE_NS]
    hears = f"hears {' '.join(alive)}" if alive else "hears nobody"
    radio = "".join(f"; {part}" for part in _radio_parts(view))
    alarms = f"; alarms: {', '.join(view.alarms)}" if view.alarms else ""
    if given.observes:
        return f"observing: {hears}{radio}{alarms}"
    return (
        f"robot {given.robot}: {_motion(view)}; {_claim(view)}; done {view.completed}; {hears}{radio}{alarms}"
    )


def _radio_parts(view: FleetView) -> list[str]:
    if view.radio is None:
        return []
    key = "OPEN" if view.radio.flags & FLAG_OPEN else "sealed"
    return [key, *filter(None, [radio_view.stopped(view)])]


def _own(view: FleetView, given: Given, log: str) -> Table:
    grid = Table.grid(padding=(0, 1))
    for port, path in enumerate((given.radio, given.base, given.lidar)):
        if path:
            device = view.ports.get(port)
            said = Text(device or "not there: trying again", style="" if device else "red")
            grid.add_row(f" {PORT_NAMES[port]}", Text(path, style="bold"), said)
    if given.ros.url:
        said = Text(
            view.ports.get(ROS) or "not there: trying again", style="" if ROS in view.ports else "red"
        )
        grid.add_row(f" {PORT_NAMES[ROS]}", Text(given.ros.url, style="bold"), said)
    if view.radio is not None:
        where = f"fleet {view.radio.fleet}, channel {view.radio.channel}"
        grid.add_row(" air", where, radio_view.air(view.radio))
        if drops := radio_view.dropped(view.radio):
            grid.add_row("", "dropped frames", Text(drops, style="yellow"))
    if stop := radio_view.stopped(view):
        grid.add_row(" STOP", Text("the fleet is stopped", style="bold red"), Text(stop, style="red"))
    if not given.observes:
        grid.add_row(" robot", _motion(view), f"{_claim(view)}; {view.completed} tasks done")
    name, counts = log.split("  ", 1)
    grid.add_row(" log", counts, name)
    return grid


def _fleet_table(view: FleetView) -> RenderableType:
    if not view.peers:
        return Text("\n nobody heard yet\n", style="dim")
    table = Table(box=None, header_style="bold", padding=(0, 1), title_justify="left")
    for name in (
        "robot",
        "status",
        "heard",
        "RSSI",
        "loss",
        "x [m]",
        "y [m]",
        "yaw",
        "claim",
        "cost",
        "digest",
        "radio",
    ):
        table.add_column(name, justify="left" if name in ("status", "claim", "radio") else "right")
    for peer in _sorted(view):
        age_ns = view.now_ns - peer.stamp_ns
        style = "" if age_ns < STALE_NS else "yellow" if age_ns < GONE_NS else "dim"
        heard = f"{age_ns / 1e9:.1f} s"
        mark = radio_view.mark(view.radio, peer.robot, age_ns >= GONE_NS)
        if mark and mark != "silent":
            style = "red"
        cells = _state_cells(peer, heard, f"{peer.rssi_dbm}", f"{peer.loss:.0%}")
        table.add_row(str(peer.robot), *cells, mark, style=style)
    return table


def _state_cells(peer: Peer, heard: str, rssi: str, loss: str) -> list[str]:
    frame = peer.frame
    if frame is None:
        return ["?", heard, rssi, loss, "", "", "", "", "", ""]
    status = STATUS[frame.status] if frame.status < len(STATUS) else str(frame.status)
    stopped = " STOP" if frame.flags & FLAG_STOPPED else ""
    yaw = f"{frame.yaw_256 * 360 / 256:.0f}°"
    claimed = frame.claim.slot != NO_SLOT
    place = [f"{frame.x_cm / 100:.2f}", f"{frame.y_cm / 100:.2f}", yaw]
    cost = str(frame.claim.cost) if claimed else ""
    return [
        status + stopped,
        heard,
        rssi,
        loss,
        *place,
        _air_claim(frame.claim) if claimed else "",
        cost,
        f"{frame.fleet_digest:08x}",
    ]


def _air_claim(claim: AirClaim) -> str:
    sure = "confirmed" if claim.confirmed else "requested"
    return f"task {claim.slot}.{claim.generation} {sure}"


def _motion(view: FleetView) -> str:
    drive = "" if view.drive is None else f" {view.drive.reason}"
    if view.pose is None:
        return f"no pose yet{drive}"
    pose = view.pose
    fits = "" if view.place is None else f" fit {view.place.score:.2f}"
    where = f"({pose.x_m:.2f}, {pose.y_m:.2f}) m {math.degrees(pose.yaw_rad):.0f}°{fits}"
    return f"{where} {pose.v_mps:.2f} m/s{drive}"


def _claim(view: FleetView) -> str:
    if view.claim is None:
        return f"no claim ({view.decided.reason})" if view.decided is not None else "no claim"
    return f"task {view.claim.slot}.{view.claim.generation} {view.claim.what}"


def _sorted(view: FleetView) -> list[Peer]:
    return [view.peers[robot] for robot in sorted(view.peers)]
