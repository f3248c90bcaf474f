import inspect
import json
import re
import shlex
from pathlib import Path

import pytest

from cpic_planner.cli.main import main
from cpic_planner.results import Explanation, RankComparison, RankResult, SensitivityResult
from simulator.config import preset_names

COMMAND = "rank"


@pytest.fixture(scope="module")
def few(tmp_path_factory):
    """A catalogue of four stars: rankings of it in one band are quick."""
    path = tmp_path_factory.mktemp("stars") / "few.csv"
    path.write_text(
        "name,distance_pc,v_mag,sp_type\nnear star,2,3,G2V\nmiddle star,4,3.5,G8V\n"
        "faint star,5,6,K5V\nfar star,20,5,G2V\n"
    )
    return ["--catalog", str(path), "--band", "F520"]


def ranking(done, few, *options, planets=800):
    out, _ = done(*few, "--planets", planets, *options, "--json")
    return RankResult.model_validate_json(out)


SCORES = {
    "completeness_per_hour": lambda row: row.completeness_per_hour,
    "completeness": lambda row: row.completeness,
    "detection_margin": lambda row: row.detection_margin,
    "detection_time": lambda row: 3600.0 / row.detection_time_s if row.detection_time_s else 0.0,
    "photometric_snr": lambda row: row.snr,
    "contrast_limit": lambda row: row.score,
}


@pytest.mark.parametrize("score", SCORES)
def test_scores(done, few, score):
    result = ranking(done, few, "--score", score)
    assert result.score_name == score
    values = [row.score for row in result.targets]
    assert values == sorted(values, reverse=True)
    assert values == pytest.approx([SCORES[score](row) for row in result.targets])


def test_populations_planets_and_seeds(done, few, tmp_path):
    default = ranking(done, few)
    assert (default.population.name, default.population.n_planets, default.population.seed) == ("giants", 800, 1)
    other = ranking(done, few, "--seed", "2")
    assert other.population.seed == 2
    assert [row.completeness for row in other.targets] != [row.completeness for row in default.targets]
    for name in preset_names("population", package="cpic_planner"):
        assert ranking(done, few, "--population", name).population.name == name
    own = tmp_path / "near.yaml"
    own.write_text("semi_major_axis_au: {law: fixed, value: 2.0}\n")
    assert ranking(done, few, "--population", str(own)).population.name == "near"


def test_strategies_reach_the_ranking(done, few):
    plain = {row.name: row.significance for row in ranking(done, few, "--band", "F662").targets}
    ideal = ranking(done, few, "--band", "F662", "--library", "idealised")
    assert ideal.reference_library == "idealised"
    assert all(row.significance > plain[row.name] for row in ideal.targets)
    dusty = ranking(done, few, "--band", "F662", "--exozodi", "100")
    assert all(row.significance < plain[row.name] for row in dusty.targets)
    counted = ranking(done, few, "--band", "F662", "--mode", "photon_counting")
    assert {row.name: row.significance for row in counted.targets} != plain


def test_explanation_of_a_star(done, few):
    out, _ = done(*few, "--planets", "200", "--explain", "near star", "--json")
    told = Explanation.model_validate_json(out)
    assert told.star.name == "near star"
    assert told.n_ranked == 4
    assert told.better.rank == told.star.rank - 1
    out, _ = done(*few, "--planets", "200", "--explain", "Near Star", "--sensitivity")
    assert "Rank under other assumptions" in out


def test_filters_choose_rows_and_keep_the_rank_among_all(done, few, tmp_path):
    listed = tmp_path / "listed.txt"
    listed.write_text("name\n# two of them\nFar Star\n\nnear star  # the first\n")
    whole = {row.name: row for row in ranking(done, few).targets}
    found = ranking(done, few, "--stars", str(listed), "--out", str(tmp_path / "two.csv"))
    assert [row.name for row in found.targets] == ["near star", "far star"]
    assert [row.rank for row in found.targets] == [1, 2]
    for row in found.targets:
        assert row.model_copy(update={"rank": row.rank_in_catalogue}) == whole[row.name]
    assert "of these only those that are named" in found.sample
    assert "rank_in_catalogue" in (tmp_path / "two.csv").read_text().splitlines()[0]
    assert len(ranking(done, few, "--sp-type", "k", "--sp-type", "G2").targets) == 3
    out, _ = done(*few, "--planets", "200", "--sp-type", "G", "--sensitivity", "--json")
    assert SensitivityResult.model_validate_json(out).n_ranked == 3


def test_comparison_with_a_file_and_with_an_instrument(done, few, tmp_path):
    for name in ("old.csv", "old.ecsv"):
        done(*few, "--planets", "200", "--out", str(tmp_path / name))
    (tmp_path / "old.json").write_text(done(*few, "--planets", "200", "--json")[0])
    for ending in ("csv", "ecsv", "json"):
        out, _ = done(*few, "--planets", "200", "--compare", str(tmp_path / f"old.{ending}"))
        assert f"What moves from old.{ending} (before) to cpic_default (after): 4 stars" in out
        assert out.count("unchanged") == 4
        assert ("does not say how its ranking was made" in out) == (ending == "csv")
    file = tmp_path / "shaky.yaml"
    file.write_text("drift: {visit_nm: 0.5, walk_nm_per_sqrt_hour: 0.5}\n")
    out, _ = done(*few, "--planets", "200", "--compare", str(file), "--json")
    told = RankComparison.model_validate_json(out)
    assert {item.key for item in told.settings} >= {"instrument.drift.visit_nm"}
    nominal = {row.name: row for row in ranking(done, few, planets=200).targets}
    assert {move.name: move.after.score for move in told.targets} == {name: row.score for name, row in nominal.items()}
    assert all(move.score_ratio is None or move.score_ratio > 1 for move in told.targets)


