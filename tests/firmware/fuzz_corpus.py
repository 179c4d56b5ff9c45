"""The seed corpus of the fuzz targets, from the golden wire; one folder a target.

python tests/firmware/fuzz_corpus.py DIRECTORY
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
from radio_desk import a_state

from hippomat_core.wire import codec
from hippomat_core.wire import frames as air

GOLDEN = Path(__file__).resolve().parent.parent / "golden/wire.json"


def seeds() -> dict[str, list[bytes]]:
    """Inputs by target: fuzz_frame, fuzz_air, fuzz_usb."""
    wire = json.loads(GOLDEN.read_text())
    frames = [bytes.fromhex(golden["bytes"]) for golden in wire["frames"].values()]
    framed = [bytes.fromhex(golden["framed"]) for golden in wire["messages"].values()]
    heard = [bytes([len(frame), 1 + at % 3, 20]) + frame for at, frame in enumerate(frames)]
    return {
        "fuzz_frame": frames,
        "fuzz_air": [*heard, b"".join(heard[:8]), b"".join(heard), a_fleet()],
        "fuzz_usb": [*framed, b"".join(framed), b"\1" + b"".join(framed), b"boot text\r\n\0" + framed[0]],
    }


def a_fleet() -> bytes:
    """STATE and RELAY of robots of the targets' own fleet (radios.h), so that the table keeps them."""
    frames = []
    for sender in (5, 6, 7):
        header = air.Header(air.STATE, False, 1, sender, 1, 1, 700_000)
        frames.append(codec.encode_frame(header, a_state(sender, n=30, m=30, digest=0xABCD)))
        costs = np.arange(30, dtype=np.uint8) + sender
        rows = tuple(
            air.RelayRow(robot, 0, 0, 255, 0, 0, False, 0, True, False, 0, 0, 0, 0, costs)
            for robot in range(sender, sender + 5)
        )
        relay = air.RelayFrame(30, 0x0FF0 << sender % 8, rows)
        frames.append(codec.encode_frame(air.Header(air.RELAY, False, 1, sender, 1, 2, 740_000), relay))
    return b"".join(bytes([len(frame), frame[2], 20]) + frame for frame in frames)


def write(directory: Path) -> None:
    """The seeds as files, named by target and number."""
    for target, inputs in seeds().items():
        folder = directory / target
        folder.mkdir(parents=True, exist_ok=True)
        for number, data in enumerate(inputs):
            (folder / f"seed-{number:02d}").write_bytes(data)


if __name__ == "__main__":
    write(Path(sys.argv[1]))
