"""One time base for the logs of a fleet, out of the frames that its robots heard of each other.

Decides how far each log's clock is off and how sure that is; trusts no clock, neither a robot's nor the
fleet's. A frame is named by sender, boot and sequence number; the radios of sender and receiver stamp it
within its airtime. Both ways of a link enclose the difference of two clocks (as in NTP, RFC 5905); of a link
with one way only the other bound is the longest airtime. Robots without a link are aligned through others.

Common time is the log time of one run, the reference. It is as wrong as that clock is, but the same for all.
"""

from __future__ import annotations

import heapq
import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import NoReturn

import numpy as np
from numpy.typing import NDArray

from hippomat_core.errors import HippomatError
from hippomat_logs.clock_map import ClockMap, Times, constant, thinned
from hippomat_logs.radio_links import Link, links_between
from hippomat_logs.radio_traffic import Traffic, traffic_of
from hippomat_logs.reader import Run
from hippomat_logs.shortfalls import whose_log

HOST_LATENCY_NS = 1e6  # from radio to log, of the least late record of a second, at most: USB's poll
Key = tuple[str, str]


@dataclass(frozen=True, slots=True)
class RunClock:
    """How one run's clock stands to common time. Residuals: how far its links' frames are off, after it."""

    name: str
    robot: int
    offset_ns: int  # common - own, when the run began
    drift_ppm: float  # by which its clock is slower than common time
    pairs: int  # frames that it sent or heard, and another run knows too
    residual_ns: tuple[float, float, float]  # median, 95 %, largest; without sign; nan where there are none
    violations: int  # frames that were heard before they were sent, by more than the uncertainty
    uncertainty_ns: (
        float  # of common time within the run, at most; 0: the reference; nan: its clock is trusted
    )
    through: str  # the run by whose frames it is aligned, "" = it is the reference, or trusted
    boots: int  # of its radio


@dataclass(slots=True)
class Alignment:
    """common_ns() turns a run's own log times into common time."""

    clocks: list[RunClock]
    reference: str  # name of a run; "" = every log's wall clock is trusted
    links: list[Link] = field(default_factory=list)
    traffic: list[Traffic] = field(default_factory=list)  # of each run, in the order of clocks
    maps: dict[Key, ClockMap] = field(default_factory=dict)
    strangers: frozenset[Key] = frozenset()  # runs that share no traffic with the reference, if allowed

    @classmethod
    def trusting(cls, runs: Sequence[Run]) -> Alignment:
        """Every log's own wall clock is common time."""
        return cls([_trusted(run) for run in runs], "", maps={key_of_run(run): constant() for run in runs})

    def common_ns(self, run: Run, log_time_ns: int) -> int:
        """A log time of `run` in common time."""
        return int(self.common_ns_array(run, np.array([log_time_ns], np.int64))[0])

    def common_ns_array(self, run: Run, log_times_ns: Times) -> Times:
        """(n,) -> (n,), int64 ns."""
        return self.map_of(run)(np.asarray(log_times_ns, np.int64))

    def in_order(self, runs: Sequence[Run]) -> list[Run]:
        """The runs as `clocks`, `traffic` and `links` number them."""
        return sorted(runs, key=_place)

    @property
    def maps_in_order(self) -> Iterator[ClockMap]:
        """Of each run, in the order of `clocks`."""
        return iter(self.maps.values())

    def is_stranger(self, run: Run) -> bool:
        """Whether it keeps its own clock although the others' are aligned."""
        return key_of_run(run) in self.strangers

    def map_of(self, run: Run) -> ClockMap:
        try:
            return self.maps[key_of_run(run)]
        except KeyError:
            raise HippomatError(f"{run.name}: is not among the runs that were aligned") from None


def key_of_run(run: Run) -> Key:
    """Names a run however often it is opened."""
    return run.manifest.get("robot", ""), run.manifest.get("session_id", "") or str(run.paths[0])


