"""Known planets: the shipped table against itself and Kepler's third law; a user's own, read or refused.

What the archive's best masses, limits and inclinations become.
"""

import csv
import pickle
import re
from pathlib import Path

import numpy as np
import pytest

from catalogs import load_known_planets, load_stars, star_key
from catalogs.known_planets import (
    COLUMNS,
    FLAGS,
    GIVEN_FLAGS,
    INPUT_ONLY,
    STATUSES,
    planets_updated,
    reference_text,
    settle,
)

NUMBERS = [name for name, column in COLUMNS.items() if column.kind != "text" and name not in INPUT_ONLY]


@pytest.fixture(scope="module")
def shipped():
    return load_known_planets()


def written(tmp_path, text, name="mine.csv"):
    path = tmp_path / name
    path.write_text(text, encoding="utf-8")
    return path


def alone(path):
    return f"none+{path}"


BEFORE = len(load_known_planets("archive_2019"))
NEW = 59
"""Planets that the table of 2019 does not have."""
GOOD = "star,planet,period_days,period_err_days,msini_mjup\nmine,mine b,1000,2,1.5\n"


def test_every_planet_is_of_a_catalogue_star_and_in_its_order(shipped):
    names = load_stars().column("name").tolist()
    places = [names.index(star) for star in shipped.text("star")]
    assert places[:BEFORE] == sorted(places[:BEFORE])
    assert len(set(places[:BEFORE])) == 112
    # 31 hosts that the table of 2019 lacks, and three that have candidates alone.
    assert (len(shipped), len(set(places))) == (BEFORE + NEW, 112 + 34)
    assert len(set(shipped.text("planet"))) == len(shipped)
    for star, planet in zip(shipped.text("star"), shipped.text("planet"), strict=True):
        assert planet.rpartition(" ")[0] == star


def test_values_are_in_range_and_flags_say_what_is_missing(shipped):
    for name in NUMBERS:
        values, column = shipped.number(name), COLUMNS[name]
        known = values[np.isfinite(values)]
        assert ((known >= column.low) & (known <= column.high)).all(), name
        if "_err" in name:
            assert (known > 0).all(), name
    for row in range(len(shipped)):
        flags = shipped.flags(row)
        assert set(flags) <= set(FLAGS)
        dated = [
            np.isfinite(shipped.number(f"{what}_{part}")[row])
            for what in ("periastron", "conjunction")
            for part in ("jd", "err_days")
        ]
        known = (all(dated[:2]) or all(dated[2:])) and np.isfinite(shipped.number("period_err_days")[row])
        assert known == ("phase_unknown" not in flags)
        assert np.isfinite(shipped.number("inclination_deg")[row]) == ("inclination_unknown" not in flags)
        assert np.isfinite(shipped.number("mass_mjup")[row]) == {"minimum_mass", "mass_unknown"}.isdisjoint(flags)


def test_periods_and_axes_obey_keplers_third_law(shipped):
    """Independent values of the archive: a wrong column or unit would not."""
    period, axis, mass = (shipped.number(name) for name in ("period_days", "semi_major_axis_au", "star_mass_msun"))
    ratio = np.cbrt(mass * (period / 365.2569) ** 2) / axis
    known = ratio[np.isfinite(ratio)]
    assert len(known) > 160
    assert np.median(known) == pytest.approx(1.0, abs=0.01)
    assert (np.abs(known - 1.0) < 0.2).all()
    assert (np.abs(known - 1.0) < 0.05).mean() > 0.85


def test_a_planet_by_any_name_of_its_star(refused, shipped):
    row = shipped.row_of("eps Eri b")
    for name in ("epsilon Eridani b", "HD 22049 b", "HIP 16537 b"):
        assert shipped.row_of(name) == row
    before = load_known_planets("archive_2019")
    assert before.number("omega_star_deg")[before.row_of("HIP 16537 b")] == 47.0  # of the star: Benedict et al. 2006
    assert "2006AJ....132.2206B" in before.text("reference")[row]
    assert shipped.text("star")[shipped.row_of("16 Cyg B b")] == "16 Cyg B"
    assert shipped.rows_of("16 Cyg A") == ()
    for name in ("eps Eri z", "tau Ceti", "b", ""):
        refused("planet", shipped.row_of, name)


