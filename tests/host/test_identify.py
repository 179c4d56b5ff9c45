"""Which device is behind a port: as a pure machine, and on pseudo-terminals."""

from __future__ import annotations

import itertools
import termios
from pathlib import Path

import pytest
from host_devices import Base, Chatter, Device, Lidar, Radio, Silent, plugged
from hypothesis import given
from hypothesis import strategies as st
from radio_samples import hello_of_robot, reply_of, status_of

from hippomat_core.config import Config, FleetConfig, RobotConfig
from hippomat_core.errors import PortError, ProtocolMismatch
from hippomat_core.messages import BASE, LIDAR, RADIO
from hippomat_core.wire import jetbot_base, rplidar
from hippomat_core.wire.device_commands import hello_of
from hippomat_core.wire.link import encode_message
from hippomat_host.acceptance import accept
from hippomat_host.conversation import Conversation
from hippomat_host.identify import ASK, LISTEN_NS, UNKNOWN, Identifier, Identity
from hippomat_host.probe import probe

HELLO = hello_of_robot(2)
REPLY = reply_of()
INFO = rplidar.Info(24, 29, 1, 7, bytes(16))
STATUS = encode_message(status_of())
SPEAKS = {
    RADIO: encode_message(REPLY),
    BASE: jetbot_base.encode_feedback(jetbot_base.Feedback(odom_x_mm=-7)),
    LIDAR: rplidar.encode_info(INFO),
}
ROBOT_2 = Config(robot=RobotConfig(id=2))


def fed(chunks: list[bytes]) -> tuple[Identity | None, bytes]:
    identifier, rest = Identifier(0, HELLO, RADIO), b""
    for chunk in chunks:
        if identifier.identity is None:
            identifier.feed(chunk)
            rest = identifier.leftover
        else:
            rest += chunk
    return identifier.identity, rest


@given(
    st.sampled_from([RADIO, BASE, LIDAR]),
    st.binary(max_size=20).filter(lambda noise: 0xAA not in noise and 0xA5 not in noise),
    st.binary(max_size=20),
    st.lists(st.integers(0, 120), max_size=6),
)
def test_a_device_is_known_behind_noise_in_any_chunking_and_no_byte_behind_is_lost(
    port: int, noise: bytes, after: bytes, cuts: list[int]
) -> None:
    stream = noise + b"\0" + SPEAKS[port] + after
    places = sorted({cut % (len(stream) + 1) for cut in cuts} | {0, len(stream)})
    chunks = [stream[a:b] for a, b in itertools.pairwise(places)]
    identity, rest = fed(chunks)
    assert identity is not None
    assert identity.port == port
    assert rest == after


SLOW, FAST = 115_200, 921_600


@pytest.mark.parametrize(
    ("expected", "asks"),
    [
        (RADIO, [(FAST, "hello", 3), (SLOW, "", 1), (SLOW, "info", 1)]),
        (BASE, [(SLOW, "hello", 3), (SLOW, "info", 1), (FAST, "hello", 3)]),
        (UNKNOWN, [(SLOW, "hello", 3), (SLOW, "info", 1), (FAST, "hello", 3)]),
        (LIDAR, [(SLOW, "info", 1), (SLOW, "hello", 3), (FAST, "hello", 3)]),
    ],
)
def test_nothing_is_asked_while_listening_and_everything_is_tried_before_giving_up(
    expected: int, asks: list[tuple[int, str, int]]
) -> None:
    identifier = Identifier(0, HELLO, expected)
    assert identifier.baud == asks[0][0]
    assert identifier.poll(LISTEN_NS - 1) == b""
    asked = []
    while identifier.identity is None:
        data = identifier.poll(identifier.due_ns)
        asked.append((identifier.baud, data))
    said = {
        "hello": [b"\0" + encode_message(HELLO)],
        "info": [b"\xa5\x25", b"\xa5\x50", b"\xa5\x50"],
        "": [b""],
    }
    assert asked[:-1] == [(baud, data) for baud, what, times in asks for data in said[what] * times]
    assert identifier.identity == Identity(UNKNOWN, "silent")


def speed_of(device: Device) -> int:
    """What the last process that opened the port set."""
    return int(termios.tcgetattr(device.fd)[5])


def test_a_port_has_the_speed_of_what_is_behind_it(tmp_path: Path) -> None:
    radio, lidar = Radio(tmp_path / "radio"), Lidar(tmp_path / "lidar")
    with plugged(radio, lidar):
        assert probe(str(radio.link), ASK, RADIO).port == RADIO
        assert speed_of(radio) == termios.B921600
        Conversation(str(radio.link)).close()
        assert speed_of(radio) == termios.B921600
        assert probe(str(lidar.link), ASK, RADIO).port == LIDAR
        assert speed_of(lidar) == termios.B115200


