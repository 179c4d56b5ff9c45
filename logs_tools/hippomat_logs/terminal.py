"""The console of our commands. Decides that whoever stops reading ends the command, as with other tools."""

from __future__ import annotations

import sys

from rich.console import Console

PIPE_CLOSED = 141  # what a shell says of a program that SIGPIPE ended: `hippomat-logs ... | head`


class Terminal(Console):
    """Lines are wrapped on a terminal only: in a pipe each is whole."""

    def __init__(self, *, stderr: bool = False) -> None:
        stream = sys.stderr if stderr else sys.stdout
        super().__init__(stderr=stderr, highlight=False, soft_wrap=not stream.isatty())

    def on_broken_pipe(self) -> None:
        """rich would end the process with 1, an error of ours; entry.py knows better."""
        raise BrokenPipeError
