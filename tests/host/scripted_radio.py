"""A radio that does what a test says: silence, refusal, garbage, going away, as no real one does on demand.

`answers` maps a message type to what is answered: messages, raw bytes, or VANISH and BACK, which unplug the
port and plug it in again. What is not in it is answered as a healthy radio would.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, TypeAlias

from host_devices import Device
from radio_samples import reply_of, status_of

from hippomat_core.wire import frames as air
from hippomat_core.wire.cobs import FrameDecoder
from hippomat_core.wire.link import (
    FLAG_OPEN,
    FLAG_PROVISIONED,
    FLAG_STOPPED,
    AskPeers,
    Command,
    Hello,
    LinkMessage,
    PeerReport,
    Provision,
    Provisioned,
    decode_message,
    encode_message,
)

VANISH, BACK = object(), object()
Answer: TypeAlias = Sequence[LinkMessage | bytes | object]


class ScriptedRadio(Device):
    """`facts`: fields of its HelloReply and Status that are not the samples'."""

    def __init__(self, link: Path, answers: dict[type, Callable[[Any], Answer]] | None = None, **facts: Any):
        self.answers = answers or {}
        self.facts = {"boot_id": 100, "flags": FLAG_OPEN, **facts}
        self.told: list[LinkMessage] = []
        self.peers: list[PeerReport] = []
        self.speaks: list[bytes] = []  # said every 100 ms
        self.stop_counter = self.stop_resumed = 0
        self._frames = FrameDecoder()
        self._next_s = 0.0
        self.counts: dict[str, int] = {}  # of its Status
        self._vanish_s = self._back_s = 0.0
        super().__init__(link)

    def told_of(self, kind: type) -> list[Any]:
        return [message for message in self.told if isinstance(message, kind)]

    def restart(self, **facts: Any) -> None:
        self.facts |= {"boot_id": self.facts["boot_id"] + 1, **facts}

    def run(self) -> None:
        while not self._ended.is_set():
            with self._lock:
                if self.plugged:
                    self._serve()
            if self._vanish_s and time.monotonic() >= self._vanish_s:
                self._vanish_s = 0.0
                self.unplug()
            if self._back_s and time.monotonic() >= self._back_s:
                self._back_s = 0.0
                self.plug_in()
            time.sleep(0.001)

    def hears(self, data: bytes) -> None:
        for payload in self._frames.feed(data):
            message = decode_message(payload)
            self.told.append(message)
            answer = self.answers.get(type(message), self._healthy)
            for part in answer(message):
                self._say(part)

    def passes(self, now_s: float) -> None:
        if self.speaks and now_s >= self._next_s:
            self._next_s = now_s + 0.1
            for part in self.speaks:
                self.sends(part)

    def _say(self, part: LinkMessage | bytes | object) -> None:
        if part is VANISH:
            self._vanish_s = time.monotonic() + 0.05  # what was said before is read by then
        elif part is BACK:
            self._back_s = time.monotonic() + 0.3
        else:
            self.sends(part if isinstance(part, bytes) else encode_message(part))  # type: ignore[arg-type]

    def status(self) -> LinkMessage:
        latched = self.stop_counter > self.stop_resumed
        flags = self.facts["flags"] | FLAG_STOPPED * latched
        counters = {"stop_counter": self.stop_counter, "stop_resumed": self.stop_resumed}
        return status_of(**{**self.facts, **counters, **self.counts, "flags": flags})

    def _healthy(self, message: LinkMessage) -> Answer:
        if isinstance(message, Hello):
            return [reply_of(**self.facts)]
        if isinstance(message, AskPeers):
            return [*self.peers, self.status()]
        if isinstance(message, Provision):
            return self.provisioned(message)
        if isinstance(message, Command) and message.kind == air.STOP:
            self.stop_counter = max(self.stop_counter, self.stop_resumed + 1)
        elif isinstance(message, Command):
            self.stop_resumed = message.counter
        return []

    def provisioned(self, wanted: Provision) -> Answer:
        """Becomes what was wanted."""
        flags = FLAG_PROVISIONED | (0 if wanted.key else FLAG_OPEN)
        self.restart(
            robot=wanted.robot,
            fleet=wanted.fleet,
            channel=wanted.channel,
            rate_mbps=wanted.rate_mbps,
            flags=flags,
        )
        return [Provisioned(True, wanted.unix_s)]
