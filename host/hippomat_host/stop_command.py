"""`hippomat-host stop` and `resume`: halt the whole fleet from any radio, and let it go on.

STOP is sent first and asks nobody; only then is it seen who shows it. RESUME names the STOP that it answers,
so it listens first. The radio floods either by itself and goes on after this command has ended.
"""

from __future__ import annotations

import sys
import time
from dataclasses import dataclass

from hippomat_core.errors import PortError
from hippomat_core.fleet.robot_names import named
from hippomat_core.wire.frames import LAST_STOP, RESUME, STOP
from hippomat_core.wire.link import (
    FLAG_OPEN,
    FLAG_UNSAFE,
    LINK_VERSION,
    NO_ROBOT,
    AskPeers,
    Command,
    Hello,
    HelloReply,
)
from hippomat_host.conversation import ANSWER_S, Conversation
from hippomat_host.following import SOME_DID_NOT, Following, Goal, say
from hippomat_host.radio_words import who
from hippomat_host.stop_watch import StopWatch
from hippomat_host.unheard import why_nobody

LISTEN_S = 1.5  # to know the fleet: 15 rounds
_OTHER_WAY = "holding the BOOT button of any radio for 1 s stops the fleet, too"

# How robots show it, and in which words
_STOP_SHOWS = (StopWatch.shows_stop, "shows STOP", "stopped")
_GO_SHOWS = (StopWatch.shows_go, "goes on", "goes on")


@dataclass(slots=True)
class _Progress:
    """How far a command got when it is interrupted."""

    sent: bool = False


@dataclass(frozen=True, slots=True)
class Told:
    """What the command line said; fleet and channel -1: the radio's own."""

    path: str
    reason: int = 0
    fleet: int = -1
    channel: int = -1


def stop(told: Told) -> int:
    """0: every robot that is heard shows it; 2: some do not. Raises PortError in one line."""
    sent = False
    try:
        with Conversation(told.path, at_once=True) as radio:
            reply = _in_fleet(radio, told)
            command = Command(STOP, 0, told.reason)
            radio.say(command)
            begun_s, sent = time.monotonic(), True
            say(f"STOP sent by {told.path}, {who(reply)}")
            _warn_open(reply)
            goal = Goal(command, LISTEN_S, lambda watch: watch.latched, *_STOP_SHOWS)
            watch = StopWatch(reply.robot)
            code = Following(radio, watch, goal, begun_s).run()
    except PortError as error:
        raise PortError(f"{error}; {_OTHER_WAY}") from None
    except KeyboardInterrupt:
        _say_interrupted("STOP", sent)
        raise
    say(f"STOP {watch.counter} holds until `hippomat-host resume --port {told.path}`")
    return code


def resume(told: Told) -> int:
    """0: every robot that is heard goes on, or none was stopped; 2: some do not. Raises PortError."""
    progress = _Progress()
    try:
        return _resume(told, progress)
    except KeyboardInterrupt:
        _say_interrupted("RESUME", progress.sent)
        raise


def _resume(told: Told, progress: _Progress) -> int:
    with Conversation(told.path) as radio:
        reply = _in_fleet(radio, told)
        radio.forget_stale()
        say(f"listening with {told.path}, {who(reply)}")
        _warn_open(reply)
        watch = StopWatch(reply.robot)
        radio.say(AskPeers())
        for message in radio.listen(LISTEN_S):
            watch.hear(time.monotonic(), message)
        if watch.counter == 0:
            return _nothing_to_resume(radio, watch)
        _check_latched(radio.path, watch)
        counter = watch.counter
        shown = f"{named(watch.stopped)} stopped" if watch.stopped else "no robot is heard to show it"
        say(f"RESUME of STOP {counter}: {shown}")
        command = Command(RESUME, counter, told.reason)
        radio.say(command)
        progress.sent = True
        goal = Goal(command, 0.0, lambda watch: not watch.latched, *_GO_SHOWS)
        code = Following(radio, watch, goal, time.monotonic()).run()
    if watch.counter > counter:
        say(f"a new STOP, {watch.counter}, was raised meanwhile: resume again if that one is over, too")
    return code


def _say_interrupted(what: str, sent: bool) -> None:
    if sent:
        unknown = f"who obeys {what} is not known"
        say(f"not waiting any longer: {unknown}; the radio goes on sending what it was told")
    else:
        say(f"interrupted before the radio was told: {what} was NOT sent")


def _in_fleet(radio: Conversation, told: Told) -> HelloReply:
    """The radio, in the fleet that the command line names; one that nobody provisioned adopts it."""
    reply = radio.reply
    fleet = reply.fleet if told.fleet < 0 else told.fleet
    channel = reply.channel if told.channel < 0 else told.channel
    if (reply.fleet, reply.channel) != (fleet, channel):
        hello = Hello(LINK_VERSION, NO_ROBOT, fleet, channel, reply.round_ms, reply.slots)
        reply = radio.reply = _adopted(radio, hello)
    if (reply.fleet, reply.channel) != (fleet, channel):
        raise PortError(
            f"the radio on {radio.path} stays {who(reply)}: leave --fleet and --channel out, or write it "
            f"anew with `hippomat-host provision` for fleet {fleet} on channel {channel}"
        )
    if reply.flags & FLAG_UNSAFE and not reply.flags & FLAG_OPEN:
        raise PortError(
            f"the radio on {radio.path} cannot store its boot counter and stays silent: use another one; "
            "flash this one anew (`pio run -t erase -t upload` in esp32_firmware)"
        )
    return reply


def _adopted(radio: Conversation, hello: Hello) -> HelloReply:
    """The answer with the wanted fleet and channel, else the last: stale answers may come before it."""
    radio.say(hello)
    reply = radio.reply
    for message in radio.listen(ANSWER_S):
        if isinstance(message, HelloReply):
            reply = message
            if (reply.fleet, reply.channel) == (hello.fleet, hello.channel):
                break
    return reply


def _warn_open(reply: HelloReply) -> None:
    if reply.flags & FLAG_OPEN:
        print(
            f"warning: fleet {reply.fleet} is OPEN here: anyone in range can stop it, and resume it",
            file=sys.stderr,
            flush=True,
        )


def _nothing_to_resume(radio: Conversation, watch: StopWatch) -> int:
    if not watch.heard and not watch.twin:
        raise PortError(f"nothing to resume is heard: {why_nobody(radio.path, radio.reply, watch)}")
    if watch.twin:
        say(f"nothing to resume is known: {watch.twin}, and whether it is stopped is not known")
        return SOME_DID_NOT
    say(f"nothing to resume: neither {named(watch.heard)} nor this radio is stopped")
    return 0


def _check_latched(path: str, watch: StopWatch) -> None:
    """The radio resumes only what it knows to be latched; it learns that from any STATE."""
    if watch.counter >= LAST_STOP:
        raise PortError(
            f"STOP {watch.counter} is the last there is and is never resumed: provision all radios of the "
            "fleet with a new key or fleet id, which begins to count anew"
        )
    if watch.latched and watch.status is not None and watch.status.stop_counter == watch.counter:
        return
    raise PortError(
        f"{named(watch.stopped)} stopped by STOP {watch.counter}, which this radio takes for resumed: "
        f"`hippomat-host stop --port {path}`, then resume again"
    )
