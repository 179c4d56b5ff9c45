"""The seed corpus of the fuzz targets, from the golden wire; one folder a target.

    python tests/firmware/fuzz_corpus.py DIRECTORY
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

GOLDEN = Path(__file__).resolve().parent.parent / "golden/wire.json"


def seeds() -> dict[str, list[bytes]]:
    """Inputs by target: fuzz_frame, fuzz_air, fuzz_usb."""
    wire = json.loads(GOLDEN.read_text())
    frames = [bytes.fromhex(golden["bytes"]) for golden in wire["frames"].values()]
    framed = [bytes.fromhex(golden["framed"]) for golden in wire["messages"].values()]
    heard = [bytes([len(frame), 1 + at % 3, 20]) + frame for at, frame in enumerate(frames)]
    return {
        "fuzz_frame": frames,
        "fuzz_air": [*heard, b"".join(heard[:8]), b"".join(heard)],
        "fuzz_usb": [*framed, b"".join(framed), b"\1" + b"".join(framed), b"boot text\r\n\0" + framed[0]],
    }


def write(directory: Path) -> None:
    """The seeds as files, named by target and number."""
    for target, inputs in seeds().items():
        folder = directory / target
        folder.mkdir(parents=True, exist_ok=True)
        for number, data in enumerate(inputs):
            (folder / f"seed-{number:02d}").write_bytes(data)


if __name__ == "__main__":
    write(Path(sys.argv[1]))
