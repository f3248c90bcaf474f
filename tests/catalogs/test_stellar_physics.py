"""The relations that fill star tables, against published values and their own definitions.

Spectral types: reading and mean sequences.
"""

import functools
import itertools
import math

import numpy as np
import pytest
from hypothesis import example, given, strategies as st

from catalogs import (
    load_johnson_v,
    load_stars,
    load_stellar_grid,
    luminosity_from_v,
    parse_spectral_type,
    stellar_parameters,
)
from catalogs.stars import parallax_flags, type_flags
from catalogs.stellar_physics import (
    bolometric_correction,
    bulk_columns,
    colour_temperature,
    gravity,
    mass_from_luminosity,
    mass_of,
    nearest_subtype,
    radius_from_luminosity,
    spectral_subtype,
    subtype_medians,
)
from cpic_core import InputError

#: V, apparent bolometric magnitude (0 is the Sun's 4.74 at 10 pc), temperature (K) and [Fe/H] of dwarfs: Casagrande et
#: al. 2006, MNRAS 373, 13, table 1 (fluxes from B to Ks, the rest by models); every star hotter than 5600 K or poorer
#: in metals than -0.6, every fourth of the others.
BOLOMETRIC = {
    "HD 4256": (7.990, 7.675, 4966.0, 0.34),
    "HD 4308": (6.560, 6.449, 5781.0, -0.40),
    "HD 8638": (8.300, 8.164, 5568.0, -0.50),
    "HD 10853": (8.910, 8.405, 4638.0, -0.74),
    "HD 11130": (8.070, 7.868, 5219.0, -0.57),
    "HD 16623": (8.760, 8.657, 5858.0, -0.60),
    "HD 18632": (8.020, 7.726, 4984.0, 0.18),
    "HD 22879": (6.679, 6.577, 5930.0, -0.91),
    "HD 25329": (8.519, 8.164, 4796.0, -1.80),
    "HD 25665": (7.757, 7.398, 4902.0, -0.03),
    "HD 31128": (9.135, 8.996, 6089.0, -1.54),
    "HD 34328": (9.427, 9.275, 6025.0, -1.69),
    "HD 37792": (7.697, 7.641, 6556.0, -0.60),
    "HD 51219": (7.410, 7.303, 5584.0, -0.09),
    "HD 53545": (8.047, 8.005, 6393.0, -0.29),
    "HD 59374": (8.485, 8.373, 5839.0, -0.88),
    "HD 59468": (6.720, 6.630, 5625.0, 0.02),
    "HD 67199": (7.166, 6.943, 5148.0, 0.03),
    "HD 73524": (6.530, 6.486, 5978.0, 0.12),
    "HD 89813": (7.769, 7.618, 5372.0, -0.17),
    "HD 94028": (8.218, 8.078, 6091.0, -1.49),
    "HD 97320": (8.161, 8.042, 6142.0, -1.28),
    "HD 106156": (7.918, 7.788, 5428.0, 0.23),
    "HD 106516": (6.104, 6.038, 6296.0, -0.78),
    "HD 108564": (9.450, 8.980, 4660.0, -1.18),
    "HD 112099": (8.250, 8.008, 5082.0, 0.09),
    "HD 114094": (9.668, 9.559, 5643.0, -0.24),
    "HD 119173": (8.828, 8.735, 5980.0, -0.62),
    "HD 120559": (7.971, 7.816, 5446.0, -0.94),
    "HD 126681": (9.296, 9.143, 5630.0, -1.14),
    "HD 127506": (8.702, 8.234, 4662.0, -0.40),
    "HD 129518": (8.809, 8.760, 6272.0, -0.34),
    "HD 130871": (9.073, 8.706, 4845.0, -0.16),
    "HD 134440": (9.420, 9.099, 4883.0, -1.45),
    "HD 136834": (8.281, 7.976, 4955.0, 0.19),
    "HD 144579": (6.660, 6.478, 5251.0, -0.69),
    "HD 144872": (8.580, 8.183, 4792.0, -0.64),
    "HD 145417": (7.530, 7.223, 4907.0, -1.39),
    "HD 149414": (9.607, 9.342, 5090.0, -1.26),
    "HD 154577": (7.395, 7.064, 4882.0, -0.63),
    "HD 166913": (8.216, 8.074, 6273.0, -1.54),
    "HD 179949": (6.240, 6.229, 6200.0, 0.22),
    "HD 193901": (8.642, 8.509, 5905.0, -1.09),
    "HD 202575": (7.897, 7.475, 4741.0, 0.04),
    "HD 215152": (8.096, 7.753, 4870.0, -0.17),
    "HD 216259": (8.294, 7.989, 4957.0, -0.63),
    "HD 218502": (8.256, 8.104, 6324.0, -1.87),
    "HD 219538": (8.051, 7.818, 5051.0, -0.04),
    "HD 225261": (7.826, 7.658, 5286.0, -0.44),
    "HD 230409": (10.070, 9.898, 5485.0, -1.00),
    "BD+24 4460": (9.463, 9.230, 5152.0, -0.89),
    "BD+41 3306": (8.870, 8.592, 4986.0, -0.62),
    "BD+51 1696": (9.916, 9.760, 5721.0, -1.48),
    "BD-01 306": (9.084, 8.969, 5771.0, -0.96),
    "BD-11 4126": (10.383, 9.986, 4788.0, 0.20),
    "CD-35 360": (10.266, 10.040, 5227.0, -1.15),
}


