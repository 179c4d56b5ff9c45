"""Where is the robot in the saved map, and is that to be believed? A value that scans and ticks move on.

It follows the pose from scan to scan while the scan fits the map; says that it is lost once the scan has not
fitted for a while; then looks for the robot in the whole map, and believes a place only if no other one fits
about as well. Nothing is believed before it held for some scans in a row. Points are in the base frame,
odometry poses in the odom frame. Knows no fleet: what is masked, is masked before.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hippomat_core.config import LidarConfig, SlamConfig
from hippomat_core.planning.costmap import Costmap
from hippomat_core.replaced import replace
from hippomat_core.slam.likelihood_field import LikelihoodField, field_of_grid
from hippomat_core.slam.matcher import Search, match
from hippomat_core.slam.pose2 import IDENTITY, Pose, apart, compose, inverse
from hippomat_core.slam.relocalize import Pyramid, Relocalization, begun, candidates, continued, pyramid_of
from hippomat_core.slam.scan_fit import ScanFit, scan_fit
from hippomat_core.slam.tracking import Estimate, at_start, carried_on, corrected

CHECKING, LOCALIZED, LOST = "checking", "localized", "lost"
AGREEING = 3  # scans in a row must fit before a pose is believed
CHECKS = 10  # sweeps; a pose that is not believed by then is given up
RETRY_NS = 2_000_000_000  # after a search without a result
START_SIGMA = (0.1, math.radians(5.0))  # how a person puts a robot on its mark
FOUND_SIGMA = (0.1, math.radians(3.0))
CLOSER = Search(0.2, math.radians(4.0))  # around a place that the search of the whole map names
WIDEST = Search(0.4, math.radians(15.0))
# A place could be it as well whose misfit is below 2.5 times the best one's (plus 0.02) and it plus 0.12.
ALIKE, SLACK, BEHIND = 2.5, 0.02, 0.12
SAME_M, SAME_RAD = 0.5, math.radians(20.0)  # two poses nearer than this are one place
LOOKING = "looking for the robot in the whole map"
NEVER = -1
NO_FIT = ScanFit(0, 0, 0)


@dataclass(frozen=True, slots=True, eq=False)
class SavedMap:
    """A map as the localizer uses it."""

    costmap: Costmap
    field: LikelihoodField
    pyramid: Pyramid


@dataclass(frozen=True, slots=True, eq=False)
class Seen:
    """One sweep: points (n, 2) [m] in the base frame, and the odometry pose that they are seen from."""

    points: NDArray[np.float64]
    odom: Pose


@dataclass(frozen=True, slots=True, eq=False)
class Hunt:
    """The search of the whole map for one sweep, and what became of the places that were looked at closer."""

    seen: Seen
    search: Relocalization
    places: tuple[Pose, ...] | None = None  # left to look at; None: the search goes on
    looked: tuple[tuple[float, Pose], ...] = ()  # score, pose


@dataclass(frozen=True, slots=True, eq=False)
class Localizer:
    """`map_from_odom` is the whole answer; the rest says what it is worth."""

    saved: SavedMap
    lidar: LidarConfig
    config: SlamConfig
    phase: str
    phase_ns: int
    why: str  # it is not localized, for people
    map_from_odom: Pose = IDENTITY
    estimate: Estimate | None = None  # at the last sweep
    odom: Pose = IDENTITY  # there, too
    fit: ScanFit = NO_FIT  # and how it fitted
    compared: int = 0  # sweeps since this pose was taken up
    agreeing: int = 0  # of them, in a row
    doubtful_ns: int = NEVER  # since when sweeps do not fit
    hunt: Hunt | None = None

    @property
    def localized(self) -> bool:
        return self.phase == LOCALIZED

    @property
    def searched(self) -> bool:
        """It is lost, and a search of the whole map did not help."""
        return self.phase == LOST and not self.why.endswith(LOOKING)


def saved_map(costmap: Costmap, body_m: float) -> SavedMap:
    """body_m: the robot's radius."""
    return SavedMap(costmap, field_of_grid(costmap.grid), pyramid_of(costmap, body_m))


