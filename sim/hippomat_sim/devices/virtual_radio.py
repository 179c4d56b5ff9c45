"""The radio of a simulated robot: the firmware's own C between a serial port and the medium. Knows no frames.

Time is the world's, in microseconds; the radio's own clock starts at its boot.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field

from hippomat_sim.medium import Medium
from hippomat_sim.radio import Radio


@dataclass(slots=True)
class VirtualRadio:
    """One station of the medium. Deterministic given the seed."""

    station: int
    seed: int
    medium: Medium
    boot_us: int = 0
    fleet: int = 1
    radio: Radio = field(init=False)

    def __post_init__(self) -> None:
        digest = hashlib.sha256(b"hippomat radio %d %d" % (self.seed, self.station)).digest()
        mac = bytes((0x02, *digest[:5]))  # 02: locally administered
        boot_id = int.from_bytes(digest[5:9], "little") or 1
        self.radio = Radio(mac, boot_id=boot_id, boot_counter=1, fleet=self.fleet)

    def receive(self, now_us: int, data: bytes) -> None:
        """Bytes from the host."""
        self.radio.usb_rx(now_us - self.boot_us, data)
        self._offer(now_us)

    def tick(self, now_us: int) -> None:
        """Time passes; at least every 10 ms."""
        self.radio.tick(now_us - self.boot_us)
        self._offer(now_us)

    def heard(self, now_us: int, rssi_dbm: int, frame: bytes) -> None:
        """A frame from the medium."""
        self.radio.air_rx(now_us - self.boot_us, rssi_dbm, frame)
        self._offer(now_us)

    def sent(self, now_us: int) -> None:
        """Our frame has left the air."""
        self.radio.air_done(now_us - self.boot_us, True)
        self._offer(now_us)

    def for_host(self) -> bytes:
        """Bytes that wait for the host."""
        return self.radio.usb_tx()

    def _offer(self, now_us: int) -> None:
        frame = self.radio.air_tx(now_us - self.boot_us)
        if frame is not None:
            self.medium.send(now_us, self.station, frame)
