"""No nonce goes to the cipher twice under one key: over reboots, crashes, an erased flash, a cloned id."""

from __future__ import annotations

from collections import Counter
from typing import Any

import numpy as np
import pytest
from c_values import RADIO
from radio_desk import a_radio, a_state, mac_of, messages, send, sent_until
from sealed_desk import FLEET, KEY

from hippomat_core.wire import link
from hippomat_sim.radio import Memory, Radio
from hippomat_sim.radio.cipher import AesCcm, CipherPort

UNIX_S = 1_790_000_000


class Recorder(AesCcm):
    """A cipher that remembers every nonce it encrypted with."""

    def __init__(self) -> None:
        self.used: list[tuple[bytes, bytes]] = []  # key, nonce

    def seal(self, key: bytes, nonce: bytes, header: bytes, body: bytes) -> bytes:
        self.used.append((key, nonce))
        return super().seal(key, nonce, header, body)


class Station:
    """A radio with its flash, as the shell runs it: a boot counter is stored before its boot, what changed
    after every step; a radio that was provisioned restarts."""

    def __init__(self, mac: bytes, port: CipherPort, flash: Memory | None = None) -> None:
        self.mac, self.port = mac, port
        self.flash = flash or Memory()
        self.writable = True

    def boot(self, sequence: int = 0) -> None:
        counted = self.flash.counted()
        if self.writable:
            self.flash = counted
        port = self.port

        class Recorded(Radio):
            def _config(self, *given: Any) -> Any:
                config = super()._config(*given)
                config.cipher = port.struct[0]
                return config

        self.now_us = 0
        self.radio = Recorded(self.mac, 1, counted, boot_kept=self.writable, sequence=sequence)

    def run(self, until_us: int) -> int:
        """Steps until then, or until it restarts; how many frames it sent."""
        frames = 0
        while self.now_us <= until_us:
            self.radio.tick(self.now_us)
            self.store()
            if self.radio.air_tx(self.now_us) is not None:
                frames += 1
                self.radio.air_done(self.now_us + 1, True)
            if self.radio.wants_restart:
                self.boot()
                return frames
            self.now_us = max(self.radio.next_us(self.now_us), self.now_us + 1)
        return frames

    def store(self) -> None:
        parts = self.radio.dirty
        if parts and self.writable:
            self.flash = self.radio.memory
        if parts:
            self.radio.kept(parts, self.writable)

    def provision(self, robot: int, unix_s: int, key: bytes = KEY) -> None:
        given = link.Provision(link.LINK_VERSION, robot, FLEET, 6, 6, key, unix_s)
        self.radio.usb_rx(self.now_us, link.encode_message(given))
        self.store()
        assert [answer.stored for answer in messages(self.radio, link.Provisioned)] == [True]
        self.run(self.now_us)


def a_life(station: Station, rng: np.random.Generator) -> int:
    """One boot, cut off at some time: STATE in its slot, often a STOP, at times the last sequence numbers."""
    station.boot(sequence=2**24 - 4 if rng.random() < 0.1 else 0)
    if rng.random() < 0.5:
        station.radio.press_button(0)
    send(station.radio, a_state(1))
    frames = station.run(int(rng.integers(0, 450_000)))
    send(station.radio, a_state(2), station.now_us)
    return frames + station.run(station.now_us + 120_000)


def new(mac: bytes, port: CipherPort, robot: int, unix_s: int) -> Station:
    station = Station(mac, port)
    station.boot()
    station.provision(robot, unix_s)
    return station


