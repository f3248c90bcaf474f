"""Processor time that the parts of an observation take, as far as leaving them out saves it.

Rough times of one core; only their ratios matter, which decide what is left out first.
"""

from __future__ import annotations

from simulator.detectors.chains import VISIBLE, rows_of
from simulator.knobs import Knobs

FRAME_S = {effect.switch: effect.frame_s for effect in rows_of(VISIBLE) if effect.frame_s}
"""Seconds a frame of each effect on the window around the hole (137 x 137)."""
SET_UP_S = {effect.switch: effect.set_up_s for effect in rows_of(VISIBLE) if effect.set_up_s} | {"sky": 1e-3}
"""Seconds a sequence of what is worked out once."""
WHOLE_FRAME_S = 3e-3
"""Seconds a frame with everything."""
FULL_PIXELS = 60.0
"""Pixels of the whole frame over those of the window around the hole."""
SOURCE_S, FAR_SOURCE_S, EXTENDED_S = 4e-3, 2e-2, 6e-2
"""Seconds of a source in the window, of a star that needs wavelengths of its own, and of an extended source."""
_STAMP_S, _PUPIL_S = 3e-4, 1e-3


def stamp_s(knobs: Knobs) -> float:
    """Seconds of one image of the star behind the mask."""
    products = knobs.wavelength_nodes * (_STAMP_S * knobs.pixel_nodes**2 + _PUPIL_S)
    return products * (0.55 if knobs.precision == "single" else 1.0) * (1.0 if knobs.pupil_samples <= 128 else 2.0)