def align_runs(
    runs: Sequence[Run],
    *,
    reference: int | None = None,
    trust_clocks: bool = False,
    strangers: bool = False,
    progress: Callable[[str], None] = lambda _: None,
) -> Alignment:
    """Common time of `runs` by their radio traffic; one run alone is its own.

    reference: the robot whose log time shall be common time; None: of the first by id and start.
    trust_clocks: leave all wall clocks as they are; how far they are off shows in the residuals.
    strangers: runs that share no traffic keep their own clocks; the others' common time is that of the first
    of the largest group that does.
    Raises HippomatError naming the runs that share no traffic with the reference (with `strangers`: where no
    two share any), LogError for damaged logs.
    """
    runs = sorted(runs, key=_place)
    root = _root(runs, reference)
    if len(runs) < 2:
        return Alignment.trusting(runs)
    traffic = []
    for run in runs:
        progress(run.name)
        traffic.append(traffic_of(run))
    links = links_between(traffic)
    if trust_clocks:
        routes = _trusted_routes(range(len(runs)))
    elif strangers:
        each = [_routes(len(runs), links, traffic, k) for k in range(len(runs))]
        routes, root = max(each, key=len), each.index(max(each, key=len))
    else:
        routes = _routes(len(runs), links, traffic, root)
    alone = [k for k in range(len(runs)) if k not in routes]
    if alone and (not strangers or len(routes) == 1):
        _refuse([runs[k] for k in alone], runs[root])
    routes |= _trusted_routes(alone)
    maps = [_composed(routes, links, k) for k in range(len(runs))]
    clocks = [_clock(runs, traffic, links, routes, maps, k) for k in range(len(runs))]
    by_key = {key_of_run(run): map_ for run, map_ in zip(runs, maps, strict=True)}
    apart = frozenset(key_of_run(runs[k]) for k in alone)
    return Alignment(clocks, "" if trust_clocks else runs[root].name, links, traffic, by_key, apart)


def _place(run: Run) -> tuple[int, str, str]:
    return run.robot if run.robot >= 0 else 1 << 16, run.manifest.get("session_id", ""), str(run.paths[0])


def _root(runs: Sequence[Run], reference: int | None) -> int:
    if reference is None:
        return 0
    found = [k for k, run in enumerate(runs) if run.robot == reference]
    if not found:
        there = ", ".join(sorted({str(run.robot) for run in runs}))
        raise HippomatError(f"there is no run of robot {reference}: there are those of {there}")
    return found[0]


@dataclass(frozen=True, slots=True)
class _Route:
    """The surest way from a run to the reference: over `link` to run `parent`, and on from there."""

    uncertainty_ns: float
    parent: int
    link: int


def _routes(count: int, links: Sequence[Link], traffic: Sequence[Traffic], root: int) -> dict[int, _Route]:
    """Shortest paths (Dijkstra 1959) by uncertainty."""
    beside: list[list[int]] = [[] for _ in range(count)]
    for number, link in enumerate(links):
        beside[link.first].append(number)
        beside[link.second].append(number)
    routes: dict[int, _Route] = {}
    waiting = [(0.0, root, root, -1)]
    while waiting:
        sum_ns, here, parent, by = heapq.heappop(waiting)
        if here in routes:
            continue
        routes[here] = _Route(sum_ns, parent, by)
        for number in beside[here]:
            link = links[number]
            there = link.second if link.first == here else link.first
            if there not in routes:
                more_ns = link.uncertainty_ns(there, traffic[there].span_ns)
                heapq.heappush(waiting, (sum_ns + more_ns, there, here, number))
    return routes


def _trusted_routes(which: Iterable[int]) -> dict[int, _Route]:
    return {k: _Route(float("nan"), k, -1) for k in which}


def _refuse(alone: Sequence[Run], reference: Run) -> NoReturn:
    names = ", ".join(run.name for run in alone)
    raise HippomatError(
        f"no radio traffic links {names} with {reference.name}, so their clocks cannot be compared: "
        "leave them out, or trust the wall clocks of all (--trust-clocks)"
    )


