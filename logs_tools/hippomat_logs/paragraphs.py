"""Lines of a report on a terminal: wrapped under their indentation there, whole in a pipe. Knows rich."""

from __future__ import annotations

from rich.console import Console
from rich.padding import Padding
from rich.text import Text


def say(console: Console, text: str, indent: int = 0, style: str = "") -> None:
    """One paragraph; brackets in it are no markup."""
    if console.is_terminal and indent:
        console.print(Padding(Text(text, style=style), (0, 0, 0, indent)))
    else:
        console.print(Text(" " * indent + text, style=style), soft_wrap=not console.is_terminal)
