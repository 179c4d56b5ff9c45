"""One radio as the simulation holds it: the C state machine behind Python methods. Knows no world."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

from hippomat_core.wire import link
from hippomat_sim.radio.binding import Library, load_library
from hippomat_sim.radio.memory import Memory, memory_of

_FIRST_BOOT = Memory(boot_counter=1)


@dataclass(frozen=True, slots=True)
class Counters:
    """rc_counters of link.h, since boot."""

    sent: int
    received: int
    relays: int
    replaced: int
    send_failed: int
    dropped_foreign: int
    dropped_malformed: int
    dropped_seal: int
    dropped_forged: int
    dropped_replayed: int
    dropped_impostor: int
    dropped_babble: int
    dropped_usb: int
    usb_skipped_bytes: int
    usb_bad_checksums: int


@dataclass(frozen=True, slots=True)
class Condition:
    """rc_condition of link.h: the changing part of a status. Bitmaps by robot id."""

    uptime_us: int
    fleet_time_us: int
    flags: int
    stop_counter: int
    stop_resumed: int
    alive: int
    rebooted: int
    babbling: int
    duplicate: int


class Radio:
    """A radio from its boot on; a reboot is a new Radio with another boot_id and memory.counted().

    now_us is the radio's own clock: microseconds since its boot, never going back. boot_kept: the boot
    counter in `memory` was stored before this boot; a radio with a key sends nothing otherwise. sequence:
    numbers that were used in this boot already.
    """

    def __init__(
        self,
        mac: bytes,
        boot_id: int,
        memory: Memory = _FIRST_BOOT,
        *,
        now_us: int = 0,
        boot_kept: bool = True,
        sequence: int = 0,
        reset_reason: int = 1,
        firmware: str = "hippomat sim",
        git_hash: str = "",
        library: Library | None = None,
    ) -> None:
        # The reply that this radio will give; encoding it once refuses what does not fit, by name.
        reply = link.HelloReply(
            *(link.LINK_VERSION, 0, boot_id, memory.boot_counter, reset_reason, mac),
            *(memory.robot, memory.fleet, memory.channel, memory.rate_mbps, 0),
            *(memory.round_ms, memory.slots, firmware, git_hash),
        )
        link.encode_payload(reply)
        self._library = library or load_library()
        ffi, lib = self._library.ffi, self._library.lib
        self._memory = ffi.new("uint64_t[]", (lib.rc_size() + 7) // 8)
        self._rc = ffi.cast("rc_radio *", self._memory)
        self._out = ffi.new("uint8_t[]", 4096)
        self._frame = ffi.new("uint8_t[]", lib.RC_MAX_FRAME)
        lib.rc_init(self._rc, now_us, self._config(reply, memory, boot_kept, sequence))

    def _config(self, reply: link.HelloReply, memory: Memory, boot_kept: bool, sequence: int) -> Any:
        about = {
            "boot_id": reply.boot_id,
            "reset_reason": reply.reset_reason,
            "mac": tuple(reply.mac),
            "firmware": reply.firmware.encode(),
            "git_hash": reply.git_hash.encode(),
        }
        config = {"about": about, "memory": memory.as_struct(), "boot_kept": boot_kept, "sequence": sequence}
        if memory.key:
            from hippomat_sim.radio.cipher import load_cipher  # an OPEN fleet does without `cryptography`

            config["cipher"] = load_cipher(self._library).struct[0]
        return self._library.ffi.new("rc_config *", config)

    @property
    def handle(self) -> Any:
        """The rc_radio, for loops in C over many radios; lives as long as this object."""
        return self._rc

    def usb_rx(self, now_us: int, data: bytes) -> None:
        """Bytes from the host."""
        self._library.lib.rc_usb_rx(self._rc, now_us, data, len(data))

    def usb_tx(self) -> bytes:
        """All framed messages that wait for the host."""
        parts = []
        while size := self._library.lib.rc_usb_tx(self._rc, self._out, len(self._out)):
            parts.append(bytes(self._library.ffi.buffer(self._out, size)))
        return b"".join(parts)

    def air_rx(self, now_us: int, rssi_dbm: int, mac: bytes, frame: bytes) -> None:
        """A frame from the air, whole, and the MAC of the radio that sent it."""
        self._library.lib.rc_air_rx(self._rc, now_us, rssi_dbm, mac, frame, len(frame))

    def air_tx(self, now_us: int) -> bytes | None:
        """The next frame for the air; None while one is in flight or nothing is due."""
        size = self._library.lib.rc_air_tx(self._rc, now_us, self._frame)
        return bytes(self._library.ffi.buffer(self._frame, size)) if size else None

    def air_done(self, now_us: int, ok: bool) -> None:
        """The frame in flight has left (ok) or could not be sent."""
        self._library.lib.rc_air_done(self._rc, now_us, ok)

    def tick(self, now_us: int) -> None:
        """Time passes: when next_us says so, and after everything else."""
        self._library.lib.rc_tick(self._rc, now_us)

    def next_us(self, now_us: int) -> int:
        """When tick or air_tx has work, if nothing comes in before."""
        return int(self._library.lib.rc_next_us(self._rc, now_us))

    def press_button(self, now_us: int) -> None:
        """The STOP button was held."""
        self._library.lib.rc_button(self._rc, now_us)

    @property
    def dirty(self) -> int:
        """RC_KEEP_... parts of the memory that have to be stored."""
        return int(self._library.lib.rc_dirty(self._rc))

    def kept(self, parts: int, ok: bool) -> None:
        """How storing them went."""
        self._library.lib.rc_kept(self._rc, parts, ok)

    @property
    def wants_restart(self) -> bool:
        """It was provisioned, and the host has the answer."""
        return bool(self._library.lib.rc_wants_restart(self._rc))

    @property
    def memory(self) -> Memory:
        return memory_of(self._library.lib.rc_memory_of(self._rc))

    @property
    def counters(self) -> Counters:
        raw = self._library.lib.rc_counters_of(self._rc)
        return Counters(*(getattr(raw, field.name) for field in fields(Counters)))

    def condition(self, now_us: int) -> Condition:
        """What its status would say now."""
        raw = self._library.lib.rc_condition_of(self._rc, now_us)
        return Condition(*(getattr(raw, field.name) for field in fields(Condition)))
