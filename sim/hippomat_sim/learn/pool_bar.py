"""A pool with a progress bar while it is prepared; nothing is shown where it comes from the disk."""

from __future__ import annotations

from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

from hippomat_sim.learn.settings import WorldSettings
from hippomat_sim.learn.world_pool import WorldPool, make_pool


def make_pool_shown(
    settings: WorldSettings, split: str, console: Console, cache: bool | Path = True
) -> WorldPool:
    """make_pool; the bar goes to the console and disappears when it is done."""
    columns = (TextColumn("{task.description}"), BarColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console, transient=True) as bar:
        task = bar.add_task(f"{split} worlds", total=None, visible=False)
        return make_pool(
            settings,
            split,
            lambda done, total: bar.update(task, completed=done, total=total, visible=True),
            cache,
        )
