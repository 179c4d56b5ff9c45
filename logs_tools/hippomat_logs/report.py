"""What a replay found, as values: one result per level, the first divergence, and the process's exit code."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import Any

REPRODUCED, TOOL_ERROR, DIVERGED, DAMAGED = 0, 1, 2, 3
OK, FAILED, NOT_RUN = "reproduced", "diverged", "not run"
LOSSY = "damaged"
NOT_WHOLE = "not whole"  # checked, and says itself what it lacks; the rest is reproduced all the same
FAULT = "error"
MISSED = "missed"  # a bar that is reported, but fails only when strict


@dataclass(frozen=True, slots=True)
class Divergence:
    """The first place where recorded and replayed differ."""

    level: str
    robot: int
    tick: int  # counts Tick events from 1; 0: before the first
    record: int  # record number
    time_s: float  # since the run's first record
    field: str
    recorded: Any
    replayed: Any

    def __str__(self) -> str:
        where = f"robot {self.robot}, tick {self.tick} (record {self.record}, {self.time_s:.3f} s)"
        values = f"recorded {_short(self.recorded)}, replayed {_short(self.replayed)}"
        return f"{where}, {self.field}: {values}"


def _short(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 120 else text[:117] + "..."


@dataclass(slots=True)
class LevelResult:
    """Outcome of one level on one log; `compared` counts decisions, bytes, records or samples."""

    level: str
    status: str
    compared: int = 0
    unit: str = ""
    detail: str = ""
    notes: list[str] = field(default_factory=list)
    divergence: Divergence | None = None
    figures: dict[str, float] = field(default_factory=dict)  # what was measured, for --json


@dataclass(slots=True)
class RunReport:
    """All levels of one robot's run."""

    name: str
    robot: int
    results: list[LevelResult] = field(default_factory=list)
    file: str = ""  # the first of its run

    @property
    def verdict(self) -> str:
        """ "reproduced L0 L1 L2", or what went wrong first."""
        for result in self.results:
            if result.status in (FAILED, LOSSY, FAULT):
                return f"{result.status} at {result.level}"
        reached = " ".join(result.level for result in self.results if result.status == OK)
        if any(result.status == NOT_WHOLE for result in self.results):
            return f"reproduced {reached} of a log that is not whole" if reached else "the log is not whole"
        return f"reproduced {reached}" if reached else "nothing was compared"

    @property
    def exit_code(self) -> int:
        statuses = {result.status for result in self.results}
        if statuses & {LOSSY, NOT_WHOLE}:
            return DAMAGED
        if FAILED in statuses:
            return DIVERGED
        if FAULT in statuses or OK not in statuses:
            return TOOL_ERROR
        return REPRODUCED

    def as_json(self) -> dict[str, Any]:
        return {**asdict(self), "verdict": self.verdict, "exit_code": self.exit_code}


def overall_exit_code(reports: list[RunReport]) -> int:
    """Damage outweighs divergence, and both outweigh a tool's failure."""
    codes = {report.exit_code for report in reports}
    for code in (DAMAGED, DIVERGED, TOOL_ERROR):
        if code in codes:
            return code
    return REPRODUCED if reports else TOOL_ERROR
