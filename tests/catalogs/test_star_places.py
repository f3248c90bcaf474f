"""Places at a date: proper motion against astropy, companions on orbits or where they were last seen."""

import math
from pathlib import Path

import numpy as np
import pytest

from catalogs import POSITION_ERROR, StarTable, catalogue_info, load_stars, open_catalogue, snapshot_vintage, stars_at
from catalogs.binaries import POSITION_ERROR_ARCSEC, companion_places, orbits_by_star

DATE_YR = 2028.5
NUMBERS = ("ra_deg", "dec_deg", "pm_ra_mas_yr", "pm_dec_mas_yr", "epoch_yr")


def by_name(stars: StarTable, name: str) -> dict[str, str | int | float | bool]:
    return stars.row(stars.column("name").tolist().index(name))


def test_positions_are_those_of_astropys_space_motion() -> None:
    from astropy import units as u
    from astropy.coordinates import SkyCoord
    from astropy.time import Time

    stars, moved = load_stars(), stars_at(load_stars(), DATE_YR)
    old = {name: np.asarray(stars.column(name), float) for name in (*NUMBERS, "parallax_mas", "rv_km_s")}
    then = SkyCoord(
        old["ra_deg"] * u.deg,
        old["dec_deg"] * u.deg,
        distance=1000.0 / old["parallax_mas"] * u.pc,
        pm_ra_cosdec=old["pm_ra_mas_yr"] * u.mas / u.yr,
        pm_dec=old["pm_dec_mas_yr"] * u.mas / u.yr,
        radial_velocity=old["rv_km_s"] * u.km / u.s,
        obstime=Time(2000.0, format="jyear"),
    )
    there = then.apply_space_motion(new_obstime=Time(DATE_YR, format="jyear"))
    found = SkyCoord(moved.column("ra_deg") * u.deg, moved.column("dec_deg") * u.deg)
    apart = found.separation(SkyCoord(there.ra, there.dec)).to_value(u.mas)
    assert float(apart.max()) < 10.0
    assert float(found.separation(SkyCoord(then.ra, then.dec)).to_value(u.arcsec).max()) > 100.0


def test_moving_twice_is_moving_once() -> None:
    once, twice = stars_at(load_stars(), DATE_YR), stars_at(stars_at(load_stars(), 2014.0), DATE_YR)
    for name in ("ra_deg", "dec_deg", "companion_sep_arcsec", "companion_pa_deg", "epoch_yr"):
        np.testing.assert_allclose(twice.column(name).astype(float), once.column(name).astype(float), atol=1e-8)


def test_companions_follow_their_orbits() -> None:
    stars, known = stars_at(load_stars(), DATE_YR), orbits_by_star()
    seen = 0
    for index, name in enumerate(stars.column("name").tolist()):
        row = stars.row(index)
        if name not in known or not known[name].resolved:
            continue
        seen += 1
        separation, pa = companion_places([known[name]], DATE_YR)
        assert row["companion_name"] == known[name].companion
        assert row["companion_sep_arcsec"] == pytest.approx(float(separation[0]))
        assert row["companion_pa_deg"] == pytest.approx(float(pa[0]))
        assert row["companion_epoch_yr"] == DATE_YR
        assert row[POSITION_ERROR] == POSITION_ERROR_ARCSEC[known[name].grade]
        assert str(row["companion_src"]).startswith("derived:orbit of ")
        assert row["companion_pa_src"] == row["companion_src"]
    assert seen > 200


def test_what_has_no_orbit_stays_where_it_was_seen() -> None:
    base, stars, known = load_stars(), stars_at(load_stars(), DATE_YR), orbits_by_star()
    resolved = [name in known and known[name].resolved for name in base.column("name").tolist()]
    still = ~np.array(resolved)
    assert still.sum() > 1000
    for name, values in base.columns.items():
        if name not in NUMBERS:
            kept = still if name.startswith("companion_") else np.ones(len(base), bool)
            np.testing.assert_array_equal(stars.column(name)[kept], values[kept], err_msg=name)


