"""Charge that cosmic rays leave in single pixels, for the variance that they add."""

from __future__ import annotations

import functools
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from simulator.config.effects import CosmicRayConfig
from simulator.effects.cosmic_rays import draw_cosmic_rays
from simulator.rng import stream

_SIDE, _TRACKS = 700, 1500.0
_CM_PER_UM = 1e-4


class PixelHits(NamedTuple):
    """Charge of a track by pixels.

    Attributes
    ----------
    mean_e : float
        Electrons a track.
    square_e2 : float
        Sum over its pixels of the squared charge.
    charge_e : ndarray
        Charge of pixels that were hit, ascending.
    """

    mean_e: float
    square_e2: float
    charge_e: NDArray[np.float64]

    def share_above(self, level_e: float) -> float:
        """Share of the squared charge in pixels of more than a level."""
        squares = self.charge_e**2
        return float(squares[np.searchsorted(self.charge_e, level_e) :].sum() / max(squares.sum(), 1e-300))

    @property
    def typical_e(self) -> float:
        """Mean charge weighted by its square."""
        squares = self.charge_e**2
        return float((squares * self.charge_e).sum() / max(squares.sum(), 1e-300))


@functools.lru_cache(maxsize=8)
def pixel_hits(config: CosmicRayConfig, pixel_um: float) -> PixelHits:
    """Moments of a configured model of tracks, from 1500 of them drawn from a fixed stream.

    The moments of a track that crosses pixels at random have no closed form; those drawn are good to 5 %.
    """
    area_cm2 = (_SIDE * pixel_um * _CM_PER_UM) ** 2
    found = draw_cosmic_rays(config, (_SIDE, _SIDE), pixel_um, 1.0, _TRACKS / area_cm2, stream(1, "ledger", "hits"))
    charge = np.sort(found.electrons.astype(np.float64))
    tracks = max(found.n_events, 1)
    return PixelHits(float(charge.sum()) / tracks, float((charge**2).sum()) / tracks, charge)
