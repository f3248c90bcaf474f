"""The embedded star catalogue: known stars, completeness of labels, plausibility, counts."""

import csv
import pickle
from pathlib import Path

import numpy as np
import pytest
from astropy import units as u
from astropy.coordinates import BarycentricMeanEcliptic, SkyCoord
from astropy.time import Time

import catalogs
from catalogs import StarTable, load_stars, separation_arcsec

DATA = Path(catalogs.__file__).parent / "data"

# Column without a label of its own -> the column that labels it.
LABELS = {
    "pm_ra_mas_yr": "pm_src",
    "pm_dec_mas_yr": "pm_src",
    "parallax_mas": "parallax_src",
    "parallax_err_mas": "parallax_err_src",
    "ecliptic_lon_deg": "ecliptic_src",
    "ecliptic_lat_deg": "ecliptic_src",
    "companion_sep_arcsec": "companion_src",
    "companion_pa_deg": "companion_pa_src",
    "companion_epoch_yr": "companion_pa_src",
    "companion_delta_v_mag": "companion_delta_v_src",
}
# Read from the source as they are, always present.
PLAIN = {"ra_deg", "dec_deg", "epoch_yr", "parallax_own_mas"}


@pytest.fixture(scope="module")
def stars() -> StarTable:
    return load_stars()


def by_name(stars: StarTable, name: str) -> dict[str, str | int | float | bool]:
    return stars.row(stars.column("name").tolist().index(name))


def test_alpha_centauri_b(stars: StarTable) -> None:
    star = by_name(stars, "alf Cen B")
    assert star["hip"] == 71681
    assert star["hd"] == "HD 128621"
    assert star["gj"] == "GJ 559 B"
    assert star["v_mag"] == pytest.approx(1.33)
    assert star["sp_type"] == "K1V"
    assert (star["spectral_class"], star["luminosity_class"]) == ("K", "V")
    assert star["parallax_own_mas"] == pytest.approx(796.92)  # Hipparcos-2, with an error of 25.9 mas
    assert star["close_companion"] is True
    assert star["teff_k"] == pytest.approx(5200.0, abs=100.0)
    assert star["luminosity_lsun"] == pytest.approx(0.50, rel=0.1)


def test_bound_pair_shares_the_better_parallax(stars: StarTable) -> None:
    one, two = by_name(stars, "alf Cen A"), by_name(stars, "alf Cen B")
    assert one["parallax_mas"] == two["parallax_mas"] == pytest.approx(750.81)
    assert one["parallax_src"] == two["parallax_src"] == "measured:Akeson et al. 2021"
    assert two["distance_pc"] == pytest.approx(1.3319, abs=1e-4)
    bright, faint = by_name(stars, "61 Cyg A"), by_name(stars, "61 Cyg B")
    assert bright["parallax_mas"] == faint["parallax_mas"] == pytest.approx(286.00, abs=0.02)
    assert bright["parallax_src"] == "derived:shared with 61 Cyg B"
    assert "shared_parallax" in str(bright["quality_flags"])


#: Parallaxes (mas) that people quote: Gaia DR3 of the archive, as github.com/svenbuder/gbs_v3 lists them.
GAIA_DR3 = {"18 Sco": 70.737, "psi Ser": 67.600, "eps Eri": 310.577, "51 Peg": 64.405, "HD 103095": 109.030}
#: Pairs within ten years, whose orbit Gaia's five parameters do not know: Hipparcos's stays.
ORBITING = {"HD 10307": 78.50, "HD 122742": 58.88, "10 UMa": 62.23}


@pytest.mark.parametrize(("name", "parallax_mas"), GAIA_DR3.items())
def test_parallaxes_are_those_of_gaia(stars: StarTable, name: str, parallax_mas: float) -> None:
    star = by_name(stars, name)
    assert star["parallax_mas"] == pytest.approx(parallax_mas, abs=0.011)
    assert star["parallax_src"] == "measured:Gaia DR3"


@pytest.mark.parametrize(("name", "parallax_mas"), ORBITING.items())
def test_parallaxes_of_short_pairs_stay_those_of_hipparcos(stars: StarTable, name: str, parallax_mas: float) -> None:
    star = by_name(stars, name)
    assert star["parallax_mas"] == pytest.approx(parallax_mas)
    assert star["parallax_src"] == "measured:Hipparcos-2"


def test_measured_companion_of_alpha_centauri() -> None:
    """Hipparcos saw B at 19.1 arcsec, PA 215 deg, at 1991.25; seen from B the angle turns by 180 deg."""
    stars = load_stars()
    one, two = by_name(stars, "alf Cen A"), by_name(stars, "alf Cen B")
    assert one["companion_name"] == "alf Cen B"
    assert one["companion_sep_arcsec"] == pytest.approx(19.1, abs=0.1)
    assert one["companion_pa_deg"] == pytest.approx(215.0, abs=0.5)
    assert one["companion_epoch_yr"] == pytest.approx(1991.25)
    assert one["companion_delta_v_mag"] == pytest.approx(1.34)
    assert (float(two["companion_pa_deg"]) - float(one["companion_pa_deg"])) % 360.0 == pytest.approx(180.0, abs=0.2)


