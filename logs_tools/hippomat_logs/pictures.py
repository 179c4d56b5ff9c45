"""Matplotlib figures (extra `viz`) without pyplot, which would keep every picture and may want a screen.

Decides what is said where matplotlib is missing, and which names a picture may have.
"""

from __future__ import annotations

from importlib.util import find_spec
from pathlib import Path
from typing import Any

from hippomat_core.errors import HippomatError
from hippomat_logs.outputs import refuse_undrawable

PICTURES = (".png", ".pdf", ".svg")


def require_matplotlib() -> None:
    """HippomatError with the command that installs it: better before long work than after it."""
    if find_spec("matplotlib") is None:
        raise HippomatError("matplotlib is not installed: pip install 'hippomat[viz]'")


def new_figure(inches: tuple[float, float], **options: Any) -> Any:
    """An empty figure; savefig() writes it in any of PICTURES."""
    require_matplotlib()
    from matplotlib.backends.backend_agg import FigureCanvasAgg  # matplotlib loads slowly
    from matplotlib.figure import Figure

    figure = Figure(inches, **options)
    FigureCanvasAgg(figure)
    return figure


def refuse_no_picture(path: Path) -> None:
    """HippomatError where no picture can be drawn, or not at that place: asked before long work."""
    refuse_undrawable(path, PICTURES)
    require_matplotlib()
