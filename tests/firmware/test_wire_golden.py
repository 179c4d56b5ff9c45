"""tests/golden/wire.json, which says what the wire is, holds for the C and for the Python."""

from __future__ import annotations

import importlib.util
import json
from pathlib import Path
from typing import get_args

import pytest
from c_messages import c_message, c_understood
from c_values import c_decode, c_encode, exactly, ffi, lib
from wire_values import plain

from hippomat_core.errors import WireError
from hippomat_core.wire import cobs, codec, link
from hippomat_core.wire import frames as air

GOLDEN = Path(__file__).parent.parent / "golden"
WIRE = json.loads((GOLDEN / "wire.json").read_text())


def by_name(part: str) -> pytest.MarkDecorator:
    return pytest.mark.parametrize("name", list(WIRE[part]))


@by_name("frames")
def test_a_golden_frame_is_read_and_written_alike_by_both(name):
    golden = WIRE["frames"][name]
    data = bytes.fromhex(golden["bytes"])
    python = codec.decode_frame(data)
    assert plain(python) == [golden["header"], golden["frame"]]
    assert plain(c_decode(data)) == [golden["header"], golden["frame"]]
    assert codec.encode_frame(*python) == data
    assert c_encode(*python) == data


@by_name("messages")
def test_a_golden_message_is_read_and_written_alike_by_both(name):
    golden = WIRE["messages"][name]
    payload, framed = bytes.fromhex(golden["payload"]), bytes.fromhex(golden["framed"])
    message = link.decode_message(payload)
    assert (type(message).__name__, plain(message)) == (golden["type"], golden["message"])
    assert link.encode_message(message) == framed
    assert list(cobs.FrameDecoder().feed(framed)) == [payload]
    out = ffi.new("uint8_t[]", lib.RC_LINK_MAX_ENCODED)
    assert bytes(ffi.buffer(out, lib.rc_cobs_encode(exactly(payload), len(payload), out))) == framed
    assert (c_understood(payload) or message) == message
    assert (c_understood(payload) is None) == (c_message(message) == payload)


@by_name("cobs")
def test_golden_stuffing_holds(name):
    assert cobs.stuff(bytes.fromhex(name)).hex() == WIRE["cobs"][name]
    assert cobs.unstuff(bytes.fromhex(WIRE["cobs"][name])) == bytes.fromhex(name)


@by_name("refused")
def test_golden_malformed_frames_are_refused_by_both(name):
    data = bytes.fromhex(WIRE["refused"][name])
    with pytest.raises(WireError):
        codec.decode_frame(data)
    assert not lib.rc_frame_valid(exactly(data), len(data))


@by_name("refused_messages")
def test_golden_malformed_messages_are_refused_by_both(name):
    payload = bytes.fromhex(WIRE["refused_messages"][name])
    with pytest.raises(WireError):
        link.decode_message(payload)
    assert c_understood(payload) is None


def test_every_kind_of_frame_and_message_has_an_example():
    assert {golden["header"]["kind"] for golden in WIRE["frames"].values()} == set(range(1, 6))
    assert {golden["header"]["sealed"] for golden in WIRE["frames"].values()} == {False, True}
    kinds = {golden["type"] for golden in WIRE["messages"].values()}
    assert kinds == {kind.__name__ for kind in get_args(link.LinkMessage)}
    assert (WIRE["protocol_version"], WIRE["link_version"]) == (air.PROTOCOL_VERSION, link.LINK_VERSION)


def test_the_golden_file_is_what_its_generator_writes():
    spec = importlib.util.spec_from_file_location("make_wire_golden", GOLDEN / "make_wire_golden.py")
    generator = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(generator)
    assert (GOLDEN / "wire.json").read_text() == generator.text()


def test_both_sides_have_the_same_limits():
    assert lib.RC_PROTOCOL_VERSION == air.PROTOCOL_VERSION
    assert lib.RC_LINK_VERSION == link.LINK_VERSION
    assert (lib.RC_MAX_FRAME, lib.RC_MAX_BODY) == (air.MAX_FRAME, air.MAX_BODY)
    assert (lib.RC_HEADER_BYTES, lib.RC_TAG_BYTES) == (air.HEADER_BYTES, air.TAG_BYTES)
    assert (lib.RC_OPERATOR, lib.RC_NO_ROBOT) == (air.OPERATOR, link.NO_ROBOT)
    assert (lib.RC_LINK_MAX_PAYLOAD, lib.RC_LINK_MAX_STUFFED) == (cobs.MAX_PAYLOAD, cobs.MAX_STUFFED)
    kinds = (lib.RC_STATE, lib.RC_RELAY, lib.RC_TASKS, lib.RC_STOP, lib.RC_RESUME)
    assert kinds == (air.STATE, air.RELAY, air.TASKS, air.STOP, air.RESUME)
    for name in ("OPEN", "AGREED", "PASSIVE", "STOPPED", "UNSAFE", "PROVISIONED"):
        assert getattr(lib, f"RC_FLAG_{name}") == getattr(link, f"FLAG_{name}")


@pytest.mark.parametrize(
    ("message", "size"),
    [
        (link.Hello, "RC_HELLO_BYTES"),
        (link.Provision, "RC_PROVISION_BYTES"),
        (link.HelloReply, "RC_REPLY_BYTES"),
        (link.Status, "RC_STATUS_BYTES"),
        (link.PeerReport, "RC_PEER_BYTES"),
        (link.Round, "RC_ROUND_BYTES"),
    ],
)
def test_a_message_has_the_length_that_link_h_names(message, size):
    found = [golden["payload"] for golden in WIRE["messages"].values() if golden["type"] == message.__name__]
    assert {len(payload) // 2 for payload in found} == {getattr(lib, size)}
