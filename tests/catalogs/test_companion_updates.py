"""Places of companions that have moved: those of published orbits at 2028.5, in every table that shares them."""

import math
from pathlib import Path

import numpy as np
import pytest

from catalogs import StarTable, catalogue_info, load_stars, open_catalogue, snapshot_vintage
from catalogs.published_parameters import published_parameters
from catalogs.stars import companion_updates

EPOCH_YR = 2028.5
# Period (yr), periastron (yr), semi-major axis (arcsec), eccentricity, inclination, node, argument of periastron (deg).
ORBITS = {
    ("alf Cen A", "alf Cen B"): (79.762, 1955.564, 17.493, 0.51947, 79.243, 205.073, 231.519),  # Akeson et al. 2021
    ("alf CMi", "alf CMi B"): (40.840, 1968.076, 4.3075, 0.39785, 31.408, 100.683, 89.23),  # Bond et al. 2015
    ("70 Oph A", "70 Oph B"): (88.3983, 1895.8225, 4.5504, 0.4980, 120.89, 121.69, 193.38),  # ORB6, as the others
    ("36 Oph A", "36 Oph B"): (470.9, 1677.8656, 13.0, 0.916, 99.79, 94.15, 89.80),
    ("ksi Boo A", "ksi Boo B"): (152.9614, 1909.622, 4.9345, 0.5139, 140.45, 168.79, 25.49),
    ("ksi UMa A", "ksi UMa B"): (59.8903, 1935.1701, 2.5044, 0.4043, 122.19, 100.94, 126.96),
    ("gam Vir A", "gam Vir B"): (169.104, 2005.511, 3.639, 0.8815, 149.46, 35.34, 255.02),
    ("eta Cas", "LHS 122"): (479.27, 1889.9311, 12.04, 0.497, 35.60, 278.0, 269.80),
    ("61 Cyg A", "61 Cyg B"): (664.37, 1700.37, 24.36, 0.457, 53.29, 174.88, 149.32),
}
# Separations that the literature expects, arcsec: a slip in an element above would show here.
EXPECTED_ARCSEC = {
    "alf Cen A": 10.2,
    "alf CMi": 5.1,
    "70 Oph A": 6.7,
    "36 Oph A": 5.2,
    "ksi Boo A": 4.6,
    "ksi UMa A": 2.8,
    "gam Vir A": 3.8,
    "eta Cas": 13.6,
    "61 Cyg A": 32.2,
}


def place(orbit: tuple[float, ...], year: float) -> tuple[float, float]:
    """Separation and position angle, by bisection of Kepler's equation and Thiele-Innes constants."""
    period, periastron, a, e, *angles = orbit
    i, node, omega = (math.radians(angle) for angle in angles)
    mean = 2.0 * math.pi * (((year - periastron) / period) % 1.0)
    low, high = 0.0, 2.0 * math.pi
    for _ in range(80):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if middle - e * math.sin(middle) < mean else (low, middle)
    x, y = math.cos(low) - e, math.sqrt(1.0 - e * e) * math.sin(low)
    north = (math.cos(omega) * math.cos(node) - math.sin(omega) * math.sin(node) * math.cos(i)) * x + (
        -math.sin(omega) * math.cos(node) - math.cos(omega) * math.sin(node) * math.cos(i)
    ) * y
    east = (math.cos(omega) * math.sin(node) + math.sin(omega) * math.cos(node) * math.cos(i)) * x + (
        -math.sin(omega) * math.sin(node) + math.cos(omega) * math.cos(node) * math.cos(i)
    ) * y
    return a * math.hypot(north, east), math.degrees(math.atan2(east, north)) % 360.0


def turned(one: float, other: float) -> float:
    """Angle between two directions, deg."""
    return abs((one - other + 180.0) % 360.0 - 180.0)


def by_name(stars: StarTable, name: str) -> dict[str, str | int | float | bool]:
    return stars.row(stars.column("name").tolist().index(name))


def test_every_pair_is_checked_here() -> None:
    assert {(item.star, item.companion) for item in companion_updates()} == set(ORBITS)


