"""The feed and the base of ROS against a server that speaks rosbridge, and against ones that do not."""

from __future__ import annotations

import contextlib
import http.server
import json
import math
import socket
import threading
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from host_devices import wait_until

from hippomat_core.config import RosConfig
from hippomat_core.errors import PortError
from hippomat_core.maps.map_event import map_event
from hippomat_core.maps.occupancy_grid import OccupancyGrid
from hippomat_core.messages import BASE, LaserScanReceived, MapReceived, TransformReceived
from hippomat_core.wire.jetbot_base import encode_velocity
from hippomat_host.child_link import ChildLink
from hippomat_host.clock import now
from hippomat_host.happenings import EVENT, LOST, NOTE, OPENED
from hippomat_host.ros.intake import Intake
from hippomat_host.ros.links import FeedLink, RosBaseLink
from hippomat_logs.ros.client import Rosbridge
from hippomat_logs.ros.dialect import MAP, ODOMETRY, ROS1, ROS2, SCAN, TF, Dialect, to_json
from hippomat_logs.ros.events import message_of
from hippomat_logs.ros.fake_rosbridge import FakeRosbridge
from hippomat_logs.ros.rosbridge import Incoming, fragments, publish, subscribe
from hippomat_logs.schema import differences

BIG = OccupancyGrid(
    np.random.default_rng(1).choice(np.array([-1, 0, 100], np.int8), (362, 924)), 0.05, -3.0, -4.0
)


def scan(k: int = 0) -> LaserScanReceived:
    values = np.linspace(0.5, 9.0, 720, dtype=np.float32)
    values[::7] = np.inf
    numbers = map(float, np.float32([-math.pi, 0.0087, 0.0001, 0.1, 12.0]))
    return LaserScanReceived(0, 10**18 + k, "laser", *numbers, values)


def transform(parent: str, child: str, fixed: bool = False, k: int = 0) -> TransformReceived:
    return TransformReceived(0, 10**18 + k, parent, child, fixed, 0.1, 0.2, 0.3, 0.0, 0.0, 0.6, 0.8)


class Followed:
    """A link that is polled as the reactor does, and what it told."""

    def __init__(self, link: ChildLink) -> None:
        self.link = link
        self.events: list[Any] = []
        self.told: list[tuple[str, str]] = []

    def poll(self) -> None:
        for told in self.link.poll(now()):
            if told.what == EVENT:
                self.events.append(told.event)
            else:
                self.told.append((told.what, told.text))

    def until(self, true_at_last, timeout_s: float = 20.0) -> bool:
        def looked() -> bool:
            self.poll()
            return true_at_last()

        return wait_until(looked, timeout_s)

    def of(self, kind: type) -> list[Any]:
        return [event for event in self.events if isinstance(event, kind)]

    def said(self, text: str) -> bool:
        return any(text in said for what, said in self.told if what in (NOTE, LOST))


@contextlib.contextmanager
def followed(link: ChildLink) -> Iterator[Followed]:
    try:
        yield Followed(link)
    finally:
        link.close()


@pytest.fixture
def bridge() -> Iterator[FakeRosbridge]:
    with FakeRosbridge() as bridge:
        make_topics(bridge)
        yield bridge


def make_topics(bridge: FakeRosbridge) -> None:
    for name, kind in (("/tf", TF), ("/scan", SCAN), ("/odom", ODOMETRY)):
        bridge.topic(name, kind)
    for name, kind in (("/map", MAP), ("/tf_static", TF)):
        bridge.topic(name, kind, latched=True)


def same(one, other) -> bool:
    return list(differences(one, other)) == []