class FastRadio(Radio):
    """Behind a UART bridge: in another speed it hears nothing."""

    def hears(self, data: bytes) -> None:
        if speed_of(self) == termios.B921600:
            super().hears(data)


def test_a_radio_behind_a_bridge_is_found_whatever_was_looked_for(tmp_path: Path) -> None:
    radio = FastRadio(tmp_path / "radio")
    radio.passes = lambda _: None  # type: ignore[method-assign]
    with plugged(radio):
        for expected in (RADIO, BASE, UNKNOWN):
            assert probe(str(radio.link), ASK, expected).port == RADIO


def test_a_radios_status_alone_is_no_answer() -> None:
    identity, _ = fed([STATUS] * 3)
    assert identity is None


@pytest.mark.parametrize(
    ("kind", "port", "text"),
    [
        (Radio, RADIO, "hippomat 0.1.0 abcdef01, robot 2"),
        (Base, BASE, "JetBot"),
        (Lidar, LIDAR, "RPLIDAR model 24"),
    ],
)
def test_each_device_is_identified_on_a_pseudo_terminal(
    tmp_path: Path, kind: type[Device], port: int, text: str
) -> None:
    device = kind(tmp_path / "port")
    with plugged(device):
        identity = probe(str(device.link), HELLO, RADIO)
    assert identity.port == port
    assert text in identity.text


@pytest.mark.parametrize(("kind", "text"), [(Silent, "silent"), (Chatter, "no radio, base or lidar")])
def test_an_unknown_device_stays_unknown(tmp_path: Path, kind: type[Device], text: str) -> None:
    device = kind(tmp_path / "port")
    with plugged(device):
        identity = probe(str(device.link), HELLO, RADIO)
    assert identity.port == UNKNOWN
    assert text in identity.text


@pytest.mark.parametrize(
    ("found", "expected", "flags"),
    [
        (BASE, RADIO, ("is the base, not the radio", "--base /dev/x", "--port")),
        (LIDAR, RADIO, ("is the lidar, not the radio", "--lidar /dev/x", "--port")),
        (RADIO, BASE, ("is the radio, not the base", "--port /dev/x", "--base")),
        (LIDAR, BASE, ("is the lidar, not the base", "--lidar /dev/x", "--base")),
        (RADIO, LIDAR, ("is the radio, not the lidar", "--port /dev/x", "--lidar")),
        (BASE, LIDAR, ("is the base, not the lidar", "--base /dev/x", "--lidar")),
        (UNKNOWN, RADIO, ("no radio on /dev/x", "pio run -t upload", "--port")),
        (UNKNOWN, LIDAR, ("no lidar on /dev/x", "powered", "--lidar")),
    ],
)
def test_a_wrong_device_is_named_with_the_flag_it_wants(
    found: int, expected: int, flags: tuple[str, ...]
) -> None:
    with pytest.raises(PortError) as caught:
        accept(ROBOT_2, "/dev/x", expected, Identity(found, "something"))
    for part in flags:
        assert part in str(caught.value)


def test_a_radio_with_another_protocol_version_is_refused_with_its_remedy(tmp_path: Path) -> None:
    radio = Radio(tmp_path / "radio", protocol=9)
    with plugged(radio):
        identity = probe(str(radio.link), HELLO, RADIO)
    with pytest.raises(ProtocolMismatch, match=r"speaks protocol 9 .* run `pio run -t upload`"):
        accept(ROBOT_2, "/dev/x", RADIO, identity)


def test_another_robots_radio_is_refused_but_may_be_listened_to() -> None:
    found = Identity(RADIO, "radio", REPLY)
    with pytest.raises(PortError, match="is robot 2, not robot 0: give --robot 2"):
        accept(Config(robot=RobotConfig(id=0)), "/dev/x", RADIO, found)
    with pytest.raises(PortError, match=r"belongs to fleet 1, not 4: set \[fleet\] id = 1"):
        accept(Config(FleetConfig(id=4), RobotConfig(id=2)), "/dev/x", RADIO, found)
    ours = Identity(RADIO, "radio", reply_of(fleet=7, channel=6))
    with pytest.raises(
        PortError, match=r"^radio: fleet 7, channel 6; settings: fleet 1, channel 1 \(wrong --con"
    ):
        accept(ROBOT_2, "/dev/x", RADIO, ours)
    assert accept(Config(), "/dev/x", RADIO, found) == "radio"
    assert hello_of(Config()).robot == 255
