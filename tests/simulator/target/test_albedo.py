"""One door to all albedos: measured against tabulated values, parametric, constant and user tables."""

import numpy as np
import pytest

from simulator.config import albedo_spec
from simulator.passbands import Passbands
from simulator.target import (
    albedo_flags,
    albedo_notes,
    albedo_source,
    lambert_phase,
    needs_insolation,
    parametric_family,
    phase_value,
    planet_albedo,
)
from simulator.target.albedo import albedo_table

WAVELENGTH_NM = np.array([520, 550, 662, 720, 850, 890, 940, 1265, 1425, 1542], dtype=float)
TABLE = {
    "jupiter": [0.519, 0.528, 0.526, 0.369, 0.452, 0.048, 0.463, 0.147, 0.006, 0.046],
    "saturn": [0.453, 0.487, 0.555, 0.381, 0.537, 0.064, 0.559, 0.279, 0.011, 0.176],
    "uranus": [0.593, 0.617, 0.250, 0.063, 0.093, 0.015, 0.262, 0.023, 0.001, 0.011],
    "neptune": [0.536, 0.552, 0.172, 0.061, 0.063, 0.016, 0.174, 0.019, 0.002, 0.009],
}


@pytest.mark.parametrize("planet", TABLE)
def test_tabulated_values(planet: str) -> None:
    np.testing.assert_allclose(planet_albedo(WAVELENGTH_NM, model=planet), TABLE[planet], atol=1.01e-3)


def test_default_is_the_parametric_model_and_shape_is_kept() -> None:
    family = parametric_family(0.5, 0.5).at(2.0)
    assert planet_albedo(600.0) == pytest.approx(np.interp(600.0, family.wavelength_nm, family.albedo), rel=1e-14)
    assert planet_albedo(np.full((2, 3), 600.0)).shape == (2, 3)
    explicit = planet_albedo(600.0, log10_mh=1.0, log10_fsed=1.0, insolation_au=2.0)
    assert explicit == pytest.approx(float(planet_albedo(600.0, log10_mh=1.0, log10_fsed=np.log10(6.0))), rel=1e-14)


def test_undocumented_wavelengths_are_flagged() -> None:
    for model in ("parametric", "jupiter"):
        flags = albedo_flags([520.0, 1050.0, 1050.1, 1542.0], model=model)
        np.testing.assert_array_equal(flags, [False, False, True, True])


@pytest.mark.parametrize("model", ["jupiter", "parametric"])
@pytest.mark.parametrize("wavelength", [299.0, 1760.0, np.nan, [500.0, 2000.0]])
def test_no_silent_extrapolation(refused, wavelength, model) -> None:
    refused("wavelength_nm", planet_albedo, wavelength, model=model)


def test_clamps_are_said() -> None:
    spec = albedo_spec({"log10_mh": 1, "log10_fsed": 1})
    assert albedo_notes(spec, 2.0) == ("fsed_clamped",)
    assert albedo_notes(spec, 0.1) == ("fsed_clamped", "insolation_clamped")
    assert albedo_notes(albedo_spec({"mh": 3, "fsed": 3, "insolation_au": 5.2})) == ("insolation_clamped",)
    assert albedo_notes(albedo_spec("jupiter")) == ()


def test_insolation_is_asked_for_only_where_it_matters(refused) -> None:
    star = albedo_spec({"mh": 3, "fsed": 3})
    assert needs_insolation(star)
    assert not needs_insolation(albedo_spec({"mh": 3, "fsed": 3, "insolation_au": 2}))
    assert not needs_insolation(albedo_spec(0.3))
    refused("insolation_au", albedo_table, star)


def test_phase_functions() -> None:
    lambert = albedo_spec({"mh": 3, "fsed": 3, "insolation_au": 2})
    own = albedo_spec({"mh": 3, "fsed": 3, "insolation_au": 2, "phase_function": "grid"})
    assert phase_value(lambert, 90.0) == lambert_phase(90.0)
    assert isinstance(phase_value(own, 90.0), float)
    # Cloudy models of the grid are fainter than Lambert at quadrature: 0.24-0.26.
    assert 0.23 < phase_value(own, 90.0) < 0.27


def test_user_tables_constants_and_files(refused, tmp_path) -> None:
    table = albedo_spec({"wavelength_nm": [400, 900], "albedo": [0.2, 0.7]})
    path = tmp_path / "mine.csv"
    path.write_text("wavelength_nm,albedo\n400,0.2\n900,0.7\n")
    for spec in (table, albedo_spec({"file": str(path)})):
        assert np.interp(650.0, albedo_table(spec).wavelength_nm, albedo_table(spec).albedo) == pytest.approx(0.45)
        assert albedo_source(spec) is albedo_source(spec)
    assert planet_albedo(650.0, model=str(path)) == pytest.approx(0.45)
    bands = Passbands.from_bands()
    np.testing.assert_allclose(bands.band_albedo(albedo_source(albedo_spec(0.3)), 5800, 4.4, 0), 0.3, rtol=1e-12)
    refused("increasing", albedo_spec, {"wavelength_nm": [900, 400], "albedo": [0.2, 0.7]})


def test_band_albedo_of_a_family_is_that_of_its_members(refused) -> None:
    """Interpolated band integrals equal band integrals of the interpolated spectrum, for stars x distances."""
    bands, family = Passbands.from_bands(), parametric_family(0.8, 0.3)
    teff = np.array([[4000.0], [5300.0], [7000.0]])
    distance = np.array([0.6, 1.1, 2.0, 8.0])
    table = bands.band_albedo(family, teff, 4.4, -0.2, insolation_au=distance)
    assert table.shape == (3, 4, 8)
    for i, temperature in enumerate(teff[:, 0]):
        for j, place in enumerate(distance):
            direct = bands.band_albedo(family.at(place), temperature, 4.4, -0.2)
            np.testing.assert_allclose(table[i, j], direct, rtol=1e-12)
    refused("insolation_au", bands.band_albedo, family, 5800.0, 4.4, 0.0)


def test_one_band_needs_no_more_than_its_own_wavelengths(refused) -> None:
    bands = Passbands.from_bands()
    narrow = albedo_source(albedo_spec({"wavelength_nm": [600, 720], "albedo": [0.2, 0.7]}))
    teff = np.array([[4000.0], [6000.0]])
    alone = bands.band_albedo(narrow, teff, 4.4, 0.0, only="F662")
    assert alone.shape == (2, 1)
    wide = albedo_source(albedo_spec({"wavelength_nm": [300, 600, 720, 1754], "albedo": [0, 0.2, 0.7, 0]}))
    np.testing.assert_allclose(alone, bands.band_albedo(wide, teff, 4.4, 0.0)[..., bands.index("F662")], rtol=1e-12)
    refused("F940|F520", bands.band_albedo, narrow, teff, 4.4, 0.0)
    refused("band", bands.band_albedo, narrow, teff, 4.4, 0.0, only="F999")