@pytest.mark.parametrize(
    ("ros", "encoding", "knows_cbor"),
    [(ROS2, "cbor-raw", True), (ROS1, "cbor-raw", True), (ROS2, "json", True), (ROS1, "cbor-raw", False)],
)
def test_the_feed_hears_the_same_in_every_encoding_of_every_ros(ros, encoding, knows_cbor):
    """The last server is one that does not know cbor-raw: it answers in JSON."""
    with FakeRosbridge(ros, knows_cbor=knows_cbor) as bridge:
        make_topics(bridge)
        bridge.say_event("/map", map_event(BIG))
        bridge.say_event("/tf_static", transform("base_link", "laser", fixed=True))
        with followed(FeedLink(RosConfig(url=bridge.url, encoding=encoding))) as feed:
            assert feed.until(lambda: bridge.subscribed("/scan") and feed.link.running)
            bridge.say_event("/scan", scan())
            assert feed.until(lambda: len(feed.events) >= 3), feed.told
    heard_map, heard_scan, heard_transform = feed.events
    assert same(heard_map, map_event(BIG))
    assert same(heard_scan, scan())
    assert same(heard_transform, transform("base_link", "laser", fixed=True))


def test_a_feed_outlives_garbage_wrong_types_and_topics_that_say_something_else(bridge):
    bridge.topic("/scan", ODOMETRY)
    with followed(FeedLink(RosConfig(url=bridge.url))) as feed:
        assert feed.until(lambda: bridge.subscribed("/tf"))
        for garbage in (
            b"\x00\xff\x13",
            "no json",
            "[1, 2]",
            '{"op": 7}',
            b"",
            '{"op": "publish", "topic": "/tf"}',
        ):
            bridge.say_frame(garbage)
        bridge.say_frame(json.dumps(publish("/map", {"info": {"width": "wide"}})))
        bridge.say_frame(json.dumps(publish("/tf", {"transforms": [7]})))
        turned = message_of(Dialect(), map_event(BIG))[1]
        turned.info.origin.orientation.z = 0.5
        bridge.say("/map", turned)
        bridge.say_event("/tf", transform("odom", "base_link"))
        assert feed.until(lambda: len(feed.events) == 1 and feed.said("origin is turned")), feed.told
        assert same(feed.events[0], transform("odom", "base_link"))
        assert feed.said("rosbridge says: subscribe: topic /scan is a nav_msgs/Odometry")
        assert feed.said("/tf: ")
        assert not any(what == LOST for what, _ in feed.told)


def test_a_fragmented_map_is_put_together(bridge):
    with followed(FeedLink(RosConfig(url=bridge.url))) as feed:
        assert feed.until(lambda: bridge.subscribed("/map"))
        text = json.dumps(publish("/map", to_json(message_of(Dialect(), map_event(BIG))[1])))
        for piece in fragments(text, 60_000, "map 1"):
            bridge.say_frame(piece)
        assert feed.until(lambda: bool(feed.of(MapReceived)))
    assert same(feed.events[0], map_event(BIG))


def test_a_slow_daemon_gets_the_newest_scan_and_every_transform(bridge):
    with followed(FeedLink(RosConfig(url=bridge.url))) as feed:
        assert feed.until(lambda: bridge.subscribed("/scan") and feed.link.running)
        for k in range(400):
            bridge.say_event("/scan", scan(k))
            bridge.say_event("/tf", transform("odom", "base_link", k=k))
        bridge.say_event("/map", map_event(BIG))
        assert feed.until(lambda: bool(feed.of(MapReceived)) and len(feed.of(TransformReceived)) == 400)
    scans = feed.of(LaserScanReceived)
    assert scans[-1].ros_ns == scan(399).ros_ns
    assert len(scans) < 400
    assert [event.ros_ns for event in feed.of(TransformReceived)] == [10**18 + k for k in range(400)]


def test_a_map_whose_server_comes_late_is_asked_for_again():
    """rosbridge takes the QoS of the publishers that are there: asked too early, it hears no latched map."""
    with FakeRosbridge() as bridge, followed(FeedLink(RosConfig(url=bridge.url))) as feed:
        assert feed.until(lambda: bridge.subscribed("/map"))
        bridge.topic("/map", MAP, latched=True)
        bridge.say_event("/map", map_event(BIG))
        assert feed.until(lambda: bool(feed.of(MapReceived)))


