"""Filters choose rows of the ranking of the whole sample, and change none of its numbers."""

import math

import pytest

import cpic_planner as cp
from catalogs import load_known_planets, star_key
from cpic_planner.queries import PlanQuestion, RankQuestion

SAMPLE = {"v_mag_max": 3.74, "bands": ["F520"], "n_planets": 100}


@pytest.fixture(scope="module")
def whole():
    """The ranking without filters."""
    return cp.rank_targets(**SAMPLE)


def hosts(*statuses):
    """Keys of stars with planets of some statuses, read from the columns of the table."""
    table = load_known_planets()
    rows = zip(table.text("star"), table.text("status"), strict=True)
    return {star_key(star) for star, status in rows if status in statuses}


COUNTED = hosts("confirmed", "controversial")
LISTED = COUNTED | hosts("candidate")
FILTERS = [
    ({"stars": "tau Cet"}, lambda row: row.name == "tau Cet"),
    ({"stars": ["HD 22049", "HIP 8102, alpha Cen B"]}, lambda row: row.name in ("eps Eri", "tau Cet", "alf Cen B")),
    ({"sp_type": "K"}, lambda row: row.sp_type[0] == "K"),
    ({"sp_type": "g8,k2"}, lambda row: row.sp_type[:2] in ("G8", "K2")),
    ({"sp_type": ["G0V"]}, lambda row: row.sp_type[:3] == "G0V"),
    ({"distance_max_pc": 8.0}, lambda row: row.distance_pc <= 8.0),
    ({"dec_min_deg": 0}, lambda row: row.dec_deg >= 0),
    ({"dec_min_deg": -30, "dec_max_deg": 0.0}, lambda row: -30 <= row.dec_deg <= 0),
    ({"known_hosts": True}, lambda row: star_key(row.name) in COUNTED),
    ({"known_hosts": True, "candidates": True}, lambda row: star_key(row.name) in LISTED),
    ({"sp_type": "G,K", "distance_max_pc": 8.0, "dec_max_deg": 30}, None),
]


@pytest.mark.parametrize(("filters", "passes"), FILTERS, ids=[" ".join(item[0]) for item in FILTERS])
def test_rows_are_those_of_the_whole_ranking_that_pass(whole, filters, passes):
    """Every number is that of the unfiltered ranking; the ranks are places among all and among the chosen."""
    if passes is None:

        def passes(row):
            return row.sp_type[0] in "GK" and row.distance_pc <= 8.0 and row.dec_deg <= 30

    expected = [row for row in whole.targets if passes(row)]
    assert 0 < len(expected) < len(whole.targets)
    found = cp.rank_targets(**SAMPLE, **filters)
    assert found.targets == [row.model_copy(update={"rank": i}) for i, row in enumerate(expected, start=1)]
    assert [row.rank_in_catalogue for row in found.targets] == [row.rank for row in expected]
    assert (found.n_in_catalogue, found.filtered) == (len(whole.targets), True)
    assert sum(found.counts.values()) == sum(found.counts_limited_by.values()) == len(expected)
    assert found.counts.get("ok", 0) == sum(row.status == "ok" for row in expected)
    assert found.config_hash != whole.config_hash


def test_a_ranking_without_filters_has_one_rank_twice(whole):
    assert [row.rank_in_catalogue for row in whole.targets] == [row.rank for row in whole.targets]
    assert not whole.filtered
    every = cp.rank_targets(**SAMPLE, distance_max_pc=1e3)
    assert (every.targets, every.config_hash) == (whole.targets, whole.config_hash)


def test_the_stars_that_are_left_decide_the_hash_and_not_the_words():
    one, two = (cp.rank_targets(**SAMPLE, stars=name) for name in ("tau Cet", "HD 10700"))
    assert one == two
    assert RankQuestion.of({"stars": "tau Cet"}).content_hash == RankQuestion.of({}).content_hash


