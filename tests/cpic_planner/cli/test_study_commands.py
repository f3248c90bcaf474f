import json
import textwrap
from shlex import split

import pytest

from cpic_planner.results import WhatIfResult
from cpic_planner.survey import load_strategies

SMALL = """kind: strategies
name: small
universe: {duration_days: 365, slot_days: 60, universes: 20}
defaults:
  time_budget_h: 150
  targets: {names: [eps Eri]}
  visit: {bands: [F520], time_s: 36000}
strategies:
  - name: once
  - name: twice
    revisits: {max_visits: 2}
"""


@pytest.fixture
def mine(tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text(SMALL)
    return str(path)


@pytest.fixture
def no_figures(monkeypatch):
    """The report without its figures, which take longer than a small survey; nobody looks at them."""
    monkeypatch.setattr("cpic_planner.report.whatif_figures.whatif_figures", lambda result: {})


COMMAND = "whatif"


def test_a_comparison_in_words_and_files(call, done, mine, tmp_path):
    out_dir = tmp_path / "out"
    out, err = done(mine, "--out", str(out_dir), "--images", "0", "--workers", "1")
    for words in ("once", "twice", "report.html"):
        assert words in out
    assert {path.name for path in out_dir.iterdir()} >= set(
        """
        whatif.json run.json report.html targets.csv universes.parquet detections.parquet stars.parquet
        orbits.parquet visits.csv visits.ecsv visits.json
    """.split()
    )
    result = WhatIfResult.model_validate_json((out_dir / "whatif.json").read_text())
    assert [item.name for item in result.strategies] == ["once", "twice"]
    run = json.loads((out_dir / "run.json").read_text())
    assert (run["computed_parts"], run["resumed_parts"]) == (2, 0)
    # The same again is there already.
    out, err = done(mine, "--out", str(out_dir), "--images", "0", "--workers", "1", "--json")
    assert WhatIfResult.model_validate_json(out) == result
    assert "reused 2 finished pieces" in err
    status, _, err = call(mine, "--out", str(out_dir), "--images", "0", "--universes", "21", "--workers", "1")
    assert status == 2
    assert "--force" in err


def test_options_reach_the_answer(done, mine, tmp_path, no_figures):
    arguments = (
        *split(
            "--strategy twice --vary max_visits=1,2 --universes 12 --seed 9 --start 2030-01-01 --days 40 "
            "--images 0 --workers 1"
        ),
    )
    out, _ = done(mine, *arguments, "--out", str(tmp_path / "o"), "--json")
    result = WhatIfResult.model_validate_json(out)
    assert [item.name for item in result.strategies] == ["twice max_visits=1", "twice max_visits=2"]
    assert result.n_universes == 12
    assert result.universe["seed"] == 9
    assert result.universe["start_utc"].startswith("2030-01-01")
    assert (result.universe["duration_days"], result.universe["slot_days"]) == (40, 40)
    assert all(text.startswith("2030") for text in result.slot_utc)


def test_known_planets_are_those_of_the_option(done, tmp_path, no_figures):
    """A planet of one's own is found; the option stands instead of what the strategies name."""
    table = tmp_path / "planets.csv"
    table.write_text("star,planet,a,e,mass,inclination,radius,star_mass\neps Eri,eps Eri q,1.5,0,1,10,1.3,0.83\n")
    path = tmp_path / "mine.yaml"
    path.write_text(SMALL.replace("universes: 20", "universes: 20, known_planets: nothing.csv"))
    made = {}
    for source in ("off", f"none+{table}", str(table)):
        out, err = done(
            str(path),
            "--known-planets",
            source,
            *split("--strategy once --images 0 --workers 1 --out"),
            str(tmp_path / "o"),
            "--force",
            "--json",
        )
        made[source] = WhatIfResult.model_validate_json(out)
        assert ("planets.csv: 0 of the 235 planets below are changed; 1 is new" in err) == (source == str(table))
    used = {source: result.known_planets for source, result in made.items()}
    assert used["off"] == ""
    assert used[f"none+{table}"].startswith("user's table of 1 planet (planets.csv ")
    assert "over NASA Exoplanet Archive" in used[str(table)]
    assert "updated" in used[str(table)]
    hosts = {source: result.strategies[0].targets[0].known_planets for source, result in made.items()}
    assert list(hosts.values()) == [[], ["eps Eri q"], ["eps Eri b", "eps Eri q"]]
    found = {source: result.strategies[0].known_planets.mean for source, result in made.items()}
    assert found["off"] == 0.0
    assert found[f"none+{table}"] > 0.1


def test_what_excludes_planets_and_which_fact_moved_which_number(done, mine, tmp_path, no_figures):
    plain = (mine, *split("--strategy once --images 0 --workers 1"))
    out, _ = done(*plain, "--facts", "--out", str(tmp_path / "all"))
    assert "Planets found without each fact, planned anew" in out
    made = json.loads((tmp_path / "all/whatif.json").read_text())
    assert made["universe"]["exclusions"] == ["rv", "stability", "known_giants"]
    facts = made["facts"]
    assert [item["name"] for item in facts["facts"]][-1] == "all"
    assert facts["statement"] in " ".join(out.split())
    assert "Which fact moved which number" in (tmp_path / "all/report.html").read_text()
    velocities = split("--exclusions rv --exclusions known_giants --no-facts --json --out")
    out, _ = done(*plain, *velocities, str(tmp_path / "some"))
    result = WhatIfResult.model_validate_json(out)
    assert result.universe["exclusions"] == ["rv", "known_giants"]
    assert result.facts is None
    out, _ = done(*plain, *split("--exclusions none --no-facts --json --out"), str(tmp_path / "none"))
    (found,) = WhatIfResult.model_validate_json(out).strategies
    assert found.new_planets == found.new_planets_unconditional


def test_what_is_varied_is_told_before_it_runs(done, mine):
    out, err = done(mine, "--vary", "drift=0.1nm,x3", "--dry-run")
    assert err.splitlines() == [
        "cpic: varied: drift 0.1 nm: 0.1 nm visit offset, 0.1 nm/sqrt(h) walk, x2 of the instrument's",
        "cpic: varied: drift x3: 0.15 nm visit offset, 0.15 nm/sqrt(h) walk, x3 of the instrument's",
    ]
    assert out.startswith("4 strategies")


def test_what_it_would_cost(done, mine, tmp_path):
    out, _ = done(mine, "--dry-run", "--out", str(tmp_path / "none"))
    assert "2 strategies, 20 universes" in out
    assert not (tmp_path / "none").exists()
    out, _ = done(mine, "--dry-run", "--json", "--universes", "500")
    assert json.loads(out)["n_universes"] == 500


FAULTS = {
    "--strategy = thrice": ["--strategy", "thrice"],
    "--vary": ["--vary", "foo=1"],
    "each value once": ["--vary", "max_visits=1,1"],
    "drift=x0.1 is 0.1 times the instrument's 0.05 nm: 0.005 nm; drift=0.1nm is 0.1 nm": ["--vary", "drift=0.1"],
    "slot_share or share_of_time": ["--vary", "share=0.05"],
    "--share-of-time = 5": ["--share-of-time", "5"],
    "--start = soon": ["--start", "soon"],
    "--days = -3": ["--days", "-3"],
    "nowhere.csv": ["--observed", "nowhere.csv"],
    "--catalog = nowhere.csv": ["--catalog", "nowhere.csv"],
    "--known-planets = nothing.csv": ["--known-planets", "nothing.csv"],
    "--instrument = nowhere.yaml": ["--instrument", "nowhere.yaml"],
    "--universes": ["--universes", "1"],
    "--exclusions = luck": ["--exclusions", "luck"],
    "--workers": ["--workers", "0"],
    "--images": ["--images", "-1"],
}


@pytest.mark.parametrize("words", FAULTS)
def test_bad_input_is_one_clear_line(call, mine, tmp_path, words):
    out_dir = tmp_path / "none"
    status, out, err = call(
        mine, *FAULTS[words], "--out", str(out_dir), "--images" if words != "--images" else "--seed", "0"
    )
    assert status == 2
    assert out == ""
    assert words in err
    assert "Traceback" not in err
    assert not (out_dir / "whatif.json").exists()


def test_a_preset_or_file_that_does_not_exist(call):
    for source in ("nothing", "nothing.yaml"):
        status, _, err = call(source)
        assert status == 2
        assert "survey_default" in err


def test_the_file_of_the_help_is_a_file(done, tmp_path):
    out, _ = done("--help")
    path = tmp_path / "help.yaml"
    path.write_text(textwrap.dedent(out[out.index("    kind: strategies") : out.index("  --set changes")]))
    config = load_strategies(path)
    assert [item.name for item in config.strategies] == ["one_hour", "ten_hours"]
    assert config.universe.universes == 500