def test_assumed_inclinations_are_not_measurements(shipped):
    before = load_known_planets("archive_2019")
    row = before.row_of("55 Cnc d")
    assert {"edge_on_assumed", "inclination_unknown", "minimum_mass"} <= set(before.flags(row))
    assert before.number("msini_mjup")[row] == pytest.approx(3.878)
    tilt, error = shipped.number("inclination_deg"), shipped.number("inclination_err_deg")
    assert not ((tilt == 90.0) & ~np.isfinite(error)).any()


def test_an_orbit_is_one_publication_s():
    """14 Her b has no time in the table of 2019: its orbit is the earlier one, its mass the later."""
    before = load_known_planets("archive_2019")
    row = before.row_of("14 Her b")
    assert "earlier_orbit" in before.flags(row)
    assert "Wittenmyer et al. 2007" in before.text("reference")[row]
    assert before.number("periastron_jd")[row] == 2451372.7
    assert before.number("omega_star_deg")[row] == 22.6
    assert before.number("msini_mjup")[row] == 4.66


def test_tables_are_immutable_and_travel(refused, shipped):
    with pytest.raises(ValueError, match="read-only"):
        shipped.columns["period_days"][0] = 1.0
    there = pickle.loads(pickle.dumps(shipped))
    assert there.text("planet") == shipped.text("planet")
    few = shipped.select([3, 1])
    assert few.text("planet") == [shipped.text("planet")[i] for i in (3, 1)]
    assert len(shipped.select(shipped.number("period_days") > 1000.0)) > 30
    refused("column", shipped.number, "star")
    refused("column", shipped.text, "period_days")


def test_every_column_and_flag_is_described():
    assert all(column.description for column in COLUMNS.values())
    assert set(GIVEN_FLAGS) <= set(FLAGS)


def test_a_user_s_table(tmp_path):
    table = load_known_planets(alone(written(tmp_path, GOOD)))
    assert table.text("planet") == ["mine b"]
    assert np.isnan(table.number("eccentricity")[0])
    assert set(table.flags(0)) == set(
        """
        phase_unknown axis_unknown eccentricity_unknown omega_unknown minimum_mass inclination_unknown
        radius_unknown mass_err_unknown
    """.split()
    )
    assert table.provenance.startswith("user's table of 1 planet (mine.csv ")


def test_omega_of_the_planet_is_turned_to_the_star_s(tmp_path):
    text = "star,planet,P,omega_planet_deg,omega_err_deg,msini\nmine,mine b,1000,250,5,1\n"
    table = load_known_planets(alone(written(tmp_path, text)))
    assert table.number("omega_star_deg")[0] == pytest.approx(70.0)
    assert "omega_planet_deg" not in table.columns


def test_capital_omega_is_the_node(tmp_path):
    text = "star,planet,period,omega,Omega,msini\nmine,mine b,1000,30,120,1\n"
    planets = load_known_planets(alone(written(tmp_path, text)))
    assert (planets.number("omega_star_deg")[0], planets.number("node_deg")[0]) == (30.0, 120.0)
    planets = load_known_planets(alone(written(tmp_path, text.replace("omega,Omega", "note,Omega"))))
    assert np.isnan(planets.number("omega_star_deg")[0])
    assert planets.number("node_deg")[0] == 120.0
    assert "omega_unknown" in planets.flags(0)


@pytest.mark.parametrize(("inclination", "known"), [("", False), ("60", False), ("90", True), ("88", True)])
def test_a_mass_that_repeats_m_sin_i_is_no_true_mass(tmp_path, inclination, known):
    text = f"star,planet,period,mass,mass_err,msini,inc\nmine,mine b,1000,0.9,0.1,0.9,{inclination}\n"
    planets = load_known_planets(alone(written(tmp_path, text)))
    assert np.isfinite(planets.number("mass_mjup")[0]) == known
    assert planets.number("msini_mjup")[0] == 0.9
    assert ("minimum_mass" in planets.flags(0)) != known


