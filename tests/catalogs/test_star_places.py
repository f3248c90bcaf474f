"""Places at a date: proper motion against astropy, companions on orbits or where they were last seen."""

import math
from pathlib import Path

import numpy as np
import pytest

from catalogs import POSITION_ERROR, StarTable, catalogue_info, load_stars, open_catalogue, snapshot_vintage, stars_at
from catalogs.binaries import (
    POSITION_ERROR_ARCSEC,
    binary_orbits,
    companion_places,
    companion_share,
    orbits_by_star,
)
from catalogs.coordinates import tangent_offset

DATE_YR = 2028.5
NUMBERS = ("ra_deg", "dec_deg", "pm_ra_mas_yr", "pm_dec_mas_yr", "epoch_yr")


def by_name(stars: StarTable, name: str) -> dict[str, str | int | float | bool]:
    return stars.row(stars.column("name").tolist().index(name))


def test_positions_are_those_of_astropys_space_motion() -> None:
    from astropy import units as u
    from astropy.coordinates import SkyCoord
    from astropy.time import Time

    stars, moved = load_stars(), stars_at(load_stars(), DATE_YR, orbits=False)
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


NAMES = frozenset(load_stars().column("name").tolist())
PAIRS = [pair for pair in binary_orbits() if pair.resolved and pair.companion in NAMES]


@pytest.mark.parametrize("date_yr", [1995.0, 2014.25, 2028.5, 2041.0])
def test_one_place_a_star(date_yr: float) -> None:
    """From either star of a pair the other is the same by their coordinates and by the columns of the companion."""
    from astropy import units as u
    from astropy.coordinates import SkyCoord

    stars = stars_at(load_stars(), date_yr)
    assert {"alf Cen A", "70 Oph A", "61 Cyg A", "ksi Boo A", "36 Oph A", "gam Vir A"} <= {pair.star for pair in PAIRS}
    for pair in PAIRS:
        both = [by_name(stars, name) for name in (pair.star, pair.companion)]
        places = [SkyCoord(row["ra_deg"] * u.deg, row["dec_deg"] * u.deg) for row in both]
        for row, here, there in ((both[0], *places), (both[1], *reversed(places))):
            east, north = (offset.to_value(u.arcsec) for offset in here.spherical_offsets_to(there))
            separation, angle = row["companion_sep_arcsec"], math.radians(float(row["companion_pa_deg"]))
            apart = math.hypot(east - separation * math.sin(angle), north - separation * math.cos(angle))
            assert apart < 0.01 < row[POSITION_ERROR], (pair.star, apart)


@pytest.mark.parametrize("pair", PAIRS, ids=lambda pair: pair.star)
def test_the_centre_of_mass_of_a_pair_moves_on_a_straight_line(pair) -> None:
    """Where proper motion alone carries it; halfway between two dates it is halfway between its places."""
    share = companion_share(pair)
    names = load_stars().column("name").tolist()
    rows = [names.index(pair.star), names.index(pair.companion)]

    def centre(date_yr: float, orbits: bool = True) -> np.ndarray:
        table = stars_at(load_stars().select(rows), date_yr, orbits=orbits)
        star, other = np.array([table.column(name) for name in ("ra_deg", "dec_deg")]).T
        return star + share * (other - star)

    wide = np.array([math.cos(math.radians(by_name(load_stars(), pair.star)["dec_deg"])), 1.0]) * 3600.0
    np.testing.assert_allclose(wide * centre(2028.5), wide * centre(2028.5, orbits=False), atol=2e-3)
    middle = (centre(2010.0) + centre(2030.0)) / 2.0
    np.testing.assert_allclose(wide * centre(2020.0), wide * middle, atol=0.02)


def test_alpha_centauri_is_where_the_motion_of_its_brighter_star_and_the_orbit_put_it() -> None:
    """Hipparcos saw alf Cen A in 1991.25 with the speed of that year: less its part of the orbit, that of the centre.

    The two ways differ by what the proper motion of alf Cen B is wrong in Hipparcos-2, 0.15 arcsec/yr; to carry each
    star along its own line would be 8 and 9.5 arcsec wrong.
    """
    (pair,) = (pair for pair in PAIRS if pair.star == "alf Cen A")
    share, base = 0.9092 / (1.0788 + 0.9092), by_name(load_stars(), "alf Cen A")
    assert companion_share(pair) == pytest.approx(share)

    def orbit(date_yr: float) -> np.ndarray:
        separation, pa = companion_places([pair], date_yr)
        return np.array([separation[0] * math.sin(math.radians(pa[0])), separation[0] * math.cos(math.radians(pa[0]))])

    own = np.array([base["pm_ra_mas_yr"], base["pm_dec_mas_yr"]], float) / 1000.0
    speed = own + share * (orbit(1991.75) - orbit(1990.75))
    expected = own * (1991.25 - 2000.0) + share * orbit(1991.25) + speed * (2028.5 - 1991.25) - share * orbit(2028.5)
    now = by_name(stars_at(load_stars(), 2028.5), "alf Cen A")
    found = tangent_offset(now["ra_deg"], now["dec_deg"], base["ra_deg"], base["dec_deg"])
    assert math.hypot(*(found - expected)) < 3.0


def test_a_star_whose_companion_has_no_row_keeps_its_place() -> None:
    with_orbits, without = (stars_at(load_stars(), DATE_YR, orbits=given) for given in (True, False))
    paired = np.isin(load_stars().column("name"), [name for pair in PAIRS for name in (pair.star, pair.companion)])
    for name in ("ra_deg", "dec_deg"):
        np.testing.assert_array_equal(with_orbits.column(name)[~paired], without.column(name)[~paired])
    alone = load_stars().select(load_stars().column("name") == "alf Cen A")
    assert stars_at(alone, DATE_YR).column("ra_deg") == stars_at(alone, DATE_YR, orbits=False).column("ra_deg")


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
    assert base.provenance == snapshot_vintage(updates=False)


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