def first_localizer(
    saved: SavedMap, lidar: LidarConfig, config: SlamConfig, odom: Pose, start_known: bool, now_ns: int
) -> Localizer:
    """Before the first sweep: where the odom frame begins at the start pose, else anywhere."""
    if start_known:
        why = "the scan has not been compared with the map at the start pose yet"
        start = at_start(odom, *START_SIGMA)
        return Localizer(saved, lidar, config, CHECKING, now_ns, why, estimate=start, odom=odom)
    why = f"no start pose was given: {LOOKING}"
    return Localizer(saved, lidar, config, LOST, now_ns - RETRY_NS, why)


def on_new_map(localizer: Localizer, saved: SavedMap, now_ns: int) -> Localizer:
    """The map changed and kept its frame: the pose stays, and has to fit anew."""
    localizer = replace(localizer, saved=saved, hunt=None, compared=0, agreeing=0, doubtful_ns=NEVER)
    if not localizer.localized:
        return localizer
    return replace(
        localizer, phase=CHECKING, phase_ns=now_ns, why="the map changed; the scan is compared with it"
    )


# ---- one sweep ----------------------------------------------------------------------------------


def with_sweep(localizer: Localizer, seen: Seen, stamp_ns: int) -> Localizer:
    """After one more sweep."""
    if localizer.phase == LOST:
        return _hunting(localizer, seen, stamp_ns)
    localizer = _followed(localizer, seen, stamp_ns)
    fits = localizer.doubtful_ns == NEVER
    if localizer.phase == CHECKING:
        if localizer.agreeing >= AGREEING:
            return replace(localizer, phase=LOCALIZED, phase_ns=stamp_ns, why="")
        if localizer.compared >= CHECKS:
            return _lost(localizer, stamp_ns, _misfit(localizer, "the scan does not fit the map here"))
        return localizer
    if not fits and stamp_ns - localizer.doubtful_ns > localizer.config.lost_after_s * 1e9:
        lost_s = localizer.config.lost_after_s
        return _lost(
            localizer, stamp_ns, _misfit(localizer, f"the scan has not fitted the map for {lost_s:g} s")
        )
    assert localizer.estimate is not None
    if localizer.estimate.radius_m > localizer.config.lost_radius_m:
        radius_m = localizer.estimate.radius_m
        return _lost(localizer, stamp_ns, f"the pose is only known within {radius_m:.1f} m")
    return localizer


def _misfit(localizer: Localizer, text: str) -> str:
    return f"{text} (score {localizer.fit.score:.2f}, needs {localizer.config.score_min:.2f})"


def _followed(localizer: Localizer, seen: Seen, stamp_ns: int) -> Localizer:
    """Predicted by the odometry, corrected by the matcher where that gives a pose that fits."""
    assert localizer.estimate is not None
    predicted = carried_on(localizer.estimate, localizer.odom, seen.odom, localizer.config)
    doubtful = localizer.doubtful_ns != NEVER
    found = match(localizer.saved.field, seen.points, predicted.pose, _window(predicted, doubtful))
    localizer = replace(localizer, compared=localizer.compared + 1)
    estimate = corrected(predicted, found)
    fit = _fit(localizer, seen, estimate.pose)
    if fit.score < localizer.config.score_min:
        since_ns = localizer.doubtful_ns if doubtful else stamp_ns
        return replace(
            localizer, estimate=predicted, odom=seen.odom, fit=fit, agreeing=0, doubtful_ns=since_ns
        )
    return replace(
        localizer,
        map_from_odom=compose(estimate.pose, inverse(seen.odom)),
        estimate=estimate,
        odom=seen.odom,
        fit=fit,
        agreeing=localizer.agreeing + 1,
        doubtful_ns=NEVER,
    )


def _window(predicted: Estimate, doubtful: bool) -> Search:
    """Three standard deviations; all that is affordable where the last sweep did not fit."""
    if doubtful:
        return WIDEST
    xy_m = 3.0 * math.sqrt(float(predicted.covariance.diagonal()[:2].max())) + 0.05
    yaw_rad = 3.0 * math.sqrt(float(predicted.covariance[2, 2])) + math.radians(1.0)
    return Search(min(xy_m, WIDEST.xy_m), min(yaw_rad, WIDEST.yaw_rad))