def test_a_topic_that_another_client_has_as_json_is_taken_as_json(bridge):
    """rosbridge for ROS 2 serves a topic raw or not, as its first subscriber wanted it."""
    with Rosbridge(bridge.url) as other, followed(FeedLink(RosConfig(url=bridge.url))) as feed:
        other.say(subscribe("/map", "nav_msgs/OccupancyGrid", "json"))
        assert wait_until(lambda: bridge.subscribed("/map"))
        bridge.say_event("/map", map_event(BIG))
        assert feed.until(lambda: bool(feed.of(MapReceived)))


def test_a_silent_ros_is_remarked_on(bridge):
    intake = Intake(RosConfig(url=bridge.url))
    assert intake.silent == {"/map", "/tf", "/tf_static", "/scan", "/odom"}
    list(intake.events(publish("/odom", {})))
    assert "/odom" not in intake.silent
    assert intake.remarks[0].startswith("/odom: ")


def test_of_the_transforms_only_those_between_map_base_and_lidar_are_kept():
    intake, dialect = Intake(RosConfig(url="ws://x")), Dialect()

    def said(topic: str, event: Any) -> list[str]:
        operation = publish(topic, to_json(message_of(dialect, event)[1]))
        kept = intake.events(operation)
        return [e.child if isinstance(e, TransformReceived) else type(e).__name__ for e in kept]

    assert said("/tf", transform("base_link", "wheel")) == []
    assert said("/tf_static", transform("base_link", "camera", fixed=True)) == []
    assert said("/tf_static", transform("mast", "laser", fixed=True)) == []
    assert said("/tf_static", transform("base_link", "mast", fixed=True)) == []
    assert said("/tf_static", transform("base_footprint", "base_link", fixed=True)) == ["base_link"]
    assert said("/tf", transform("map", "odom")) == []  # nothing says yet that the base hangs on it
    assert said("/tf", transform("odom", "base_footprint")) == ["base_footprint"]
    assert said("/tf", transform("map", "odom")) == ["odom"]
    assert said("/scan", scan()) == ["LaserScanReceived", "laser", "mast"]
    assert said("/tf", transform("base_link", "wheel")) == []


# ---- the base ----


@pytest.mark.parametrize("kind", ["Twist", "TwistStamped"])
def test_velocities_are_repeated_until_the_daemon_falls_silent_and_end_in_zeros(bridge, kind):
    ros = RosConfig(url=bridge.url, cmd_vel_type=kind, cmd_vel_hz=50.0)
    with followed(RosBaseLink(ros)) as base:
        assert base.until(lambda: base.link.running)
        assert base.link.write(encode_velocity(0.25, -0.5))
        assert base.until(lambda: (0.25, -0.5) in velocities(bridge))
        assert base.until(lambda: velocities(bridge)[-1] == (0.0, 0.0) and base.said("no command for"))
        assert velocities(bridge).count((0.25, -0.5)) > 3
        assert base.link.write(encode_velocity(0.25, 0.0))
        assert base.until(lambda: velocities(bridge)[-1] == (0.25, 0.0))
    assert wait_until(lambda: velocities(bridge)[-3:] == [(0.0, 0.0)] * 3)
    if kind == "TwistStamped":  # without a stamp: rosbridge sets its own
        assert bridge.heard[-1][2]["header"] == {"frame_id": "base_link"}


def velocities(bridge: FakeRosbridge) -> list[tuple[float, float]]:
    twists = [message.get("twist", message) for message in bridge.commands("/cmd_vel")]
    return [(twist["linear"]["x"], twist["angular"]["z"]) for twist in twists]


