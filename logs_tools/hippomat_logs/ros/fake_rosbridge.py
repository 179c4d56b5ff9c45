"""A stand-in for rosbridge_server: the real protocol over a real websocket, with topics instead of a ROS.

It serves replay, tests, and a look at a daemon without a ROS system. It does what the server does for
subscribe, unsubscribe, advertise, unadvertise and publish: latched topics, cbor-raw or JSON per subscription,
fragments of JSON where a client wants them, throttling, status messages for what is wrong.
"""

from __future__ import annotations

import contextlib
import json
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from hippomat_core.messages import Event, TransformReceived
from hippomat_logs.ros.dialect import ROS2, TF, Dialect, short_name, to_json
from hippomat_logs.ros.events import message_of
from hippomat_logs.ros.rosbridge import cbor, fragments, websockets_sync


@dataclass(slots=True)
class _Topic:
    kind: str  # as ROS 2 names it
    latched: bool
    raw: bool | None = None  # as its first subscriber wanted it, of a ROS 2 rosbridge; None: nobody did
    kept: dict[str, Any] = field(default_factory=dict)  # /tf_static has many publishers: one each child


@dataclass(slots=True, eq=False)
class _Client:
    socket: Any
    lock: threading.Lock = field(default_factory=threading.Lock)  # a websocket is written by one at a time
    wanted: dict[str, dict[str, Any]] = field(default_factory=dict)  # topic -> its subscribe
    early: set[str] = field(default_factory=set)  # subscribed to before there was a publisher
    sent_s: dict[str, float] = field(default_factory=dict)
    advertised: dict[str, str] = field(default_factory=dict)  # topic -> type


