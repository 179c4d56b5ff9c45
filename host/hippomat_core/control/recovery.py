"""What a robot does that should move and does not: a few attempts, then it gives its task back.

    stuck -> clear (forget marks, plan anew) -> back up the way it came -> turn in place -> wait -> give up

After each attempt it drives on; the next one follows only if it is stuck again before it was free.
Waiting for a robot that is heard is no reason for any of it until much longer. Decides from where the robot
is, what it commands and what holds it; knows no map, no scan and no peer: whatever it commands passes the
guard. The sequence is that of nav2's default behaviour tree, with the fleet's task to give back at its end.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from hippomat_core.config import Config
from hippomat_core.control.follower import Motion
from hippomat_core.replaced import quickly_made, replace

NEVER = -1
DRIVE, CLEAR, BACK_UP, TURN, WAIT, GIVE_UP = "drive", "clear", "back_up", "turn", "wait", "give_up"
FREE = "free"  # only told: it has left the place where it was stuck, or needs to go nowhere any more

# Causes: what keeps it.
GUARD = "guard"  # something that the lidar sees
WAITING = "waiting"  # for a robot that is heard
BLOCKED = "blocked"  # its way is taken, or there is none
WHEELS = "wheels"  # commanded to move, they do not turn
SLIPS = "slip"  # they turn, the robot stays where it is
NO_NEARER = "no_nearer"  # it moves, but not towards its goal

# What is tried after what, while the robot stays stuck.
NEXT = {DRIVE: CLEAR, CLEAR: BACK_UP, BACK_UP: TURN, TURN: WAIT, WAIT: GIVE_UP, GIVE_UP: CLEAR}

ESCAPED = 3.0  # times progress_m from where it was stuck: free again
TRAIL_STEP_M, TRAIL = 0.05, 41  # places passed, 2 m of them
TURN_RAD = math.pi / 2
TURNED_RAD = 1.0  # turning this far is progress too: a long turn in place is no standing still
HELD_BACK_S = 1.0  # of being held by the guard: there is no way back
LONGEST_S = 8.0  # an attempt that does not come to its end is over
LONGEST_TICK_S = 0.2  # time in which nothing was seen counts for no more
STEER_M = 0.15  # the place backed up to is at least so far away
DETOUR = 2.0  # times the way that is left may be driven without coming nearer to the goal
AGAIN_S = 20.0  # after an attempt, before the next one for coming no nearer
SLIP = 3.0  # wheels that turned for so many times progress_m without the pose moving slip
IDLE_MPS = 0.02  # less was commanded, or measured, on average: not driven at all


@quickly_made
@dataclass(frozen=True, slots=True)
class Symptoms:
    """What is seen of the robot in one tick."""

    goal: tuple[float, float] | None  # where it should be and is not; None: nowhere, or it may not move
    waits: bool  # for a robot that is heard, or it lets one pass
    held: bool  # the guard limited the last command
    commanded_mps: float  # the last command, as the guard let it through
    remaining_m: float  # to the goal; inf: there is no way
    behind: bool = True  # the lidar sees what is there: else no backing up


@dataclass(frozen=True, slots=True)
class Order:
    """What is commanded instead of driving on; `step` is empty where nothing is."""

    step: str = ""
    v_mps: float = 0.0
    wz_radps: float = 0.0
    began: bool = False  # in this tick: the moment to clear, or to give up


NOTHING = Order()


@quickly_made
@dataclass(frozen=True, slots=True)
class Standstill:
    """Since there last was progress."""

    anchor: tuple[float, float, float] = (0.0, 0.0, 0.0)  # the pose then
    stalled_s: float = 0.0
    held_s: float = 0.0  # of which the guard held it
    commanded_m: float = 0.0
    wheels_m: float = 0.0  # of which the wheels turned


@quickly_made
@dataclass(frozen=True, slots=True)
class Approach:
    """Whether the way to the goal gets shorter than it ever was."""

    nearest_m: float = math.inf  # so far
    distant_s: float = 0.0  # since then
    farthest_m: float = 0.0  # since then, where there was a way


@dataclass(frozen=True, slots=True)
class Recovery:
    """Memory between ticks; start with Recovery(). Places in the frame of the pose it is given."""

    stamp_ns: int = NEVER
    goal: tuple[float, float] | None = None
    step: str = DRIVE  # what it is doing
    tried: str = DRIVE  # the last attempt; DRIVE: none since the robot was free
    cause: str = ""
    since_ns: int = NEVER  # of the step
    began_at: tuple[float, float, float] = (0.0, 0.0, 0.0)  # its place
    still: Standstill = Standstill()
    approach: Approach = Approach()
    stuck_at: tuple[float, float] = (0.0, 0.0)
    stuck_nearest_m: float = math.inf  # approach.nearest_m at that time
    trail: tuple[tuple[float, float], ...] = ()  # oldest first

    @property
    def stuck(self) -> bool:
        """True from the first attempt until it is free or has given up."""
        return self.tried not in (DRIVE, GIVE_UP)


def recover(
    last: Recovery, stamp_ns: int, motion: Motion, seen: Symptoms, config: Config
) -> tuple[Recovery, Order]:
    """One tick: what is known, and what to do if the robot is stuck."""
    trail = _trailed(last.trail, motion)
    if seen.goal is None or seen.goal != last.goal:
        still = Standstill(_place(motion))
        return Recovery(stamp_ns=stamp_ns, goal=seen.goal, still=still, trail=trail), NOTHING
    dt_s = min(max((stamp_ns - last.stamp_ns) / 1e9, 0.0), LONGEST_TICK_S)
    still, approach = _watched(last, motion, seen, dt_s, config)
    now = replace(last, stamp_ns=stamp_ns, still=still, approach=approach, trail=trail)
    if now.step != DRIVE:
        return _acting(now, motion, seen, config)
    if now.stuck and _is_free(now, motion, config):
        now = replace(now, tried=DRIVE, cause="")
    if not _is_stuck(now, config):
        return now, NOTHING
    return _begun(now, motion, seen, config)


def _watched(
    last: Recovery, motion: Motion, seen: Symptoms, dt_s: float, config: Config
) -> tuple[Standstill, Approach]:
    """Time without progress; that of waiting for a robot counts for less."""
    settings, still, approach = config.recovery, last.still, last.approach
    worry_s = dt_s * (min(settings.stuck_s / settings.waiting_s, 1.0) if seen.waits else 1.0)
    left_m = seen.remaining_m if math.isfinite(seen.remaining_m) else 0.0
    if seen.remaining_m < approach.nearest_m - settings.progress_m:
        approach = Approach(seen.remaining_m, 0.0, left_m)
    else:
        farthest_m = max(approach.farthest_m, left_m)
        approach = Approach(approach.nearest_m, approach.distant_s + worry_s, farthest_m)
    turned_rad = abs(math.remainder(motion.yaw_rad - still.anchor[2], math.tau))
    if _away_m(still.anchor[:2], motion) > settings.progress_m or turned_rad > TURNED_RAD:
        return Standstill(_place(motion)), approach
    still = Standstill(
        still.anchor,
        still.stalled_s + worry_s,
        still.held_s + (worry_s if seen.held else 0.0),
        still.commanded_m + abs(seen.commanded_mps) * dt_s,
        still.wheels_m + abs(motion.v_mps) * dt_s,
    )
    return still, approach


def _is_free(now: Recovery, motion: Motion, config: Config) -> bool:
    """Elsewhere, and nearer to the goal than ever: going to and fro is no escape."""
    away = _away_m(now.stuck_at, motion) > ESCAPED * config.recovery.progress_m
    return away and now.approach.nearest_m < now.stuck_nearest_m


def _is_stuck(now: Recovery, config: Config) -> bool:
    settings = config.recovery
    patience_s = settings.retry_s if now.stuck else settings.stuck_s
    return now.still.stalled_s >= patience_s or now.approach.distant_s >= _patience_s(now, config)


def _patience_s(now: Recovery, config: Config) -> float:
    """Time enough for any detour: after that a robot that is no nearer is stuck."""
    return config.recovery.distant_s + DETOUR * now.approach.farthest_m / config.limits.speed_mps


def _begun(now: Recovery, motion: Motion, seen: Symptoms, config: Config) -> tuple[Recovery, Order]:
    """The next attempt."""
    step, place = NEXT[now.tried], _place(motion)
    if step == BACK_UP and not seen.behind:
        step = NEXT[step]
    if not now.stuck:
        now = replace(now, stuck_at=place[:2], stuck_nearest_m=now.approach.nearest_m)
    cause = _cause(now, seen, config)
    now = replace(now, step=step, tried=step, cause=cause, since_ns=now.stamp_ns, began_at=place)
    return now, replace(_order(now, motion, config), began=True)


def _acting(now: Recovery, motion: Motion, seen: Symptoms, config: Config) -> tuple[Recovery, Order]:
    """Go on with the attempt, or end it and drive on."""
    if not _is_over(now, motion, seen, config):
        return now, _order(now, motion, config)
    distant_s = min(now.approach.distant_s, _patience_s(now, config) - AGAIN_S)
    approach, still = replace(now.approach, distant_s=distant_s), Standstill(_place(motion))
    return replace(now, step=DRIVE, since_ns=now.stamp_ns, still=still, approach=approach), NOTHING


def _is_over(now: Recovery, motion: Motion, seen: Symptoms, config: Config) -> bool:
    age_s = (now.stamp_ns - now.since_ns) / 1e9
    x, y, yaw = now.began_at
    if now.step == BACK_UP:
        done = _away_m((x, y), motion) >= config.recovery.back_m or not _behind(now.trail, motion)
        return done or not seen.behind or (seen.held and age_s > HELD_BACK_S) or age_s > LONGEST_S
    if now.step == TURN:
        return abs(math.remainder(motion.yaw_rad - yaw, math.tau)) >= TURN_RAD or age_s > LONGEST_S
    return now.step in (CLEAR, GIVE_UP) or age_s >= config.recovery.wait_s


def _order(now: Recovery, motion: Motion, config: Config) -> Order:
    if now.step == BACK_UP:
        return Order(BACK_UP, *_backing(now.trail, motion, config.recovery.back_mps))
    return Order(now.step, 0.0, TURN_RAD / (LONGEST_S / 2) if now.step == TURN else 0.0)


def _backing(trail: tuple[tuple[float, float], ...], motion: Motion, back_mps: float) -> tuple[float, float]:
    """(v, wz) backward along the arc through a place that the robot came from."""
    behind = _behind(trail, motion)
    if not behind:
        return 0.0, 0.0
    x, y = behind[-1]
    return -back_mps, -back_mps * 2.0 * y / (x * x + y * y)


def _behind(trail: tuple[tuple[float, float], ...], motion: Motion) -> list[tuple[float, float]]:
    """Places of the trail behind the robot, in its base frame, far enough to steer for; nearest last."""
    c, s = math.cos(motion.yaw_rad), math.sin(motion.yaw_rad)
    seen = [(x - motion.x_m, y - motion.y_m) for x, y in trail]
    own = [(c * dx + s * dy, -s * dx + c * dy) for dx, dy in seen]
    return [(x, y) for x, y in own if math.hypot(x, y) >= STEER_M and -x > abs(y)]


def _cause(now: Recovery, seen: Symptoms, config: Config) -> str:
    """What keeps the robot, as far as its own senses tell."""
    still = now.still
    if still.stalled_s < config.recovery.retry_s:
        return NO_NEARER
    if seen.waits:
        return WAITING
    if still.held_s > still.stalled_s / 2:
        return GUARD
    if still.wheels_m > SLIP * config.recovery.progress_m:
        return SLIPS
    return WHEELS if still.commanded_m > IDLE_MPS * still.stalled_s else BLOCKED


def _trailed(trail: tuple[tuple[float, float], ...], motion: Motion) -> tuple[tuple[float, float], ...]:
    if trail and _away_m(trail[-1], motion) < TRAIL_STEP_M:
        return trail
    return (*trail, (motion.x_m, motion.y_m))[-TRAIL:]


def _place(motion: Motion) -> tuple[float, float, float]:
    return motion.x_m, motion.y_m, motion.yaw_rad


def _away_m(place: tuple[float, float], motion: Motion) -> float:
    return math.hypot(place[0] - motion.x_m, place[1] - motion.y_m)
