"""For all tests: none is timed, and Ctrl-C works.

A shell that starts a command in the background has it ignore Ctrl-C, and so would every process that a test
starts and interrupts.
"""

from __future__ import annotations

import signal

from hypothesis import settings

settings.register_profile("untimed", deadline=None)
settings.load_profile("untimed")
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)
