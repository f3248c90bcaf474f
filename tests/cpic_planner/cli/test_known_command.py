"""``cpic known`` and ``cpic rank --known-planets``."""

import inspect
import json
import re
import shlex

import pytest

from cpic_planner.cli import star_commands
from cpic_planner.cli.main import main
from cpic_planner.results import KnownResult, RankResult
from simulator import load_scene

FEW = ["--planets", "200"]
ROUGH = ["--planets", "20"]  # of many stars, where the numbers do not matter
MINE = "star,planet,a,e,mass,inclination,radius,star_mass\neps Eri,eps Eri q,1.5,0,1,30,1.1,0.83\n"


def known(done, *arguments, draws=FEW):
    out, _ = done("known", *arguments, *draws, "--json")
    return KnownResult.model_validate_json(out)


def test_one_star(done):
    result = known(done, "HIP 16537", "--date", "2030-03-01", "--years", "1", "--band", "F520")
    assert [row.planet for row in result.planets] == ["eps Eri b"]
    assert (result.date_utc, result.mjd, result.years) == ("2030-03-01T00:00:00", 62561.0, 1.0)
    assert result.planets[0].windows
    heads, _ = done("known", "eps Eri", "--years", "1", "--format", "csv", *FEW)
    assert "separation_arcsec_low,separation_arcsec,separation_arcsec_high" in heads.splitlines()[0]


def test_eps_eri_is_within_an_arcsecond_and_a_little_in_2028(done):
    (row,) = known(done, "eps Eri", "--date", "2028-07-01").planets
    assert 0.9 < row.separation_arcsec.median <= 1.12


def test_refuted_planets_are_shown_with_who_says_so(call, tmp_path):
    status, out, _ = call("known", "omi2 Eri", "-v", *FEW)
    told = " ".join(out.split())
    assert status == 0
    assert "refuted, not counted. Status from Burrows et al. 2024 (arXiv:2404.17494)" in told
    for option, file in (("--plot", "x.png"), ("--scene", "x.yaml")):
        status, _, err = call("known", "omi2 Eri", option, str(tmp_path / file), *FEW)
        assert status == 2
        assert "confirmed or controversial" in err


def test_candidates_count_when_asked_for(done):
    (row,) = known(done, "alpha Cen A").planets
    assert (row.status, row.counted, row.track, row.windows) == ("candidate", False, None, [])
    (row,) = known(done, "alpha Cen A", "--candidates").planets
    assert row.counted
    assert row.track is not None


@pytest.mark.long
def test_orbits_that_disagree_are_told_with_their_shares(done):
    row = next(row for row in known(done, "HD 219134").planets if row.planet == "HD 219134 h")
    assert [orbit.share for orbit in row.orbits] == [0.5, 0.5]
    assert [orbit.eccentricity for orbit in row.orbits] == [0.025, 0.34]
    assert "several_orbits" in row.flags
    told = " ".join(done("known", "HD 219134", "-v", *FEW)[0].split())
    assert "2 published orbits disagree: 50% of the draws from Rosenthal et al. 2021" in told


def test_a_contradicted_orbit_is_flagged(done):
    (row,) = known(done, "eps Eri", "--known-planets", "archive_2019").planets
    assert "orbit_superseded" in row.flags
    assert row.superseded_by.startswith("Thompson et al. 2025")
    (row,) = known(done, "eps Eri").planets
    assert (row.superseded_by, "orbit_superseded" in row.flags) == ("", False)


@pytest.mark.long
def test_a_wider_cut_keeps_the_planets_of_a_narrower_one(done):
    result = known(done, "--v-mag-max", "7.5", draws=ROUGH)
    assert result.date_utc == "2028-01-01T00:00:00"
    assert sum(row.v_mag <= 7.0 for row in result.planets) == 182 < len(result.planets)


def test_files_that_are_asked_for(done, tmp_path):
    plot, scene = tmp_path / "track.png", tmp_path / "scene.yaml"
    _, err = done("known", "eps Eri", "--plot", str(plot), "--scene", str(scene), *FEW)
    assert str(plot) in err
    assert plot.read_bytes().startswith(b"\x89PNG")
    assert load_scene(scene).planets[0].name == "eps Eri b"
    assert scene.read_text().startswith("# eps Eri with its known planets on 2028-01-01T00:00:00")