def test_the_sun_comes_out_as_the_sun():
    """V = -26.76 at one au is the star at the other end of everything."""
    luminosity = luminosity_from_v(-26.76, 1 / 206264.806, 5772.0, 0.0, 4.438)
    assert luminosity == pytest.approx(1.0, abs=0.005)
    radius = radius_from_luminosity(1.0, 5772.0)
    assert radius == pytest.approx(1.0, rel=1e-12)
    assert mass_from_luminosity(1.0) == pytest.approx(1.0, abs=0.02)
    assert gravity(1.0, 1.0) == pytest.approx(4.438)
    assert colour_temperature(0.653, 0.0)[0] == pytest.approx(5772.0, abs=50.0)


def test_bolometric_correction_of_the_sun_and_its_shape():
    assert bolometric_correction(5772.0) == pytest.approx(-0.082, abs=0.002)  # of V = -26.76 and M_bol = 4.73
    warmest = max(range(4000, 20000, 50), key=bolometric_correction)
    assert 6500 < warmest < 8500, "F stars send most of their light through V"
    assert bolometric_correction(warmest) == pytest.approx(0.01, abs=0.02)
    assert bolometric_correction(4000) < -0.9
    assert bolometric_correction(20000) < -1.7


def test_bolometric_correction_has_only_the_small_steps_of_its_polynomials():
    for exponent in (3.70, 3.90):
        below, above = (bolometric_correction(10 ** (exponent + shift)) for shift in (-1e-9, 1e-9))
        assert below == pytest.approx(above, abs=0.025)


def test_luminosities_are_those_of_measured_bolometric_magnitudes():
    """Median and spread, for all and for each kind of star by itself: the poor in metals, the hot, the cool."""
    stars = list(BOLOMETRIC.values())
    found = np.array([luminosity_from_v(v, 10.0, teff, metal) for v, _, teff, metal in stars])
    ratio = found / np.array([10.0 ** (-0.4 * (m_bol - 4.74)) for _, m_bol, _, _ in stars])
    teff, metal = (np.array([star[column] for star in stars]) for column in (2, 3))
    for part in (metal < 9.0, metal < -0.6, metal > -0.6, teff > 5600.0, teff < 5000.0):
        assert part.sum() > 10
        assert np.median(ratio[part]) == pytest.approx(1.0, abs=0.02)
        assert np.median(np.abs(ratio[part] - 1.0)) < 0.02
    assert np.median(ratio) == pytest.approx(1.0, abs=0.01)


def test_luminosities_of_alpha_centauri():
    """1.5059 and 0.4981 (Akeson et al. 2021, AJ 162, 14), temperatures and metals of Soubiran et al. 2024."""
    assert luminosity_from_v(-0.01, 1.3319, 5804.0, 0.20, 4.29) == pytest.approx(1.5059, rel=0.03)
    assert luminosity_from_v(1.33, 1.3319, 5207.0, 0.24, 4.53) == pytest.approx(0.4981, rel=0.03)


@pytest.mark.parametrize("teff_k", [5200.0, 5500.0, 6000.0, 6500.0, 7000.0, 8000.0])
@pytest.mark.parametrize("metallicity", [-1.0, -0.5, 0.0, 0.3])
@pytest.mark.parametrize("log_g", [2.5, 3.7, 4.5])
def test_bolometric_correction_is_that_of_the_stellar_grid(teff_k, metallicity, log_g):
    """Sigma T^4 over the photons that the same surface sends through V, against the Sun's at V = -26.76."""
    integrals, suns = v_photons(teff_k, log_g, metallicity), v_photons(5772.0, 4.438, 0.0)
    of_the_sun = 4.73 - (-26.76 + 5.0 * math.log10(206264.806) + 5.0)
    expected = of_the_sun - 10.0 * math.log10(teff_k / 5772.0) + 2.5 * math.log10(integrals / suns)
    assert bolometric_correction(teff_k, metallicity, log_g) == pytest.approx(expected, abs=0.012)


