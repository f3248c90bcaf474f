"""Published temperatures: what the shipped rows say, what a star takes from them, which tables they are laid over."""

import csv
import math
import re
from pathlib import Path

import numpy as np
import pytest

from catalogs import StarTable, catalogue_info, load_stars, open_catalogue, snapshot_vintage
from catalogs.stars import parameters_vintage, published_parameters, updated_columns
from catalogs.stellar_physics import (
    colour_temperature,
    luminosity_from_diameter,
    luminosity_from_v,
    temperatures_disagree,
)
from tools.build_catalogue.builders._star_physics import infrared_temperature

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


@pytest.fixture(scope="module")
def stars() -> StarTable:
    return load_stars()


def by_name(table: StarTable, name: str) -> dict[str, str | int | float | bool]:
    return table.row(table.column("name").tolist().index(name))


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
    radius = np.sqrt(stars.column("luminosity_lsun")) * (5772.0 / stars.column("teff_k")) ** 2
    np.testing.assert_allclose(stars.column("radius_rsun"), radius, rtol=2e-3)


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
