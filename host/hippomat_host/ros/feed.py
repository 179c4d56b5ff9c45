"""The process that listens to ROS for the daemon: a websocket in, events out.

A process of its own, because a map as JSON takes 0.1 s to parse, on a Jetson Nano several times that, in
which the daemon would neither drive nor brake. It ends when the connection does; its link starts it anew.

    python -m hippomat_host.ros.feed CONFIG      stdin: socket to the daemon; stdout: reports as JSON lines
"""

from __future__ import annotations

import json
import select
import signal
import sys
import time
from collections import deque
from multiprocessing.connection import Connection

from hippomat_core.config import RosConfig
from hippomat_core.errors import HippomatError, PortError
from hippomat_core.messages import Event, LaserScanReceived, OdometryReceived
from hippomat_host.base_guard import report
from hippomat_host.ros.intake import Intake
from hippomat_logs.ros.client import Rosbridge
from hippomat_logs.ros.rosbridge import cbor, unsubscribe

WAIT_S = 0.1
AGAIN_S = 3.0  # rosbridge takes the QoS of whoever publishes then: a subscription made too early stays empty
SILENT_S = 10.0
MOST_UNSENT = 5000
NEWEST_ONLY = (LaserScanReceived, OdometryReceived)  # an old one is worth nothing beside a new one


class Outbox:
    """Events that the daemon has not taken yet. It never waits for a daemon that hangs."""

    def __init__(self, daemon: Connection) -> None:
        self._daemon = daemon
        self._unsent: deque[Event] = deque()

    def put(self, event: Event) -> None:
        if isinstance(event, NEWEST_ONLY):
            self._unsent = deque(old for old in self._unsent if type(old) is not type(event))
        self._unsent.append(event)
        if len(self._unsent) > MOST_UNSENT:
            raise PortError("the daemon takes no events")

    def flush(self) -> None:
        """Raises OSError once the daemon is gone."""
        while self._unsent and select.select([], [self._daemon], [], 0)[1]:
            self._daemon.send(self._unsent.popleft())


def run(ros: RosConfig, daemon: Connection) -> None:
    """Until the daemon is gone; raises PortError when the connection is, OSError when the daemon is."""
    if ros.encoding != "json":
        cbor()  # what is not installed is said now, not at the first message
    intake, outbox = Intake(ros), Outbox(daemon)
    with Rosbridge(ros.url) as bridge:
        for topic in intake.topics:
            bridge.say(topic.request(ros.encoding))
        report(connected=ros.url)
        begun_s = again_s = time.monotonic()
        told, turns = False, 0
        while True:
            operation = bridge.hear(WAIT_S)
            for event in [] if operation is None else intake.events(operation):
                outbox.put(event)
            outbox.flush()
            if daemon.poll():  # it says nothing: only its end is there to be read
                return
            now_s = time.monotonic()
            if now_s - again_s > AGAIN_S:
                again_s = now_s
                turns += 1
                _subscribe_again(bridge, intake, "json" if turns % 2 else ros.encoding)
            if now_s - begun_s > SILENT_S and not told:
                told = True
                intake.remarks += _silence(intake)
            while intake.remarks:
                report(remark=intake.remarks.pop(0))


def _subscribe_again(bridge: Rosbridge, intake: Intake, encoding: str) -> None:
    """Silent topics, in turn as JSON: rosbridge serves one raw or not, as its first subscriber wanted it."""
    for topic in intake.topics:
        if topic.name in intake.silent:
            bridge.say(unsubscribe(topic.name))
            bridge.say(topic.request(encoding))


def _silence(intake: Intake) -> list[str]:
    silent = [topic.name for topic in intake.topics if topic.name in intake.silent]
    if not silent:
        return []
    if len(silent) == len(intake.topics):
        return ["connected, but nothing comes on any topic: is that a rosbridge, and are its nodes running?"]
    topics = ", ".join(silent)
    return [
        f"nothing on {topics} for {SILENT_S:.0f} s: are the names right ([ros] ..._topic), who publishes?"
    ]


def main(settings: str) -> int:
    """0 if the daemon ended it, 1 if the connection did."""
    for number in (signal.SIGINT, signal.SIGHUP):  # the terminal's Ctrl-C is the daemon's affair
        signal.signal(number, signal.SIG_IGN)
    try:
        with Connection(0) as daemon:
            run(RosConfig(**json.loads(settings)), daemon)
    except (BrokenPipeError, ConnectionResetError):
        return 0
    except HippomatError as error:
        report(failed=str(error))
    return 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