def test_units_and_headings_of_the_archive(tmp_path):
    """Headings, limits, kinds of masses and links of the NASA Exoplanet Archive; its 0 is no error."""
    text = (
        "# a comment\nhostname,pl_name,pl_orbper,pl_orbpererr1,pl_orbeccen,pl_orbeccenerr1,pl_orbeccenlim,pl_bmassj,"
        "pl_bmassprov,pl_orbincl,pl_refname,pl_controv_flag,sy_dist\n"
        "a,a b,100,0,0.3,,1,2,Msini,,<a refstr=X href=https://x/abs/2020A&amp;A...1..2B/abstract>Us 2020</a>,0,5\n"
        "a,a c,300,1,0.1,0.02,0,1,Mass,90,here,1,5\n"
        "a,a d,500,1,0.1,0.02,0,1,Msin(i)/sin(i),40,here,0,5\n"
    )
    table = load_known_planets(alone(written(tmp_path, text)))
    assert {"eccentricity_upper_limit", "period_err_unknown", "minimum_mass"} <= set(table.flags(0))
    assert {"edge_on_assumed", "minimum_mass"} <= set(table.flags(1))
    assert table.text("status") == ["confirmed", "controversial", "confirmed"]
    assert table.number("msini_mjup")[1] == 1.0
    assert (table.number("mass_mjup")[2], table.number("inclination_deg")[2]) == (1.0, 40.0)
    assert table.text("reference")[0] == "Us 2020 (2020A&A...1..2B)"
    assert "sy_dist" in table.notes[0]
    ecsv = (
        "# %ECSV 1.0\n# ---\n# datatype:\n# - {name: star, datatype: string}\n# - {name: planet, datatype: string}\n"
        "# - {name: period, unit: yr, datatype: float64}\n# - {name: msini, unit: earthMass, datatype: float64}\n"
        "star planet period msini\nmine b 2.0 317.828\n"
    )
    table = load_known_planets(alone(written(tmp_path, ecsv.replace("mine b 2.0", '"mine" "mine b" 2.0'), "mine.ecsv")))
    assert table.number("period_days")[0] == pytest.approx(730.5)
    assert table.number("msini_mjup")[0] == pytest.approx(1.0, rel=1e-4)


def test_star_keys_keep_components_apart():
    assert star_key("16 Cyg A") != star_key("16 Cyg B")
    assert star_key("my own star") == "my own star"


ONE = "star,planet,a,e,mass,inclination,star_mass\nHD 22049,HD 22049 B,1.5,0,1,30,0.83\n"


def cells_of(table, row):
    return {name: str(cells[row]) for name, cells in table.columns.items()}


@pytest.mark.parametrize("base", ["snapshot", "archive_2019"])
def test_a_table_of_one_planet_keeps_the_others(tmp_path, base):
    below = load_known_planets(base)
    table = load_known_planets(f"{base}+{written(tmp_path, ONE)}")
    row = below.row_of("eps Eri b")
    assert len(table) == len(below)
    assert [k for k in range(len(below)) if cells_of(table, k) != cells_of(below, k)] == [row]
    # The name is that of the table below, so that draws have the same numbers.
    assert (table.text("star")[row], table.text("planet")[row]) == ("eps Eri", "eps Eri b")
    assert table.number("semi_major_axis_au")[row] == 1.5
    assert np.isnan(table.number("period_days")[row])  # of one publication, not mixed
    assert table.text("reference")[row] == ""
    assert f"1 of the {len(below)} planets below is changed: eps Eri b; 0 are new" in table.notes[0]
    assert below.provenance in table.provenance


def test_a_file_alone_is_laid_over_the_snapshot(tmp_path):
    path = written(tmp_path, ONE.replace(" B", " q"))
    table = load_known_planets(path)
    assert len(table) == BEFORE + NEW + 1
    assert table.text("star")[-1] == "eps Eri"
    assert table.rows_of("epsilon Eridani") == (table.row_of("eps Eri b"), len(table) - 1)
    assert cells_of(table, 5) == cells_of(load_known_planets(), 5)
    assert len(load_known_planets(f"none+{path}")) == 1


