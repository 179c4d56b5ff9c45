"""For all tests.

A shell that starts a command in the background has it ignore Ctrl-C, and so would every process that a test
starts and interrupts.
"""

from __future__ import annotations

import signal

if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)