@pytest.mark.parametrize(
    ("name", "sep_arcsec", "pa_deg"),
    [("16 Cyg A", 39.4, 133.4), ("61 Cyg A", 30.0, 148.0), ("psi Dra A", 30.1, 15.0), ("gam2 Del", 9.3, 267.0)],
)
def test_wide_pairs_of_the_double_star_literature(name: str, sep_arcsec: float, pa_deg: float) -> None:
    star = by_name(load_stars(), name)
    assert star["companion_sep_arcsec"] == pytest.approx(sep_arcsec, abs=0.3)
    assert star["companion_pa_deg"] == pytest.approx(pa_deg, abs=1.5)


@pytest.mark.parametrize(
    ("name", "east", "north"),
    [
        ("alf Cen A", -1, 1),
        ("61 Cyg A", 1, 1),
        ("tau Cet", -1, 1),
        ("eps Eri", -1, 1),
        ("eps Ind", 1, -1),
        ("alf CMi", -1, -1),
    ],
)
def test_proper_motion_signs(stars: StarTable, name: str, east: int, north: int) -> None:
    star = by_name(stars, name)
    assert np.sign(float(star["pm_ra_mas_yr"])) == east
    assert np.sign(float(star["pm_dec_mas_yr"])) == north


def test_selection(stars: StarTable) -> None:
    v_mag = stars.column("v_mag")
    assert np.all(np.diff(v_mag) >= 0.0), "brightest first"
    assert np.all(v_mag <= 7.5)
    assert np.all(stars.column("parallax_own_mas") >= 25.0), "by the parallax that the paper's sample was cut by"
    beyond = stars.column("parallax_mas") < 25.0
    assert beyond.sum() == 51
    assert set(stars.column("parallax_src")[beyond].tolist()) == {"measured:Gaia DR3"}
    assert set(stars.column("spectral_class").tolist()) == {"F", "G", "K"}
    assert {"alf Cen A", "alf Boo", "tau Cet", "eps Eri"} <= set(stars.column("name").tolist())
    names = stars.column("name").tolist()
    assert len(set(names)) == len(names)
    ids = stars.column("simbad_id").tolist()
    assert len(set(ids)) == len(ids)


def test_every_number_has_a_label_and_nan_only_where_missing(stars: StarTable) -> None:
    allowed = ("measured", "derived:", "assumed:", "missing")
    for name, values in stars.columns.items():
        if name.endswith("_src"):
            assert all(text.startswith(allowed) for text in values.tolist()), name
        if values.dtype != np.float64:
            continue
        missing = ~np.isfinite(values)
        label = LABELS.get(name, f"{name}_src")
        if name in PLAIN:
            assert not missing.any(), name
            continue
        labels = stars.column(label)
        said = labels == "missing"
        if name == "companion_sep_arcsec":
            np.testing.assert_array_equal(missing, said, err_msg=name)
        else:
            assert not np.any(missing & ~said), name
            assert not np.any(~missing & said), name


def test_physical_columns_are_never_missing(stars: StarTable) -> None:
    for name in """
        v_mag b_v_mag teff_k log_g metallicity luminosity_lsun radius_rsun mass_msun rv_km_s
    """.split():
        assert np.all(np.isfinite(stars.column(name))), name


def test_sun_like_stars_are_sun_like(stars: StarTable) -> None:
    like = np.isin(stars.column("sp_type"), ("G1V", "G2V", "G3V"))
    assert like.sum() > 30
    assert np.median(stars.column("teff_k")[like]) == pytest.approx(5800.0, abs=100.0)
    assert 0.9 < np.median(stars.column("luminosity_lsun")[like]) < 1.6
    assert np.median(stars.column("mass_msun")[like]) == pytest.approx(1.05, abs=0.1)
    assert np.median(stars.column("log_g")[like]) == pytest.approx(4.4, abs=0.1)
    twin = by_name(stars, "18 Sco")
    assert twin["luminosity_lsun"] == pytest.approx(1.06, abs=0.08)
    assert twin["teff_k"] == pytest.approx(5800.0, abs=60.0)


def test_ranges_are_plausible(stars: StarTable) -> None:
    dwarf = stars.column("luminosity_class") == "V"
    assert np.all((stars.column("teff_k") > 3800.0) & (stars.column("teff_k") < 7700.0))
    assert np.all(stars.column("log_g")[dwarf] > 3.5)
    assert np.all((stars.column("metallicity") > -2.5) & (stars.column("metallicity") < 0.6))
    # Radius, luminosity and temperature obey Stefan-Boltzmann to the digits written.
    radius = np.sqrt(stars.column("luminosity_lsun")) * (5772.0 / stars.column("teff_k")) ** 2
    np.testing.assert_allclose(stars.column("radius_rsun"), radius, rtol=2e-3)
    np.testing.assert_allclose(stars.column("distance_pc"), 1000.0 / stars.column("parallax_mas"), rtol=1e-4)