def _fit(localizer: Localizer, seen: Seen, pose: Pose) -> ScanFit:
    lidar = localizer.lidar
    return scan_fit(localizer.saved.costmap, seen.points, pose, (lidar.x_m, lidar.y_m))


# ---- lost ---------------------------------------------------------------------------------------


def _lost(localizer: Localizer, stamp_ns: int, why: str) -> Localizer:
    why = f"{why}: {LOOKING}"
    return replace(localizer, phase=LOST, phase_ns=stamp_ns - RETRY_NS, why=why, agreeing=0, hunt=None)


def _hunting(localizer: Localizer, seen: Seen, stamp_ns: int) -> Localizer:
    if localizer.hunt is not None or stamp_ns - localizer.phase_ns < RETRY_NS:
        return localizer
    return replace(localizer, hunt=Hunt(seen, begun(localizer.saved.pyramid, seen.points)))


def with_work(localizer: Localizer, now_ns: int) -> Localizer:
    """One more piece of the search of the whole map, where there is one; bounded work."""
    hunt = localizer.hunt
    if hunt is None:
        return localizer
    if hunt.places is None:
        search = continued(hunt.search, localizer.saved.pyramid)
        places = None
        if search.done:
            expected = _expected(localizer, hunt)
            guesses = () if expected is None else (expected,)
            places = (*guesses, *candidates(search, localizer.saved.pyramid))
        return replace(localizer, hunt=replace(hunt, search=search, places=places))
    if hunt.places:
        found = match(localizer.saved.field, hunt.seen.points, hunt.places[0], CLOSER)
        x, y, yaw = found.pose.tolist()
        looked = (*hunt.looked, (_fit(localizer, hunt.seen, (x, y, yaw)).score, (x, y, yaw)))
        return replace(localizer, hunt=replace(hunt, places=hunt.places[1:], looked=looked))
    return _judged(localizer, hunt, now_ns)


def _judged(localizer: Localizer, hunt: Hunt, now_ns: int) -> Localizer:
    """One place that fits, or one of several that is where the odometry expects the robot; else none."""
    ranked = _distinct(hunt.looked)
    best = ranked[0][0] if ranked else 0.0
    expected = _expected(localizer, hunt)
    limit = min(ALIKE * (1.0 - best) + SLACK, 1.0 - best + BEHIND)
    alike = [pose for score, pose in ranked if 1.0 - score < limit]
    near = [pose for pose in alike if expected is not None and _same(pose, expected)]
    if best < localizer.config.score_min:
        return _undecided(localizer, now_ns, f"the scan fits the map nowhere (best score {best:.2f})")
    if len(alike) > 1 and not near:
        text = f"the scan fits the map at {len(alike)} places alike: bring the robot where the map is unlike"
        return _undecided(localizer, now_ns, text)
    pose = near[0] if near else alike[0]
    estimate = at_start(pose, *FOUND_SIGMA)
    return replace(
        localizer,
        phase=CHECKING,
        phase_ns=now_ns,
        why="a place was found in the map, and is being checked",
        map_from_odom=compose(pose, inverse(hunt.seen.odom)),
        estimate=estimate,
        odom=hunt.seen.odom,
        doubtful_ns=NEVER,
        compared=0,
        agreeing=0,
        hunt=None,
    )


def _expected(localizer: Localizer, hunt: Hunt) -> Pose | None:
    """Where the robot is if it was not carried; None where it never knew."""
    return None if localizer.estimate is None else compose(localizer.map_from_odom, hunt.seen.odom)


def _undecided(localizer: Localizer, now_ns: int, why: str) -> Localizer:
    return replace(localizer, phase_ns=now_ns, why=why, hunt=None)


def _distinct(looked: tuple[tuple[float, Pose], ...]) -> list[tuple[float, Pose]]:
    """Best first, one per place."""
    kept: list[tuple[float, Pose]] = []
    for score, pose in sorted(looked, key=lambda one: -one[0]):
        if not any(_same(pose, other) for _, other in kept):
            kept.append((score, pose))
    return kept


def _same(a: Pose, b: Pose) -> bool:
    away_m, turn_rad = apart(a, b)
    return away_m < SAME_M and turn_rad < SAME_RAD
