"""What cosmic rays and dates refuse, each in one line that names the setting."""

import numpy as np

from simulator.config import load_instrument
from simulator.effects import draw_cosmic_rays
from simulator.effects.sky import decimal_year, parse_utc

RAYS = {"shape": (1024, 1024), "pixel_um": 13.0, "exposure_s": 300.0, "rate_per_s_cm2": 1.0}


def cosmic_rays(change):
    asked = RAYS | {key: tuple(value) if isinstance(value, list) else value for key, value in change.items()}
    return draw_cosmic_rays(load_instrument().cosmic_rays, **asked, rng=np.random.default_rng(20280101))


READERS = {
    "start_utc": lambda value: parse_utc("start_utc", value),
    "year": lambda value: decimal_year("when", value),
    "cosmic_rays": cosmic_rays,
}


def test_bad_input_is_refused_in_one_line(refusal):
    refusal.by(READERS)
