"""The embedded star catalogue: known stars, completeness of labels, plausibility, counts.

Published temperatures: what the shipped rows say, what a star takes from them, which tables they are laid over.

Tables that nobody can change: mappings, arrays, copies with other columns, and travel to worker processes.
"""

import csv
import math
import pickle
import re
from pathlib import Path

import numpy as np
import pytest
from astropy import units as u
from astropy.coordinates import BarycentricMeanEcliptic, SkyCoord
from astropy.time import Time

import catalogs
from catalogs import (
    StarTable,
    catalogue_info,
    load_known_planets,
    load_stars,
    open_catalogue,
    separation_arcsec,
    snapshot_vintage,
)
from catalogs.stars import parameters_vintage, published_parameters, updated_columns
from catalogs.stellar_physics import (
    colour_temperature,
    luminosity_from_diameter,
    luminosity_from_v,
    temperatures_disagree,
)
from tools.build_catalogue.builders._star_physics import infrared_temperature

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


def test_proper_motion_signs(stars: StarTable) -> None:
    west, east = {"alf Cen A": 1, "tau Cet": 1, "eps Eri": 1, "alf CMi": -1}, {"61 Cyg A": 1, "eps Ind": -1}
    for way, names in ((-1, west), (1, east)):
        for name, north in names.items():
            star = by_name(stars, name)
            assert np.sign([star["pm_ra_mas_yr"], star["pm_dec_mas_yr"]]).tolist() == [way, north], name


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
    for name in "v_mag b_v_mag teff_k log_g metallicity luminosity_lsun radius_rsun mass_msun rv_km_s".split():
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
    for unit in ("mas", "deg", "pc", "mag", "arcsec", "K"):
        assert all(stars.units[name] == unit for name in stars.columns if name.endswith(f"_{unit.lower()}")), unit


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


