import csv
import inspect
import re
import shlex

import pytest

from cpic_planner.cli.main import main
from cpic_planner.results import VisibilityResult

COMMAND = "visibility"


def result_of(done, *arguments):
    out, _ = done(*arguments, "--json")
    return VisibilityResult.model_validate_json(out)


def test_options_reach_the_answer(done, tmp_path):
    plain = result_of(done, "eps Eri", "--days", "40")
    assert (plain.start_utc, plain.n_days, len(plain.mjd)) == ("2028-01-01T00:00:00", 40, 40)
    later = result_of(done, "eps Eri", "--start", "2045-06-01", "--days", "20", "--step-days", "0.5")
    assert (later.start_utc, len(later.mjd)) == ("2045-06-01T00:00:00", 40)
    limits = tmp_path / "mine.yaml"
    limits.write_text("panel: fixed\nmoon_deg: 40\n")
    strict = result_of(done, "eps Eri", "--days", "40", "--visibility", str(limits))
    assert (strict.pointing.name, strict.pointing.panel, strict.pointing.moon_deg) == ("mine", "fixed", 40)
    assert strict.targets[0].observable_days < plain.targets[0].observable_days
    high = tmp_path / "high.yaml"
    high.write_text("mission: {orbit: {altitude_km: 550}}\n")
    assert result_of(done, "eps Eri", "--days", "5", "--instrument", str(high)).altitude_km == 550


def test_never_seen_is_an_answer(done, tmp_path):
    limits = tmp_path / "never.yaml"
    limits.write_text("sun_deg: 180\n")
    out, _ = done("eps Eri", "--days", "30", "--visibility", str(limits))
    assert "Never seen in this time" in out
    out, _ = done("eps Eri", "tau Cet", "--days", "30", "--visibility", str(limits))
    assert "–" in out


def test_every_step_as_csv(done, tmp_path):
    path = tmp_path / "days.csv"
    _, err = done("eps Eri", "tau Cet", "--days", "30", "--out", str(path))
    assert f"wrote 60 rows to {path}" in err
    with path.open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert len(rows) == 60
    result = result_of(done, "eps Eri", "tau Cet", "--days", "30")
    for row, (target, step) in zip(rows, ((t, i) for t in result.targets for i in range(30)), strict=True):
        assert row["name"] == target.name
        assert float(row["mjd"]) == result.mjd[step]
        for key in ("visible_s", "window_s", "roll_half_range_deg", "sun_deg", "moon_deg"):
            assert float(row[key]) == getattr(target.days, key)[step]
        assert row["blocked_by"] == target.days.blocked_by[step]


def test_a_table_of_ones_own_needs_coordinates(call, done, tmp_path):
    stars = tmp_path / "stars.csv"
    stars.write_text("name,distance_pc,v_mag,sp_type,ra_deg,dec_deg\nplaced,2,3,G2V,10,20\nbare,4,3.5,G8V,,\n")
    assert result_of(done, "placed", "--catalog", str(stars), "--days", "3").targets[0].ra_deg == 10
    status, out, err = call("bare", "--catalog", str(stars))
    assert (status, out) == (2, "")
    assert "coordinates" in err
    assert "bare" in err


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ([], ["TARGET"]),
        (["Vegga"], ["Vegga"]),
        (["tau Cet", "--start", "tomorrow"], ["--start", "tomorrow"]),
        (["tau Cet", "--start", "1950-01-01"], ["--start", "1972"]),
        (["tau Cet", "--days", "0"], ["--days", "1 to 36525"]),
        (["tau Cet", "--step-days", "0"], ["--step-days"]),
        (["tau Cet", "--visibility", "none.yaml"], ["none.yaml", "default"]),
        (["tau Cet", "--out", "days.txt"], ["--out", ".csv"]),
        (["tau Cet", "--out", "no/such/days.csv"], ["--out", "writable"]),
    ],
)
def test_bad_input_is_one_line(refuses, options, words):
    refuses(options, words)


@pytest.mark.long
def test_examples_of_the_help_are_accepted(capsys, tmp_path, monkeypatch):
    from cpic_planner.cli.star_commands import visibility

    monkeypatch.chdir(tmp_path)
    (tmp_path / "my_limits.yaml").write_text("moon_deg: 40\n")
    (tmp_path / "my_stars.csv").write_text("name,distance_pc,v_mag,sp_type,ra_deg,dec_deg\nmy star,2,3,G2V,10,20\n")
    examples = re.findall(r"^  cpic (.*)$", inspect.getdoc(visibility), re.M)
    assert len(examples) >= 5
    for example in examples:
        assert main(shlex.split(example)) == 0, example
    capsys.readouterr()
    for name in ("visibility.png", "calendar.png", "days.csv"):
        assert (tmp_path / name).exists()
