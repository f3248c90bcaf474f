"""Answers about known planets: contrast by Eq. 1 of the paper, windows by the shares of draws."""

import numpy as np
import pytest

from catalogs import load_known_planets
from cpic_planner.etc import build_model
from cpic_planner.planets import ephemeris
from cpic_planner.ranking import KnownChoice
from cpic_planner.ranking.known_answer import known_answer, planets_contrast
from cpic_planner.results import KnownResult
from cpic_planner.targets import find_target, rank_sample
from simulator import load_instrument, planet_contrast
from simulator.config import albedo_spec
from simulator.target import lambert_phase

BANDS = ("F520", "F850")
AU_KM, RJUP_KM = 149597870.7, 71492.0


@pytest.fixture(scope="module")
def model():
    return build_model(load_instrument(), bands=BANDS)


def choice(n=300, mjd=61771.0, albedo=0.4, table="snapshot", **more):
    return KnownChoice(load_known_planets(table), "2028-01-01T00:00:00", mjd, albedo_spec(albedo), n, **more)


@pytest.fixture(scope="module")
def eps_eri():
    return find_target("eps Eri")[0]


def test_contrast_is_that_of_the_paper_s_equation(model, eps_eri):
    sample = choice().draw(eps_eri)
    planets = sample.planets[0][0]
    found = planets_contrast(model, eps_eri, "F520", planets, albedo_spec(0.4))
    expected = 0.4 * (planets.radius_rjup * RJUP_KM / (planets.distance_au * AU_KM)) ** 2
    expected = expected * lambert_phase(planets.phase_deg)
    np.testing.assert_allclose(found, expected, rtol=1e-6)
    by_offsets = planet_contrast(planets.radius_rjup, planets.east_au, planets.north_au, planets.phase_deg, 0.4)
    np.testing.assert_allclose(found, by_offsets, rtol=1e-6)


def test_an_albedo_that_follows_the_insolation(model, eps_eri):
    """Takes each planet's own distance over the root of the star's luminosity."""
    spec = albedo_spec({"model": "parametric", "log10_mh": 1.0, "log10_fsed": 0.0})
    planets = choice().draw(eps_eri).planets[0][0]
    found = planets_contrast(model, eps_eri, "F850", planets, spec)
    assert np.isfinite(found).all()
    insolation_au = float(planets.distance_au[0] / np.sqrt(eps_eri.luminosity_lsun[0]))
    fixed = albedo_spec({"model": "parametric", "log10_mh": 1.0, "log10_fsed": 0.0, "insolation_au": insolation_au})
    assert planets_contrast(model, eps_eri, "F850", planets, fixed)[0] == pytest.approx(found[0], rel=1e-6)


def test_answer_of_one_star(model, eps_eri):
    result = known_answer(model, eps_eri, choice(), years=8.0)
    assert KnownResult.model_validate_json(result.model_dump_json()) == result
    (row,) = result.planets
    assert (row.planet, row.star, row.hip) == ("eps Eri b", "eps Eri", 16537)
    assert [hole.band for hole in result.holes] == list(BANDS) == [look.band for look in row.bands]
    assert row.semi_major_axis_au.median == pytest.approx(3.53, rel=0.01)
    assert row.pa_deg is not None
    assert (row.status, row.status_reference) == ("confirmed", "")
    assert "2025AJ....170..301T" in row.reference
    track = row.track
    assert track.mjd[0] == 61771.0
    assert track.mjd[-1] == pytest.approx(61771.0 + 8 * 365.25)
    assert row.separation_arcsec.median == track.separation_median_arcsec[0]
    assert (np.array(track.separation_low_arcsec) <= track.separation_median_arcsec).all()


