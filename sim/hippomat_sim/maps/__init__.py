"""Maps to run on: the recorded turtlebot3 world where it is at hand, else a room of our own."""

from __future__ import annotations

import os
from pathlib import Path

_OWN = Path(__file__).with_name("demo_room.yaml")


def find_demo_map() -> Path:
    """$HIPPOMAT_DATA first, then ../shared/data beside the checkout, then the map that ships with us."""
    checkout = Path(__file__).resolve().parents[3]
    places = [checkout.parent / "shared" / "data"]
    if "HIPPOMAT_DATA" in os.environ:
        places.insert(0, Path(os.environ["HIPPOMAT_DATA"]))
    for place in places:
        path = place / "ros_maps" / "turtlebot3_world.yaml"
        if path.is_file():
            return path
    return _OWN