#: Effective temperatures (K) of bright targets: of interferometry where there is any, else of spectroscopy.
LITERATURE = {
    "alf CMi": (6554, "Heiter et al. 2015"),
    "alf Cen A": (5792, "Heiter et al. 2015"),
    "alf Cen B": (5231, "Heiter et al. 2015"),
    "eps Eri": (5076, "Heiter et al. 2015"),
    "tau Cet": (5414, "Heiter et al. 2015"),
    "61 Cyg A": (4374, "Heiter et al. 2015"),
    "61 Cyg B": (4044, "Heiter et al. 2015"),
    "bet Hyi": (5873, "Heiter et al. 2015"),
    "del Eri": (4954, "Heiter et al. 2015"),
    "mu Cas": (5308, "Heiter et al. 2015"),
    "bet Gem": (4858, "Heiter et al. 2015"),
    "alf Boo": (4286, "Heiter et al. 2015"),
    "eta Boo": (6099, "Heiter et al. 2015"),
    "bet Vir": (6083, "Heiter et al. 2015"),
    "eps Ind": (4676, "Soubiran et al. 2024, erratum"),
    "omi2 Eri": (5181, "Soubiran et al. 2024"),
    "sig Dra": (5289, "Soubiran et al. 2024"),
    "pi3 Ori": (6518, "Soubiran et al. 2024"),
    "HD 131977": (4657, "Soubiran et al. 2024, erratum"),
    "HD 88230": (4132, "Soubiran et al. 2024"),
    "HD 219134": (4800, "Soubiran et al. 2024"),
    "107 Psc": (5129, "Soubiran et al. 2024"),
    "bet Com": (5930, "Soubiran et al. 2024"),
    "kap Cet": (5786, "Soubiran et al. 2024"),
    "iot Per": (5921, "Soubiran et al. 2024"),
    "gam Ser": (6296, "Soubiran et al. 2024"),
    "tet Per": (6206, "Soubiran et al. 2024"),
    "iot Peg": (6419, "Soubiran et al. 2024"),
    "61 UMa": (5310, "Soubiran et al. 2024"),
    "chi1 Ori": (5883, "Soubiran et al. 2024"),
    "tet UMa": (6217, "Soubiran et al. 2024"),
    "del Pav": (5571, "Rains et al. 2020"),
    "eta Cas": (5920, "Brewer et al. 2016"),
    "mu Her": (5559, "Brewer et al. 2016"),
    "bet CVn": (5884, "Brewer et al. 2016"),
    "61 Vir": (5562, "Brewer et al. 2016"),
    "HD 4628": (4938, "Brewer et al. 2016"),
    "HD 102365": (5673, "Brewer et al. 2016"),
    "HD 192310": (5071, "Brewer et al. 2016"),
    "82 Eri": (5422, "Sousa et al. 2021"),
    "70 Oph A": (5319, "Heap & Lindler 2008"),
    "HD 191408": (4922, "Valenti & Fischer 2005"),
    "HD 16160": (4866, "Valenti & Fischer 2005"),
    "zet Tuc": (5948, "Valenti & Fischer 2005"),
    "alf Men": (5587, "Valenti & Fischer 2005"),
    "ksi Boo A": (5410, "Boeche & Grebel 2016"),
    "gam Lep": (6306, "Boeche & Grebel 2016"),
    "bet TrA": (7171, "Rains et al. 2020"),
    "chi Dra": (6150, "Torres et al. 2010"),
    "36 Oph A": (5100, "Heiter & Luck 2003"),
    "36 Oph B": (5087, "Ramirez et al. 2013"),
    "70 Oph B": (4348, "Tuchow et al. 2024"),
    "HD 156026": (4476, "Soubiran et al. 2022"),
    "HD 156274": (5334, "Borisov et al. 2023"),
    "HD 216803": (4575, "Hojjatpanah et al. 2019"),
    "del Tri": (5920, "Gray et al. 2001"),
    "p Eri": (5111, "Soubiran et al. 2022"),
}
#: K dwarfs of Casagrande et al. 2006, table 1 (infrared flux method): B-V (mag), V-Ks (mag), [Fe/H], Teff (K).
K_DWARFS = (
    (0.94, 2.20, 0.01, 5002),  # HD 3765
    (0.99, 2.25, 0.34, 4966),  # HD 4256
    (0.94, 2.29, -0.10, 4956),  # HD 5133
    (1.14, 2.66, 0.15, 4637),  # HD 190007
    (1.162, 2.748, 0.27, 4577),  # HD 21197
    (1.19, 2.95, -0.18, 4429),  # HD 85512
    (1.22, 2.96, 0.06, 4430),  # HD 200779
    (1.27, 3.01, 0.24, 4406),  # HD 120467
)


@pytest.mark.parametrize("star", LITERATURE)
def test_bright_targets_have_the_temperatures_of_the_literature(stars: StarTable, star: str) -> None:
    assert by_name(stars, star)["teff_k"] == pytest.approx(LITERATURE[star][0], abs=100.0)


def test_rows_name_their_sources_and_stars_of_the_table(stars: StarTable) -> None:
    names = stars.column("name").tolist()
    for star, rows in published_parameters().items():
        assert names.count(star) == 1
        assert len({row.reference for row in rows}) == len(rows), star
        for row in rows:
            assert row.star == star
            assert re.search(r"[a-z.] 20\d\d\b", row.reference), star
            assert row.read_in
            assert row.date >= "2026-11-23"
            assert 3500.0 < row.teff_k < 7500.0
            assert not row.angular_diameter_mas <= 0.0


def test_a_star_takes_the_median_of_publications_and_its_own_measured_value(stars: StarTable) -> None:
    base = load_stars(updates=False)
    for star, rows in published_parameters().items():
        old, new = by_name(base, star), by_name(stars, star)
        values = [row.teff_k for row in rows]
        values += [old["teff_k"]] if str(old["teff_k_src"]).startswith("measured") else []
        assert new["teff_k"] == pytest.approx(np.median(values), abs=0.51)
        assert str(new["teff_k_src"]).startswith(f"measured:median of {len(values)} published values")
        assert all(row.reference in str(new["teff_k_src"]) for row in rows)
        metal = [row.metallicity for row in rows if math.isfinite(row.metallicity)]
        if metal:
            assert new["metallicity"] == pytest.approx(np.median(metal), abs=0.0051)


