"""What mapping has to achieve, and whether a run did. Accuracy is judged on the log it was set for."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from hippomat_sim.bench.radio_targets import Target
from hippomat_sim.bench.slam_relations import RelationErrors
from hippomat_sim.bench.slam_run import Costs

INTEL = (910, 2984)  # scans and relations of the log that the bounds were set for
ALL_M, ALL_DEG = 0.066, 2.4
AT_SCANS_M, AT_SCANS_DEG = 0.022, 0.45
SCAN_P95_MS, STEP_MS = 15.0, 50.0


@dataclass(frozen=True, slots=True)
class Errors:
    """Of one trajectory, against the same relations."""

    at_scans: RelationErrors  # both ends at a scan
    interpolated: RelationErrors  # all, poses between scans interpolated in time
    all: RelationErrors | None  # all, with odometry between the scans; None where there is none


def targets_of(
    costs: Costs, scans: int, relations: int, errors: Errors | None, with_odometry: bool
) -> list[Target]:
    """The same ones for every run, judged or not."""
    why_not = ""
    if errors is None:
        why_not = "no --relations"
    elif not with_odometry:
        why_not = "--no-odometry"
    elif (scans, relations) != INTEL:
        why_not = "set for the Intel log"
    why_no_step = "" if with_odometry else "--no-odometry"
    why_no_speed = why_no_step or ("" if scans == INTEL[0] else "set for the Intel log")
    return [*_accuracy(errors, why_not), *_speed(costs, why_no_speed, why_no_step)]


def _accuracy(errors: Errors | None, why_not: str) -> Iterator[Target]:
    everywhere = errors.all if errors else None
    why_not_all = why_not or ("" if everywhere else "no --between")
    at_scans = errors.at_scans if errors else None
    for what, found, most_m, most_deg, reason in (
        ("all relations", everywhere, ALL_M, ALL_DEG, why_not_all),
        ("relations at scans", at_scans, AT_SCANS_M, AT_SCANS_DEG, why_not),
    ):
        translation_m = found.translation_m if found else math.nan
        rotation_deg = found.rotation_deg if found else math.nan
        yield Target(f"{what}, translation", translation_m, most_m, False, "m", reason)
        yield Target(f"{what}, rotation", rotation_deg, most_deg, False, "deg", reason)


def _speed(costs: Costs, why_no_speed: str, why_no_step: str) -> Iterator[Target]:
    p95_ms = float(np.percentile(costs.scan_ms, 95))
    yield Target("front end, 95th percentile per scan", p95_ms, SCAN_P95_MS, False, "ms", why_no_speed)
    yield Target("longest step that the robot waits for", costs.longest_ms, STEP_MS, False, "ms", why_no_step)
