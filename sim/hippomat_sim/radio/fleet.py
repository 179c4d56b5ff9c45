"""A whole fleet of real radio cores on one medium, each with the least of a host, in simulated time.

For benchmarks and tests of the radio alone: no world, no daemons. A host answers every Round with a valid
STATE a few milliseconds later, as the daemon does. Clocks are off by up to `drift_ppm`. Deterministic, given
the set-up and what is done to the fleet.
"""

from __future__ import annotations

import random
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hippomat_core.errors import HippomatError
from hippomat_sim.air import AirSettings, Ended
from hippomat_sim.medium import Medium
from hippomat_sim.radio.binding import load_fleet_library
from hippomat_sim.radio.memory import Memory
from hippomat_sim.radio.radio import Condition, Radio

STRETCH_US = 100  # shorter than any frame's airtime: see fleet_driver.h
NEVER_US = 2**63 - 1


@dataclass(frozen=True, slots=True)
class FleetSetup:
    """Everything that decides a run but what is done to the fleet in it."""

    robots: int = 30
    tasks: int = 30
    round_ms: int = 100
    spares: int = 0  # more stations, off at first
    seed: int = 1
    air: AirSettings = field(default_factory=AirSettings)
    drift_ppm: float = 100.0
    boots_within_us: int = 1_000_000
    answer_us: tuple[int, int] = (2000, 6000)  # from a Round to the host's next STATE, uniform
    side_m: float = 8.0  # of the square in which they stand