def test_a_place_without_an_orbit_gets_less_certain_with_age() -> None:
    """By the arc of a circular orbit of Kepler's period, at most across it."""
    stars = load_stars()
    rows = np.flatnonzero(
        np.isfinite(stars.column("companion_epoch_yr")) & (stars.column("companion_src") != "missing")
    ).tolist()
    known = orbits_by_star()
    row = next(row for row in rows if stars.column("name")[row].item() not in known)
    one = stars.select([row])
    facts = one.row(0)
    axis_au = float(facts["companion_sep_arcsec"]) * float(facts["distance_pc"])
    period_yr = math.sqrt(axis_au**3 / (2.0 * float(facts["mass_msun"])))
    for years in (1.0, 10.0):
        now = stars_at(one, float(facts["companion_epoch_yr"]) + years)
        arc = 2.0 * math.pi * years / period_yr * float(facts["companion_sep_arcsec"])
        expected = min(arc, 2.0 * float(facts["companion_sep_arcsec"]))
        assert now.row(0)[POSITION_ERROR] == pytest.approx(expected, rel=1e-9)


def test_pairs_that_are_never_resolved_keep_their_light() -> None:
    """66 Cet A is a pair of 14 mas; the star that the table lists 17 arcsec away is its companion."""
    before, now = by_name(load_stars(), "66 Cet"), by_name(stars_at(load_stars(), DATE_YR), "66 Cet")
    assert not orbits_by_star()["66 Cet"].resolved
    assert now["companion_name"] == before["companion_name"] == "LTT 1138"
    assert now["companion_sep_arcsec"] == pytest.approx(16.58)


def test_procyon_has_its_white_dwarf() -> None:
    """V 10.82 (Bond et al. 2015); the base table knows no companion. SIMBAD's flag of close pairs stays as it is."""
    before, now = by_name(load_stars(), "alf CMi"), by_name(stars_at(load_stars(), DATE_YR), "alf CMi")
    assert before["companion_name"] == ""
    assert float(now["v_mag"]) + float(now["companion_delta_v_mag"]) == pytest.approx(10.82, abs=0.005)
    assert now["close_companion"] is before["close_companion"] is False


def test_orbits_can_be_left_out() -> None:
    snapshot, base = open_catalogue("snapshot"), open_catalogue("simbad_2012")
    assert (snapshot.orbits, base.orbits) == (True, False)
    assert (base.kind, base.ranked_v_mag, base.sample) == ("simbad_2012", snapshot.ranked_v_mag, snapshot.sample)
    listed = by_name(stars_at(base.table, DATE_YR, orbits=False), "alf Cen A")
    assert listed["companion_sep_arcsec"] == pytest.approx(19.11)
    assert listed[POSITION_ERROR] == pytest.approx(2.0 * 19.11), "half an orbit ago at the least"
    assert "binary_orbits.csv" in snapshot.provenance == snapshot_vintage()
    assert "binary_orbits.csv" not in base.provenance
    assert base.provenance == snapshot_vintage(orbits=False)


def test_the_catalogues_story_lists_them() -> None:
    listed = {row["star"]: row for row in catalogue_info()["binary_orbits"]}
    assert listed["70 Oph A"]["period_yr"] == pytest.approx(88.3983)
    assert "delta_v_mag" not in listed["70 Oph A"], "the star table's stays"
    assert listed["alf CMi"]["delta_v_mag"] == pytest.approx(10.48)


def test_tables_of_ones_own_keep_their_companions(tmp_path: Path) -> None:
    mine = tmp_path / "mine.csv"
    mine.write_text(
        "name,distance_pc,v_mag,sp_type,companion_name,companion_sep_arcsec,companion_pa_deg,companion_delta_v_mag\n"
        "alf Cen A,1.32,-0.01,G2V,alf Cen B,15.5,200.0,1.3\n"
        "alf CMi,3.5,0.34,F5IV-V,,,,\n",
        encoding="utf-8",
    )
    opened = open_catalogue(mine)
    table = stars_at(opened.table, DATE_YR, orbits=opened.orbits)
    assert by_name(table, "alf Cen A")["companion_sep_arcsec"] == 15.5
    assert math.isnan(float(by_name(table, "alf CMi")["companion_sep_arcsec"]))
    assert math.isnan(float(by_name(table, "alf CMi")["ra_deg"])), "no position, and none is made up"