def test_a_table_of_one_s_own(call, done, tmp_path):
    path = tmp_path / "mine.csv"
    path.write_text(MINE.replace("star_mass", "star_mass,weather").replace("0.83", "0.83,fine"))
    result = known(done, "eps Eri", "--known-planets", str(path))
    assert [row.planet for row in result.planets] == ["eps Eri b", "eps Eri q"]
    assert "mine.csv" in result.planets_table
    assert "known_planets_updates.csv" in result.planets_table
    single = known(done, "eps Eri", "--known-planets", f"none+{path}")
    assert [row.planet for row in single.planets] == ["eps Eri q"]
    assert "known_planets" not in single.planets_table
    (before,) = known(done, "eps Eri", "--known-planets", "archive_2019").planets
    assert before.eccentricity.median == pytest.approx(0.70, abs=0.02)
    _, _, err = call("known", "eps Eri", "--known-planets", str(path), *FEW)
    assert "columns not used: weather" in err
    assert "mine.csv: 0 of the 235 planets below are changed; 1 is new" in err


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["Procyon"], "a star with known planets"),
        (["--plot", "x.png"], "only with a STAR"),
        (["--years", "3"], "only with a STAR"),
        (["--scene", "x.yaml"], "only with a STAR"),
        (["eps Eri", "--scene", "x.txt"], "ends in .yaml"),
        (["eps Eri", "--v-mag-max", "5"], "only without a STAR"),
        (["eps Eri", "--date", "soon"], "--date = soon UTC"),
        (["eps Eri", "--years", "0"], "years = 0"),
        (["eps Eri", "--planets", "0"], "--planets = 0"),
        (["eps Eri", "--known-planets", "nowhere.csv"], "nowhere.csv"),
    ],
)
def test_refusals_are_one_line(refuses, arguments, says):
    refuses(["known", *arguments], [says])


@pytest.mark.long
def test_examples_of_the_help_are_accepted(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "my_planets.csv").write_text(MINE)
    examples = re.findall(r"^  cpic (.*)$", inspect.getdoc(star_commands.known), re.M)
    assert len(examples) >= 6
    for example in examples:
        words = shlex.split(example)
        # All stars take seconds each time.
        few = ["--v-mag-max", "4.5"] if words[1:2] == [] or words[1].startswith("-") else []
        assert main([*words, *few, *ROUGH]) == 0, example
    capsys.readouterr()
    assert (tmp_path / "separation.png").exists()
    assert (tmp_path / "eps_eri.yaml").exists()


def test_ranking_of_stars_with_known_planets(done, tmp_path):
    path = tmp_path / "mine.csv"
    path.write_text(MINE)
    options = ["rank", "--known-planets", f"none+{path}", "--date", "2030-06-01", "--planets", "300", "--band", "F520"]
    out, _ = done(*options, "--json")
    result = RankResult.model_validate_json(out)
    assert [row.name for row in result.targets] == ["eps Eri"]
    assert 0.0 < result.targets[0].completeness < 1.0
    assert "2030-06-01" in result.population.description
    assert "those with known planets only" in result.sample


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (["--population", "giants"], "hypothetical"),
        (["--explain", "eps Eri"], "hypothetical"),
        (["--sensitivity"], "hypothetical"),
        (["--planets", "0"], "--planets = 0"),
        (["--date", "2200-01-01"], "--date"),
    ],
)
def test_rank_refuses_what_has_no_meaning_with_known_planets(call, options, says):
    status, _, err = call("rank", "--known-planets", "snapshot", *options)
    assert status == 2
    assert says in err


def test_candidates_are_ranked_when_asked_for(call, done):
    options = shlex.split("rank --known-planets snapshot --planets 50 --band F520 --v-mag-max 4.2 --json")
    names = [
        {row.name for row in RankResult.model_validate_json(done(*options, *more)[0]).targets}
        for more in ([], ["--candidates"])
    ]
    assert names[1] - names[0] == {"alf Cen A"}
    status, _, err = call("rank", "--candidates")
    assert status == 2
    assert "only with --known-planets" in err


def test_catalog_tells_of_planets(call, done):
    out, _ = done("catalog", "info", "--json")
    told = json.loads(out)["known_planets"]
    assert "176 planets of 112 stars" in told["notes"]
    assert told["updates"]["refuted"] == ["tau Cet e", "82 Eri c", "omi2 Eri b"]
    candidates = ["alf Cen A S1", "ups And e", "HD 89744 c", "HD 155555 b", "HIP 560 b"]
    assert (told["updates"]["n_rows"], told["updates"]["candidate"]) == (90, candidates)
    out, _ = done("catalog", "columns", "--json")
    names = [column["name"] for column in json.loads(out)["planet_columns"]]
    assert {"star", "planet", "omega_star_deg", "omega_planet_deg", "best_mass_mjup", "status"} <= set(names)