def how_sure(alignment: Alignment) -> str:
    """ "within 0.3 ms", and who is not."""
    unsure_ns = [clock.uncertainty_ns for clock in alignment.clocks if not math.isnan(clock.uncertainty_ns)]
    alone = [whose_log(clock.robot) for clock in alignment.clocks if math.isnan(clock.uncertainty_ns)]
    text = f"within {max(unsure_ns) / 1e6:.1f} ms"
    if not alone:
        return text
    whose = "it keeps its" if len(alone) == 1 else "they keep their"
    return f"{text}; but no frames link {', '.join(alone)} with them: {whose} own wall clock"


def _composed(routes: dict[int, _Route], links: Sequence[Link], k: int) -> ClockMap:
    """From run k's log time to the reference's, link by link."""
    steps = list(_steps(routes, links, k))
    if len(steps) == 1:
        return steps[0]
    if not steps:
        return constant()
    knots = [step.origin_ns + np.rint(step.knots_ns).astype(np.int64) for step in steps]
    at = knots[0]
    for number in range(1, len(steps)):  # knots of later maps, seen on run k's clock
        back = knots[number]
        for step in reversed(steps[:number]):
            back = step.inverse(back)
        at = np.concatenate([at, back])
    origin_ns = int(at.min())
    since_ns = thinned((at - origin_ns).astype(np.float64))
    at = through = origin_ns + np.rint(since_ns).astype(np.int64)
    for step in steps:
        through = step(through)
    shift_ns = int(through[0] - at[0])
    return ClockMap(origin_ns, shift_ns, since_ns, (through - at - shift_ns).astype(np.float64))


def _steps(routes: dict[int, _Route], links: Sequence[Link], k: int) -> Iterator[ClockMap]:
    while routes[k].link >= 0:
        link = links[routes[k].link]
        yield link.map if link.first == k else link.map.inverse
        k = routes[k].parent


def _clock(
    runs: Sequence[Run],
    traffic: Sequence[Traffic],
    links: Sequence[Link],
    routes: dict[int, _Route],
    maps: Sequence[ClockMap],
    k: int,
) -> RunClock:
    route, map_, begun_ns = routes[k], maps[k], traffic[k].span_ns[0]
    aligned = route.link >= 0
    root = next(k for k, one in routes.items() if one.link < 0)
    host_ns = max(HOST_LATENCY_NS, traffic[k].latency_ns, traffic[root].latency_ns)
    late_ns, violations = [], 0
    for link in links:
        if k in (link.first, link.second):
            late_ns.append(link.lateness_ns(maps[link.first], maps[link.second]))
            ends = link.first, link.second
            unsure_ns = sum(
                float(np.nan_to_num(routes[end].uncertainty_ns)) + traffic[end].latency_ns for end in ends
            )
            violations += int(np.count_nonzero(late_ns[-1] < -unsure_ns))
    off_ns = np.abs(np.concatenate(late_ns)) if late_ns else np.empty(0)
    return RunClock(
        name=runs[k].name,
        robot=runs[k].robot,
        offset_ns=int(map_(np.array([begun_ns]))[0]) - begun_ns,
        drift_ppm=map_.drift * 1e6,
        pairs=len(off_ns),
        residual_ns=_summary(off_ns),
        violations=violations,
        uncertainty_ns=route.uncertainty_ns + (host_ns if aligned else 0.0),
        through=runs[route.parent].name if aligned else "",
        boots=traffic[k].boots,
    )


def _summary(off_ns: NDArray[np.float64]) -> tuple[float, float, float]:
    if not len(off_ns):
        return float("nan"), float("nan"), float("nan")
    return float(np.median(off_ns)), float(np.percentile(off_ns, 95)), float(off_ns.max())


def _trusted(run: Run) -> RunClock:
    nan = float("nan")
    return RunClock(run.name, run.robot, 0, 0.0, 0, (nan, nan, nan), 0, nan, "", 0)
