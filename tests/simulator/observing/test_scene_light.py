"""Light that stays during a sequence: a window with what smears into it against the whole frame."""

import numpy as np
import pytest

from simulator import load_instrument, observe
from simulator.imaging import psf_metrics

NOTHING = dict.fromkeys(type(load_instrument().detector.switches).model_fields, False)
STILL = {"drift": {"visit_nm": 0.0, "walk_nm_per_sqrt_hour": 0.0, "orbital_nm": 0.0}}
STRAY = {"sky": {"stray_light": {"rate_e_s": 0.5}}}
COMPANION = {"name": "B", "v_mag": 4.0, "teff_k": 5200, "separation_arcsec": 6.0, "pa_deg": 5.0}


def smear(window, changes=None, more=(), band="F520", **settings):
    """Electrons that smear into the stamp around the mask: expected frames with and without it."""
    instrument = load_instrument(STILL | (changes or {}))
    scene = {"name": "s", "cstar": {"name": "s", "v_mag": 2.0, "teff_k": 5800}} | dict(more)
    frames = []
    for on in (True, False):
        seen = observe(
            scene,
            band=band,
            exposure_s=0.01,
            window=window,
            instrument=instrument,
            switches=NOTHING | {"smear": on},
            **settings,
        )
        rows, columns, _ = seen.area.stamp(len(seen.psf.on_axis))
        frames.append(seen.expected_e[rows, columns])
        if on:
            parts = seen.smear_e[rows, columns]
        else:
            assert seen.light.beyond_e_s is None
            assert not seen.smear_e.any()
    if "extended" not in scene:  # a window alone is not lit by a disc as far out as its columns are
        np.testing.assert_allclose(parts, frames[0] - frames[1], rtol=1e-6, atol=1e-12 * frames[1].max())
    return parts


DISC = {"kind": "disc", "name": "d", "contrast": 0.01, "inner_arcsec": 0.5, "outer_arcsec": 3.0}


@pytest.mark.parametrize(
    ("changes", "more", "offset", "tolerance"),
    [
        ({}, {}, (0.0, 0.0), 1e-6),
        (STRAY, {}, (0.0, 0.0), 1e-6),
        ({}, {"stars": [COMPANION]}, (0.0, 0.0), 1e-6),
        pytest.param({}, {"extended": [DISC]}, (0.0, 0.0), 1e-6, marks=pytest.mark.long),
        ({}, {}, (0.3, 0.3), 0.01),  # the core has other settings on a whole frame
    ],
    ids=["star", "stray light", "companion", "disc", "star off the mask"],
)
def test_a_window_holds_the_smear_of_the_whole_frame(changes, more, offset, tolerance):
    whole, window = (smear(name, changes, more, star_offset_arcsec=offset) for name in ("full", "hole"))
    hole = psf_metrics(load_instrument(), "F520").hole
    np.testing.assert_allclose(window[hole], whole[hole], rtol=tolerance)


@pytest.mark.parametrize("band", ["F520", "F850"])
def test_the_column_light_of_the_metrics_is_that_of_a_whole_frame(band):
    """Whole frames of one star without a sky: the smear is its light in the columns, to 1 %."""
    dark = {"sky": {"model": "uniform", "brightness_v_mag_arcsec2": 40.0}}
    instrument = load_instrument()
    metrics, whole = psf_metrics(instrument, band), smear("full", dark, band=band)
    star = observe({"name": "s", "cstar": {"v_mag": 2.0, "teff_k": 5800}}, band=band, exposure_s=1.0, window="hole")
    light = metrics.column_light * star.truth.sources[0].rate_e_s * instrument.detector.transfer.line_shift_s
    seen = np.where(metrics.hole, whole, np.nan)
    columns = metrics.hole.any(axis=0)
    np.testing.assert_allclose(np.nanmean(seen[:, columns], axis=0), light[columns], rtol=0.01)


def test_no_smear_without_line_shifts():
    still = {"detector": {"transfer": {"line_shift_s": 0.0}}}
    seen = observe(
        {"name": "s", "cstar": {"v_mag": 2.0, "teff_k": 5800}},
        band="F520",
        exposure_s=1.0,
        window="hole",
        instrument=load_instrument(still),
    )
    assert seen.light.beyond_e_s is None
    assert not seen.smear_e.any()
