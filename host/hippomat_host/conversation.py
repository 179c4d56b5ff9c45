"""A conversation with one radio: open its port, learn who it is, exchange messages until a deadline.

Shared by the commands that speak to a radio (provision, radio-info, stop, resume). Knows the messages and
what can go wrong with a port; not what is said, and no fleet.
"""

from __future__ import annotations

import contextlib
import os
import select
import time
from collections import deque
from collections.abc import Iterator
from types import TracebackType
from typing import TypeVar

from hippomat_core.errors import PortError, WireError
from hippomat_core.messages import RADIO
from hippomat_core.wire.cobs import FrameDecoder
from hippomat_core.wire.link import HelloReply, LinkMessage, decode_message, encode_message
from hippomat_host.acceptance import radio_behind
from hippomat_host.identify import ASK, LISTEN_NS, Identifier
from hippomat_host.probe import identify
from hippomat_host.serial_port import RADIO_BAUD, open_port, read_port, write_port

ANSWER_S = 1.0
_STALE_S = 0.1  # what the radio had ready for whoever asks next comes at once
_WRITE_S = 2.0
_REOPEN_S = 0.1

T = TypeVar("T", bound=LinkMessage)


class Vanished(PortError):
    """The port went away: unplugged, or the radio restarted."""


class Conversation:
    """One radio, one port, ours alone. Use as a context. Every method raises PortError in one line."""

    def __init__(self, path: str, *, at_once: bool = False) -> None:
        """Identifies what is behind `path`; at_once: asks before listening, so that a radio answers in ms."""
        self.path = path
        self._fd = -1
        self._restart_frames()
        self.reply = self._open(0 if at_once else LISTEN_NS)

    def __enter__(self) -> Conversation:
        return self

    def __exit__(self, kind: type[BaseException] | None, value: object, trace: TracebackType | None) -> None:
        self.close()

    def close(self) -> None:
        fd, self._fd = self._fd, -1
        if fd >= 0:
            with contextlib.suppress(OSError):
                os.close(fd)

    def _restart_frames(self) -> None:
        self._frames = FrameDecoder()
        self._heard: deque[LinkMessage] = deque()

    def _open(self, listen_ns: int) -> HelloReply:
        self._fd = open_port(self.path, RADIO_BAUD)
        try:
            identifier = Identifier(time.monotonic_ns(), ASK, RADIO, listen_ns)
            reply = radio_behind(self.path, identify(self._fd, identifier))
            self._feed(identifier.leftover)
            return reply
        except OSError as error:
            self.close()
            raise self._vanished(error) from None
        except PortError:
            self.close()
            raise

    def reopen(self, until_s: float) -> None:
        """After Vanished: wait for the port to come back, and open it."""
        self.close()
        self._restart_frames()
        while self._fd < 0:
            try:
                self._fd = open_port(self.path, RADIO_BAUD)
            except PortError:  # gone, not yet ours (udev), or looked at by somebody else
                if time.monotonic() >= until_s:
                    raise
                time.sleep(_REOPEN_S)

    def say(self, message: LinkMessage) -> None:
        data, until_s = encode_message(message), time.monotonic() + _WRITE_S
        try:
            while data := data[write_port(self._fd, data) :]:
                if time.monotonic() >= until_s:
                    raise PortError(f"{self.path} takes no bytes: unplug the radio and plug it in again")
                select.select([], [self._fd], [], 0.1)
        except OSError as error:
            raise self._vanished(error) from None

    def hear(self, until_s: float) -> LinkMessage | None:
        """The next message; None once time.monotonic() has reached until_s. What is no message is skipped."""
        while not self._heard:
            wait_s = until_s - time.monotonic()
            if wait_s <= 0:
                return None
            try:
                if select.select([self._fd], [], [], wait_s)[0]:
                    self._feed(read_port(self._fd))
            except OSError as error:
                raise self._vanished(error) from None
        return self._heard.popleft()

    def listen(self, seconds: float) -> Iterator[LinkMessage]:
        """Messages as they come, for so long."""
        until_s = time.monotonic() + seconds
        while (message := self.hear(until_s)) is not None:
            yield message

    def await_kind(self, kind: type[T], within_s: float = ANSWER_S) -> T | None:
        """The next message of one kind, others being dropped; None if none came in time."""
        return next((message for message in self.listen(within_s) if isinstance(message, kind)), None)

    def ask(self, question: LinkMessage, kind: type[T], within_s: float = ANSWER_S) -> T:
        self.say(question)
        answer = self.await_kind(kind, within_s)
        if answer is None:
            raise PortError(
                f"the radio on {self.path} does not answer any more: unplug it, plug it in again, and repeat"
            )
        return answer

    def forget_stale(self) -> None:
        """Drop what the radio said before now, and ask it again who it is."""
        for _ in self.listen(_STALE_S):
            pass
        self.reply = self.ask(ASK, HelloReply)

    def _feed(self, data: bytes) -> None:
        for payload in self._frames.feed(data):
            with contextlib.suppress(WireError):  # whatever it was, it was no answer
                self._heard.append(decode_message(payload))

    def _vanished(self, error: OSError) -> Vanished:
        return Vanished(
            f"{self.path} went away ({error.strerror or error}): plug the radio in again and repeat"
        )
