"""Planets of a user's own table: what has no error is exact, and every answer names columns that were not used."""

import itertools
import json
import math

import numpy as np
import pytest

from catalogs.known_planets import COLUMNS, FLAGS, flags_of, load_known_planets
from cpic_planner.planets.published_orbits import draw_known, ephemeris, known_uniforms

STAR, DISTANCE_PC, MJD = "tau Cet", 3.65, 61771.0
ORBIT = {
    "period_days": 1000.0,
    "periastron_jd": 2461000.5,
    "eccentricity": 0.3,
    "omega_star_deg": 40.0,
    "inclination_deg": 60.0,
    "radius_rjup": 1.0,
    "star_mass_msun": 0.78,
}
ERRORS = {
    "period_err_days": 1.0,
    "periastron_err_days": 1.0,
    "eccentricity_err": 0.01,
    "omega_err_deg": 1.0,
    "inclination_err_deg": 1.0,
    "radius_err_rjup": 0.01,
}
TIMES = {"periastron_jd": 0.0, "conjunction_jd": None}


@pytest.fixture
def table(tmp_path):
    """Write a table of one planet; returns what --known-planets takes."""

    def write(orbit, name="pl.csv"):
        own = {"star": STAR, "planet": f"{STAR} z", **orbit}
        path = tmp_path / name
        path.write_text(f"{','.join(own)}\n{','.join(map(str, own.values()))}\n", encoding="utf-8")
        return f"none+{path}"

    return write


def place_of(orbit, mjd):
    """Return separation (arcsec) and phase angle (deg) by Newton's steps of Kepler's equation, from the textbook."""
    e, period = orbit["eccentricity"], orbit["period_days"]
    axis = (orbit["star_mass_msun"] * (period / 365.2568983) ** 2) ** (1 / 3)
    mean = 2 * math.pi * (mjd + 2400000.5 - orbit["periastron_jd"]) / period
    anomaly = mean
    for _ in range(60):
        anomaly -= (anomaly - e * math.sin(anomaly) - mean) / (1 - e * math.cos(anomaly))
    true = 2 * math.atan2(math.sqrt(1 + e) * math.sin(anomaly / 2), math.sqrt(1 - e) * math.cos(anomaly / 2))
    r = axis * (1 - e * math.cos(anomaly))
    along = true + math.radians(orbit["omega_star_deg"] + 180.0)
    tilt = math.radians(orbit["inclination_deg"])
    # Towards the observer is where the planet is in front of the star: its phase is then 180 deg.
    depth = math.sin(along) * math.sin(tilt)
    return r * math.sqrt(1 - depth**2) / DISTANCE_PC, math.degrees(math.acos(depth))


@pytest.mark.parametrize("mjd", [61771.0, 62000.0, 62345.0])
def test_an_orbit_without_errors_is_exact(table, mjd):
    """The case that was found: 0.303 +- 0.121 arcsec for a planet whose elements are known by definition."""
    planets = load_known_planets(table(ORBIT))
    where = ephemeris(planets, 0, [mjd], n_draws=200, seed=1, distance_pc=DISTANCE_PC)
    separation, phase = place_of(ORBIT, mjd)
    assert where.separation_arcsec[:, 0] == pytest.approx([separation] * 3, rel=2e-4)
    assert where.phase_deg[:, 0] == pytest.approx([phase] * 3, abs=0.05)
    assert "phase_unknown" not in planets.flags(0)


@pytest.mark.parametrize("given", [(), *itertools.combinations(ERRORS, 1), *itertools.combinations(ERRORS, 5)])
def test_every_element_without_an_error_is_exact_and_said_to_be(table, given):
    planets = load_known_planets(table(ORBIT | {name: ERRORS[name] for name in given}))
    drawn = draw_known(planets, [0], known_uniforms(planets, [0], 300, 1), epoch_mjd=MJD)
    spread = {
        "period_err_days": np.ptp(drawn.period_days),
        "eccentricity_err": np.ptp(drawn.eccentricity),
        "omega_err_deg": np.ptp(drawn.argument_of_pericentre_deg),
        "inclination_err_deg": np.ptp(drawn.inclination_deg),
        "radius_err_rjup": np.ptp(drawn.radius_rjup),
    }
    assert {name for name, value in spread.items() if value > 0} == set(given) & set(spread)
    exact = {flag for flag in planets.flags(0) if FLAGS[flag].endswith("taken as exact")}
    flags = {"periastron_err_days": "time_err_unknown"} | {
        name: f"{name.partition('_err')[0]}_err_unknown" for name in spread
    }
    assert exact == {flag for name, flag in flags.items() if name not in given}
    assert "phase_unknown" not in planets.flags(0)