def v_photons(teff_k: float, log_g: float, metallicity: float) -> float:
    grid = load_stellar_grid()
    nodes, weights = grid.corners(teff_k, log_g, metallicity)
    return float(v_photons_of_nodes()[nodes] @ weights)


@functools.cache
def v_photons_of_nodes() -> np.ndarray:
    grid, curve = load_stellar_grid(), load_johnson_v()
    step = np.gradient(grid.wavelength_nm)
    weight = np.interp(grid.wavelength_nm, curve.wavelength_nm, curve.transmission, left=0.0, right=0.0)
    return grid.node_integrals((weight * step)[:, None])[:, 0]


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


def test_shipped_stars_are_flagged_as_their_types_say():
    types, flags = (load_stars(updates=False).column(name).tolist() for name in ("sp_type", "quality_flags"))
    told = ("composite_spectrum", "giant", "no_class", "peculiar")
    for sp_type, words in zip(types, flags, strict=True):
        assert {word for word in words.split(";") if word in told} == type_flags(sp_type, "", ""), sp_type
    assert sum("composite_spectrum" in words for words in flags) == 34


def test_what_is_known_of_a_star_counts_before_what_is_derived():
    row = {"v_mag": 4.0, "distance_pc": 10.0, "teff_k": 5772.0, "metallicity": 0.0, "sp_type": "G2V"}
    derived = bulk_columns(row, {})
    assert derived["luminosity_lsun"] == luminosity_from_v(4.0, 10.0, 5772.0)
    assert derived["mass_msun_src"].startswith("derived:luminosity")
    known = bulk_columns(row, {"luminosity_lsun": (4.0, "a"), "mass_msun": (1.2, "b"), "log_g": (4.1, "c")})
    assert [known[name] for name in ("luminosity_lsun", "mass_msun", "log_g")] == [4.0, 1.2, 4.1]
    assert [known[f"{name}_src"] for name in ("luminosity_lsun", "mass_msun", "log_g")] == ["a", "b", "c"]
    assert known["radius_rsun"] == pytest.approx(2.0, rel=1e-9), "four suns at the temperature of the Sun"
    poor = bulk_columns(row | {"metallicity": -1.0}, {"log_g": (2.5, "c"), "mass_msun": None})
    assert poor["luminosity_lsun"] == luminosity_from_v(4.0, 10.0, 5772.0, -1.0, 2.5)


def test_gravities() -> None:
    assert stellar_parameters("G2V").log_g == pytest.approx(4.44, abs=0.02)
    assert stellar_parameters("K0III").log_g == pytest.approx(2.14)
    dwarf, subgiant, giant = (stellar_parameters(f"K0{c}") for c in ("V", "IV", "III"))
    assert dwarf.log_g > subgiant.log_g > giant.log_g
    assert subgiant.teff_k == pytest.approx((dwarf.teff_k + giant.teff_k) / 2)


def test_temperature_falls_along_the_sequence() -> None:
    names = [f"{letter}{n}V" for letter in "AFGK" for n in range(10)] + [f"M{n}V" for n in range(7)]
    values = [stellar_parameters(name).teff_k for name in names]
    assert all(a > b for a, b in itertools.pairwise(values))


@given(st.one_of(st.text(), st.text("OBAFGKMLDWIVabdegkmhns0123456789.:+-/()? ", max_size=20)))
@example("K0" + "-" * 150)
@example("kA0" * 60)
@example("x" * 999)
def test_any_text_is_read_or_refused(text: str) -> None:
    try:
        found = stellar_parameters(text)
    except InputError:
        return
    assert 2000.0 < found.teff_k < 35000.0
    assert -1.0 < found.log_g < 6.0


def test_every_type_of_the_catalogue_is_read() -> None:
    types = {str(text) for text in load_stars().column("sp_type")}
    assert len(types) > 300
    for text in types:
        found = parse_spectral_type(text)
        assert found.position // 10 == "OBAFGKM".index(text[0])
        assert 3500.0 < stellar_parameters(text).teff_k < 8000.0
