"""Questions in the words of the user: units, changes of the instrument, bands, planets, forms of the answer."""

import csv
import io
import json
import subprocess
import sys
from shlex import split

import pytest

HERE = ["etc", "tau Cet", "--band", "F520", "--separation-arcsec", "0.5"]


def result(done, *arguments):
    return json.loads(done(*arguments, "--json")[0])


@pytest.mark.parametrize(
    ("written", "seconds"),
    [("2h", "7200"), ("120min", "7200"), ("7200s", "7200"), ("0.5d", "43200"), ("1.5 h", "5400")],
)
def test_a_time_with_a_unit(done, written, seconds):
    plain = result(done, *HERE, "--time-s", seconds)
    assert result(done, *HERE, "--time", written) == plain
    assert result(done, *HERE, f"--time={written}") == plain


def test_the_time_of_a_visit_with_a_unit(done):
    plain = result(done, *HERE, "--visits", "3", "--visit-time-s", "2700")
    assert result(done, *HERE, "--visits", "3", "--visit-time", "45min") == plain


@pytest.mark.parametrize("written", ["7200", "2kg", "x2", "long", "-1h", ""])
def test_a_time_without_a_unit_is_refused(refuses, written):
    refuses([*HERE, "--time", written], ["--time"])


def test_changes_of_the_instrument_are_those_of_a_file(done, tmp_path):
    path = tmp_path / "calm.yaml"
    path.write_text("kind: instrument\nname: calm\ndrift: {visit_nm: 0.02}\n", encoding="utf-8")
    file = result(done, *HERE, "--instrument", str(path))["answers"]
    assert result(done, *HERE, "--set", "drift.visit_nm=20pm")["answers"] == file
    both = result(done, *HERE, "--set", "drift.visit_nm=0.02", "--set", "throughput=x0.5")["answers"][0]
    assert both["snr"] < file[0]["snr"]
    assert result(done, *HERE)["answers"][0]["snr"] < file[0]["snr"]


@pytest.mark.parametrize(
    "command",
    [
        "rank --band F520 --planets 50 --v-mag-max 4 --limit 1 --brief",
        "known 'eps Eri' --band F520 --planets 50 --brief",
        "visibility 'tau Cet' --days 2",
        "plan --top 1 --band F520 --dry-run",
        "confirm paper_example --band F520 --dry-run",
        "simulate paper_example --band F520 --dry-run",
        "whatif survey_default --strategy few_and_deep --dry-run",
    ],
)
def test_every_command_with_an_instrument_takes_changes(call, command):
    assert call(*split(command), "--set", "detector.dark_e_s=0.001")[0] == 0
    status, _, err = call(*split(command), "--set", "drift=0.1")
    assert status == 2
    assert "--set drift = 0.1" in err
    assert "a unit (nm), or an x before a factor" in err


def test_all_bands(done, refuses):
    rows = result(done, "etc", "tau Cet", "--band", "all", "--separation-arcsec", "0.8", "--time", "2h")["answers"]
    assert [row["band"] for row in rows] == ["F520", "F662", "F720", "F850", "F940", "F1265", "F1425", "F1542"]
    refuses(["etc", "tau Cet", "--band", "all", "--band", "F520"], ["--band", "all alone"])


def test_a_separation_in_au(done, refuses):
    near = result(done, "etc", "tau Cet", "--band", "F520", "--separation-au", "1.9")
    assert near["answers"][0]["separation_arcsec"] == pytest.approx(1.9 / near["distance_pc"])
    refuses([*HERE, "--separation-au", "2"], ["--separation-arcsec", "--separation-au"])


def test_a_planet_by_name(done):
    asked = ["etc", "eps Eri b", "--date", "2030-01-01", "--time", "10h", "--band", "F520"]
    (answer,) = result(done, *asked)["answers"]
    look = answer["known_planet"]
    assert look["planet"] == "eps Eri b"
    (row,) = csv.DictReader(io.StringIO(done(*asked, "--format", "csv")[0]))
    assert float(row["known_planet_value_high"]) == pytest.approx(look["value"]["high"], rel=1e-3)
    other = result(done, *asked[:2], "--date", "2031-01-01", *asked[4:])
    assert other["config_hash"] != result(done, *asked)["config_hash"]
    assert other["answers"][0]["separation_arcsec"] != answer["separation_arcsec"]


def test_an_snr_has_its_predicted_error_beside_it(done):
    out, _ = done(*HERE, "--brief")
    answers = result(done, *HERE)
    snr = answers["answers"][0]["snr"]
    error = answers["fidelity"]["answers"][0]["predicted_error"]["snr"]
    assert f"{snr:.1f} ± {snr * error:.1f}" in out


