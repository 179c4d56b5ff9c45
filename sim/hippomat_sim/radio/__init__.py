"""The firmware's own radio core, compiled for this machine and driven from Python."""

from hippomat_sim.radio.binding import Library, load_library
from hippomat_sim.radio.build import BuildError
from hippomat_sim.radio.memory import Memory
from hippomat_sim.radio.radio import Condition, Counters, Radio

__all__ = ["BuildError", "Condition", "Counters", "Library", "Memory", "Radio", "load_library"]