def test_updates_are_dated_cited_and_of_catalogue_planets(shipped):
    before = load_known_planets("archive_2019")
    assert shipped.text("planet")[:BEFORE] == before.text("planet")
    changed = [k for k in range(len(shipped)) if k >= BEFORE or cells_of(before, k) != cells_of(shipped, k)]
    assert changed == [k for k, date in enumerate(shipped.text("updated")) if date]
    for row in changed:
        for orbit in (shipped, row), *((table, k) for table in [shipped.orbits_of(row)] for k in range(len(table))):
            table, k = orbit
            assert re.fullmatch(r"20\d\d-\d\d-\d\d", table.text("updated")[k])
            said = table.text("status_reference")[k] or table.text("reference")[k]
            published = r"\((\d{4}[A-Za-z&.]+.*|arXiv:\d{4}\.\d{5}|doi:10\..*|exoplanet\.eu; .*|github\.com/.*)\)"
            assert re.search(published, said), said
    assert planets_updated() == max(shipped.text("updated"))


def test_planets_of_another_component_are_not_the_catalogue_star_s(shipped):
    """HD 99492 and GJ 667 C stand apart from 83 Leo (HD 99491) and HD 156384, which the catalogue has."""
    assert shipped.listed_rows_of("83 Leo") == shipped.listed_rows_of("HD 156384") == ()


def test_the_status_of_planets_that_later_work_excludes_or_doubts(shipped):
    def of(status):
        return {name for name, own in zip(shipped.text("planet"), shipped.text("status"), strict=True) if own == status}

    assert of("refuted") == {"tau Cet e", "omi2 Eri b", "82 Eri c"}
    assert of("controversial") == {
        "tau Cet f",
        "tau Cet g",
        "tau Cet h",
        "82 Eri e",
        "HD 102365 b",
        "HD 114613 b",
        "rho CrB b",
        "HD 219134 f",
        "HD 40307 g",
    }
    assert of("candidate") == {"alf Cen A S1", "ups And e", "HD 89744 c", "HD 155555 b", "HIP 560 b"}
    assert set(shipped.text("status")) <= set(STATUSES)
    # The orbit that a refuted planet was said to have stays, with its reference.
    row = shipped.row_of("tau Cet e")
    assert shipped.number("period_days")[row] == 162.87
    assert "2017AJ....154..135F" in shipped.text("reference")[row]


def test_refuted_planets_and_candidates_are_listed_and_not_counted(shipped, tmp_path):
    assert len(shipped.listed_rows_of("tau Cet")) == 4
    assert shipped.row_of("tau Cet e") not in shipped.rows_of("tau Cet")
    assert len(shipped.rows_of("tau Cet")) == 3
    assert shipped.rows_of("omi2 Eri") == ()
    assert star_key("omi2 Eri") not in shipped.by_star
    assert len(load_known_planets("archive_2019").rows_of("omi2 Eri")) == 1
    text = "star,planet,P,msini,status\nmine,mine b,100,1,Candidate\nmine,mine c,200,1,\n"
    table = load_known_planets(alone(written(tmp_path, text)))
    assert table.text("status") == ["candidate", "confirmed"]
    assert table.rows_of("mine") == (1,)
    asked = load_known_planets(alone(tmp_path / "mine.csv"), candidates=True)
    assert asked.rows_of("mine") == (0, 1)
    assert "candidates counted" in asked.provenance
    assert pickle.loads(pickle.dumps(asked)).rows_of("mine") == (0, 1)
    every = load_known_planets(candidates=True)
    assert every.rows_of("alpha Cen A") == (every.row_of("alf Cen A S1"),)
    assert every.rows_of("omi2 Eri") == ()
    assert shipped.rows_of("alpha Cen A") == ()


@pytest.mark.parametrize(
    ("text", "status", "after", "axis"),
    [
        # A status alone leaves the orbit; what is said about an orbit alone leaves the status.
        ("star,planet,status,reference\ntau Cet,tau Cet e,confirmed,me\n", "confirmed", "me", 0.538),
        ("star,planet,a,e,mass\ntau Cet,tau Cet e,0.6,0,1\n", "refuted", "Figueira et al. 2025", 0.6),
        ("star,planet,a,e,mass,status\ntau Cet,tau Cet e,0.6,0,1,controversial\n", "controversial", "", 0.6),
        ("star,planet,a,e,mass,pl_controv_flag\ntau Cet,tau Cet e,0.6,0,1,1\n", "refuted", "Figueira et al. 2025", 0.6),
    ],
)
def test_a_user_s_table_may_say_the_status(tmp_path, text, status, after, axis):
    table = load_known_planets(written(tmp_path, text))
    row = table.row_of("tau Cet e")
    assert table.text("status")[row] == status
    assert table.text("status_reference")[row].startswith(after)
    assert bool(table.text("status_reference")[row]) == bool(after)
    assert table.number("semi_major_axis_au")[row] == axis
    assert table.counted[row] == (status != "refuted")


