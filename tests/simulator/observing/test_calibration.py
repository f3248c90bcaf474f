"""Calibration sequences against what they calibrate."""

import numpy as np
import pytest

from simulator import calibrate
from simulator.effects import sky_rate_e_s_arcsec2

PLAIN = {"cosmic_rays": False, "interference": False, "bias_drift": False, "nonlinearity": False}


def active(sequence, image):
    return image[sequence.sections["active"]]


def test_bias_frames_hold_level_stripes_and_read_noise():
    seen = calibrate("BIAS", n_frames=4, switches=PLAIN | {"clock_charge": False})
    stack = seen.frames.astype(float)
    detector = seen.instrument.detector
    assert stack.mean() == pytest.approx(detector.bias_adu, abs=0.3)
    assert (stack[0] - stack[1]).std() / np.sqrt(2) == pytest.approx(
        np.hypot(detector.read_noise_e / detector.gain_e_adu, 12**-0.5), rel=0.01
    )
    assert stack.mean(axis=(0, 1)).std() == pytest.approx(detector.bias_structure.stripe_rms_adu, rel=0.1)
    assert seen.exposure_s == 0
    assert seen.header["OBSTYPE"] == "BIAS"


def test_dark_frames_hold_the_dark_current():
    seen = calibrate(
        "DARK",
        exposure_s=2000.0,
        em_gain=100.0,
        switches=PLAIN | {"stripes": False, "bad_columns": False, "bad_pixels": False},
    )
    detector = seen.instrument.detector
    electrons = (active(seen, seen.frame(0).adu).astype(float) - detector.bias_adu) * detector.gain_e_adu / 100
    mean = detector.dark_rate_e_s * 2000 + detector.cic_e
    assert np.median(seen.expected_e) == pytest.approx(detector.dark_rate_e_s * 2000, rel=0.1)
    assert electrons.mean() == pytest.approx(mean, rel=0.01)


def test_flat_fields_hold_the_response():
    seen = calibrate("FLAT", band="F662", exposure_s=1.0, n_frames=2, switches=PLAIN)
    detector = seen.instrument.detector
    level = (active(seen, seen.frame(0).adu).astype(float) - detector.bias_adu) * detector.gain_e_adu
    good = active(seen, seen.frame(0).mask) == 0
    assert level[good].mean() == pytest.approx(detector.full_well_e / 2, rel=0.01)
    noise = np.sqrt(detector.full_well_e / 2 + detector.read_noise_e**2 + detector.gain_e_adu**2 / 12)
    scatter = np.hypot(noise, detector.flaws.prnu_rms * detector.full_well_e / 2)
    assert level[good].std() == pytest.approx(scatter, rel=0.05)


def test_background_is_the_sky_behind_the_mask():
    seen = calibrate("BKG", band="F662", exposure_s=100.0)
    rates = seen.mean_rate_map
    assert rates.max() > 0
    row, column = seen.instrument.detector.star_row, seen.instrument.detector.star_column
    assert rates[row, column] == 0  # behind the cross
    assert np.count_nonzero(rates == 0) == pytest.approx(19 * (1050 + 1080), rel=0.1)


def test_laser_is_a_spot_where_it_is_asked_for():
    seen = calibrate("LASER", band="F720", exposure_s=1.0, level_e=1e5, offset_arcsec=(-0.4, 0.6), switches=PLAIN)
    row, column = np.unravel_index(seen.mean_rate_map.argmax(), seen.shape)
    pixel = seen.instrument.detector.pixel_scale_arcsec
    assert (column - 536) * pixel == pytest.approx(-0.4, abs=pixel)
    assert (row - 514) * pixel == pytest.approx(0.6, abs=pixel)
    # One wavelength, the apodizer's energy behind an open mask.
    assert 0.1 * 1e5 < seen.mean_rate_map.sum() < 1e5


def test_infrared_calibrations():
    bias = calibrate("BIAS", camera="NIR")
    assert bias.camera == "NIR"
    assert bias.shape == bias.instrument.near_infrared.detector.shape
    flat = calibrate("FLAT", band="F1265", exposure_s=10.0, level_e=20_000, switches={"cosmic_rays": False})
    detector = flat.instrument.near_infrared.detector
    assert np.median(flat.frame(0).adu) == pytest.approx(
        detector.bias_adu + (20_000 + 10 * detector.dark_e_s) / detector.gain_e_adu, rel=0.02
    )


def test_the_camera_of_a_band_may_be_said_too():
    for camera in (None, "NIR"):
        assert calibrate("FLAT", band="F1265", camera=camera, exposure_s=1.0).camera == "NIR"
    assert calibrate("BIAS").camera == "VIS"


def test_background_at_a_place_and_date():
    dated = {"sky": {"season": "date"}}
    settings = {"band": "F662", "exposure_s": 100.0, "instrument": dated, "start_utc": "2028-03-20"}
    near, far = (
        calibrate("BKG", ra_deg=ra, dec_deg=dec, **settings) for ra, dec in ((45.0, 17.0), ("12:00:00", "-0:00:01"))
    )
    ratio = near.mean_rate_map.max() / far.mean_rate_map.max()
    level = [
        sky_rate_e_s_arcsec2(near.instrument, "F662", ra_deg=ra, dec_deg=dec, start_utc="2028-03-20").rate_e_s_arcsec2
        for ra, dec in ((45.0, 17.0), (180.0, -1 / 3600))
    ]
    assert ratio == pytest.approx(level[0] / level[1], rel=1e-9)
    assert ratio > 1.5  # the Sun stands at right ascension 0
    assert far.header["RA_OBJ"] == 180.0
    assert far.header["DEC_OBJ"] == pytest.approx(-1 / 3600)
    row = next(row for row in far.ledger if row.effect == "sky")
    assert "zodiacal" in row.reason
    plain = calibrate("BKG", band="F662", exposure_s=1.0)
    assert "RA_OBJ" not in plain.header
    assert {"sky", "earthshine", "stray light"} <= {row.effect for row in plain.ledger}


def test_ledger_of_frames_that_see_no_sky_has_none():
    for kind, more in (("BIAS", {}), ("DARK", {"exposure_s": 5.0}), ("FLAT", {"exposure_s": 1.0, "band": "F662"})):
        rows = {row.effect: row for row in calibrate(kind, **more).ledger}
        assert "sky" not in rows
        assert rows["cosmic rays"].decision == ("skipped" if kind == "BIAS" else "kept")
        assert rows["flat field"].decision == ("kept" if kind == "FLAT" else "skipped")