def test_names_are_read_from_files_as_people_write_them(tmp_path):
    path = tmp_path / "mine.txt"
    path.write_text(
        "\ufeff# the nearest\n\ntau Cet   # quiet\n  HD   22049 \nalpha Cen A, alpha Cen B\n", encoding="utf-8"
    )
    names = ("tau Cet", "HD 22049", "alpha Cen A", "alpha Cen B")
    assert RankQuestion.of({"stars": path}).stars == names
    assert RankQuestion.of({"stars": [str(path), "tau Cet", "eps Ind"]}).stars == (*names, "eps Ind")
    question = tmp_path / "question.yaml"
    question.write_text("kind: question\nstars: mine.txt\nsp_type: [k]\ndec_min_deg: -40\n")
    read = RankQuestion.of(RankQuestion.load(question))
    assert (read.stars, read.sp_type, read.dec_min_deg) == (names, ("K",), -40.0)
    assert read.filters == ("stars", "sp_type", "dec_min_deg")
    assert PlanQuestion.of(PlanQuestion.load(question)).stars == names


@pytest.mark.parametrize(
    ("filters", "words"),
    [
        (
            {"stars": ["tau Cte", "61 Cyg", "eps Eri", "eps Ind", "Vega"]},
            [
                "stars = tau Cte, 61 Cyg, eps Ind, Vega: ",
                "nearest: tau Cet",
                "61 Cyg: several stars, 61 Cyg A, 61 Cyg B",
                "eps Ind: in the catalogue, but not in the sample",
                "Vega: not an F, G or K star",
            ],
        ),
        ({"stars": "no/such.txt"}, ["stars = no/such.txt: ", "No such file"]),
        ({"stars": []}, ["stars = none: "]),
        ({"stars": " , "}, ["stars = "]),
        ({"sp_type": "M"}, ["sp_type = ", "M", "none of the {ranked} ranked stars passes"]),
        ({"sp_type": "Kelvin"}, ["sp_type = Kelvin: ", "a class (G)"]),
        ({"sp_type": ""}, ["sp_type = none: "]),
        ({"dec_max_deg": 0, "distance_max_pc": 1}, ["distance_max_pc = 1.0 pc: ", "none of the"]),
        ({"sp_type": "K", "distance_max_pc": 1}, ["none of the {of_class_k} stars that sp_type leaves passes"]),
        ({"dec_min_deg": 10, "dec_max_deg": -10}, ["dec_min_deg = 10.0 deg: ", "at most dec_max_deg -10"]),
        ({"dec_min_deg": 91}, ["dec_min_deg = 91 deg: ", "-90 to 90"]),
        ({"distance_max_pc": 0}, ["distance_max_pc = 0 pc: ", "above 0"]),
        ({"known_hosts": True, "known_planets": "snapshot"}, ["known_hosts = given with known_planets"]),
        ({"candidates": True}, ["candidates = given: ", "known_planets or known_hosts"]),
    ],
)
def test_what_leaves_no_star_or_means_none_is_refused_in_one_line(refused, whole, filters, words):
    line = refused("", cp.rank_targets, **SAMPLE, **filters)
    counts = {"ranked": len(whole.targets), "of_class_k": sum(row.sp_type[0] == "K" for row in whole.targets)}
    assert [word for word in words if word.format(**counts) not in line] == [], line


def test_stars_without_coordinates_pass_no_declination(refused, tmp_path):
    path = tmp_path / "mine.csv"
    path.write_text("name,distance_pc,v_mag,sp_type,ra,dec\nhere,3,4,sdG2V,10,20\nnowhere,4,4,(G8) V,,\n")
    mine = {"catalog": path, "bands": ["F520"], "n_planets": 20}
    assert [row.name for row in cp.rank_targets(**mine, dec_min_deg=-90).targets] == ["here"]
    assert [row.name for row in cp.rank_targets(**mine, sp_type="G8").targets] == ["nowhere"]
    refused("dec_max_deg", cp.rank_targets, **mine, dec_max_deg=0)


def test_known_hosts_are_ranked_by_their_planets_among_all_hosts():
    """With known planets the sample is their stars; the filter chooses of these."""
    asked = {"v_mag_max": 4.5, "bands": ["F520"], "n_planets": 30, "known_planets": "snapshot"}
    every = cp.rank_targets(**asked)
    one = cp.rank_targets(**asked, stars="eps Eri")
    row = next(row for row in every.targets if row.name == "eps Eri")
    assert one.targets == [row.model_copy(update={"rank": 1})]
    assert one.n_in_catalogue == len(every.targets)
    assert math.isfinite(row.score)