def test_diameters_give_the_radii_that_were_published(stars: StarTable) -> None:
    """Kervella et al. 2008, 2017 (61 Cyg, alf Cen) and Rains et al. 2020 (limb-darkened), in solar radii."""
    published = {"61 Cyg A": 0.665, "61 Cyg B": 0.595, "alf Cen A": 1.2234, "alf Cen B": 0.8632}
    published |= {"eps Eri": 0.738, "eps Ind": 0.711, "HD 131977": 0.715}
    for star, radius in published.items():
        assert by_name(stars, star)["radius_rsun"] == pytest.approx(radius, rel=0.02), star


def test_luminosity_of_v_agrees_with_bolometric_fluxes_of_interferometry(stars: StarTable) -> None:
    """V and the bolometric correction, which serve most stars, against diameter and temperature of the benchmarks."""
    ratios = []
    for star, rows in published_parameters().items():
        row, benchmark = by_name(stars, star), rows[0]
        if math.isfinite(benchmark.angular_diameter_mas) and row["log_g"] > 3.7 and row["teff_k"] > 4500.0:
            distance = float(row["distance_pc"])
            flux = luminosity_from_diameter(benchmark.angular_diameter_mas, distance, benchmark.teff_k)
            ratios.append(luminosity_from_v(float(row["v_mag"]), distance, benchmark.teff_k) / flux)
    assert len(ratios) > 60
    assert abs(np.median(np.log10(ratios))) < 0.015
    assert np.median(np.abs(np.log10(ratios))) < 0.025


def test_luminosity_of_a_diameter_is_that_of_the_sun_at_ten_parsecs() -> None:
    """Diameter 2 R / d: 0.930 mas for the Sun at 10 pc (695 700 km, 149 597 870.7 km)."""
    diameter_mas = 2.0 * 695700.0 / (10.0 * 206264.806247 * 149597870.7) * 206264.806247e3
    assert diameter_mas == pytest.approx(0.930, abs=0.001)
    assert luminosity_from_diameter(diameter_mas, 10.0, 5772.0) == pytest.approx(1.0, rel=1e-9)
    assert luminosity_from_diameter(2.0 * diameter_mas, 10.0, 2886.0) == pytest.approx(0.25, rel=1e-9)


@pytest.mark.parametrize(("b_v_mag", "v_ks_mag", "metallicity", "teff_k"), K_DWARFS)
def test_colour_relations_hold_for_k_dwarfs(b_v_mag: float, v_ks_mag: float, metallicity: float, teff_k: float) -> None:
    assert colour_temperature(b_v_mag, metallicity)[0] == pytest.approx(teff_k, abs=100.0)
    assert infrared_temperature(v_ks_mag, metallicity) == pytest.approx(teff_k, abs=60.0)


def test_infrared_colour_has_a_range() -> None:
    assert math.isnan(infrared_temperature(0.77, 0.0))
    assert math.isnan(infrared_temperature(3.16, 0.0))
    assert math.isnan(infrared_temperature(math.nan, 0.0))


def test_the_coolest_colour_meets_stars_of_known_temperature() -> None:
    """Beyond the published range, to B-V 1.40: 61 Cyg B 4109 K, HD 88230 4132 K, both of B-V 1.37."""
    assert colour_temperature(1.37, -0.3)[0] == pytest.approx(4109.0, abs=100.0)
    assert colour_temperature(1.37, 0.2)[0] == pytest.approx(4132.0, abs=100.0)
    assert colour_temperature(1.41, 0.0)[1].endswith("(Ballesteros 2012)")