class RadioFleet:
    """Stations 0 .. robots - 1 are the robots of that id, the spares follow. Times in us since the begin."""

    def __init__(self, setup: FleetSetup) -> None:
        self.setup = setup
        self.now_us = 0
        self.stations = setup.robots + setup.spares
        self.medium = Medium(self.stations, setup.air, setup.seed)
        self.on_ended: list[Callable[[Ended], None]] = []
        self.radios: dict[int, Radio] = {}  # the last of each station, off or on
        self.boot_us: dict[int, int] = {}  # of those that are on
        self._library = load_fleet_library()
        self._fleet = self._library.ffi.new("fd_fleet *")
        self._library.lib.fd_init(self._fleet)
        self._fleet.answer_min_us = setup.answer_us[0]
        self._fleet.answer_span_us = setup.answer_us[1] - setup.answer_us[0]
        self._told: list[NDArray[Any]] = []
        self._round_type = self._type_of("fd_round")
        self._rounds = self._array(self._fleet.rounds, self._round_type)
        self._times_us = np.zeros(self._library.lib.FD_STATIONS, np.int64)
        self._random = random.Random(f"radio fleet {setup.seed}")
        self._macs = [bytes((2, *self._random.randbytes(5))) for _ in range(self.stations)]
        self._rates = [1 + self._random.uniform(-1, 1) * setup.drift_ppm / 1e6 for _ in self._macs]
        self.medium.positions_m = [
            (self._random.uniform(0, setup.side_m), self._random.uniform(0, setup.side_m)) for _ in self._macs
        ]
        for robot in range(setup.robots):
            self.boot(robot, self._random.randrange(setup.boots_within_us))

    def boot(self, station: int, at_us: int | None = None, robot: int | None = None) -> None:
        """Switch it on, or off and on. Its flash is as it was left; `robot` gives it another id."""
        at_us = max(self.now_us, at_us or 0)
        setup, before = self.setup, self.radios.get(station)
        if before is None or robot is not None:
            robot = station if robot is None else robot
            memory = Memory(robot, round_ms=setup.round_ms, slots=setup.robots)
        else:
            memory = before.memory
        boot_id = self._random.randrange(1, 2**32)
        radio = Radio(self._macs[station], boot_id, memory.counted(), library=self._library)
        self.radios[station], self.boot_us[station] = radio, at_us
        lib, fleet = self._library.lib, self._fleet
        lib.fd_boot(fleet, station, radio.handle, at_us, self._rates[station])
        lib.fd_host(fleet, station, memory.robot, setup.robots, setup.tasks)

    def kill(self, station: int) -> None:
        """Switch it off."""
        lib, ffi = self._library.lib, self._library.ffi
        lib.fd_boot(self._fleet, station, ffi.NULL, self.now_us, self._rates[station])
        self.boot_us.pop(station, None)

    def tell(self, station: int, data: bytes) -> None:
        """Bytes from its host."""
        self._library.lib.fd_usb(self._fleet, station, self.now_us, data, len(data))
        self._take_sends()

    def run(self, until_us: int) -> None:
        """Everything up to and with until_us."""
        lib, fleet, medium = self._library.lib, self._fleet, self.medium
        while True:
            radio_us, air_us = lib.fd_next_us(fleet), medium.next_us()
            air_us = NEVER_US if air_us is None else air_us
            if min(radio_us, air_us) > until_us:
                break
            if radio_us <= air_us:
                lib.fd_advance(fleet, min(radio_us + STRETCH_US, air_us, until_us))
                self._take_sends()
                self._take_rounds()
            elif (ended := medium.pop_ended(min(radio_us - 1, until_us))) is not None:
                self._ended(ended)
        self.now_us = until_us
        if fleet.overruns:
            raise HippomatError(f"the fleet driver lost {fleet.overruns} events: its queues are too short")

    def rounds(self) -> NDArray[Any]:
        """What the hosts were told since the last call: station, round, held, wrong, agreed, at_us."""
        told, self._told = self._told, []
        return np.concatenate(told) if told else np.zeros(0, self._round_type)

    def fleet_times_us(self) -> NDArray[np.int64]:
        """(S,) what every station takes for the fleet's time now; -1 where it is off."""
        times = self._library.ffi.from_buffer("int64_t[]", self._times_us)
        self._library.lib.fd_fleet_times(self._fleet, self.now_us, times)
        return self._times_us[: self.stations].copy()

    def stopped_us(self) -> list[int | None]:
        """When each station latched the STOP that it has."""
        stations = self._fleet.stations
        times = [stations[station].stopped_us for station in range(self.stations)]
        return [None if time_us == NEVER_US else time_us for time_us in times]

    def steps_back(self) -> int:
        """How often a station's fleet time went back while it was on."""
        return sum(self._fleet.stations[station].steps_back for station in range(self.stations))

    def own_us(self, station: int) -> int:
        """The station's own clock."""
        return int((self.now_us - self.boot_us[station]) * self._rates[station])

    def condition(self, station: int) -> Condition:
        """What the station's status would say now."""
        return self.radios[station].condition(self.own_us(station))

    def _ended(self, ended: Ended) -> None:
        from_buffer = self._library.ffi.from_buffer
        self._library.lib.fd_ended(
            *(self._fleet, ended.sender, ended.at_us, ended.frame, len(ended.frame), len(ended.receivers)),
            from_buffer("int64_t[]", ended.receivers),
            from_buffer("int64_t[]", ended.arrivals_us),
            from_buffer("int8_t[]", ended.rssi_dbm),
        )
        for observer in self.on_ended:
            observer(ended)

    def _take_sends(self) -> None:
        fleet, buffer = self._fleet, self._library.ffi.buffer
        for k in range(fleet.send_count):
            send = fleet.sends[k]
            self.medium.send(send.at_us, send.station, bytes(buffer(send.frame, send.length)))
        fleet.send_count = 0

    def _take_rounds(self) -> None:
        if self._fleet.round_count:
            self._told.append(self._rounds[: self._fleet.round_count].copy())
            self._fleet.round_count = 0

    def _array(self, cdata: Any, dtype: np.dtype[Any]) -> NDArray[Any]:
        return np.frombuffer(self._library.ffi.buffer(cdata), dtype)

    def _type_of(self, name: str) -> np.dtype[Any]:
        """The numpy type of a C struct of integers."""
        ffi = self._library.ffi
        members = ffi.typeof(name).fields
        kinds = ["i" if one.type.cname.startswith("int") else "u" for _, one in members]
        return np.dtype(
            {
                "names": [member for member, _ in members],
                "formats": [
                    f"{kind}{ffi.sizeof(one.type)}" for kind, (_, one) in zip(kinds, members, strict=True)
                ],
                "offsets": [one.offset for _, one in members],
                "itemsize": ffi.sizeof(name),
            }
        )
