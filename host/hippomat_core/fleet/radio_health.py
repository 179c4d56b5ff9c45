"""What our radio's status says is wrong, as alarms with ids and remedy, each raised once and cleared.

Decides from one status a second what holds; knows no frame and sends nothing. That the radio is silent is
another's concern (reactions.py: radio_lost). A radio that restarts counts anew and has heard nobody yet, so
that who was heard before is kept and judged again once it has listened for T_dead.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from hippomat_core.config import Config
from hippomat_core.fleet.robot_names import named, robots_of
from hippomat_core.fleet.timing import DEAD_S
from hippomat_core.messages import ERROR, INFO, WARNING, AlarmCleared, AlarmRaised, Effect, RadioStatus
from hippomat_core.replaced import replace
from hippomat_core.wire.link_messages import (
    FLAG_AGREED,
    FLAG_OPEN,
    FLAG_PASSIVE,
    FLAG_UNSAFE,
    NO_ROBOT,
)

LISTENED_US = round((DEAD_S + 1) * 1e6)
AGREE_ROUNDS = 10  # until then, and at least AGREE_NS, radios may still be finding the fleet's time
AGREE_NS = 5 * 10**9
WINDOW_NS = 10 * 10**9  # drops are counted over this
MANY_DROPS = 20  # in a window: two a second are no accident

CAUSES = ("foreign", "seal", "forged", "replayed")  # of drops that somebody should know of


@dataclass(frozen=True, slots=True, eq=False)
class RadioHealth:
    """What is remembered from status to status."""

    status: RadioStatus | None = None  # the last
    known: int = 0  # bitmap of peers that this run's radio heard
    odd: bool = False  # the last status was not what the configuration asks for
    alone_ns: int | None = None  # since when fleet time is not agreed although peers are alive
    counted: RadioStatus | None = None  # at the begin of the window of drops
    drops: tuple[tuple[str, int], ...] = ()  # causes with many in the last window
    raised: frozenset[str] = frozenset()

    @property
    def is_open(self) -> bool:
        """No fleet key, as far as we know."""
        return self.status is None or bool(self.status.flags & FLAG_OPEN)

    def muted(self, config: Config) -> str:
        """Why a robot must take no part while its radio is like this; empty: it may."""
        if self.status is None or config.robot.id < 0:
            return ""
        if self.status.flags & FLAG_PASSIVE:
            return "duplicate id"
        other = self.status.robot not in (config.robot.id, NO_ROBOT)
        return f"the radio is robot {self.status.robot}" if other else ""


@dataclass(frozen=True, slots=True)
class _Finding:
    code: str
    level: int
    text: str


def judged(health: RadioHealth, status: RadioStatus, config: Config) -> tuple[RadioHealth, list[Effect]]:
    """After a status: alarms raised and cleared."""
    last = health.status
    restarted = last is not None and last.boot_id != status.boot_id
    alone = bool(status.alive) and not status.flags & FLAG_AGREED
    alone_ns = status.stamp_ns if health.alone_ns is None or restarted else health.alone_ns
    health = replace(
        _with_drops(health, status, restarted),
        status=status,
        known=health.known | status.alive,
        alone_ns=alone_ns if alone else None,
    )
    findings = {finding.code: finding for finding in _findings(health, status, config)}
    differs = _differing(status, config)
    if differs and health.odd:  # twice: a radio that has just restarted is told again what it shall be
        text = f"the radio is not what this robot asks for: {differs}; provision it, or change [fleet]"
        findings["radio_identity"] = _Finding("radio_identity", ERROR, text)
    held = _held_silent(health, status)
    effects: list[Effect] = [AlarmCleared(code) for code in sorted(health.raised - findings.keys() - held)]
    for code in sorted(findings.keys() - health.raised):
        effects.append(AlarmRaised(findings[code].level, code, findings[code].text))
    raised = frozenset(findings) | (health.raised & held)
    return replace(health, raised=raised, odd=bool(differs)), effects


def _with_drops(health: RadioHealth, status: RadioStatus, restarted: bool) -> RadioHealth:
    since = health.counted
    if since is None or restarted:
        return replace(health, counted=status)
    if status.stamp_ns - since.stamp_ns < WINDOW_NS:
        return health
    grown = ((cause, _dropped(status, cause) - _dropped(since, cause)) for cause in CAUSES)
    many = tuple((cause, count % 2**32) for cause, count in grown if count % 2**32 >= MANY_DROPS)
    return replace(health, counted=status, drops=many)


def _dropped(status: RadioStatus, cause: str) -> int:
    return int(getattr(status, f"dropped_{cause}"))


def _held_silent(health: RadioHealth, status: RadioStatus) -> frozenset[str]:
    """Alarms of silence that stand until the radio has listened long enough to judge anew."""
    if status.uptime_us >= LISTENED_US:
        return frozenset()
    back = {f"peer_silent:{robot}" for robot in robots_of(status.alive)}
    return frozenset(code for code in health.raised if code.startswith("peer_silent:")) - back


def _findings(health: RadioHealth, status: RadioStatus, config: Config) -> Iterator[_Finding]:
    yield from _of_ourselves(status)
    yield from _of_peers(health, status)
    if health.alone_ns is not None:
        patience_ns = max(AGREE_NS, AGREE_ROUNDS * round(config.fleet.round_s * 1e9))
        if status.stamp_ns - health.alone_ns >= patience_ns:
            yield _Finding(
                "time_not_agreed",
                WARNING,
                f"fleet time is not agreed with {named(robots_of(status.alive))}, although heard: "
                "robots decide at different instants; has every robot the same firmware and [fleet] round_s?",
            )
    for cause, count in health.drops:
        seconds = WINDOW_NS // 10**9
        text = f"{count} frames {_cause_text(cause, status)}"
        yield _Finding(f"radio_{cause}", WARNING, f"{text} (counted over {seconds} s)")


def _of_ourselves(status: RadioStatus) -> Iterator[_Finding]:
    if status.flags & FLAG_PASSIVE:
        text = (
            f"another radio sends as robot {status.robot}: ours is silent and this robot takes no part; "
            "give every robot its own id (hippomat-host provision), then restart this radio"
        )
        yield _Finding("radio_passive", ERROR, text)
    if status.flags & FLAG_UNSAFE:
        text = (
            "the radio could not store its boot counter, and with a fleet key it stays silent: provision it "
            "again, and replace it if that does not help"
        )
        yield _Finding("radio_unsafe", ERROR, text)
    if status.flags & FLAG_OPEN:
        text = (
            "this fleet is OPEN: frames are neither encrypted nor authentic, and anybody in range can send "
            "STOP; hippomat-host provision --key-file gives it a key"
        )
        yield _Finding("radio_open", INFO, text)


NAMES = {"slots": "size"}  # as the settings call it


def _differing(status: RadioStatus, config: Config) -> str:
    fleet, robot = config.fleet, config.robot.id
    wanted = {"fleet": fleet.id, "channel": fleet.channel}
    if robot >= 0:  # else somebody's radio that is only listened to
        wanted |= {"robot": robot, "round_ms": round(fleet.round_s * 1000), "slots": fleet.size}
    found = {name: getattr(status, name) for name in wanted}
    return ", ".join(
        f"{NAMES.get(name, name)} {found[name]} instead of {wanted[name]}"
        for name in wanted
        if found[name] != wanted[name]
    )


def _of_peers(health: RadioHealth, status: RadioStatus) -> Iterator[_Finding]:
    others = ~0 if status.robot == NO_ROBOT else ~(1 << status.robot)
    for robot in robots_of(status.duplicate & others):
        text = f"two radios send as robot {robot}: give every robot its own id (hippomat-host provision)"
        yield _Finding(f"peer_duplicate:{robot}", WARNING, text)
    for robot in robots_of(status.babbling):
        text = f"robot {robot} sends far too many frames: most are ignored; restart its radio and its daemon"
        yield _Finding(f"peer_babbling:{robot}", WARNING, text)
    for robot in robots_of(status.rebooted):
        yield _Finding(f"peer_rebooted:{robot}", INFO, f"the radio of robot {robot} restarted")
    if status.uptime_us < LISTENED_US:
        return
    for robot in robots_of(health.known & ~status.alive):
        text = (
            f"robot {robot} was not heard for {DEAD_S:.0f} s: is it switched on, in range and on channel "
            f"{status.channel}?"
        )
        yield _Finding(f"peer_silent:{robot}", WARNING, text)


def _cause_text(cause: str, status: RadioStatus) -> str:
    if cause == "foreign":
        return (
            f"of another fleet or firmware on channel {status.channel}: choose another channel, or flash "
            "every radio with one firmware"
        )
    if cause == "seal" and status.flags & FLAG_OPEN:
        return f"of a fleet {status.fleet} with a key, which this radio lacks: provision this radio"
    if cause == "seal":
        return f"without a key under fleet {status.fleet}, not believed: provision the radio that sends them"
    if cause == "forged":
        return f"forged, or of fleet {status.fleet} with another key: provision every radio with one key"
    return (
        "heard before, or of an earlier boot: somebody repeats them, or a radio lost its boot counter: "
        "provision that radio again"
    )
