"""Sealed frames: what the tag covers, which nonce, and that nothing altered is opened."""

from __future__ import annotations

import sys

import numpy as np
import pytest
from c_values import RADIO, exactly, ffi, lib
from hypothesis import given
from hypothesis import strategies as st

from hippomat_sim.radio.cipher import AesCcm, CipherPort

CIPHER = AesCcm()
PORT = CipherPort(RADIO)
KEY = bytes(range(0xC0, 0xD0))
MAC = bytes.fromhex("24 58 7c 01 02 03")

# RFC 3610, section 8, packet vectors 1, 2, 3, 4, 13 and 16: key, nonce, header, body, sealed.
OF_THE_RFC = """
c0c1c2c3c4c5c6c7c8c9cacbcccdcecf 00000003020100a0a1a2a3a4a5 0001020304050607
08090a0b0c0d0e0f101112131415161718191a1b1c1d1e
588c979a61c663d2f066d0c2c0f989806d5f6b61dac38417e8d12cfdf926e0
c0c1c2c3c4c5c6c7c8c9cacbcccdcecf 00000004030201a0a1a2a3a4a5 0001020304050607
08090a0b0c0d0e0f101112131415161718191a1b1c1d1e1f
72c91a36e135f8cf291ca894085c87e3cc15c439c9e43a3ba091d56e10400916
c0c1c2c3c4c5c6c7c8c9cacbcccdcecf 00000005040302a0a1a2a3a4a5 0001020304050607
08090a0b0c0d0e0f101112131415161718191a1b1c1d1e1f20
51b1e5f44a197d1da46b0f8e2d282ae871e838bb64da8596574adaa76fbd9fb0c5
c0c1c2c3c4c5c6c7c8c9cacbcccdcecf 00000006050403a0a1a2a3a4a5 000102030405060708090a0b
0c0d0e0f101112131415161718191a1b1c1d1e
a28c6865939a9a79faaa5c4c2a9d4a91cdac8c96c861b9c9e61ef1
d7828d13b2b0bdc325a76236df93cc6b 00412b4ea9cdbe3c9696766cfa 0be1a88bace018b1
08e8cf97d820ea258460e96ad9cf5289054d895ceac47c
4cb97f86a2a4689a877947ab8091ef5386a6ffbdd080f8e78cf7cb0cddd7b3
d7828d13b2b0bdc325a76236df93cc6b 00764c63b8058e3c9696766cfa d0d0735c531e1becf049c244
12daac5630efa5396f770ce1a66b21f7b2101c
14d253c3967b70609b7cbb7c499160283245269a6f49975bcadeaf
"""
VECTORS = np.reshape(OF_THE_RFC.split(), (-1, 5)).tolist()


def header(boot: int = 5, sequence: int = 9, sealed: int = 1, kind: int = 1, sender: int = 3) -> bytes:
    fields = {"kind": kind, "sealed": sealed, "fleet": 7, "sender": sender, "boot": boot}
    struct = ffi.new("rc_header *", fields | {"sequence": sequence, "fleet_time_us": 123_456_789})
    out = ffi.new("uint8_t[]", lib.RC_HEADER_BYTES)
    assert lib.rc_header_encode(struct, out) == lib.RC_HEADER_BYTES
    return bytes(out)


def seal(frame: bytes, key: bytes = KEY, mac: bytes = MAC) -> bytes | None:
    """The sealed frame; None when it was refused."""
    room = ffi.new("uint8_t[]", lib.RC_MAX_FRAME)
    ffi.memmove(room, frame, min(len(frame), lib.RC_MAX_FRAME))
    size = lib.rc_seal(PORT.struct, exactly(key), exactly(mac), room, len(frame))
    return bytes(room[0:size]) if size else None


def unseal(frame: bytes, key: bytes = KEY, mac: bytes = MAC) -> bytes | None:
    plain = ffi.new("uint8_t[]", lib.RC_MAX_FRAME)
    size = lib.rc_unseal(PORT.struct, exactly(key), exactly(mac), exactly(frame), len(frame), plain)
    return bytes(plain[0:size]) if size else None


@pytest.mark.parametrize("vector", VECTORS)
def test_the_cipher_gives_the_packets_of_rfc_3610(vector):
    key, nonce, head, body, sealed = map(bytes.fromhex, vector)
    assert CIPHER.seal(key, nonce, head, body) == sealed
    assert CIPHER.open(key, nonce, head, sealed) == body


@pytest.mark.parametrize("vector", VECTORS)
def test_a_packet_of_rfc_3610_with_any_bit_flipped_is_not_opened(vector):
    key, nonce, head, _, sealed = map(bytes.fromhex, vector)
    for bit in range(8 * len(sealed)):
        assert CIPHER.open(key, nonce, head, flipped(sealed, bit)) is None