def test_disagreement_is_flagged_beyond_200_k(stars: StarTable) -> None:
    assert not temperatures_disagree(5000.0, (5200.0, 4800.0, math.nan))
    assert temperatures_disagree(5000.0, (5201.0,))
    for star, rows in published_parameters().items():
        row = by_name(stars, star)
        if any(abs(item.teff_k - float(row["teff_k"])) > 200.5 for item in rows):
            assert "teff_disagreement" in str(row["quality_flags"]), star
    assert "teff_disagreement" in str(by_name(stars, "bet CVn")["quality_flags"])
    assert "teff_disagreement" not in str(by_name(stars, "tau Cet")["quality_flags"])


def test_close_pairs_are_not_cooled_by_an_infrared_magnitude_of_both_stars(stars: StarTable) -> None:
    for star in ("HD 148653 A", "zet1 Cnc", "99 Her", "HD 111456"):
        row = by_name(stars, star)
        assert "V-K" not in str(row["teff_k_src"]), star
        assert row["teff_k"] == pytest.approx(colour_temperature(float(row["b_v_mag"]), 0.0)[0], abs=1.0)


def test_other_stars_and_columns_stay(stars: StarTable) -> None:
    base = load_stars(updates=False)
    changed = set(updated_columns(base.columns))
    kept = ~np.isin(base.column("name"), list(published_parameters()))
    for name, values in base.columns.items():
        if name in changed:
            np.testing.assert_array_equal(stars.column(name)[kept], values[kept], err_msg=name)
        elif not name.startswith("companion"):
            np.testing.assert_array_equal(stars.column(name), values, err_msg=name)


def test_the_story_of_the_table_tells_of_them() -> None:
    assert "stellar_parameters.csv" in parameters_vintage()
    assert parameters_vintage() in snapshot_vintage() == open_catalogue("snapshot").provenance
    assert "stellar_parameters.csv" not in open_catalogue("simbad_2012").provenance
    listed = catalogue_info()["published_parameters"]
    assert len(listed) == sum(len(rows) for rows in published_parameters().values())
    assert {"star", "teff_k", "reference", "read_in", "date"} <= set(listed[0])
    assert all(value == value for row in listed for value in row.values()), "what is not known is not there"


def test_tables_of_ones_own_are_not_touched(tmp_path: Path) -> None:
    mine = tmp_path / "mine.csv"
    with mine.open("w", encoding="utf-8", newline="") as stream:
        csv.writer(stream).writerows(
            [("name", "distance_pc", "v_mag", "sp_type", "teff_k"), ("61 Cyg A", 3.5, 5.21, "K5V", 4655)]
        )
    row = by_name(open_catalogue(mine).table, "61 Cyg A")
    assert row["teff_k"] == 4655.0
    assert "published" not in str(row["teff_k_src"])


@pytest.mark.parametrize("load", [load_stars, load_known_planets])
def test_nothing_of_a_table_can_be_changed_and_it_travels_whole(load):
    table = load()
    name = next(iter(table.columns))
    with pytest.raises(TypeError):
        table.columns[name] = np.zeros(len(table))
    with pytest.raises(ValueError, match="read-only"):
        table.columns[name][0] = table.columns[name][1]
    back = pickle.loads(pickle.dumps(table))
    assert type(back) is type(table)
    assert len(back) == len(table) > 200
    for column, values in table.columns.items():
        np.testing.assert_array_equal(back.columns[column], values)
    with pytest.raises(TypeError):
        back.columns[name] = np.zeros(len(table))


def test_a_copy_with_other_columns_leaves_the_table_as_it_is():
    stars = load_stars()
    moved = stars.with_columns({"ra_deg": np.zeros(len(stars)), "more": np.ones(len(stars))})
    assert not moved.column("ra_deg").any()
    assert moved.column("more").all()
    assert "more" not in stars.columns
    assert stars.column("ra_deg").any()
    with pytest.raises(ValueError, match="read-only"):
        moved.column("more")[0] = 2.0
