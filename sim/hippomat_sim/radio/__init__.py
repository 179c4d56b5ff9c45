"""The firmware's own radio core, compiled for this machine and driven from Python."""

from hippomat_sim.radio.binding import Library, load_library
from hippomat_sim.radio.build import BuildError
from hippomat_sim.radio.radio import Counters, Identity, Radio

__all__ = ["BuildError", "Counters", "Identity", "Library", "Radio", "load_library"]
