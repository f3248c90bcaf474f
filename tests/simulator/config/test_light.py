"""What people may write for an albedo."""

import math

import pytest
from hypothesis import given, strategies as st

from simulator.config import ConstantAlbedo, GridAlbedo, MeasuredAlbedo, ParametricAlbedo, TableAlbedo, albedo_spec


@pytest.mark.parametrize(
    ("text", "kind"),
    [
        ("jupiter", MeasuredAlbedo),
        ("parametric", ParametricAlbedo),
        (0.3, ConstantAlbedo),
        ({"value": 0.3}, ConstantAlbedo),
        ({"log10_mh": 1, "log10_fsed": 1}, ParametricAlbedo),
        ({"mh": 10, "fsed": 10, "insolation_au": 2}, ParametricAlbedo),
        ({"file": "mine.txt"}, TableAlbedo),
        ({"file": "AlbedoModels.db", "mh": 1, "fsed": 3}, GridAlbedo),
        ({"wavelength_nm": [400, 900], "albedo": [0.1, 0.2]}, TableAlbedo),
    ],
)
def test_kinds_and_round_trip(text, kind):
    spec = albedo_spec(text)
    assert isinstance(spec, kind)
    assert albedo_spec(spec.model_dump(mode="json")) == spec
    assert albedo_spec(spec) is spec


@given(st.floats(1.0, 100.0), st.floats(0.01, 6.0))
def test_linear_aliases_are_logarithms(mh, fsed):
    spec = albedo_spec({"mh": mh, "fsed": fsed})
    assert (spec.log10_mh, spec.log10_fsed) == (math.log10(mh), math.log10(fsed))


def test_no_clouds_and_thin_clouds_are_different_things():
    assert albedo_spec({"mh": 1, "fsed": 0}).log10_fsed is None
    assert albedo_spec({"log10_mh": 0, "log10_fsed": None}).clamped_log10_fsed is None
    assert albedo_spec({"mh": 1, "fsed": 10}).clamped_log10_fsed == pytest.approx(math.log10(6.0))


def test_labels_say_what_was_used():
    label = albedo_spec({"log10_mh": 1, "log10_fsed": 1, "insolation_au": 2}).label
    assert label == "parametric (10 x solar, f_sed 10 taken as 6, 2 au)"
    assert "cloud-free" in albedo_spec({"mh": 1, "fsed": 0}).label


def test_names_files_objects_and_units_are_read(tmp_path):
    import astropy.units as u
    import numpy as np

    from catalogs import load_albedo

    assert albedo_spec("Jupiter") == albedo_spec("jupiter")
    file = tmp_path / "mine"
    assert albedo_spec("mine.txt") == TableAlbedo(file="mine.txt")
    assert albedo_spec(file) == TableAlbedo(file=str(file))
    assert albedo_spec({"coe_metal": np.float32(1), "coe_cloud": 0}) == ParametricAlbedo(log10_mh=1.0, log10_fsed=0.0)
    assert albedo_spec({"fsed": 3, "file": "grid.db"}).model == "grid"
    assert albedo_spec({"insolation_au": 2 * u.au}) == ParametricAlbedo(insolation_au=2.0)
    inline = albedo_spec({"wavelength_nm": [0.3, 1.7] * u.um, "albedo": np.array([0.5, 0.5])})
    assert inline.wavelength_nm == pytest.approx((300.0, 1700.0), rel=1e-15)
    assert inline.albedo == (0.5, 0.5)
    assert albedo_spec(load_albedo("saturn")).wavelength_nm == tuple(load_albedo("saturn").wavelength_nm)
