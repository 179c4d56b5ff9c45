"""`hippomat-host radio-info`: everything that a radio says of itself but its key. Changes nothing in it."""

from __future__ import annotations

import dataclasses
import json
from dataclasses import dataclass
from typing import Any, Literal

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from hippomat_core.errors import PortError
from hippomat_core.fleet.robot_names import named, robots_of
from hippomat_core.wire import link
from hippomat_core.wire.link import (
    PEER_ALIVE,
    PEER_BABBLING,
    PEER_DUPLICATE,
    AskPeers,
    HelloReply,
    PeerReport,
    Status,
)
from hippomat_host import radio_words as words
from hippomat_host.conversation import ANSWER_S, Conversation
from hippomat_host.screen import table_console


@dataclass(frozen=True, slots=True)
class RadioInfo:
    """What was learnt in one conversation."""

    path: str
    reply: HelloReply
    status: Status
    peers: tuple[PeerReport, ...]


def radio_info(path: str, as_json: bool) -> int:
    """Print it; exit code 0. Raises PortError in one line."""
    info = ask(path)
    if as_json:
        print(json.dumps(as_tree(info), indent=2))
    else:
        table_console().print(picture(info))
    return 0


def ask(path: str) -> RadioInfo:
    """The radio's answers; a status closes its list of peers."""
    with Conversation(path) as radio:
        radio.forget_stale()
        radio.say(AskPeers())
        peers: list[PeerReport] = []
        for message in radio.listen(ANSWER_S):
            if isinstance(message, PeerReport):
                peers.append(message)
            elif isinstance(message, Status):
                return RadioInfo(path, radio.reply, message, tuple(peers))
    raise PortError(f"the radio on {path} does not tell its status: unplug it, plug it in again, and repeat")


# ---- for a person -------------------------------------------------------------------------------


def picture(info: RadioInfo) -> RenderableType:
    """Two tables: the radio, and whom it hears."""
    grid = Table.grid(padding=(0, 2))
    grid.add_column(style="bold")
    grid.add_column(overflow="fold")
    for name, text, style in _rows(info):
        grid.add_row(name, Text(text, style=style))
    return Group(grid, Text(), _peer_table(info))


def _rows(info: RadioInfo) -> list[tuple[str, str, str]]:
    reply, status = info.reply, info.status
    provisioned = (
        "provisioned" if status.flags & link.FLAG_PROVISIONED else "takes fleet and channel from its host"
    )
    boot = (
        f"id {status.boot_id:08x}, counter {status.boot_counter}, up {words.duration(status.uptime_us / 1e6)}"
    )
    relays = f"{status.sent} sent ({status.relays} of them relays), {status.received} received"
    failures = f"{status.replaced} replaced by newer ones, {status.send_failed} given up"
    agreed = "agreed with others" if status.flags & link.FLAG_AGREED else "not agreed with anybody"
    is_open = status.flags & link.FLAG_OPEN
    versions = f"{words.firmware(reply)}, protocol {reply.protocol_version}, link {reply.link_version}"
    return [
        ("port", info.path, ""),
        ("firmware", versions, ""),
        ("MAC", reply.mac.hex(":"), ""),
        ("identity", f"{words.owner(status)} of fleet {status.fleet}, {provisioned}", ""),
        ("air", f"channel {status.channel}, {status.rate_mbps} Mbit/s", ""),
        ("seal", words.seal(status.flags), "yellow" if is_open else ""),
        ("boot", f"{boot}, reset by: {words.reset_reason(status.reset_reason)}", ""),
        ("schedule", f"rounds of {status.round_ms} ms, {status.slots} slots", ""),
        ("fleet time", f"{status.fleet_time_us / 1e6:.3f} s, {agreed}", ""),
        ("STOP", *_stop(info)),
        ("frames", f"{relays}; {failures}", ""),
        *[("dropped" if not at else "", *_drop(status, name)) for at, name in enumerate(words.DROPS)],
        *[("trouble", text, "red") for text in _troubles(status)],
    ]


def _drop(status: Status, name: str) -> tuple[str, str]:
    count = getattr(status, name)
    text = f"{count:6} {name.removeprefix('dropped_')}: {words.DROPS[name]}"
    return text, "yellow" if count else "dim"