class FakeRosbridge:
    """A server on a port of the loopback interface, as a context.

    ros: whose serialisation its bytes are (dialect.ROS1, ROS2)   knows_cbor: an old server does not
    once: subscriptions are made once and not throttled, so that all that is said comes exactly once (replay)
    heard: what clients published, (monotonic [s], topic, message as JSON), in order
    """

    def __init__(self, ros: int = ROS2, port: int = 0, knows_cbor: bool = True, once: bool = False) -> None:
        self._serve = websockets_sync("server").serve
        self.dialect = Dialect()
        self.ros, self.port, self.knows_cbor, self._once = ros, port, knows_cbor, once
        self.heard: list[tuple[float, str, dict[str, Any]]] = []
        self._topics: dict[str, _Topic] = {}
        self._clients: list[_Client] = []
        self._lock = threading.Lock()
        self._server: Any = None
        self._operations: dict[str, Callable[[_Client, dict[str, Any]], None]] = {
            "subscribe": self._subscribe,
            "unsubscribe": self._unsubscribe,
            "advertise": self._advertise,
            "unadvertise": self._unadvertise,
            "publish": self._published,
        }

    @property
    def url(self) -> str:
        return f"ws://127.0.0.1:{self.port}"

    def __enter__(self) -> FakeRosbridge:
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    def start(self) -> None:
        """Listen; after stop(), on the same port again."""
        self._server = self._serve(self._client, "127.0.0.1", self.port, compression=None)
        self.port = self._server.socket.getsockname()[1]
        threading.Thread(target=self._server.serve_forever, name="rosbridge", daemon=True).start()

    def stop(self) -> None:
        """Hang up, as a server that is killed."""
        if self._server is None:
            return
        self._server.shutdown()
        self._server = None
        for client in self._everyone():
            with contextlib.suppress(Exception):
                client.socket.socket.shutdown(2)

    # ---- the ROS side ----

    def topic(self, name: str, kind: str, latched: bool = False) -> None:
        """Make a topic of this type; latched: late subscribers get its last message (transient_local)."""
        with self._lock:
            self._topics[name] = _Topic(kind, latched)

    def say(self, topic: str, message: Any) -> None:
        """Publish a ROS 2 message on a topic that was made."""
        with self._lock:
            held = self._topics[topic]
            held.kept[message.transforms[0].child_frame_id if held.kind == TF else ""] = message
        for client in self._everyone():
            # A ROS 2 rosbridge takes the QoS of the publishers it finds: asked too early, it is volatile.
            deaf = held.latched and self.ros == ROS2 and topic in client.early
            if topic in client.wanted and not deaf:
                self._send(client, topic, held.kind, message)

    def say_event(self, topic: str, event: Event) -> None:
        """Publish what the event was read from; a topic that is new is made."""
        kind, message = message_of(self.dialect, event)
        if topic not in self._topics:
            self.topic(topic, kind, latched=isinstance(event, TransformReceived) and event.fixed)
        self.say(topic, message)

    def say_frame(self, frame: str | bytes) -> None:
        """Any frame, e.g. garbage, to everybody."""
        for client in self._everyone():
            self._write(client, frame)

    def subscribed(self, topic: str) -> bool:
        return any(topic in client.wanted for client in self._everyone())

    def commands(self, topic: str) -> list[dict[str, Any]]:
        """The messages that clients published on a topic."""
        return [message for _, name, message in list(self.heard) if name == topic]

    # ---- clients ----

    def _everyone(self) -> list[_Client]:
        with self._lock:
            return list(self._clients)

    def _client(self, socket: Any) -> None:
        client = _Client(socket)
        with self._lock:
            self._clients.append(client)
        try:
            for frame in socket:
                self._operation(client, frame)
        except Exception:  # a client that hangs up in the middle
            return
        finally:
            with self._lock:
                self._clients.remove(client)

    def _operation(self, client: _Client, frame: str | bytes) -> None:
        try:
            said = json.loads(frame)
            self._operations[said["op"]](client, said)
        except (ValueError, KeyError, TypeError) as error:
            self._complain(client, f"{frame[:80]!r}: {error!r}")

    def _complain(self, client: _Client, text: str) -> None:
        self._write(client, json.dumps({"op": "status", "level": "error", "msg": text}))

    def _subscribe(self, client: _Client, said: dict[str, Any]) -> None:
        name, kind = said["topic"], said["type"]
        held = self._topics.get(name)
        if held is not None and short_name(held.kind) != kind:
            is_a = short_name(held.kind)
            self._complain(client, f"subscribe: topic {name} is a {is_a}, not a {kind}")
            return
        if self._once and name in client.wanted:
            return
        client.wanted[name] = said
        if held is not None and held.raw is None:
            held.raw = said.get("compression") == "cbor-raw"
        (client.early.add if held is None else client.early.discard)(name)
        if held is not None and held.latched:
            for message in list(held.kept.values()):
                self._send(client, name, held.kind, message)

    def _unsubscribe(self, client: _Client, said: dict[str, Any]) -> None:
        if self._once:
            return
        client.wanted.pop(said["topic"], None)
        held = self._topics.get(said["topic"])
        if held is not None and not self.subscribed(said["topic"]):
            held.raw = None

    def _unadvertise(self, client: _Client, said: dict[str, Any]) -> None:
        client.advertised.pop(said["topic"], None)

    def _advertise(self, client: _Client, said: dict[str, Any]) -> None:
        held = self._topics.get(said["topic"])
        if held is not None and short_name(held.kind) != said["type"]:
            self._complain(client, f"advertise: topic {said['topic']} is a {short_name(held.kind)}")
            return
        client.advertised[said["topic"]] = said["type"]

    def _published(self, client: _Client, said: dict[str, Any]) -> None:
        if said["topic"] not in client.advertised:
            self._complain(client, f"publish: {said['topic']} is not advertised")
            return
        self.heard.append((time.monotonic(), said["topic"], said["msg"]))

    # ---- to a client ----

    def _send(self, client: _Client, topic: str, kind: str, message: Any) -> None:
        wanted = client.wanted[topic]
        now_s, least_s = time.monotonic(), wanted.get("throttle_rate", 0) / 1000
        if now_s - client.sent_s.get(topic, -1e9) < least_s and not self._once:
            return
        client.sent_s[topic] = now_s
        raw = self._topics[topic].raw
        if self.ros == ROS2 and raw is not None and raw != (wanted.get("compression") == "cbor-raw"):
            return  # the real server fails over its own mixture of bytes and messages, and says so in its log
        if wanted.get("compression") == "cbor-raw" and self.knows_cbor:
            secs, nsecs = divmod(time.time_ns(), 10**9)
            data = self.dialect.encode_as(self.ros, kind, message)
            said = {"op": "publish", "topic": topic, "msg": {"secs": secs, "nsecs": nsecs, "bytes": data}}
            self._write(client, cbor().dumps(said))
            return
        text = json.dumps({"op": "publish", "topic": topic, "msg": to_json(message, self.ros)})
        size = wanted.get("fragment_size")
        for frame in fragments(text, size, topic) if size and len(text) > size else [text]:
            self._write(client, frame)

    def _write(self, client: _Client, frame: str | bytes) -> None:
        with client.lock, contextlib.suppress(Exception):  # a client that went away
            client.socket.send(frame)
