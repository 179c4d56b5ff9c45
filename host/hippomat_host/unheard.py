"""Why a radio hears no robot, from what it dropped meanwhile, and the remedy. Pure."""

from __future__ import annotations

from hippomat_core.wire.link import FLAG_OPEN, FLAG_PROVISIONED, NO_ROBOT, HelloReply
from hippomat_host.stop_watch import StopWatch


def why_nobody(path: str, reply: HelloReply, watch: StopWatch) -> str:
    """One clause for the end of a message."""
    role = "--operator" if reply.robot == NO_ROBOT else f"--robot {reply.robot}"
    anew = f"`hippomat-host provision --port {path} {role}"
    provision = f"{anew} --fleet {reply.fleet} --channel {reply.channel}"
    sealed, forged = watch.grown("dropped_seal"), watch.grown("dropped_forged")
    if sealed > 0 and reply.flags & FLAG_OPEN:
        return (
            f"fleet {reply.fleet} is sealed ({sealed} frames were dropped as dropped_seal), but this radio "
            f"has no key: {provision} --key-file F` gives it the fleet's"
        )
    if sealed > 0:
        return (
            f"fleet {reply.fleet} is OPEN ({sealed} frames were dropped as dropped_seal) and this radio has "
            f"a key: {provision} --open` takes it away"
        )
    if forged > 0:
        return (
            f"fleet {reply.fleet} has another key ({forged} frames were dropped as dropped_forged): "
            f"{provision} --key-file F` gives it the fleet's"
        )
    remedy = "give the fleet's with --fleet and --channel"
    if reply.flags & FLAG_PROVISIONED:  # it takes no other from a command
        remedy = f"{anew} --fleet F --channel C {_key(reply)}` writes the fleet's into it"
    foreign = watch.grown("dropped_foreign")
    if foreign > 0:
        return (
            f"{foreign} frames of another fleet or of other firmware were dropped, none was of fleet "
            f"{reply.fleet}: {remedy}"
        )
    return f"nobody sends on channel {reply.channel}: {remedy}, or go nearer"


def _key(reply: HelloReply) -> str:
    return "--open" if reply.flags & FLAG_OPEN else "--key-file F"
