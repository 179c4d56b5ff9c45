"""The radio of a simulated robot: the firmware's own C between serial port and medium. Knows no frames.

Time is the world's, in microseconds; the radio's own clock starts at its boot and runs a little fast or slow.
Does what the shell does on the chip: stores the memory, restarts when asked, wakes the core when it is due.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field

from hippomat_sim.medium import Medium
from hippomat_sim.radio import Memory, Radio

DRIFT_PPM = 20  # of a crystal, at most


def _digest(seed: int, station: int) -> bytes:
    return hashlib.sha256(b"hippomat radio %d %d" % (seed, station)).digest()


def mac_of(seed: int, station: int) -> bytes:
    """The MAC of a simulated radio."""
    return bytes((0x02, *_digest(seed, station)[:5]))  # 02: locally administered


@dataclass(slots=True)
class VirtualRadio:
    """One station of the medium, deterministic given the seed. `memory` is its flash, beyond reboot()."""

    station: int
    seed: int
    medium: Medium
    memory: Memory = field(default_factory=Memory)
    drift_ppm: float | None = None  # None: by the seed, at most DRIFT_PPM
    boots: int = 0
    wake_us: int = 0  # when tick() has work
    radio: Radio = field(init=False)
    _boot_us: int = field(init=False)
    _rate: float = field(init=False)

    def __post_init__(self) -> None:
        digest = _digest(self.seed, self.station)
        if self.drift_ppm is None:
            self.drift_ppm = DRIFT_PPM * (digest[10] / 127.5 - 1)
        self._rate = 1 + self.drift_ppm / 1e6
        # Switched on some time within the second before the world began.
        self._boot(-int.from_bytes(digest[11:14], "little") % 1_000_000 - 1_000_000)

    @property
    def mac(self) -> bytes:
        return mac_of(self.seed, self.station)

    def reboot(self, now_us: int) -> None:
        """Power off and on: what is not in the memory is gone."""
        self._boot(now_us)
        self._settle(now_us)

    def receive(self, now_us: int, data: bytes) -> None:
        """Bytes from the host."""
        self.radio.usb_rx(self._own_us(now_us), data)
        self._settle(now_us)

    def tick(self, now_us: int) -> None:
        """Time has come to wake_us."""
        self._settle(now_us)

    def heard(self, now_us: int, rssi_dbm: int, sender: int, frame: bytes) -> None:
        """A frame from the medium."""
        self.radio.air_rx(self._own_us(now_us), rssi_dbm, mac_of(self.seed, sender), frame)
        self._settle(now_us)

    def sent(self, now_us: int) -> None:
        """Our frame has left the air."""
        self.radio.air_done(self._own_us(now_us), True)
        self._settle(now_us)

    def press_button(self, now_us: int) -> None:
        """STOP."""
        self.radio.press_button(self._own_us(now_us))
        self._settle(now_us)

    def for_host(self) -> bytes:
        """Bytes that wait for the host."""
        return self.radio.usb_tx()

    def _boot(self, now_us: int) -> None:
        self._boot_us = now_us
        self.boots += 1
        self.memory = self.memory.counted()  # stored before anything is sent
        digest = hashlib.sha256(b"%d %s" % (self.boots, _digest(self.seed, self.station))).digest()
        self.radio = Radio(self.mac, int.from_bytes(digest[:4], "little") or 1, self.memory)

    def _own_us(self, now_us: int) -> int:
        return int((now_us - self._boot_us) * self._rate)

    def _settle(self, now_us: int) -> None:
        """What follows every call: time, flash, air, restart, the next wake-up."""
        own_us = self._own_us(now_us)
        self.radio.tick(own_us)
        if dirty := self.radio.dirty:
            self.memory = self.radio.memory
            self.radio.kept(dirty, True)
        if (frame := self.radio.air_tx(own_us)) is not None:
            self.medium.send(now_us, self.station, frame)
        if self.radio.wants_restart:
            self.reboot(now_us)
            return
        due_us = self.radio.next_us(own_us)
        self.wake_us = max(now_us + 1, self._boot_us + -int(-due_us // self._rate))
