"""Match a keyframe with the keyframes around another one: what loop closing and the final pass are made of.

Knows a pose graph; decides nothing about what a match is worth.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from hippomat_core.slam.mapper import MapperSettings, surroundings
from hippomat_core.slam.matcher import Match, Search, match
from hippomat_core.slam.pose_graph import Links, PoseGraph
from hippomat_core.slam.poses import seen_from, turned_information


def places_near(
    graph: PoseGraph, keyframe: int, candidates: NDArray[np.bool_], reach_m: float, at_most: int
) -> list[int]:
    """The nearest candidate (n,) of each unbroken run of keyframes within reach, nearest run first."""
    apart_m = np.hypot(*(graph.poses[:, :2] - graph.poses[keyframe, :2]).T)
    within = np.flatnonzero(candidates & (apart_m <= reach_m))
    if not len(within):
        return []
    runs = np.split(within, np.flatnonzero(np.diff(within) > 1) + 1)
    nearest = [int(run[np.argmin(apart_m[run])]) for run in runs]
    return sorted(nearest, key=lambda place: (float(apart_m[place]), place))[:at_most]


def match_at(
    graph: PoseGraph, place: int, keyframe: int, beside: int, search: Search, mapper: MapperSettings
) -> Match:
    """The keyframe matched with those within `beside` of the place, itself left out; frame of the place."""
    first, end = max(place - beside, 0), min(place + beside + 1, len(graph))
    around = [k for k in range(first, end) if k != keyframe]
    poses = seen_from(graph.poses[place], graph.poses[around])
    field = surroundings([graph.keyframes[k] for k in around], poses, mapper)
    guess = seen_from(graph.poses[place], graph.poses[keyframe])
    return match(field, graph.keyframes[keyframe].points, guess, search)


def link_of(place: int, keyframe: int, found: Match) -> Links:
    """The link that a match_at() found, from the place to the keyframe."""
    information = turned_information(found.information, float(found.pose[2]))
    first, second = np.array([place], np.int32), np.array([keyframe], np.int32)
    return Links(first, second, found.pose[None, :], information[None, :, :])


def loosest_m(found: Match) -> float:
    """The largest standard deviation of the matched position, over all directions [m]."""
    return math.sqrt(float(np.linalg.eigvalsh(np.linalg.inv(found.information)[:2, :2])[-1]))