@pytest.mark.parametrize(
    ("given", "meets"),
    [
        ({"conjunction_jd": 2461300.5}, "conjunction"),
        ({"conjunction_jd": 2461300.5, "periastron_jd": 2461000.5}, "conjunction"),
        ({"conjunction_jd": 2461300.5, "periastron_jd": 2461000.5, "periastron_err_days": 1e-6}, "periastron"),
        ({"conjunction_jd": 2461300.5, "conjunction_err_days": 1e-6, "periastron_jd": 2461000.5}, "conjunction"),
        ({"periastron_jd": 2461000.5}, "periastron"),
    ],
)
def test_of_two_times_the_one_with_an_error_counts(table, given, meets):
    orbit = {name: value for name, value in ORBIT.items() if name != "periastron_jd"} | {"eccentricity": 0.0} | given
    planets = load_known_planets(table(orbit))
    drawn = draw_known(planets, [0], known_uniforms(planets, [0], 5, 1), epoch_mjd=MJD)
    start, before = (2461300.5, 50.0) if meets == "conjunction" else (2461000.5, 0.0)
    expected = (360.0 * (MJD + 2400000.5 - start) / 1000.0 + before) % 360.0
    assert drawn.mean_anomaly_deg[0] == pytest.approx([expected] * 5, abs=1e-3)


@pytest.mark.parametrize("lacking", ["period_days", "periastron_jd"])
def test_without_period_or_time_the_phase_is_unknown(table, lacking):
    orbit = {name: value for name, value in ORBIT.items() if name != lacking} | {"semi_major_axis_au": 1.8}
    assert "phase_unknown" in load_known_planets(table(orbit)).flags(0)


def test_an_archive_that_states_no_error_leaves_the_phase_unknown():
    for left in ("period_err_days", "periastron_err_days"):
        row = {name: value for name, value in (ORBIT | ERRORS).items() if name != left}
        assert "phase_unknown" in flags_of(row)
        assert "phase_unknown" not in flags_of(row, exact=True)
        assert "time_err_unknown" not in flags_of(row)


@pytest.mark.parametrize("source", ["snapshot", "archive_2019"])
def test_no_shipped_planet_has_become_surer(source):
    """Of 235 planets those have a phase that have a time, a period, and the errors of both."""
    planets = load_known_planets(source)
    for orbits in (planets, *planets.solutions.values()):
        for row in range(len(orbits)):
            times = [
                np.isfinite(orbits.number(f"{what}_jd")[row] + orbits.number(f"{what}_err_days")[row])
                for what in ("periastron", "conjunction")
            ]
            sure = any(times) and np.isfinite(orbits.number("period_err_days")[row])
            assert sure == ("phase_unknown" not in orbits.flags(row))
            assert {"time_err_unknown", "columns_not_used"}.isdisjoint(orbits.flags(row))


UNUSED = {"omega_star_deg": "orbit_angle", "inclination_deg": "tilt_angle", "periastron_jd": "peri_passage"}
FEW = ["--planets", "100"]
FLAG_OF = {"orbit_angle": "omega_unknown", "tilt_angle": "inclination_unknown", "peri_passage": "phase_unknown"}


def renamed(column):
    return {UNUSED[name] if name == column else name: value for name, value in ORBIT.items()}


@pytest.mark.parametrize("column", UNUSED)
def test_the_console_of_etc_and_known_names_the_column_and_what_is_unknown(done, table, column):
    word = UNUSED[column]
    assert COLUMNS.meant_by(word)[0] is None
    source = table(renamed(column))
    etc = done("etc", f"{STAR} z", "--known-planets", source, "--band", "F520")[0]
    known = done("known", STAR, "--known-planets", source, "--band", "F520", "--years", "0.1", *FEW)[0]
    for out in (etc, known):
        told = " ".join(out.split())
        assert f"Columns of the table that were not used: {word}" in told
        assert FLAGS[FLAG_OF[word]][1:] in told
        assert "Taken as exact, because no error is given: the period" in told


def test_without_unused_columns_nothing_is_said_of_them(done, table):
    source = table(ORBIT)
    for command in ("etc", "known"):
        star = f"{STAR} z" if command == "etc" else STAR
        out, err = done(command, star, "--known-planets", source, "--band", "F520")
        assert "not used" not in out + err


@pytest.mark.parametrize("column", ["omega_star_deg"])
def test_json_and_csv_of_every_command_name_the_column(done, table, column):
    word, source = UNUSED[column], table(renamed(column))
    common = ["--known-planets", source, "--band", "F520"]
    (answer,) = json.loads(done("etc", f"{STAR} z", *common, "--json")[0])["answers"]
    assert answer["known_planet"]["columns_not_used"] == [word]
    assert {"columns_not_used", "omega_unknown"} <= set(answer["known_planet"]["flags"])
    known = json.loads(done("known", STAR, *common, "--json", "--years", "0.1", *FEW)[0])
    assert known["columns_not_used"] == [word]
    assert f"columns not used: {word}" in known["planets_table"]
    assert "columns_not_used" in known["planets"][0]["flags"]
    rank = json.loads(done("rank", *common, "--json")[0])
    assert rank["population"]["columns_not_used"] == [word]
    assert f"not used: {word}" in " ".join(done("rank", *common)[0].split())


def test_the_figure_of_known_names_the_column(done, table, tmp_path, monkeypatch):
    from cpic_planner import report

    drawn = []
    monkeypatch.setattr(
        report, "known_figure", lambda result, draw=report.known_figure: drawn.append(draw(result)) or drawn[0]
    )
    out = tmp_path / "known.svg"
    source = table(renamed("omega_star_deg"))
    done("known", STAR, "--known-planets", source, "--plot", out, "--years", "0.1", "--band", "F520", *FEW)
    (figure,) = drawn
    assert "columns of the table that were not used: orbit_angle" in figure.get_suptitle()
    assert "omega unknown" in figure.axes[0].get_legend().get_texts()[-1].get_text()
