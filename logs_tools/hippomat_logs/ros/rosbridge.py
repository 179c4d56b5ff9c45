"""The rosbridge v2 protocol as values: what goes over the websocket, in both directions. No socket.

Binary frames are CBOR, text frames JSON; `fragment` pieces are put together again. A server that does not
know `cbor-raw` answers in JSON, so the form of each message decides how it is read, never what was asked for.
Source: ROSBRIDGE_PROTOCOL.md of rosbridge_suite.
"""

from __future__ import annotations

import importlib
import json
from collections.abc import Mapping
from typing import Any

from hippomat_core.errors import HippomatError

PIP = "pip install 'hippomat[ros]'"
MOST_FRAGMENTS = 10_000
MOST_BYTES = 64 << 20  # of one message: a map of 8,000 x 8,000 cells
OPEN_FRAGMENTED = 8  # messages whose pieces are still coming


def cbor() -> Any:
    """The cbor2 module, of the extra `ros`."""
    try:
        import cbor2
    except ImportError:
        raise HippomatError(f"cbor2 is not installed: {PIP}") from None
    return cbor2


def websockets_sync(what: str) -> Any:
    """websockets.sync.client or .server, of the extra `ros`."""
    try:
        return importlib.import_module(f"websockets.sync.{what}")
    except ImportError:
        raise HippomatError(f"websockets (12 or newer) is not installed: {PIP}") from None


def subscribe(topic: str, kind: str, encoding: str, throttle_ms: int = 0, queue: int = 0) -> dict[str, Any]:
    """encoding: cbor-raw or json. A queue of 1 keeps the newest, of 0 all."""
    compression = "none" if encoding == "json" else encoding
    wanted = {"op": "subscribe", "id": f"hippomat:{topic}", "topic": topic, "type": kind}
    return {**wanted, "compression": compression, "throttle_rate": throttle_ms, "queue_length": queue}


def unsubscribe(topic: str) -> dict[str, Any]:
    return {"op": "unsubscribe", "id": f"hippomat:{topic}", "topic": topic}


def advertise(topic: str, kind: str) -> dict[str, Any]:
    return {"op": "advertise", "id": f"hippomat:{topic}", "topic": topic, "type": kind}


def unadvertise(topic: str) -> dict[str, Any]:
    return {"op": "unadvertise", "id": f"hippomat:{topic}", "topic": topic}


def publish(topic: str, message: Mapping[str, Any]) -> dict[str, Any]:
    return {"op": "publish", "topic": topic, "msg": message}


class Incoming:
    """Frames of one websocket in, operations out; what is no operation is counted and left out."""

    def __init__(self) -> None:
        self.garbage = 0
        self._pieces: dict[str, dict[int, str]] = {}

    def operation(self, frame: str | bytes) -> dict[str, Any] | None:
        """The operation that this frame is or completes, None for an incomplete one or garbage."""
        operation = _parsed(frame)
        if operation is not None and operation.get("op") == "fragment":
            try:
                operation = self._whole(operation)
            except (KeyError, TypeError, ValueError):
                operation = None
            if operation is not None and not operation:
                return None
        if operation is None or not isinstance(operation.get("op"), str):
            self.garbage += 1
            return None
        return operation

    def _whole(self, piece: Mapping[str, Any]) -> dict[str, Any] | None:
        """The message that its last missing piece completes; {} while pieces are missing."""
        name, number, total = str(piece["id"]), int(piece["num"]), int(piece["total"])
        if not 0 <= number < total <= MOST_FRAGMENTS:
            raise ValueError(f"fragment {number} of {total}")
        pieces = self._pieces.setdefault(name, {})
        pieces[number] = str(piece["data"])
        if len(pieces) < total:
            if len(self._pieces) > OPEN_FRAGMENTED:  # one whose pieces were lost must not stay for ever
                del self._pieces[next(iter(self._pieces))]
            return {}
        del self._pieces[name]
        return _parsed("".join(pieces[number] for number in range(total)))


def _parsed(frame: str | bytes) -> dict[str, Any] | None:
    try:
        value = json.loads(frame) if isinstance(frame, str) else cbor().loads(frame)
    except HippomatError:
        raise
    except Exception:  # whatever a decoder makes of garbage
        return None
    return value if isinstance(value, dict) else None


def fragments(text: str, size: int, name: str) -> list[str]:
    """The pieces of a JSON text, as a server sends them that was asked for fragment_size."""
    parts = [text[at : at + size] for at in range(0, len(text), size)]
    head = {"op": "fragment", "id": name, "total": len(parts)}
    return [json.dumps({**head, "num": number, "data": part}) for number, part in enumerate(parts)]
