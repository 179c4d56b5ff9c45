"""Which faults hold, and since when: the rows of the reaction table (reactions.py) that apply now.

Knows the state only; ages are differences of stamps.
"""

from __future__ import annotations

from hippomat_core.messages import BASE, LIDAR, RADIO, AlarmCleared, AlarmRaised, Effect
from hippomat_core.reactions import BY_CODE
from hippomat_core.replaced import replace
from hippomat_core.ros.intake import base_silent, not_localized, text_for
from hippomat_core.state import State

STARTUP_NS = 4_000_000_000  # devices come up one after the other: no alarm before
RADIO_SILENT_NS = 3_000_000_000  # its status comes once a second
BASE_SILENT_NS = 1_000_000_000  # its feedback comes every 40 ms; without it the pose stands still


def with_faults(state: State, now_ns: int, effects: list[Effect]) -> State:
    """Faults keep the stamp they began at; alarms are raised and cleared as faults come and go."""
    if state.observes:
        return state
    found = _faults(state, now_ns)
    if not found and not state.faults and not state.alarms:
        return state
    since = dict(state.faults)
    faults = tuple((code, since.get(code, now_ns)) for code in found)
    quiet = now_ns - state.started_ns < STARTUP_NS
    codes = frozenset(found)
    raised = frozenset() if quiet else codes - state.alarms
    cleared = frozenset(BY_CODE) & state.alarms - codes
    effects += [AlarmRaised(BY_CODE[code].level, code, _text(state, code)) for code in sorted(raised)]
    effects += [AlarmCleared(code) for code in sorted(cleared)]
    return replace(state, faults=faults, alarms=(state.alarms | raised) - cleared)


def _text(state: State, code: str) -> str:
    if code == "no_map" and state.charting is not None:
        return (
            "a map is being made: push the robot, or drive it with something else; it does not drive itself"
        )
    if code == "not_localized" and state.place is not None:
        return state.place.why
    return state.stop.text if code == "stop" else text_for(state, code) or BY_CODE[code].text


def _faults(state: State, now_ns: int) -> list[str]:
    config, place = state.config, state.place
    scan_ns = None if state.scan is None else now_ns - state.scan.stamp_ns
    holds = {
        "no_map": state.ground is None,
        "base_lost": not state.ports[BASE] or base_silent(state, now_ns, BASE_SILENT_NS),
        "lidar_lost": not state.ports[LIDAR] or scan_ns is None or scan_ns > config.lidar.timeout_s * 1e9,
        "not_localized": not_localized(state, now_ns) if place is None else not place.localized,
        "radio_lost": not state.ports[RADIO] or now_ns - state.radio_heard_ns > RADIO_SILENT_NS,
        "stop": state.stop.latched,
    }
    return [code for code, held in holds.items() if held]