@pytest.mark.parametrize(("star", "companion"), ORBITS)
def test_companions_stand_where_their_orbits_put_them(star: str, companion: str) -> None:
    separation, pa = place(ORBITS[star, companion], EPOCH_YR)
    assert separation == pytest.approx(EXPECTED_ARCSEC[star], abs=0.1)
    stars = load_stars()
    seen = [(star, companion, pa)]
    if companion in stars.column("name"):
        seen.append((companion, star, pa + 180.0))
    for name, other, angle in seen:
        row = by_name(stars, name)
        assert row["companion_name"] == other
        assert row["companion_sep_arcsec"] == pytest.approx(separation, abs=0.02)
        assert turned(float(row["companion_pa_deg"]), angle) < 0.5
        assert 0.0 <= float(row["companion_pa_deg"]) < 360.0
        assert row["companion_epoch_yr"] == EPOCH_YR
        assert str(row["companion_src"]).startswith("derived:orbit of ")
        assert row["companion_pa_src"] == row["companion_src"]
        assert np.isfinite(float(row["companion_delta_v_mag"]))


def test_procyon_has_its_white_dwarf() -> None:
    """V 10.82 (Bond et al. 2015); the base table knows no companion. SIMBAD's flag of close pairs stays as it is."""
    before, now = by_name(load_stars(updates=False), "alf CMi"), by_name(load_stars(), "alf CMi")
    assert before["companion_name"] == ""
    assert float(now["v_mag"]) + float(now["companion_delta_v_mag"]) == pytest.approx(10.82, abs=0.005)
    assert "Bond" in str(now["companion_delta_v_src"])
    assert now["close_companion"] is before["close_companion"] is False


def test_nothing_else_changes() -> None:
    base, stars = load_stars(updates=False), load_stars()
    moved = {name for pair in ORBITS for name in pair}
    still = ~np.isin(base.column("name"), sorted(moved))
    unpublished = ~np.isin(base.column("name"), list(published_parameters()))
    for name, values in base.columns.items():
        kept = still if name.startswith("companion_") else unpublished
        np.testing.assert_array_equal(stars.column(name)[kept], values[kept], err_msg=name)
    known = [name for name in moved if name in base.column("name")]
    for name in known:
        if name != "alf CMi":
            old, new = by_name(base, name), by_name(stars, name)
            assert new["companion_name"] == old["companion_name"]
            assert new["companion_delta_v_mag"] == old["companion_delta_v_mag"]


def test_base_is_the_table_before() -> None:
    snapshot, base = open_catalogue("snapshot"), open_catalogue("simbad_2012")
    assert by_name(base.table, "alf Cen A")["companion_sep_arcsec"] == pytest.approx(19.11)
    assert by_name(snapshot.table, "alf Cen A")["companion_sep_arcsec"] == pytest.approx(10.25)
    assert (base.kind, base.ranked_v_mag, base.sample) == ("simbad_2012", snapshot.ranked_v_mag, snapshot.sample)
    assert "companion_updates.csv" in snapshot.provenance == snapshot_vintage()
    assert "companion_updates.csv" not in base.provenance
    assert base.provenance == snapshot_vintage(updates=False)


def test_the_catalogues_story_lists_them() -> None:
    listed = {row["star"]: row for row in catalogue_info()["companion_updates"]}
    assert listed["70 Oph A"]["separation_arcsec"] == pytest.approx(6.68)
    assert "delta_v_mag" not in listed["70 Oph A"], "the base table's stays"
    assert listed["alf CMi"]["delta_v_mag"] == pytest.approx(10.48)
    assert all(row["reference"] and "P " in row["note"] for row in listed.values())


def test_tables_of_ones_own_are_not_touched(tmp_path: Path) -> None:
    mine = tmp_path / "mine.csv"
    mine.write_text(
        "name,distance_pc,v_mag,sp_type,companion_name,companion_sep_arcsec,companion_pa_deg,companion_delta_v_mag\n"
        "alf Cen A,1.32,-0.01,G2V,alf Cen B,15.5,200.0,1.3\n"
        "alf CMi,3.5,0.34,F5IV-V,,,,\n",
        encoding="utf-8",
    )
    table = open_catalogue(mine).table
    assert by_name(table, "alf Cen A")["companion_sep_arcsec"] == 15.5
    assert math.isnan(float(by_name(table, "alf CMi")["companion_sep_arcsec"]))
