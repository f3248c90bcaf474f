"""Sizes of the effects of the visible camera: what each of them says of itself."""

from __future__ import annotations

from simulator.detectors.chains import VISIBLE, rows_of
from simulator.knobs import Quantity
from simulator.ledger.case import CameraCase


def camera_sizes(case: CameraCase) -> dict[str, dict[Quantity, float]]:
    """Return the size of every effect of the camera on every quantity, by the name of its switch.

    Of a change of the mean ``d`` of a pixel the size is ``|d| / sigma``, or that of the variance that goes with it; of
    a part of the variance half its share; of a change of the aperture sum of a planet its relative size; for the SNR
    the sum of this and half the share of the variance of the aperture sum.
    """
    found = {effect.switch: effect.size(case) for effect in rows_of(VISIBLE)}
    return {key: size for key, size in found.items() if size is not None}
