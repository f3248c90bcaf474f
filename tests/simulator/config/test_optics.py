import math

import pytest

from catalogs.errors import InputError
from simulator.config import load_instrument
from simulator.config.optics import DarkHoleConfig, MirrorConfig, WavefrontConfig


def test_inner_edge_by_band_replaces_the_one_in_lambda_d():
    instrument = load_instrument({"coronagraph": {"inner_arcsec": {"F662": 0.25}}})
    assert instrument.hole_inner_arcsec("F662") * math.sqrt(2) == pytest.approx(0.25)
    assert instrument.hole_inner_arcsec("F720") == load_instrument().hole_inner_arcsec("F720")
    with pytest.raises(InputError, match=r"outer_half_side_arcsec.*hole of F662"):
        load_instrument({"coronagraph": {"inner_arcsec": {"F662": 0.95}}})


@pytest.mark.parametrize("band", ["F940", "F1265", "F1425", "F1542"])
def test_the_near_infrared_channel_has_its_own_geometry(band):
    instrument = load_instrument({"near_infrared": {"pixel_scale_arcsec": 0.03, "mask_half_width_arcsec": 0.2}})
    assert instrument.pixel_scale_arcsec(band) == 0.03
    assert instrument.mask_half_width_arcsec(band) == 0.2
    assert instrument.hole_outer_arcsec(band) == 1.2
    assert instrument.pixel_scale_arcsec("F850") == 0.016153
    assert instrument.mask_half_width_arcsec("F850") == 0.155


@pytest.mark.parametrize(
    ("preset", "control", "mode", "inner"),
    [
        ("cpic_default", "conjugation", "4q", (0.231, 0.294, 0.319, 0.377)),
        ("cpic_2q", "conjugation", "2q", (0.19, 0.21, 0.23, 0.27)),
        ("cpic_single_jacobian", "single_jacobian", "4q", (0.231, 0.294, 0.319, 0.377)),
    ],
)
def test_shipped_instruments(preset, control, mode, inner):
    instrument = load_instrument(preset)
    assert instrument.name == preset
    assert (instrument.dark_hole.control, instrument.dark_hole.mode) == (control, mode)
    corners = [instrument.hole_inner_arcsec(band) * math.sqrt(2) for band in instrument.visible_bands()]
    assert corners == pytest.approx(inner, abs=5e-4)
    for band in instrument.bands:  # the cross hides nothing of the hole
        assert instrument.mask_half_width_arcsec(band) <= instrument.hole_inner_arcsec(band) + 1e-3
    for key in ("wavefront.opd_rms_nm", "mirror.n_actuators", "dark_hole.control", "coronagraph.apodizer"):
        assert instrument.provenance[key].source
        assert instrument.provenance[key].confidence == "A"


def test_perfect_is_without_aberrations():
    values = load_instrument().wavefront.model_dump()
    assert not WavefrontConfig(**values).perfect
    assert not WavefrontConfig(**values | {"opd_rms_nm": 0}).perfect
    assert not WavefrontConfig(**values | {"amplitude_rms": 0}).perfect
    assert WavefrontConfig(**values | {"opd_rms_nm": 0, "amplitude_rms": 0, "jitter_mas": 9}).perfect


def test_models_are_frozen_and_need_every_value():
    mirror = load_instrument().mirror
    assert MirrorConfig(**mirror.model_dump()) == mirror
    with pytest.raises(ValueError, match="frozen"):
        mirror.bits = 12
    with pytest.raises(ValueError, match="side"):
        DarkHoleConfig(control="off", mode="4q", bandwidth=0.1, surface_files={})