SEVERAL = """star,planet,P,e,msini,reference,solution_weight
mine,mine b,100,0.1,1,me 2020,1
mine,mine b,130,0.5,2,you 2021,3
"""


def test_several_orbits_of_a_planet_are_one_row_and_its_solutions(tmp_path):
    table = load_known_planets(alone(written(tmp_path, SEVERAL)))
    assert table.text("planet") == ["mine b"]
    assert table.number("period_days")[0] == 130.0  # of the largest weight
    assert "several_orbits" in table.flags(0)
    orbits = pickle.loads(pickle.dumps(table.select([0]))).orbits_of(0)
    assert orbits.number("period_days").tolist() == [100.0, 130.0]
    assert orbits.number("solution_weight").tolist() == [1.0, 3.0]
    assert orbits.text("reference") == ["me 2020", "you 2021"]
    single = load_known_planets(alone(written(tmp_path, GOOD)))
    assert single.orbits_of(0).text("planet") == ["mine b"]
    assert not single.solutions


def test_a_row_laid_over_a_mixture_replaces_all_of_it(tmp_path, shipped):
    assert len(shipped.orbits_of(shipped.row_of("HD 219134 h"))) == 2
    text = "star,planet,P,e,msini\nHD 219134,HD 219134 h,2100,0,0.3\n"
    table = load_known_planets(written(tmp_path, text))
    row = table.row_of("HD 219134 h")
    assert (len(table.orbits_of(row)), table.number("period_days")[row]) == (1, 2100.0)
    alone_status = "star,planet,status\nHD 219134,HD 219134 h,candidate\n"
    table = load_known_planets(written(tmp_path, alone_status))
    assert len(table.orbits_of(table.row_of("HD 219134 h"))) == 2


@pytest.mark.parametrize(
    "change", [("1,me 2020,1", "1,me 2020,"), ("you 2021", "me 2020"), ("2021,3", "2021,"), ("2020,1", "2020,-1")]
)
def test_orbits_without_weight_or_reference_of_their_own_are_refused(refused, tmp_path, change):
    refused("mine.csv", load_known_planets, alone(written(tmp_path, SEVERAL.replace(*change))), strict=True)


FACTS = Path(__file__).resolve().parents[3] / "shared" / "validation" / "facts" / "decisive_planets.csv"
SAME = {
    "eps Eri b": "eps Eri b",
    "HD 20794 c(=archive d 89.7 d)": "82 Eri d",
    "HD 20794 d (647 d)": "82 Eri d647",
    "HD 219134 h": "HD 219134 h",
    "55 Cnc d": "rho1 Cnc d",
    "ups And d": "ups And d",
    "47 UMa b": "47 UMa b",
    "47 UMa c": "47 UMa c",
    "47 UMa d": "47 UMa d",
    "HD 190360 b": "HD 190360 b",
    "HD 154345 b": "HD 154345 b",
    "HD 217107 c": "HD 217107 c",
    "HD 134987 c": "23 Lib c",
    "14 Her b": "14 Her b",
    "pi Men b": "pi Men b",
    "HD 142 c": "HD 142 c",
    "HD 222237 b": "HD 222237 b",
    "HD 140901 c": "HD 140901 c",
    "iot Dra c": "iot Dra c",
    "eps Ind A b": "eps Ind b",
}
"""Planets of the checked list of facts, and their names here."""
COMPARED = (
    ("P_d", "period_days", "period_err_days"),
    ("a_au", "semi_major_axis_au", "semi_major_axis_err_au"),
    ("e", "eccentricity", "eccentricity_err"),
)


