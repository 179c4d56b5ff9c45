"""What chance does to a frame at its receivers: lost, late, twice, stronger or weaker.

Losses are independent, or in bursts of a link, or in fades of a receiver. Bursts are those of Gilbert (1960)
and Elliott (1963): a link is good or bad, nothing gets through while it is bad, and both last exponentially
long. Knows no frames and no carrier.
"""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from hippomat_sim.air import AirSettings

_BLOCK = 256


class Fates:
    """For one transmission after the other what befalls it at every receiver; drawn many at a time."""

    def __init__(self, stations: int, air: AirSettings, rng: np.random.Generator) -> None:
        self._shape, self._air, self._rng = (_BLOCK, stations), air, rng
        self._used = _BLOCK

    def draw(self) -> tuple[NDArray[np.int64], NDArray[np.bool_], NDArray[np.float64]]:
        """(S,) each: delay after its end [us]; whether it comes twice; what its strength differs by [dB]."""
        if self._used == _BLOCK:
            self._refill()
        k = self._used
        self._used += 1
        return self._delays_us[k], self._twice[k], self._noise_db[k]

    def _refill(self) -> None:
        air, rng, shape = self._air, self._rng, self._shape
        jitter_us = rng.integers(0, air.jitter_us, shape, endpoint=True)
        late_us = rng.integers(0, air.late_us, shape, endpoint=True)
        self._delays_us = air.latency_us + jitter_us + np.where(rng.random(shape) < air.late, late_us, 0)
        self._twice = rng.random(shape) < air.duplicate
        self._noise_db = rng.normal(0.0, air.shadowing_db, shape)
        self._used = 0


class LossModel(Protocol):
    """Who misses which frame. The calls' times never go back."""

    def lost(self, now_us: int, sender: int, frame: bytes) -> NDArray[np.bool_]:
        """(S,) who misses this frame of the sender, which ends now."""
        ...


class Losses:
    """Loss of every link, with the memory that bursts need. The calls' times never go back."""

    def __init__(self, stations: int, air: AirSettings, rng: np.random.Generator) -> None:
        self._loss = np.full((stations, stations), air.loss)  # [sender, receiver]
        for (sender, receiver), loss in air.link_loss.items():
            self._loss[sender, receiver] = loss
        self._rng, self._used = rng, _BLOCK
        self._block: NDArray[np.float64] = np.zeros((0, stations))
        self._bursts = air.bursts
        # Bad for burst_s on average and good so long that the share of bad times is the loss.
        self._memory_us = np.maximum(1e6 * air.burst_s * (1 - self._loss), 1.0)
        states = stations if air.bursts == "link" else 1
        self._was_bad = np.zeros((states, stations))
        self._at_us = np.full((states, 1), -1e12)

    def lost(self, now_us: int, sender: int, frame: bytes) -> NDArray[np.bool_]:  # noqa: ARG002
        """(S,) who misses what this sender sends now, whatever it is."""
        chance = self._loss[sender]
        bursts = self._bursts != "none"
        state = sender if self._bursts == "link" else 0
        if bursts:
            kept = np.exp((self._at_us[state] - now_us) / self._memory_us[sender])
            chance = chance + (self._was_bad[state] - chance) * kept
        lost: NDArray[np.bool_] = self._uniform() < chance
        if bursts:
            self._was_bad[state], self._at_us[state] = lost, now_us
        return lost

    def _uniform(self) -> NDArray[np.float64]:
        """(S,) in [0, 1)."""
        if self._used == _BLOCK:
            self._block = self._rng.random((_BLOCK, len(self._loss)))
            self._used = 0
        row: NDArray[np.float64] = self._block[self._used]
        self._used += 1
        return row