@pytest.mark.timeout(300)
def test_over_a_thousand_reboots_an_erased_flash_and_a_cloned_id_no_nonce_is_used_twice():
    cipher, rng = Recorder(), np.random.default_rng(7)
    port = CipherPort(RADIO, cipher)
    first, second = new(mac_of(1), port, 1, UNIX_S), new(mac_of(2), port, 2, UNIX_S)
    clone = Station(mac_of(3), port, first.flash)  # another chip with the first one's flash: its id, its key
    stations, silent, frames = (first, second, clone), 0, Counter[bytes]()
    for reboot in range(1000):
        unix_s = UNIX_S + 3 * reboot  # no radio boots more than once in a second
        station = stations[reboot % 3]
        if reboot % 100 == 50:
            station.flash = Memory()  # erased, and provisioned again
            station.boot()
            station.provision(int(rng.integers(0, 5)), unix_s)
        if reboot % 100 == 75:
            station.boot()  # provisioned again with nothing erased, by a machine whose clock is behind
            station.provision(1, UNIX_S)
        station.writable = reboot % 20 != 10
        sent = a_life(station, rng)
        if not station.writable:
            silent += sent == 0
        station.writable = True
        frames[station.mac] += sent
    assert silent == 50
    assert len(cipher.used) == frames.total() > 5000
    assert min(frames.values()) > 1000
    assert {key for key, _ in cipher.used} == {KEY}
    assert [nonce for (_, nonce), times in Counter(cipher.used).items() if times > 1] == []
    boots = {nonce[6:10] for _, nonce in cipher.used}
    assert len(boots) > 500


def test_the_check_above_would_see_a_boot_counter_that_is_not_stored():
    cipher = Recorder()
    port = CipherPort(RADIO, cipher)
    flash = Memory(robot=1, fleet=FLEET, key=KEY, provisioned=True)
    for _ in range(2):
        a_life(Station(mac_of(1), port, flash), np.random.default_rng(3))
    assert max(Counter(cipher.used).values()) == 2


@pytest.mark.parametrize("kept", [True, False])
def test_a_radio_that_runs_out_of_sequence_numbers_sends_the_next_only_once_a_higher_boot_is_stored(kept):
    radio = a_radio(robot=1, fleet=FLEET, key=KEY, boot_counter=UNIX_S, sequence=2**24 - 2)
    radio.press_button(0)
    before = sent_until_sealed(radio, 0, 300_000)
    assert [header[1:] for header in before] == [(UNIX_S, 2**24 - 1)]
    assert radio.memory.boot_counter == UNIX_S + 1
    radio.kept(radio.dirty, kept)
    after = sent_until_sealed(radio, 300_001, 900_000)
    if kept:
        assert [header[1:] for header in after[:2]] == [(UNIX_S + 1, 1), (UNIX_S + 1, 2)]
    else:
        assert after == []
        assert radio.condition(900_000).flags & link.FLAG_UNSAFE


def sent_until_sealed(radio: Radio, from_us: int, until_us: int) -> list[tuple[int, int, int]]:
    """Kind, boot and sequence of what it sent."""
    found, now_us = [], from_us
    while now_us <= until_us:
        radio.tick(now_us)
        if (frame := radio.air_tx(now_us)) is not None:
            boot, sequence = int.from_bytes(frame[3:7], "little"), int.from_bytes(frame[7:10], "little")
            found.append((frame[0] & 7, boot, sequence))
            radio.air_done(now_us, True)
        now_us = max(radio.next_us(now_us), now_us + 1)
    return found


def test_a_radio_with_a_key_whose_boot_counter_was_not_stored_stays_silent_and_says_so():
    radio = a_radio(robot=1, fleet=FLEET, key=KEY, boot_kept=False)
    radio.press_button(0)
    send(radio, a_state(1))
    assert sent_until_sealed(radio, 0, 900_000) == []
    assert all(status.flags & link.FLAG_UNSAFE for status in messages(radio, link.Status))


def test_without_a_key_a_boot_counter_that_was_not_stored_silences_nothing():
    radio = a_radio(robot=1, boot_kept=False)
    send(radio, a_state(1))
    assert len(sent_until(radio, 0, 900_000)) == 1
    assert not radio.condition(900_000).flags & link.FLAG_UNSAFE


def test_a_silent_radio_with_a_stop_to_send_does_not_ask_to_be_woken_at_once():
    radio = a_radio(robot=1, fleet=FLEET, key=KEY, boot_kept=False)
    radio.press_button(0)
    radio.tick(1)
    assert radio.next_us(1) > 1000