def test_updates_agree_with_the_checked_list_of_facts(shipped):
    """Period, axis and eccentricity of one of the orbits agree within the errors of either, or half a per cent."""
    if not FACTS.is_file():
        pytest.skip("the checked list of facts is not beside this repository")
    with FACTS.open(encoding="utf-8") as stream:
        listed = {row["planet"]: row for row in csv.DictReader(stream)}
    for theirs, mine in SAME.items():
        orbits, fact = shipped.orbits_of(shipped.row_of(mine)), listed[theirs]
        near = np.ones(len(orbits), bool)
        for column, ours, own in COMPARED:
            errors = [abs(float(word)) for word in fact[f"{column.partition('_')[0]}_err"].split("/") if word]
            if fact[column] not in ("", "0"):  # the list writes 0 where it has no eccentricity
                value = float(fact[column])
                within = np.fmax(max([*errors, 0.005 * value]), orbits.number(own))
                near &= np.abs(orbits.number(ours) - value) <= within
        assert near.any(), (theirs, mine)


@pytest.mark.parametrize(
    ("link", "radius"),
    [
        ("<a refstr=CALCULATED_VALUE href=/docs/composite_calc.html target=_blank>Calculated Value</a>", np.nan),
        ("<a refstr=SMITH_ET_AL_2020 href=/abs/2020ApJ...1S target=ref>Smith et al. 2020</a>", 1.2),
    ],
)
def test_a_radius_that_the_archive_calculates_from_the_mass_is_no_measurement(tmp_path, link, radius):
    rows = f"pl_name,hostname,pl_orbper,pl_msinij,pl_radj,pl_radj_reflink\nHD 10700 x,HD 10700,100,0.1,1.2,{link}\n"
    read = load_known_planets(alone(written(tmp_path, rows)))
    np.testing.assert_equal(read.number("radius_rjup")[0], radius)


MASS = {"best_mass_mjup": 2.0, "best_mass_err_mjup": 0.1}


@pytest.mark.parametrize(
    ("numbers", "kind", "expected", "flags"),
    [
        ({}, "Mass", {"mass_mjup": 2.0, "mass_err_mjup": 0.1}, ()),
        ({}, "Msini", {"msini_mjup": 2.0, "msini_err_mjup": 0.1}, ()),
        ({}, "M-R relationship", {}, ()),
        ({"msini_mjup": 1.0}, "Mass", {"mass_mjup": 2.0, "mass_err_mjup": 0.1, "msini_mjup": 1.0}, ()),
        ({"best_mass_limit": 1.0}, "Mass", {"mass_mjup": 2.0, "mass_err_mjup": 0.1}, ("mass_upper_limit",)),
        ({"best_mass_limit": -1.0}, "Mass", {"msini_mjup": 2.0, "msini_err_mjup": 0.1}, ("mass_lower_limit",)),
        ({"inclination_deg": 90.0}, "Mass", {"msini_mjup": 2.0, "msini_err_mjup": 0.1}, ("edge_on_assumed",)),
        (
            {"inclination_deg": 90.0, "inclination_err_deg": 0.1},
            "Mass",
            {"inclination_deg": 90.0, "inclination_err_deg": 0.1, "mass_mjup": 2.0, "mass_err_mjup": 0.1},
            (),
        ),
        (
            {"eccentricity": 0.3, "eccentricity_limit": 1.0},
            "M-R relationship",
            {"eccentricity": 0.3},
            ("eccentricity_upper_limit",),
        ),
        ({"controversial": 1.0}, "M-R relationship", {}, ("controversial",)),
    ],
)
def test_settled(numbers, kind, expected, flags):
    assert settle(MASS | numbers, kind, "a row") == (expected, flags)


def test_a_table_without_best_masses_is_left_alone():
    own = {"mass_mjup": 1.0, "inclination_deg": 90.0}
    assert settle(own, "", "a row") == (own, ())


def test_an_unknown_kind_is_refused(refused):
    refused("a row column best_mass_kind = Guess", settle, dict(MASS), "Guess", "a row")


def test_links_become_words_with_their_bibcode():
    link = "<a refstr=X href=http://adsabs.harvard.edu/abs/2013A%26A...551A..90M target=ref> Marmier et al. 2013 </a>"
    assert reference_text(link) == "Marmier et al. 2013 (2013A&A...551A..90M)"
    assert reference_text("Gregory &amp; Fischer 2010") == "Gregory & Fischer 2010"
