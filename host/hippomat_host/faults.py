"""What a user sees of a fault that nobody foresaw: one line, and where the traceback was put."""

from __future__ import annotations

import tempfile
import time
import traceback
from pathlib import Path

from hippomat_core.errors import HippomatError


def as_error(fault: BaseException, directory: str = "", comfort: str = "") -> HippomatError:
    """comfort: what is all right nevertheless, e.g. that the motors were stopped."""
    text = "".join(traceback.format_exception(fault))
    name = time.strftime("hippomat-host-fault-%Y%m%dT%H%M%S.txt")
    said = f"internal fault ({type(fault).__name__}: {fault}){f'; {comfort}' if comfort else ''}"
    for folder in filter(None, (directory, tempfile.gettempdir())):
        path = Path(folder) / name
        try:
            path.write_text(text, encoding="utf-8")
        except OSError:
            continue
        return HippomatError(f"{said}; please report {path}")
    return HippomatError(said)