def flipped(data: bytes, bit: int) -> bytes:
    changed = bytearray(data)
    changed[bit // 8] ^= 1 << bit % 8
    return bytes(changed)


def test_the_nonce_is_mac_boot_and_sequence_little_endian():
    nonce = ffi.new("uint8_t[]", lib.RC_NONCE_BYTES)
    lib.rc_nonce(exactly(MAC), 0x0A0B0C0D, 0x010203, nonce)
    assert bytes(nonce) == MAC + bytes.fromhex("0d0c0b0a 030201")


def test_what_the_core_seals_is_ccm_with_the_header_covered_and_nothing_else_added():
    head, body = header(boot=0x0A0B0C0D, sequence=0x010203), b"the body"
    nonce = MAC + bytes.fromhex("0d0c0b0a 030201")
    assert seal(head + body) == head + CIPHER.seal(KEY, nonce, head, body)


def test_frames_of_every_length_come_back_as_they_were():
    for length in range(lib.RC_MAX_BODY + 1):
        frame = header(sequence=length) + bytes(length % 251 for _ in range(length))
        sealed = seal(frame)
        assert sealed is not None
        assert (len(sealed), sealed[:16]) == (len(frame) + 8, frame[:16])
        assert length < 4 or frame[16:] not in sealed
        assert unseal(sealed) == frame


@given(st.binary(max_size=226), st.binary(min_size=16, max_size=16), st.binary(min_size=6, max_size=6))
def test_frames_of_any_key_and_mac_come_back_as_they_were(body, key, mac):
    sealed = seal(header() + body, key, mac)
    assert unseal(sealed, key, mac) == header() + body


def test_a_frame_with_any_bit_flipped_is_refused():
    sealed = seal(header() + bytes(range(60)))
    for bit in range(8 * len(sealed)):
        assert unseal(flipped(sealed, bit)) is None, f"bit {bit % 8} of byte {bit // 8}"


def test_a_frame_of_another_mac_or_key_is_refused_in_every_bit():
    sealed = seal(header() + bytes(60))
    assert all(unseal(sealed, mac=flipped(MAC, bit)) is None for bit in range(48))
    assert all(unseal(sealed, key=flipped(KEY, bit)) is None for bit in range(128))


def test_a_frame_under_another_boot_sequence_sender_or_kind_is_refused():
    body = bytes(60)
    sealed = seal(header() + body)
    others = [header(boot=6), header(boot=4), header(sequence=10), header(sender=4), header(kind=2)]
    assert all(unseal(other + sealed[16:]) is None for other in others)
    assert unseal(header() + sealed[16:]) == header() + body


def test_a_truncated_or_extended_frame_is_refused():
    sealed = seal(header() + bytes(60))
    assert all(unseal(sealed[:length]) is None for length in range(len(sealed)))
    assert all(unseal(sealed + bytes(more)) is None for more in (1, 2, 8, 16, 250))


def test_the_largest_state_fits_a_frame_with_its_tag():
    assert lib.RC_HEADER_BYTES + lib.RC_MAX_BODY + lib.RC_TAG_BYTES == lib.RC_MAX_FRAME == 250
    sealed = seal(header() + bytes(lib.RC_MAX_BODY))
    assert len(sealed) == 250


def test_a_frame_without_room_for_its_tag_is_not_sealed():
    assert seal(header() + bytes(lib.RC_MAX_BODY + 1)) is None
    assert seal(header() + bytes(400)) is None


def test_a_header_that_does_not_say_sealed_is_neither_sealed_nor_opened():
    assert seal(header(sealed=0) + bytes(9)) is None
    sealed = seal(header() + bytes(9))
    assert unseal(header(sealed=0) + sealed[16:]) is None


def test_bytes_that_are_no_header_are_neither_sealed_nor_opened():
    assert seal(b"") is None
    assert seal(header()[:15]) is None
    assert seal(b"\xff" + header()[1:] + b"body") is None
    assert unseal(b"\xff" * 40) is None


def test_without_a_cipher_nothing_is_sealed_or_opened():
    none = ffi.new("rc_cipher *")
    sealed = seal(header() + b"body")
    room = ffi.new("uint8_t[]", lib.RC_MAX_FRAME)
    assert lib.rc_unseal(none, exactly(KEY), exactly(MAC), exactly(sealed), len(sealed), room) == 0
    ffi.memmove(room, header(), 16)
    assert lib.rc_seal(none, exactly(KEY), exactly(MAC), room, 20) == 0


def test_a_cipher_that_fails_is_a_refusal_and_no_crash(monkeypatch):
    told: list[object] = []
    monkeypatch.setattr(sys, "unraisablehook", lambda error: told.append(str(error.exc_value)))

    class Broken(AesCcm):
        def seal(self, *_: bytes) -> bytes:
            raise RuntimeError("out of tags")

        def open(self, *_: bytes) -> bytes:
            raise RuntimeError("out of tags")

    port = CipherPort(RADIO, Broken())
    sealed = exactly(seal(header() + b"body"))
    room = ffi.new("uint8_t[]", lib.RC_MAX_FRAME)
    assert lib.rc_unseal(port.struct, exactly(KEY), exactly(MAC), sealed, len(sealed), room) == 0
    ffi.memmove(room, header(), 16)
    assert lib.rc_seal(port.struct, exactly(KEY), exactly(MAC), room, 20) == 0
    assert told == ["out of tags"] * 2
