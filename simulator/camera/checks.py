"""Input checks shared by the camera: refuse by name, with the offending pixel."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from catalogs.errors import InputError
from simulator.quantities import element_name

FloatArray = npt.NDArray[np.float64]
NEGATIVE_TOLERANCE = 1e-9
# More light than this counts as this: that of any exposure and any sum of it stays finite.
MOST_E_S = 1e100


def checked_rates(rate_map_e_s: npt.ArrayLike) -> tuple[FloatArray, int]:
    """Rates of a 2-D map with rounding-error negatives set to 0 (and those above 1e100 to that), and their number.

    Raises
    ------
    InputError
        For an empty map or one of other dimensions, and for NaN, infinity or a rate more negative than 1e-9 of the
        largest, naming the pixel.
    """
    allowed = f"finite and at least 0 (rounding errors to -{NEGATIVE_TOLERANCE:g} of the largest count as 0)"
    try:
        rates = np.asarray(rate_map_e_s)
    except ValueError:
        raise InputError(
            "rate_map_e_s", type(rate_map_e_s).__name__, unit="e-/s", allowed="a 2-D (y, x) array"
        ) from None
    if rates.dtype.kind not in "iuf" or rates.ndim != 2 or rates.size == 0:
        raise InputError(
            "rate_map_e_s",
            f"{rates.dtype} array of shape {rates.shape}",
            unit="e-/s",
            allowed="a non-empty 2-D (y, x) array of numbers",
        )
    rates = rates.astype(np.float64, copy=False)
    lowest, highest = float(rates.min()), float(rates.max())
    if lowest >= 0.0 and highest <= MOST_E_S:
        return rates, 0
    finite = np.isfinite(rates)
    bad = ~finite if not finite.all() else rates < -NEGATIVE_TOLERANCE * max(highest, 0.0)
    if bad.any():
        name, index = element_name("rate_map_e_s", bad)
        raise InputError(name, float(rates[index]), unit="e-/s", allowed=allowed)
    return np.clip(rates, 0.0, MOST_E_S), int(np.count_nonzero(rates < 0.0))