def test_a_topic_of_another_type_is_told(bridge):
    bridge.topic("/cmd_vel", TF)
    with followed(RosBaseLink(RosConfig(url=bridge.url))) as base:
        assert base.until(
            lambda: base.said("rosbridge says: advertise: topic /cmd_vel is a tf2_msgs/TFMessage")
        )


def test_links_are_opened_again_after_the_server_was_away(bridge):
    ros = RosConfig(url=bridge.url)
    with followed(FeedLink(ros)) as feed, followed(RosBaseLink(ros)) as base:
        assert feed.until(lambda: feed.link.running)
        assert base.until(lambda: base.link.running)
        bridge.stop()
        for link in (feed, base):
            assert link.until(lambda link=link: not link.link.running)
        bridge.start()
        for link in (feed, base):
            assert link.until(lambda link=link: link.link.running)
            assert [what for what, _ in link.told if what != NOTE] == [OPENED, LOST, OPENED]


# ---- what is no rosbridge ----


class NoWebsocket(http.server.BaseHTTPRequestHandler):
    def do_GET(self) -> None:
        self.send_response(200)
        self.end_headers()

    def log_message(self, *_: object) -> None:
        """Quietly."""


def test_every_way_not_to_be_a_rosbridge_is_named(monkeypatch):
    server = http.server.HTTPServer(("127.0.0.1", 0), NoWebsocket)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    with pytest.raises(PortError, match=r"that is no rosbridge .*usually 9090"):
        Rosbridge(f"ws://127.0.0.1:{server.server_port}")
    server.shutdown()
    server.server_close()
    with pytest.raises(PortError, match="connection refused; start rosbridge there"):
        Rosbridge(f"ws://127.0.0.1:{server.server_port}")
    with pytest.raises(PortError, match="no such host"):
        Rosbridge("ws://robot-that-is-not.invalid:9090")
    monkeypatch.setattr("hippomat_logs.ros.client.OPEN_S", 0.2)
    with socket.create_server(("127.0.0.1", 0)) as deaf, pytest.raises(PortError, match="no answer within"):
        Rosbridge(f"ws://127.0.0.1:{deaf.getsockname()[1]}")


def test_a_daemon_whose_first_connection_fails_says_why_at_once():
    refused = r"ws://127\.0\.0\.1:9: connection refused; start rosbridge"
    link = FeedLink(RosConfig(url="ws://127.0.0.1:9"))
    with followed(link) as feed, pytest.raises(PortError, match=refused):
        feed.until(lambda: link.running)


class Babbler(ChildLink):
    """Its child prints what looks like a report, as a library's warning may, before a true one."""

    LINES = ("{no report}", '{"cut": ', "{\xff}", '{"true": 1}')

    def __init__(self) -> None:
        printed = "\n".join(self.LINES)
        super().__init__(BASE, "ws://x", "babbler", ["timeit", "-n1", "-r1", f"print({printed!r})"])
        self.reports: list[dict[str, Any]] = []

    def _reported(self, report, now_ns):  # noqa: ARG002
        self.reports.append(report)
        return iter(())


def test_a_line_of_a_child_that_is_no_report_is_kept_as_its_last_words():
    link = Babbler()
    with followed(link) as child, pytest.raises(PortError, match="the babbler of ws://x died"):
        child.until(lambda: False)
    assert link.reports == [{"true": 1}]


def test_a_hung_up_connection_is_an_error_in_one_line(bridge):
    with Rosbridge(bridge.url) as client:
        bridge.stop()
        with pytest.raises(PortError, match="rosbridge hung up") as error:
            client.hear(10.0)
        assert "\n" not in str(error.value)


def test_an_incoming_frame_is_read_by_its_form_not_by_what_was_asked_for():
    incoming = Incoming()
    assert incoming.operation('{"op": "publish"}') == {"op": "publish"}
    assert incoming.operation(b"\xa1bopgpublish") == {"op": "publish"}  # CBOR of the same
    assert incoming.garbage == 0
