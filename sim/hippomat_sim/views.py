"""How a run looks while it goes on: a live table on a terminal, plain lines elsewhere. Changes nothing."""

from __future__ import annotations

import math
import sys
from typing import Protocol

from rich.box import SIMPLE_HEAD
from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text

from hippomat_sim.virtual_fleet import VirtualFleet
from hippomat_sim.world import Contact

_PLAIN_PERIOD_S = 5.0
_STATUS_STYLE = {
    "idle": "dim",
    "assigned": "cyan",
    "serving": "green",
    "blocked": "yellow",
    "lost": "red",
    "silent": "red",
}


class View(Protocol):
    """What a run tells whoever watches."""

    def phase(self, name: str, began_s: float, seconds: float) -> None: ...
    def show(self, now_s: float, fleet: VirtualFleet) -> None: ...
    def note(self, text: str) -> None: ...
    def close(self) -> None: ...


def view_for(console: Console) -> View:
    """The live table on a terminal, else plain lines."""
    return LiveView(console) if console.is_terminal else PlainView(console)


class LiveView:
    """A table that is redrawn in place; no thread of its own."""

    def __init__(self, console: Console) -> None:
        self._live = Live(console=console, auto_refresh=False, transient=False)
        self._name, self._began_s, self._seconds = "", 0.0, 0.0
        self._started = False
        self._table: RenderableType = ""

    def phase(self, name: str, began_s: float, seconds: float) -> None:
        self._name, self._began_s, self._seconds = name, began_s, seconds
        if not self._started:
            self._started = True
            self._live.start()

    def show(self, now_s: float, fleet: VirtualFleet) -> None:
        self._table = fleet_table(fleet)
        self._live.update(Group(self._table, self._progress(now_s)), refresh=True)

    def note(self, text: str) -> None:
        self._live.console.print(Text(text, style="red"))

    def close(self) -> None:
        if self._started:
            self._live.update(self._table, refresh=True)  # without the progress
            self._live.stop()

    def _progress(self, now_s: float) -> RenderableType:
        if not self._seconds:
            return Text(f" {self._name} ...", style="dim")
        gone_s = min(now_s - self._began_s, self._seconds)
        row = Table.grid(padding=(0, 1))
        left = Text(f"{_clock(self._seconds - gone_s)} left", style="bold")
        row.add_row(f" {self._name}", ProgressBar(self._seconds, gone_s, width=44), left)
        return row


class PlainView:
    """One line every few seconds."""

    def __init__(self, console: Console) -> None:
        self._console = console
        self._name, self._began_s, self._seconds = "", 0.0, 0.0
        self._next_s = -math.inf

    def phase(self, name: str, began_s: float, seconds: float) -> None:
        self._name, self._began_s, self._seconds = name, began_s, seconds
        self._next_s = -math.inf
        if not seconds:
            self._print(name)

    def show(self, now_s: float, fleet: VirtualFleet) -> None:
        if not self._seconds or now_s < self._next_s:
            return
        self._next_s = now_s + _PLAIN_PERIOD_S
        heard, counts = fleet.ear.robots, fleet.medium.counts
        statuses = " ".join(f"{robot}:{one.status}" for robot, one in enumerate(heard))
        self._print(
            f"{now_s - self._began_s:5.1f}/{self._seconds:.0f} s  "
            f"{sum(one.served for one in heard)} tasks done, {statuses}; "
            f"{sum(c.sent for c in counts)} frames sent, {sum(c.received for c in counts)} received, "
            f"{sum(c.lost for c in counts)} lost; {len(fleet.world.contacts)} contacts"
        )

    def note(self, text: str) -> None:
        self._print(text)

    def close(self) -> None:
        """Nothing to give back."""

    def _print(self, text: str) -> None:
        self._console.print(text, markup=False, highlight=False, soft_wrap=True)
        sys.stdout.flush()


def fleet_table(fleet: VirtualFleet) -> Table:
    """Robots as rows: where they are, what they say, what their radios did, what they touched."""
    table = Table(title="hippomat: simulated fleet", title_justify="left", title_style="bold")
    table.box, table.padding = SIMPLE_HEAD, (0, 0, 0, 0)
    table.add_column("robot", justify="right", style="bold", no_wrap=True, min_width=5)
    table.add_column(r"x \[m]  y \[m] yaw [°]", justify="right", no_wrap=True)
    table.add_column("status", min_width=8)
    table.add_column("claim", min_width=6)
    for name in ("done", "sent", "recv.", "lost", "contacts"):  # fits 80 columns
        table.add_column(name, justify="right", no_wrap=True)
    contacts = fleet.world.contacts
    for robot, (pose, heard, counts) in enumerate(
        zip(fleet.world.poses.tolist(), fleet.ear.robots, fleet.medium.counts, strict=True)
    ):
        table.add_row(
            str(robot),
            f"{pose[0]:5.2f}  {pose[1]:5.2f}  {math.degrees(math.remainder(pose[2], 2 * math.pi)):5.0f}",
            Text(heard.status, style=_STATUS_STYLE.get(heard.status, "")),
            heard.claim,
            str(heard.served),
            str(counts.sent),
            str(counts.received),
            str(counts.lost),
            _contact_text(contacts, robot),
        )
    return table


def _contact_text(contacts: list[Contact], robot: int) -> Text:
    count = sum(robot in (contact.robot, contact.other) for contact in contacts)
    return Text(str(count), style="bold red" if count else "dim")


def _clock(seconds: float) -> str:
    whole = math.ceil(max(seconds, 0.0))
    return f"{whole // 60}:{whole % 60:02d}"
