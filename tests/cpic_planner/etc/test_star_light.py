"""Light that is kept of a star is that of this star, at this date, in this model."""

import numpy as np
import pytest

from cpic_planner.etc import build_model
from cpic_planner.etc.rates import aperture_sky_e_s, light_of, star_e_s
from cpic_planner.targets import Targets, find_target
from simulator.config import load_instrument

MODELS = [
    build_model(load_instrument(tree)) for tree in ({}, {"sky": {"season": "date"}}, {"bands": {"F662": {"qe": 0.4}}})
]
STARS = [
    find_target(name, date_utc=date)[0] for name in ("tau Cet", "eps Eri") for date in ("2028-01-01", "2028-07-01")
]


@pytest.mark.parametrize("again", [False, True])
def test_one_star_as_among_many(again):
    for model in MODELS:
        for star in STARS:
            own, sky = light_of(model, star, "F662")
            assert np.array_equal(own, star_e_s(model, "F662", star, star.v_mag, star.teff_k))
            assert np.array_equal(sky, aperture_sky_e_s(model, star, "F662"))
    many = light_of(MODELS[0], Targets.joined(STARS), "F662")
    assert np.array_equal(many[0], np.concatenate([light_of(MODELS[0], star, "F662")[0] for star in STARS]))


def test_what_is_kept_is_not_written_to():
    own, sky = light_of(MODELS[0], STARS[0], "F520")
    assert not own.flags.writeable
    assert not sky.flags.writeable
    assert light_of(MODELS[0], STARS[0], "F520")[0] is own
