"""The relations that fill star tables, against published values and their own definitions."""

import math

import pytest

from catalogs import luminosity_from_v
from catalogs.star_columns import parallax_flags, type_flags
from catalogs.stellar_physics import (
    bolometric_correction,
    colour_temperature,
    gravity,
    mass_from_luminosity,
    mass_of,
    nearest_subtype,
    radius_from_luminosity,
    spectral_subtype,
    subtype_medians,
)


def test_the_sun_comes_out_as_the_sun():
    """V = -26.76 at one au is the star at the other end of everything; the scale of BC is 0.03 mag from IAU's."""
    luminosity = luminosity_from_v(-26.76, 1 / 206264.806, 5772.0)
    assert luminosity == pytest.approx(1.0, abs=0.04)
    radius = radius_from_luminosity(1.0, 5772.0)
    assert radius == pytest.approx(1.0, rel=1e-12)
    assert mass_from_luminosity(1.0) == pytest.approx(1.0, abs=0.02)
    assert gravity(1.0, 1.0) == pytest.approx(4.438)
    assert colour_temperature(0.653, 0.0)[0] == pytest.approx(5772.0, abs=50.0)


def test_bolometric_correction_of_the_sun_and_its_shape():
    assert bolometric_correction(5777.0) == pytest.approx(-0.080, abs=0.002)  # Torres 2010
    warmest = max(range(4000, 20000, 50), key=bolometric_correction)
    assert 6500 < warmest < 8500, "F stars send most of their light through V"
    assert bolometric_correction(warmest) == pytest.approx(0.03, abs=0.02)
    assert bolometric_correction(4000) < -0.9
    assert bolometric_correction(20000) < -1.7


def test_bolometric_correction_has_only_the_small_steps_of_its_polynomials():
    for exponent in (3.70, 3.90):
        below, above = (bolometric_correction(10 ** (exponent + shift)) for shift in (-1e-9, 1e-9))
        assert below == pytest.approx(above, abs=0.025)


def test_luminosity_scales_as_flux_times_distance_squared():
    one = luminosity_from_v(5.0, 10.0, 5800.0)
    assert luminosity_from_v(5.0, 20.0, 5800.0) == pytest.approx(4 * one)
    assert luminosity_from_v(7.5, 10.0, 5800.0) == pytest.approx(one / 10)


def test_mass_luminosity_relation_has_only_the_small_steps_of_its_pieces():
    for mass in (0.72, 1.05):
        slope = 4.572 if mass < 1 else 5.743
        level = slope * math.log10(mass) - (0.102 if mass < 1 else 0.007)
        below, above = (mass_from_luminosity(10 ** (level + shift)) for shift in (-1e-9, 1e-9))
        assert below == pytest.approx(above, rel=0.03)


def test_mass_of_giants_is_assumed_and_says_so():
    assert mass_of("K2III", 60.0) == (1.5, "assumed:1.5 Msun, giant")
    mass, src = mass_of("G2V", 1.0)
    assert mass == mass_from_luminosity(1.0)
    assert src.startswith("derived")


def test_medians_by_subtype_and_the_nearest_of_them():
    stars = [("G2V", 5700.0 + 10 * i, 0.6 + 0.01 * i) for i in range(5)] + [("G6V", 5500.0, 0.7)] * 2
    stars += [("K2III", 4500.0, 1.1)] * 3 + [("G2V", float("nan"), 0.1), ("G", 1.0, 1.0)]
    table = subtype_medians(stars)
    assert table == {(False, 12): (5720.0, 0.62), (True, 22): (4500.0, 1.1)}
    assert nearest_subtype("G4V", table) == (5720.0, 0.62)
    assert nearest_subtype("K1III", table) == (4500.0, 1.1)
    assert math.isnan(nearest_subtype("K2V", table)[0]), "giants are no measure for dwarfs"
    assert math.isnan(nearest_subtype("G", table)[0])
    assert spectral_subtype("K2.5III") == 22.5


@pytest.mark.parametrize(
    ("sp_type", "object_type", "simbad_id", "expected"),
    [
        ("G2V", "*", "HD 1", set()),
        ("K0III", "RG*", "HD 1", {"giant"}),
        ("G5", "V*", "HD 1", {"no_class", "variable"}),
        ("G0V+K", "SB*", "HD 1", {"composite_spectrum", "spectroscopic_binary"}),
        ("F5Vp", "EB*", "V* AB Cyg", {"peculiar", "variable", "spectroscopic_binary"}),
        ("G2V", "**", "** STF 1", {"double_entry"}),
        ("G8III+0", "*", "HD 1", {"giant"}),
    ],
)
def test_flags_of_types(sp_type, object_type, simbad_id, expected):
    assert type_flags(sp_type, object_type, simbad_id) == expected


def test_flags_of_parallaxes():
    assert parallax_flags(100.0, 1.0) == set()
    assert parallax_flags(49.9, 1.0) == {"low_parallax_snr"}
    assert parallax_flags(100.0, float("nan")) == {"parallax_unknown_error"}