@pytest.mark.parametrize(("limit", "drawn"), [("2", 2), ("4", 3)])
def test_a_figure_shows_as_many_stars_as_the_table_or_says_why_not(done, few, tmp_path, monkeypatch, limit, drawn):
    from cpic_planner.report import answers, ranking_figures

    figures = []
    monkeypatch.setattr(ranking_figures, "MOST_STARS", 3)
    monkeypatch.setattr(answers, "write_figure", lambda figure, path: figures.append(figure))
    path = tmp_path / "first.png"
    out, err = done(*few, "--planets", "100", "--plot", str(path), "--limit", limit)
    assert f"first {limit} of 4 stars" in out
    assert figures[0].get_suptitle().startswith(f"First {drawn} of 4 stars")
    assert ("with the first 3 stars only" in err) == (drawn < int(limit))


def test_figures(done, few, tmp_path):
    path = tmp_path / "bars.pdf"
    _, err = done(*few, "--planets", "100", "--plot", str(path))
    assert path.read_bytes().startswith(b"%PDF")
    assert f"wrote {path}" in err


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--score", "beauty"], ["--score", "completeness"]),
        (["--population", "unicorns"], ["unicorns", "giants"]),
        (["--planets", "2000000"], ["--planets", "1000000"]),
        (["--seed", "-1"], ["--seed"]),
        (["--explain", "near star", "--compare", "as_published"], ["--explain", "--compare"]),
        (["--explain", "near star", "--out", "x.csv"], ["--explain", "--out"]),
        (["--sensitivity", "--plot", "x.png"], ["--sensitivity", "--plot"]),
        (["--explain", "no such star"], ["no such star"]),
        (["--explain", "faint star", "--v-mag-max", "5"], ["--explain", "faint star", "cut"]),
        (["--drift-nm", "-3"], ["--drift-nm = -3", "nm"]),
        (["--exclusions", "velocities"], ["--exclusions", "rv, stability, known_giants"]),
        (["--exclusions", "none", "--exclusions", "rv"], ["--exclusions", "none alone"]),
        (["--exclusions", "rv", "--known-planets", "snapshot"], ["--exclusions", "--known-planets"]),
        (["--stars", "near star,neer star,far"], ["--stars = neer star, far", "nearest: near star", "one ranked star"]),
        (["--stars", "no_such.txt"], ["--stars", "no_such.txt", "No such file"]),
        (["--sp-type", "M"], ["--sp-type", "none of the 4 ranked stars passes"]),
        (
            ["--sp-type", "G", "--distance-max-pc", "1"],
            ["--distance-max-pc", "1.0 pc", "3 stars that --sp-type leaves"],
        ),
        (["--dec-min", "1", "--dec-max", "0"], ["--dec-min", "at most --dec-max 0"]),
        (["--known-hosts", "--known-planets", "snapshot"], ["--known-hosts", "--known-planets"]),
        (["--stars", "near star", "--explain", "near star"], ["--explain", "without --stars"]),
        (["--compare", "as_publishd"], ["--compare = as_publishd", "earlier ranking", "as_published"]),
        (["--compare", "gone.csv"], ["--compare = gone.csv", "No such file"]),
        (["--compare", "as_published", "--sensitivity"], ["--sensitivity", "--compare"]),
        (["--compare", "as_published", "--out", "x.csv"], ["--compare", "--out"]),
    ],
)
def test_contradictions_and_bad_input_are_one_line(refuses, few, options, words):
    refuses([*few, *options], words)


@pytest.mark.long
def test_examples_of_the_help_are_accepted(capsys, few, tmp_path, monkeypatch):
    from cpic_planner.cli.star_commands import rank

    monkeypatch.chdir(tmp_path)
    (tmp_path / "my_stars.csv").write_bytes(Path(few[1]).read_bytes())
    examples = [line.split(" | ")[0] for line in re.findall(r"^  cpic (.*)$", inspect.getdoc(rank), re.M)]
    assert len(examples) >= 7
    for example in examples:
        words = shlex.split(example)
        # The whole catalogue takes seconds each time, and the few stars have no known planets.
        own = {"--catalog", "--known-planets"} & set(words)
        quick = ["--v-mag-max", "3.5"] if own == {"--known-planets"} else [] if own else few
        for option in ("--explain", "--stars"):
            if option in words:
                words[words.index(option) + 1] = "near star"
        if "--instruments" in words:
            words[words.index("--instruments") + 1] = "10"
        if "--planets" in words:
            words[words.index("--planets") : words.index("--planets") + 2] = []
        assert main([*words, *quick, "--planets", "100"]) == 0, example
    capsys.readouterr()
    assert (tmp_path / "ranking.csv").exists()
    assert (tmp_path / "ranking.png").exists()


def test_the_table_holds_the_columns_of_completeness(call, few, tmp_path):
    path = tmp_path / "r.csv"
    assert call(*few, "--planets", "100", "--out", str(path))[0] == 0
    head = path.read_text().splitlines()[0].split(",")
    for name in ("score", "completeness", "completeness_per_hour", "expected_planets", "detection_time_s"):
        assert name in head
    for name in ("completeness_unconditional", "expected_planets_unconditional", "rv_amplitude_m_s"):
        assert name in head


@pytest.mark.parametrize(
    ("options", "exclusions"),
    [([], ["rv", "stability", "known_giants"]), (["none"], []), (["known_giants", "rv"], ["rv", "known_giants"])],
)
def test_exclusions_are_those_named(call, few, options, exclusions):
    asked = [word for name in options for word in ("--exclusions", name)]
    tree = json.loads(call(*few, "--planets", "100", "--json", *asked)[1])
    assert tree["population"]["exclusions"] == exclusions
