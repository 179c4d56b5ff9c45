"""A fleet's frames as one who has its key reads them. Judges nothing: neither replays nor identities."""

from __future__ import annotations

from hippomat_sim.radio.binding import load_library


def opened(key: bytes, mac: bytes, frame: bytes) -> bytes | None:
    """Header and plain body of a frame that the radio with that MAC sent; None for one that is forged.

    key: b"" for an OPEN fleet, whose frames are as they are.
    """
    if not key:
        return frame
    from hippomat_sim.radio.cipher import load_cipher  # an OPEN fleet does without `cryptography`

    library = load_library()
    ffi, lib = library.ffi, library.lib
    plain = ffi.new("uint8_t[]", lib.RC_MAX_FRAME)
    size = lib.rc_unseal(load_cipher(library).struct, key, mac, frame, len(frame), plain)
    return bytes(ffi.buffer(plain, size)) if size else None