@pytest.mark.parametrize(
    ("command", "status"),
    [
        ("etc 'tau Cet' --detect --separation-arcsec 0.5 --band F520", 0),
        ("etc 'tau Cet' --snr 1e5 --separation-arcsec 0.5 --band F520", 3),
        ("etc 'omi2 Eri' --snr 5 --band F520", 3),
        ("etc 'tau Cet' --contrast-limit --band F520", 0),
        ("etc 'tau Cet' --contrast-limit --separation-arcsec 0.05 --band F520", 3),
        ("rank --band F520 --planets 50 --v-mag-max 4", 0),
        ("rank --band F520 --planets 50 --v-mag-max 4 --time-s 601", 3),
        ("visibility 'tau Cet' --days 2", 0),
    ],
)
def test_strict_tells_what_is_not_found(call, command, status):
    assert call(*split(command))[0] == 0
    found, out, err = call(*split(command), "--strict")
    assert found == status, err
    assert call(*split(command), "--strict", "--json")[0] == status
    assert out


def test_forms_and_briefness_contradict_each_other(refuses):
    refuses([*HERE, "--json", "--format", "csv"], ["--json", "--format"])
    refuses([*HERE, "--brief", "--format", "csv"], ["--brief"])
    refuses([*HERE, "--brief", "--budget"], ["--budget", "--brief"])
    refuses([*HERE, "--format", "html"], ["--format", "latex"])


def test_json_is_a_form(done):
    assert done(*HERE, "--format", "json")[0] == done(*HERE, "--json")[0]


def test_quiet_stands_anywhere(call, done, tmp_path):
    table = tmp_path / "mine.csv"
    table.write_text("name,distance_pc,v_mag,sp_type\nmine,5.0,4.4,K0V\n", encoding="utf-8")
    plot = str(tmp_path / "a.svg")
    assert "wrote" in done(*HERE, "--plot", plot)[1]
    for arguments in ([*HERE, "--plot", plot, "-q"], ["-q", *HERE, "--plot", plot], ["etc", "-q", *HERE[1:]]):
        assert done(*arguments)[1] == ""
    assert done("instrument", "show", "-q", "--key", "drift")[1] == ""
    assert done("cache", "info", "-q")[1] == ""


@pytest.mark.parametrize(("words", "shown"), [([], "plan"), (["catalog"], "refresh"), (["instrument"], "diff")])
def test_a_command_alone_shows_its_help(done, words, shown):
    out, err = done(*words)
    assert out.startswith(f"Usage: {' '.join(['cpic', *words])}")
    assert f"  {shown} " in out
    assert err == ""


@pytest.mark.parametrize(
    ("arguments", "place"),
    [
        (["etc", "tau Cet", "--fly"], "cpic etc --help"),
        (["etc"], "cpic etc --help"),
        (["catalog", "fly"], "cpic catalog --help"),
        (["instrument", "show", "--fly"], "cpic instrument show --help"),
        (["fly"], "cpic --help"),
    ],
)
def test_errors_point_to_the_help_of_their_command(refuses, arguments, place):
    refuses(arguments, [f"(see {place})"])


def test_the_version_has_a_short_option(done):
    assert done("-V")[0] == done("--version")[0]


COMPLETED = {
    "cpic et": {"etc"},
    "cpic etc --separation": {"--separation-arcsec", "--separation-au"},
    "cpic etc --band F5": {"F520"},
    "cpic etc --library r": {"reference_star", "roll"},
    "cpic etc eps": {"eps Eri", "eps Ind"},
    "cpic rank --format ": {"table", "csv", "ecsv", "json", "latex", "markdown"},
}
# Each line is completed by a process of its own, as a shell has it done; what they all load is loaded once.
COMPLETE = """
import json, os, sys
from cpic_planner.cli.main import main
for line in json.loads(sys.argv[1]):
    if os.fork() == 0:
        count = str(len(line.split(" ")) - 1)
        os.environ.update(_CPIC_COMPLETE="complete_bash", COMP_WORDS=line, COMP_CWORD=count)
        sys.argv = ["cpic"]
        main()
        sys.exit()
    os.wait()
    print("end", flush=True)
"""


@pytest.fixture(scope="module")
def completions():
    """What a shell is offered after each of the lines."""
    command = [sys.executable, "-c", COMPLETE, json.dumps(list(COMPLETED))]
    told = subprocess.run(command, capture_output=True, text=True, check=True).stdout.split("end\n")
    return dict(zip(COMPLETED, (set(text.splitlines()) for text in told), strict=False))


@pytest.mark.parametrize("words", COMPLETED)
def test_shells_complete(completions, words):
    assert completions[words] >= COMPLETED[words]


def test_commands_are_built_once_for_a_process(done, monkeypatch):
    told = done("etc", "--help")
    monkeypatch.setattr("typer.main.get_command", None)
    assert done("etc", "--help") == told
