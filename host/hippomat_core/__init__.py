"""The robot core: pure state machines for allocation, planning and motion. Knows no clock, port or file."""

__version__ = "0.1.0"
