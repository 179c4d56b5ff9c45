"""AES-128-CCM of the PyPI package `cryptography` behind the radio core's cipher port (seal.h).

Knows keys, nonces and bytes; what the nonce is and what the tag covers is decided in seal.c.
"""

from __future__ import annotations

import functools
from typing import Any

from cryptography.exceptions import InvalidTag
from cryptography.hazmat.primitives.ciphers.aead import AESCCM

from hippomat_sim.radio.binding import Library, load_library

TAG_BYTES = 8


class AesCcm:
    """RFC 3610 with a tag of 8 bytes: key 16 bytes, nonce 13; the header is covered, not encrypted."""

    def seal(self, key: bytes, nonce: bytes, header: bytes, body: bytes) -> bytes:
        """The encrypted body and its tag."""
        return _keyed(key).encrypt(nonce, body, header)

    def open(self, key: bytes, nonce: bytes, header: bytes, sealed: bytes) -> bytes | None:
        """The body; None when the tag is wrong."""
        try:
            return _keyed(key).decrypt(nonce, sealed, header)
        except InvalidTag:
            return None


class CipherPort:
    """A cipher as `rc_cipher`, for any number of radios of one library; must live as long as they do.

    No exception crosses the C: an error of the cipher goes to sys.unraisablehook, the core sees a refusal.
    """

    def __init__(self, library: Library | None = None, cipher: AesCcm | None = None) -> None:
        library = library or load_library()
        ffi, lib = library.ffi, library.lib
        self._cipher = cipher or AesCcm()
        self._buffer = ffi.buffer
        self._key_bytes: int = lib.RC_KEY_BYTES
        self._nonce_bytes: int = lib.RC_NONCE_BYTES
        self._header_bytes: int = lib.RC_HEADER_BYTES
        self._seal = ffi.callback("rc_seal_port", self._on_seal, error=False)
        self._open = ffi.callback("rc_open_port", self._on_open, error=False)
        self.struct: Any = ffi.new("rc_cipher *", {"seal": self._seal, "open": self._open})

    def _given(self, key: Any, nonce: Any, header: Any) -> tuple[bytes, bytes, bytes]:
        return (
            self._buffer(key, self._key_bytes)[:],
            self._buffer(nonce, self._nonce_bytes)[:],
            self._buffer(header, self._header_bytes)[:],
        )

    def _on_seal(self, _: Any, key: Any, nonce: Any, header: Any, body: Any, n: int, out: Any) -> bool:
        sealed = self._cipher.seal(*self._given(key, nonce, header), self._buffer(body, n)[:])
        self._buffer(out, n + TAG_BYTES)[:] = sealed
        return True

    def _on_open(self, _: Any, key: Any, nonce: Any, header: Any, sealed: Any, n: int, out: Any) -> bool:
        body = self._cipher.open(*self._given(key, nonce, header), self._buffer(sealed, n)[:])
        if body is None:
            return False
        self._buffer(out, n - TAG_BYTES)[:] = body
        return True


@functools.lru_cache(maxsize=64)
def _keyed(key: bytes) -> AESCCM:
    return AESCCM(key, tag_length=TAG_BYTES)


@functools.cache
def load_cipher(library: Library) -> CipherPort:
    """The one port that the radios of a library share."""
    return CipherPort(library)
