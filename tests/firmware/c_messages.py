"""USB messages between Python values and the structs of link.h, field by field."""

from __future__ import annotations

from typing import Any

from c_values import exactly, ffi, lib

from hippomat_core.wire import link

COUNTERS = tuple(name for name, _ in ffi.typeof("rc_counters").fields if not name.startswith("usb_"))


def c_understood(payload: bytes) -> link.LinkMessage | None:
    """What link.c reads in a payload from the host; None when no decoder takes it."""
    raw = exactly(payload)
    readers = (_hello, _send, _provision, _command, _ask_peers)
    found = [message for read in readers if (message := read(raw, len(payload))) is not None]
    assert len(found) <= 1
    return found[0] if found else None


def _who(identity: Any) -> tuple[int, int, int]:
    return identity.robot, identity.fleet, identity.channel


def _hello(raw: Any, n: int) -> link.Hello | None:
    hello = ffi.new("rc_hello *")
    if not lib.rc_hello_decode(raw, n, hello):
        return None
    rounds = hello.schedule
    return link.Hello(hello.link_version, *_who(hello.identity), rounds.round_ms, rounds.slots)


def _send(raw: Any, n: int) -> link.SendBody | None:
    send = ffi.new("rc_send *")
    if not lib.rc_send_decode(raw, n, send):
        return None
    return link.SendBody(send.kind, bytes(ffi.buffer(send.body, send.length)))


def _provision(raw: Any, n: int) -> link.Provision | None:
    given = ffi.new("rc_provision *")
    if not lib.rc_provision_decode(raw, n, given):
        return None
    key = bytes(given.key)
    assert given.keyed or not any(key)
    who = _who(given.identity)
    return link.Provision(
        given.link_version, *who, given.rate_mbps, key if given.keyed else link.OPEN_KEY, given.unix_s
    )


def _command(raw: Any, n: int) -> link.Command | None:
    command = ffi.new("rc_command *")
    if not lib.rc_command_decode(raw, n, command):
        return None
    return link.Command(command.kind, command.counter, command.reason)


def _ask_peers(raw: Any, n: int) -> link.AskPeers | None:
    return link.AskPeers() if lib.rc_ask_peers_decode(raw, n) else None


def c_message(message: link.LinkMessage) -> bytes | None:
    """The payload as link.c writes it; None for a message that only a host writes."""
    out = ffi.new("uint8_t[]", lib.RC_LINK_MAX_PAYLOAD)
    if isinstance(message, link.HelloReply):
        size = _reply(message, out)
    elif isinstance(message, link.Status):
        size = _status(message, out)
    elif isinstance(message, link.Heard):
        times = (message.radio_time_us, message.fleet_time_us, message.rssi_dbm)
        size = lib.rc_heard_encode(*times, exactly(message.frame), len(message.frame), out)
    elif isinstance(message, link.Sent):
        size = lib.rc_sent_encode(message.radio_time_us, message.kind, message.sequence, message.sent, out)
    elif isinstance(message, link.Provisioned):
        size = lib.rc_provisioned_encode(message.stored, message.boot_counter, out)
    elif isinstance(message, link.PeerReport):
        fields = {name: getattr(message, name) for name in message.__dataclass_fields__}
        size = lib.rc_peer_encode(ffi.new("rc_peer_report *", fields | {"mac": tuple(message.mac)}), out)
    elif isinstance(message, link.Round):
        times = (message.fleet_time_us, message.radio_time_us)
        size = lib.rc_round_encode(message.round, *times, message.held, message.agreed, out)
    else:
        return None
    return bytes(ffi.buffer(out, size))


def _about(message: link.HelloReply | link.Status, mac: bytes) -> Any:
    texts = {"firmware": message.firmware.encode(), "git_hash": message.git_hash.encode()}
    numbers = {"boot_id": message.boot_id, "reset_reason": message.reset_reason, "mac": tuple(mac)}
    return ffi.new("rc_about *", numbers | texts)


def _identified(message: link.HelloReply | link.Status, mac: bytes) -> tuple[Any, ...]:
    """What both begin with: about, boot counter, identity, schedule, rate."""
    who = ffi.new("rc_identity *", [message.robot, message.fleet, message.channel])
    schedule = ffi.new("rc_schedule *", [message.round_ms, message.slots])
    return _about(message, mac), message.boot_counter, who, schedule, message.rate_mbps


def _reply(message: link.HelloReply, out: Any) -> int:
    size: int = lib.rc_reply_encode(*_identified(message, message.mac), message.flags, out)
    assert (out[1], out[2]) == (lib.RC_LINK_VERSION, lib.RC_PROTOCOL_VERSION)
    out[1], out[2] = message.link_version, message.protocol_version
    return size


def _status(message: link.Status, out: Any) -> int:
    names = (name for name, _ in ffi.typeof("rc_condition").fields)
    condition = ffi.new("rc_condition *", {name: getattr(message, name) for name in names})
    counters = ffi.new("rc_counters *", {name: getattr(message, name) for name in COUNTERS})
    size: int = lib.rc_status_encode(*_identified(message, bytes(6)), condition, counters, out)
    return size
