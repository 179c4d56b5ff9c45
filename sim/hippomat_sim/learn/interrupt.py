"""Ctrl-C as a question that a loop asks; a second Ctrl-C does not wait for the answer."""

from __future__ import annotations

import signal
from types import FrameType, TracebackType


class Interrupt:
    """A context in which the first SIGINT or SIGTERM sets `asked`, and the next one is KeyboardInterrupt."""

    def __init__(self) -> None:
        self.asked = False

    def __enter__(self) -> Interrupt:
        self._before = {
            number: signal.signal(number, self._ask) for number in (signal.SIGINT, signal.SIGTERM)
        }
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def _ask(self, _number: int, _frame: FrameType | None) -> None:
        if self.asked:
            raise KeyboardInterrupt
        self.asked = True
