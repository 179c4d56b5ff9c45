"""Which receivers miss a frame: independently, in bursts of a link, or in fades of a receiver.

Bursts are those of Gilbert (1960) and Elliott (1963): a link is good or bad, nothing gets through while it is
bad, and both last exponentially long. Knows no frames and no carrier.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hippomat_sim.air import AirSettings

_BLOCK = 256


class Draws:
    """Rows of `width` independent numbers in [0, 1), drawn many at a time."""

    def __init__(self, rng: np.random.Generator, width: int) -> None:
        self._rng, self._width, self._used = rng, width, _BLOCK

    def row(self) -> NDArray[np.float64]:
        """(width,) the next ones."""
        if self._used == _BLOCK:
            self._block = self._rng.random((_BLOCK, self._width))
            self._used = 0
        self._used += 1
        return self._block[self._used - 1]


class Losses:
    """Loss of every link, with the memory that bursts need. The calls' times never go back."""

    def __init__(self, stations: int, air: AirSettings, rng: np.random.Generator) -> None:
        self._loss = np.full((stations, stations), air.loss)  # [sender, receiver]
        for (sender, receiver), loss in air.link_loss.items():
            self._loss[sender, receiver] = loss
        self._draws = Draws(rng, stations)
        self._bursts = air.bursts
        # Bad for burst_s on average and good so long that the share of bad times is the loss.
        self._memory_us = np.maximum(1e6 * air.burst_s * (1 - self._loss), 1.0)
        states = stations if air.bursts == "link" else 1
        self._was_bad = np.zeros((states, stations))
        self._at_us = np.full((states, 1), -1e12)

    def lost(self, now_us: int, sender: int) -> NDArray[np.bool_]:
        """(S,) who misses what this sender sends now."""
        loss = self._loss[sender]
        if self._bursts == "none":
            return self._draws.row() < loss
        state = sender if self._bursts == "link" else 0
        kept = np.exp((self._at_us[state] - now_us) / self._memory_us[sender])
        bad = self._draws.row() < loss + (self._was_bad[state] - loss) * kept
        self._was_bad[state], self._at_us[state] = bad, now_us
        return bad
