"""One radio as the simulation holds it: the C state machine behind Python methods. Knows no world."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

from hippomat_core.wire import link
from hippomat_sim.radio.binding import Library, load_library


@dataclass(frozen=True, slots=True)
class Counters:
    """rc_counters of link.h, since boot."""

    sent: int
    received: int
    replaced: int
    send_failed: int
    dropped_foreign: int
    dropped_malformed: int
    dropped_duplicate: int
    dropped_usb: int
    usb_skipped_bytes: int
    usb_bad_checksums: int


@dataclass(frozen=True, slots=True)
class Identity:
    """Who the radio is; robot 255 listens only."""

    robot: int
    fleet: int
    channel: int


class Radio:
    """A radio from its boot on; a reboot is a new Radio with another boot_id and a higher boot_counter.

    now_us is the radio's own clock: microseconds since its boot, never going back.
    """

    def __init__(
        self,
        mac: bytes,
        boot_id: int,
        boot_counter: int,
        robot: int = link.NO_ROBOT,
        fleet: int = 1,
        channel: int = 1,
        reset_reason: int = 1,
        *,
        firmware: str = "hippomat sim",
        git_hash: str = "",
        library: Library | None = None,
    ) -> None:
        # The reply that this radio will give; encoding it once refuses what does not fit, by name.
        reply = link.HelloReply(
            *(link.LINK_VERSION, 0, boot_id, boot_counter, reset_reason, mac, robot, fleet, channel),
            *(firmware, git_hash),
        )
        link.encode_payload(reply)
        self._library = library or load_library()
        ffi, lib = self._library.ffi, self._library.lib
        self._memory = ffi.new("uint64_t[]", (lib.rc_size() + 7) // 8)
        self._rc = ffi.cast("rc_radio *", self._memory)
        self._out = ffi.new("uint8_t[]", 4096)
        self._frame = ffi.new("uint8_t[]", lib.RC_MAX_FRAME)
        lib.rc_init(self._rc, self._config(reply))

    def _config(self, reply: link.HelloReply) -> Any:
        about = {
            "boot_id": reply.boot_id,
            "boot_counter": reply.boot_counter,
            "reset_reason": reply.reset_reason,
            "mac": tuple(reply.mac),
            "firmware": reply.firmware.encode(),
            "git_hash": reply.git_hash.encode(),
        }
        identity = {"robot": reply.robot, "fleet": reply.fleet, "channel": reply.channel}
        return self._library.ffi.new("rc_config *", {"about": about, "identity": identity})

    def usb_rx(self, now_us: int, data: bytes) -> None:
        """Bytes from the host."""
        self._library.lib.rc_usb_rx(self._rc, now_us, data, len(data))

    def usb_tx(self) -> bytes:
        """All framed messages that wait for the host."""
        parts = []
        while size := self._library.lib.rc_usb_tx(self._rc, self._out, len(self._out)):
            parts.append(bytes(self._library.ffi.buffer(self._out, size)))
        return b"".join(parts)

    def air_rx(self, now_us: int, rssi_dbm: int, frame: bytes) -> None:
        """A frame from the air, whole."""
        self._library.lib.rc_air_rx(self._rc, now_us, rssi_dbm, frame, len(frame))

    def air_tx(self, now_us: int) -> bytes | None:
        """The next frame for the air; None while one is in flight or nothing waits."""
        size = self._library.lib.rc_air_tx(self._rc, now_us, self._frame)
        return bytes(self._library.ffi.buffer(self._frame, size)) if size else None

    def air_done(self, now_us: int, ok: bool) -> None:
        """The frame in flight has left (ok) or could not be sent."""
        self._library.lib.rc_air_done(self._rc, now_us, ok)

    def tick(self, now_us: int) -> None:
        """Time passes; at least every 10 ms."""
        self._library.lib.rc_tick(self._rc, now_us)

    @property
    def identity(self) -> Identity:
        raw = self._library.lib.rc_identity_of(self._rc)
        return Identity(raw.robot, raw.fleet, raw.channel)

    @property
    def counters(self) -> Counters:
        raw = self._library.lib.rc_counters_of(self._rc)
        return Counters(*(getattr(raw, field.name) for field in fields(Counters)))