def _stop(info: RadioInfo) -> tuple[str, str]:
    status = info.status
    if words.latched(status):
        resume = f"`hippomat-host resume --port {info.path}` lifts it"
        return f"LATCHED, counter {status.stop_counter}: {resume}", "red"
    history = f"the last, {status.stop_counter}, was resumed" if status.stop_counter else "none yet"
    return f"not latched ({history})", ""


def _troubles(status: Status) -> list[str]:
    """What somebody has to look after."""
    found = []
    if status.flags & link.FLAG_PASSIVE:
        found.append(
            f"another radio sends as robot {status.robot}: this one sends nothing but STOP and RESUME; "
            "provision one of the two with another id"
        )
    if status.flags & link.FLAG_UNSAFE:
        found.append("the boot counter cannot be stored, so a radio with a key stays silent: flash it anew")
    own = 1 << status.robot if status.robot < 64 else 0
    for bitmap, text in (
        (status.duplicate & ~own, "two radios send under one id: {}"),
        (status.babbling, "sends far too many frames: {}"),
        (status.rebooted, "restarted within the last second: {}"),
    ):
        if bitmap:
            found.append(text.format(named(robots_of(bitmap))))
    return found


def _peer_table(info: RadioInfo) -> RenderableType:
    if not info.peers:
        return Text("hears nobody since its boot", style="dim")
    table = Table(box=None, header_style="bold", padding=(0, 1, 0, 0))  # fits 80 columns
    for name in ("peer", "state", "heard", "RSSI", "loss", "received", "MAC", "boot"):
        justify: Literal["left", "right"] = "left" if name in ("peer", "state", "MAC") else "right"
        table.add_column(name, justify=justify, overflow="fold")
    for peer in info.peers:
        state = _state(peer)
        style = "red" if peer.flags & (PEER_BABBLING | PEER_DUPLICATE) else "" if state == "alive" else "dim"
        loss = f"{peer.loss / 255:.0%}" if peer.robot != link.NO_ROBOT else ""
        heard = f"{words.duration(peer.age_ms / 1e3)} ago"
        cells = (
            state,
            heard,
            str(peer.rssi_dbm),
            loss,
            str(peer.received),
            peer.mac.hex(":"),
            str(peer.boot),
        )
        table.add_row(_name(peer), *cells, style=style)
    return table


def _name(peer: PeerReport) -> str:
    return "operator" if peer.robot == link.NO_ROBOT else f"robot {peer.robot}"


def _state(peer: PeerReport) -> str:
    marks = ((PEER_DUPLICATE, "DUPLICATE id"), (PEER_BABBLING, "BABBLING"))
    names = [name for flag, name in marks if peer.flags & flag]
    return ", ".join(names) or ("alive" if peer.flags & PEER_ALIVE else "silent")


# ---- for a program ------------------------------------------------------------------------------


def as_tree(info: RadioInfo) -> dict[str, Any]:
    """Everything as JSON would have it; flags by name, MACs and ids as hex digits."""
    status = dataclasses.asdict(info.status)
    bitmaps = {name: robots_of(status.pop(name)) for name in ("alive", "rebooted", "babbling", "duplicate")}
    names = ("open", "agreed", "passive", "stopped", "unsafe", "provisioned")
    bits = [getattr(link, f"FLAG_{name.upper()}") for name in names]
    flags = {name: bool(status["flags"] & bit) for name, bit in zip(names, bits, strict=True)}
    return {
        "port": info.path,
        "mac": info.reply.mac.hex(":"),
        "link_version": info.reply.link_version,
        "protocol_version": info.reply.protocol_version,
        **status,
        **bitmaps,
        "boot_id": f"{info.status.boot_id:08x}",
        "reset_reason": words.reset_reason(info.status.reset_reason),
        "flags": flags,
        "peers": [_peer_tree(peer) for peer in info.peers],
    }


def _peer_tree(peer: PeerReport) -> dict[str, Any]:
    flags = {"alive": PEER_ALIVE, "babbling": PEER_BABBLING, "duplicate": PEER_DUPLICATE}
    return {
        **dataclasses.asdict(peer),
        "robot": None if peer.robot == link.NO_ROBOT else peer.robot,
        "operator": peer.robot == link.NO_ROBOT,
        "mac": peer.mac.hex(":"),
        "loss": round(peer.loss / 255, 3),
        "flags": {name: bool(peer.flags & bit) for name, bit in flags.items()},
    }
