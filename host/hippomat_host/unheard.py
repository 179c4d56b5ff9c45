"""Why a radio hears no robot, from what it dropped meanwhile, and the remedy. Pure."""

from __future__ import annotations

from hippomat_core.wire.link import FLAG_OPEN, HelloReply
from hippomat_host.stop_watch import StopWatch


def why_nobody(path: str, reply: HelloReply, watch: StopWatch) -> str:
    """One clause for the end of a message."""
    provision = (
        f"`hippomat-host provision --port {path} --operator --fleet {reply.fleet} --channel {reply.channel}"
    )
    sealed, forged = watch.grown("dropped_seal"), watch.grown("dropped_forged")
    if sealed and reply.flags & FLAG_OPEN:
        return (
            f"fleet {reply.fleet} is sealed ({sealed} frames were dropped as dropped_seal), but this radio "
            f"has no key: {provision} --key-file F` gives it the fleet's"
        )
    if sealed:
        return (
            f"fleet {reply.fleet} is OPEN ({sealed} frames were dropped as dropped_seal) and this radio has "
            f"a key: {provision} --open` takes it away"
        )
    if forged:
        return (
            f"fleet {reply.fleet} has another key ({forged} frames were dropped as dropped_forged): "
            f"{provision} --key-file F` gives it the fleet's"
        )
    foreign = watch.grown("dropped_foreign")
    if foreign:
        return (
            f"{foreign} frames of another fleet or of other firmware were dropped, none was of fleet "
            f"{reply.fleet}: give the right one with --fleet"
        )
    return (
        f"nobody sends on channel {reply.channel}: give the fleet's with --fleet and --channel, or go nearer"
    )