def test_temperatures_from_colour_agree_with_measured_ones() -> None:
    """Teff from B-V must reproduce the spectroscopy of ExoCat-1 that stands in the same table."""
    from catalogs.stellar_physics import colour_temperature

    stars = load_stars(updates=False)
    good = np.char.startswith(stars.column("teff_k_src"), "measured") & (stars.column("luminosity_class") == "V")
    assert good.sum() > 400
    colour = stars.column("b_v_mag")[good]
    metal = stars.column("metallicity")[good]
    found = np.array([colour_temperature(b, z)[0] for b, z in zip(colour, metal, strict=True)])
    error = found - stars.column("teff_k")[good]
    assert abs(np.median(error)) < 40.0
    assert 1.48 * np.median(np.abs(error)) < 140.0


def test_ecliptic_coordinates_agree_with_astropy(stars: StarTable) -> None:
    sky = SkyCoord(stars.column("ra_deg") * u.deg, stars.column("dec_deg") * u.deg)
    there = sky.transform_to(BarycentricMeanEcliptic(equinox=Time("J2000")))
    apart = separation_arcsec(
        stars.column("ecliptic_lon_deg"), stars.column("ecliptic_lat_deg"), there.lon.deg, there.lat.deg
    )
    assert apart.max() < 0.15


def test_companions_are_flagged_and_kept(stars: StarTable) -> None:
    ranked = stars.select(stars.column("v_mag") <= 7.0)
    assert ranked.column("close_companion").sum() > 150
    listed = ranked.column("companion_name") != ""
    assert np.all(ranked.column("companion_sep_arcsec")[listed] > 0.0)
    pa = ranked.column("companion_pa_deg")
    assert np.all((pa[np.isfinite(pa)] >= 0.0) & (pa[np.isfinite(pa)] < 360.0))


def test_low_parallax_quality_is_flagged(stars: StarTable) -> None:
    error = stars.column("parallax_err_mas")
    low = np.isfinite(error) & (stars.column("parallax_mas") / error < 50.0)
    flagged = np.char.find(stars.column("quality_flags"), "low_parallax_snr") >= 0
    edge = np.abs(stars.column("parallax_mas") / error - 50.0) < 0.5  # the file holds rounded values
    np.testing.assert_array_equal(low[~edge], flagged[~edge])


def test_counts_table(stars: StarTable) -> None:
    with (DATA / "stars_counts.csv").open(encoding="utf-8", newline="") as stream:
        rows = list(csv.DictReader(stream))
    found = {(row["group"], row["what"]): int(row["count"]) for row in rows}
    for row in rows:  # the count of all F, G and K stars of any magnitude is the one that was not reproduced
        if row["reference"] and row["what"] != "and F, G or K":
            assert row["count"] == row["reference"], row["what"]
    assert found["source", "and F, G or K"] == 3443
    v_mag, classes = stars.column("v_mag"), stars.column("luminosity_class")
    bright = v_mag <= 7.0
    dwarf = bright & np.isin(classes, ("V", "IV-V"))
    assert found["catalogue", "rows with V <= 7 (ranked)"] == bright.sum() == 1077
    assert found["catalogue", "of them dwarfs (V, IV-V)"] == dwarf.sum()
    assert found["catalogue", "of them without close companion"] == (dwarf & ~stars.column("close_companion")).sum()
    assert found["catalogue", "rows with V <= 7.5 (all)"] == len(stars) == 1390
    start = found["catalogue", "V <= 7 in the cut, no bright limit"]
    gone = sum(
        found["catalogue", f"removed, V <= 7: {why}"]
        for why in ("blend with listed components", "adopted parallax below 25 mas")
    )
    assert start - gone == bright.sum()


def test_units_and_descriptions(stars: StarTable) -> None:
    assert set(stars.units) == set(stars.descriptions) == set(stars.columns)
    assert all(stars.descriptions.values())
    for suffix, unit in (
        ("_mas", "mas"),
        ("_deg", "deg"),
        ("_pc", "pc"),
        ("_mag", "mag"),
        ("_arcsec", "arcsec"),
        ("_k", "K"),
    ):
        assert all(stars.units[name] == unit for name in stars.columns if name.endswith(suffix)), suffix


def test_table_operations(refused, stars: StarTable) -> None:
    few = stars.select([3, 1])
    assert len(few) == 2
    assert few.row(0)["name"] == stars.row(3)["name"]
    assert len(stars.select(np.zeros(len(stars), bool))) == 0
    assert len(stars.select([])) == 0
    assert load_stars() is stars
    with pytest.raises(ValueError, match="read-only"):
        stars.column("v_mag")[0] = 0.0
    refused("column", stars.column, "nonsense")
    refused("mask", stars.select, [True, False])
    refused("mask", stars.select, [len(stars)])
    refused("mask", stars.select, [0.5])
    refused("row", stars.row, len(stars))


def test_table_goes_to_worker_processes(stars: StarTable) -> None:
    back = pickle.loads(pickle.dumps(stars.select([0, 1])))
    assert back.row(1) == stars.row(1)
