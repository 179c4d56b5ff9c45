"""What the run cost the robot's computer, and what its radio counted. Knows records only."""

from __future__ import annotations

from dataclasses import dataclass, field
from math import nan

from hippomat_core import messages as m
from hippomat_logs.metrics.samples import Samples
from hippomat_logs.records import ProcessRecord, TimingRecord

RADIO_COUNTERS = (
    *("sent", "received", "relays", "replaced", "send_failed"),
    *("dropped_foreign", "dropped_malformed", "dropped_seal", "dropped_forged", "dropped_replayed"),
    *("dropped_impostor", "dropped_babble", "dropped_usb"),
)


@dataclass(slots=True)
class ComputerMetrics:
    """Of the daemon."""

    compute_ms: Samples = field(default_factory=Samples)  # per pass of its loop (20 a second)
    lag_ms: Samples = field(default_factory=Samples)  # how late each pass began
    cpu_share: float = nan  # of one core, all threads of the process; nan: not recorded
    memory_mib: float = nan  # the most it had; nan: not recorded


class ComputerReading:
    """Timing and process records as they come."""

    def __init__(self) -> None:
        self._metrics = ComputerMetrics()
        self._first: ProcessRecord | None = None
        self._last: ProcessRecord | None = None

    def timing(self, message: TimingRecord) -> None:
        self._metrics.compute_ms.add(message.compute_ns / 1e6)
        self._metrics.lag_ms.add(message.lag_ns / 1e6)

    def process(self, message: ProcessRecord) -> None:
        self._first, self._last = self._first or message, message

    def result(self) -> ComputerMetrics:
        found, first, last = self._metrics, self._first, self._last
        if first is not None and last is not None:
            found.memory_mib = last.peak_memory_kib / 1024
            if last.real_ns > first.real_ns:
                found.cpu_share = (last.cpu_ns - first.cpu_ns) / (last.real_ns - first.real_ns)
        return found


class RadioReading:
    """The radio's counters from its first to its last status; each boot counts anew from 0."""

    def __init__(self) -> None:
        self._before: m.RadioStatus | None = None
        self.counts = dict.fromkeys(RADIO_COUNTERS, 0)
        self.reboots = 0

    def status(self, message: m.RadioStatus) -> None:
        before = self._before
        if before is not None:
            rebooted = before.boot_id != message.boot_id
            self.reboots += rebooted
            for name in RADIO_COUNTERS:
                self.counts[name] += getattr(message, name) - (0 if rebooted else getattr(before, name))
        self._before = message