def test_windows_are_the_days_with_most_draws_in_the_hole(model, eps_eri):
    """Day by day, from an ephemeris on other dates."""
    result = known_answer(model, eps_eri, choice(), years=8.0, bands=["F520"])
    (row,), (hole,) = result.planets, result.holes
    table = load_known_planets()
    days = 61771.0 + np.arange(0.0, 2922.0, 1.0)
    where = ephemeris(table, table.row_of("eps Eri b"), days, n_draws=300, seed=1, distance_pc=row.distance_pc)
    share = where.share_between(hole.inner_arcsec, hole.outer_arcsec)
    epoch = np.datetime64("1858-11-17")
    inside = np.zeros(len(days), bool)
    for window in row.windows:
        start, end, best = (
            float((np.datetime64(day) - epoch).astype(int))
            for day in (window.start_utc, window.end_utc, window.best_utc)
        )
        inside |= (days >= start) & (days <= end)
        assert start <= best <= end
        assert window.best_share == pytest.approx(share[int(best - days[0])], abs=0.03)
    assert len(row.windows) == 3
    # The track has a date every 7 days.
    assert np.count_nonzero(inside != (share >= 0.5)) <= 2 * 8 * len(row.windows)


def test_refuted_planets_are_listed_with_their_reference_and_no_windows(refused, model):
    """tau Cet e, of which the archive of 2019 knows nothing bad."""
    star = find_target("tau Cet")[0]
    rows = {row.planet[-1]: row for row in known_answer(model, star, choice(n=50), years=2.0, bands=["F520"]).planets}
    assert {letter: row.status for letter, row in rows.items()} == {
        "e": "refuted",
        "f": "controversial",
        "g": "controversial",
        "h": "controversial",
    }
    assert "2025A&A...700A.174F" in rows["e"].status_reference
    assert "2017AJ....154..135F" in rows["e"].reference
    assert (rows["e"].windows, rows["e"].track) == ([], None)
    assert rows["f"].track is not None
    before = known_answer(model, star, choice(n=50, table="archive_2019"), years=2.0, bands=["F520"]).planets
    assert [row.status for row in before] == ["confirmed"] * 4
    assert all(row.track is not None for row in before)
    refused("known_planets", known_answer, model, find_target("Procyon")[0], choice(n=50))


def test_a_planet_that_is_asked_for_is_drawn_alone_and_as_among_all(model, monkeypatch):
    """Its answer is made without the draws of the others of its star, which take as long again for each."""
    asked = model, find_target("tau Cet")[0], choice(n=50)
    every = known_answer(*asked, years=2.0, bands=["F520"])
    drawn = []

    def told(table, row, *args, **named):
        drawn.append(row)
        return ephemeris(table, row, *args, **named)

    monkeypatch.setattr("cpic_planner.ranking.known_answer.ephemeris", told)
    one = known_answer(*asked, years=2.0, bands=["F520"], planet="tau Cet g")
    assert one == every.model_copy(update={"planets": [row for row in every.planets if row.planet == "tau Cet g"]})
    assert len(one.planets) == len(drawn) == 1


def test_answers_of_all_stars_have_no_tracks(model):
    stars = rank_sample(v_mag_max=5.0)
    result = known_answer(model, stars, choice(n=50), bands=["F520"])
    assert len(result.planets) > 20
    assert all(row.track is None and row.windows == [] for row in result.planets)
    assert result.years is None
    for row in result.planets:
        assert row.separation_arcsec.low <= row.separation_arcsec.median <= row.separation_arcsec.high
        assert 0.0 <= row.bands[0].hole_share <= 1.0


def test_what_decides_is_in_the_hash(model, eps_eri):
    made = [
        known_answer(model, eps_eri, choice(n=20), bands=["F520"]),
        known_answer(model, eps_eri, choice(n=20), bands=["F850"]),
        known_answer(model, eps_eri, choice(n=20), bands=["F520"], years=1.0),
        known_answer(model, eps_eri, choice(n=20, mjd=61772.0), bands=["F520"]),
    ]
    assert len({result.config_hash for result in made}) == 4


@pytest.mark.parametrize("years", [0.0, -1.0, 101.0, np.nan])
def test_refuses_other_lengths(refused, model, eps_eri, years):
    refused("years", known_answer, model, eps_eri, choice(n=20), years=years)
