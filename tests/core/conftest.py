"""Lets the tests of this folder share motion_world.py and fleet_world.py."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))
