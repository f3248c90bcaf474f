"""Known planets: the shipped table against itself and Kepler's third law; a user's own, read or refused."""

import pickle
import re

import numpy as np
import pytest

from catalogs import load_known_planets, load_stars, star_key
from catalogs.known_planet_columns import COLUMNS, FLAGS, GIVEN_FLAGS, INPUT_ONLY, STATUSES
from catalogs.known_planets import planets_updated

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


GOOD = "star,planet,period_days,period_err_days,msini_mjup\nmine,mine b,1000,2,1.5\n"


def test_every_planet_is_of_a_catalogue_star_and_in_its_order(shipped):
    names = load_stars().column("name").tolist()
    places = [names.index(star) for star in shipped.text("star")]
    assert places == sorted(places)
    assert (len(shipped), len(set(places))) == (176, 112)
    assert len(set(shipped.text("planet"))) == 176
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
        assert np.isfinite(shipped.number("mass_mjup")[row]) == ("minimum_mass" not in flags)


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
    row = shipped.row_of("55 Cnc d")
    assert {"edge_on_assumed", "inclination_unknown", "minimum_mass"} <= set(shipped.flags(row))
    assert shipped.number("msini_mjup")[row] == pytest.approx(3.878)
    tilt, error = shipped.number("inclination_deg"), shipped.number("inclination_err_deg")
    assert not ((tilt == 90.0) & ~np.isfinite(error)).any()


def test_an_orbit_is_one_publication_s(shipped):
    """14 Her b has no time in the table of 2019: its orbit is the earlier one, its mass the later."""
    row = shipped.row_of("14 Her b")
    assert "earlier_orbit" in shipped.flags(row)
    assert "Wittenmyer et al. 2007" in shipped.text("reference")[row]
    assert shipped.number("periastron_jd")[row] == 2451372.7
    assert shipped.number("omega_star_deg")[row] == 22.6
    assert shipped.number("msini_mjup")[row] == 4.66


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
    assert len(table) == len(below) == 176
    assert [k for k in range(176) if cells_of(table, k) != cells_of(below, k)] == [row]
    # The name is that of the table below, so that draws have the same numbers.
    assert (table.text("star")[row], table.text("planet")[row]) == ("eps Eri", "eps Eri b")
    assert table.number("semi_major_axis_au")[row] == 1.5
    assert np.isnan(table.number("period_days")[row])  # of one publication, not mixed
    assert table.text("reference")[row] == ""
    assert "1 of the 176 planets below is changed: eps Eri b; 0 are new" in table.notes[0]
    assert below.provenance in table.provenance


def test_a_file_alone_is_laid_over_the_snapshot(tmp_path):
    path = written(tmp_path, ONE.replace(" B", " q"))
    table = load_known_planets(path)
    assert len(table) == 177
    assert table.text("star")[-1] == "eps Eri"
    assert table.rows_of("epsilon Eridani") == (table.row_of("eps Eri b"), 176)
    assert cells_of(table, 5) == cells_of(load_known_planets(), 5)
    assert len(load_known_planets(f"none+{path}")) == 1


def test_updates_are_dated_cited_and_of_catalogue_planets(shipped):
    before = load_known_planets("archive_2019")
    assert before.text("planet") == shipped.text("planet")
    changed = [k for k in range(176) if cells_of(before, k) != cells_of(shipped, k)]
    assert changed == [k for k, date in enumerate(shipped.text("updated")) if date]
    assert len(changed) == 10
    for row in changed:
        assert re.fullmatch(r"20\d\d-\d\d-\d\d", shipped.text("updated")[row])
        said = shipped.text("status_reference")[row] or shipped.text("reference")[row]
        assert re.search(r"\((\d{4}[A-Za-z&.]+.*|arXiv:\d{4}\.\d{5}|doi:10\..*)\)", said), said
    assert planets_updated() == max(shipped.text("updated"))


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
