"""Lets the tests of this folder share wire_values.py."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))
