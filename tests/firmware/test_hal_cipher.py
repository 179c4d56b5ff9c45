"""The chip's cipher, hal_cipher.c, compiled with this machine's mbedTLS: the same bytes as `cryptography`.

mbedTLS is the Debian package libmbedtls-dev; where it is not installed these tests skip.
"""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import cffi
import pytest
from c_values import RADIO, exactly, ffi, lib
from hypothesis import given
from hypothesis import strategies as st

from hippomat_sim.radio.cipher import CipherPort

HERE = Path(__file__).parent
SOURCE = HERE.parent.parent / "esp32_firmware/src/hal_cipher.c"
CORE = HERE.parent.parent / "esp32_firmware/lib/radio_core"
STRICT = ("-std=c11", "-O2", "-Wall", "-Wextra", "-Werror", "-Wconversion", "-Wpedantic", "-Wshadow")
MAC = bytes(range(6))
HEADER = bytes.fromhex("2907030b000000050000040302010000")


def build(output: Path, *arguments: str | Path) -> Path:
    """hal_cipher.c and what else is named."""
    if shutil.which("gcc") is None:
        pytest.skip("gcc is not installed")
    start = ("gcc", *STRICT, "-I", CORE, "-I", SOURCE.parent)
    probe = subprocess.run(
        (*start, "-E", "-"), input="#include <mbedtls/ccm.h>", capture_output=True, text=True
    )
    if probe.returncode != 0:
        pytest.skip("mbedTLS is not installed (Debian: apt install libmbedtls-dev)")
    command = [*start, SOURCE, *arguments, "-o", output]
    built = subprocess.run([str(part) for part in command], capture_output=True, text=True, check=False)
    assert built.returncode == 0, built.stderr
    return output


@pytest.fixture(scope="module")
def ports(tmp_path_factory):
    """rc_cipher of the chip and of this machine."""
    hal_ffi = cffi.FFI()
    hal_ffi.cdef("void hal_cipher_init(void *cipher);")
    path = build(tmp_path_factory.mktemp("hal") / "hal_cipher.so", "-shared", "-fPIC", "-lmbedcrypto")
    hal = hal_ffi.dlopen(str(path))
    chip, pc = ffi.new("rc_cipher *"), CipherPort(RADIO)
    hal.hal_cipher_init(chip)
    yield chip, pc.struct
    del hal, pc


def seal(port, key: bytes, body: bytes) -> bytes:
    room = ffi.new("uint8_t[]", lib.RC_MAX_FRAME)
    ffi.memmove(room, HEADER + body, 16 + len(body))
    size = lib.rc_seal(port, exactly(key), exactly(MAC), room, 16 + len(body))
    return bytes(room[0:size])


def unseal(port, key: bytes, frame: bytes) -> bytes:
    room = ffi.new("uint8_t[]", lib.RC_MAX_FRAME)
    size = lib.rc_unseal(port, exactly(key), exactly(MAC), exactly(frame), len(frame), room)
    return bytes(room[0:size])


def test_the_chip_and_the_pc_seal_to_the_same_bytes_at_every_length(ports):
    chip, pc = ports
    for length in range(lib.RC_MAX_BODY + 1):
        body, key = bytes(k * length & 255 for k in range(length)), bytes([length]) * 16
        sealed = seal(chip, key, body)
        assert sealed == seal(pc, key, body)
        assert len(sealed) == 24 + length
        assert unseal(chip, key, sealed) == unseal(pc, key, sealed) == HEADER + body


@given(st.binary(max_size=226), st.binary(min_size=16, max_size=16))
def test_the_chip_opens_what_the_pc_sealed_and_the_other_way_round(ports, body, key):
    chip, pc = ports
    assert unseal(chip, key, seal(pc, key, body)) == HEADER + body
    assert unseal(pc, key, seal(chip, key, body)) == HEADER + body


def test_the_chip_opens_nothing_that_was_altered_and_goes_on(ports):
    chip, _ = ports
    key, body = b"k" * 16, bytes(40)
    sealed = seal(chip, key, body)
    for bit in range(8 * len(sealed)):
        forged = bytearray(sealed)
        forged[bit // 8] ^= 1 << bit % 8
        assert unseal(chip, key, bytes(forged)) == b""
    assert unseal(chip, b"x" * 16, sealed) == b""
    assert unseal(chip, key, sealed) == HEADER + body


def test_the_chip_uses_the_heap_when_a_key_is_set_and_for_no_frame(tmp_path):
    counted = ("-Wl,--wrap=malloc,--wrap=calloc", "-l:libmbedcrypto.a")
    program = build(tmp_path / "cipher_heap", HERE / "cipher_heap.c", *counted)
    result = subprocess.run([str(program)], capture_output=True, text=True, check=True)
    assert result.stdout.splitlines() == [
        *("start: 0", "key: 1", "3000 frames: 0", "no key twice: 0", "another key: 1"),
    ]
