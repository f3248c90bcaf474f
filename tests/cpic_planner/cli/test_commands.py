import contextlib
import io
import itertools
import json
import os
import signal
import subprocess
import sys
import time
from shlex import split

import pytest

from cpic_core import fingerprint
from cpic_planner.cli.main import main

ETC_KEYS = {"target", "hip", "answers", "schema_version", "best_band"}
RANK_KEYS = set(
    """
    name hip v_mag sp_type distance_pc separation_arcsec contrast band snr significance score completeness
    completeness_per_hour status reason
""".split()
)

# Nearby stars whose plan is one of sums of frames, which takes a tenth of the time of frames.
STARS = """name,v_mag,sp_type,teff_k,log_g,metallicity,distance_pc,luminosity_lsun,ra_deg,dec_deg
first,3.73,K2V,5080,4.6,-0.1,3.2,0.34,53.2,-9.5
second,3.5,G8V,5283,4.5,-0.5,3.65,0.5,26.0,-15.9
third,4.4,G0V,5950,4.4,0.0,8.7,1.1,88.6,20.3
"""


# A ranking in a moment, where neither the numbers nor the stars matter.
ROUGH = ["--band", "F520", "--planets", "50", "--v-mag-max", "4"]


@pytest.fixture(scope="module")
def ranked():
    """What `cpic rank --json` prints of the whole sample, in one band, where the numbers do not matter."""
    with contextlib.redirect_stdout(io.StringIO()) as stdout:
        assert main(["rank", "--band", "F520", "--planets", "50", "--json"]) == 0
    return stdout.getvalue()


def test_rank_json_holds_one_row_per_star(ranked):
    result = json.loads(ranked)
    assert result["schema_version"] == 1
    assert len(result["targets"]) == 1077
    assert all(set(row) >= RANK_KEYS for row in result["targets"])
    assert [row["rank"] for row in result["targets"]] == list(range(1, 1078))
    assert sum(result["counts"].values()) == 1077
    assert len({row["name"] for row in result["targets"]}) == 1077
    for row in result["targets"]:
        assert (row["status"] == "ok") == (row["reason"] == "")
        assert (row["status"] == "ok") == (row["detection_probability"] >= 0.5 * (1 - 1e-9))


def test_rank_writes_tables(call, tmp_path):
    assert call("rank", *ROUGH, "--out", str(tmp_path / "r.json"))[0] == 0
    stars = len(json.loads((tmp_path / "r.json").read_text(encoding="utf-8"))["targets"])
    assert stars > 50
    for ending, around, rows in ((".csv", 1, 3), (".csv", 1, stars), (".tex", 11, 3), (".md", 4, 3)):
        path = tmp_path / f"r{ending}"
        limit = () if rows == stars else ("--limit", "3")
        status, _, err = call("rank", *ROUGH, *limit, "--out", str(path), "--brief")
        assert status == 0
        assert path.read_text(encoding="utf-8").count("\n") == rows + around
        assert (f"wrote {rows} rows" if rows == stars else f"wrote {rows} of {stars} rows") in err
    assert call("rank", *ROUGH, "--limit", "2", "--columns", "hip,name", "--out", str(tmp_path / "r.csv"))[0] == 0
    assert (tmp_path / "r.csv").read_text(encoding="utf-8").splitlines()[0] == "hip,name"
    status, _, err = call("rank", *ROUGH, "--out", str(tmp_path / "r.txt"))
    assert status == 2
    assert ".csv, .ecsv, .json, .tex or .md" in err


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["etc", "tau Cte"], ["tau C"]),
        (["etc", "tau Cet", "--snr", "nan"], ["snr", "finite"]),
        (["etc", "tau Cet", "--snr", "5", "--time-s", "100"], ["--snr", "--time-s"]),
        (["etc", "tau Cet", "--frames", "5"], ["--exposure-s"]),
        (["etc", "tau Cet", "--albedo", "cheese"], ["cheese", "jupiter"]),
        (["etc", "tau Cet", "--albedo", "-1"], ["--albedo = -1.0", "0 to 1.5"]),
        (["etc", "tau Cet", "--phase-deg", "180"], ["--phase-deg", "180"]),
        (["etc"], ["TARGET"]),
        (["etc", "tau Cet", "--snrr", "5"], ["--snrr"]),
        (["plan", "--top", "0"], ["--top"]),
        (["plan", "--instrument", "missing.yaml"], ["missing.yaml", "cpic_default"]),
        (["schema", "nothing"], ["nothing", "plan"]),
        (["rank", "--time-s", "0"], ["--time-s", "0.001"]),
        (["fly"], ["fly"]),
    ],
)
def test_bad_input_is_one_clear_line_with_status_2(refuses, arguments, words):
    refuses(arguments, words)


def test_semi_major_axis_places_the_planet(call):
    _, out, _ = call("etc", "tau Cet", "--semi-major-axis-au", "2", "--phase-deg", "60", "--band", "F520", "--json")
    (answer,) = json.loads(out)["answers"]
    assert answer["separation_arcsec"] == pytest.approx(2 * 3**0.5 / 2 / json.loads(out)["distance_pc"])


def test_more_time_is_never_worse(call):
    snr = []
    for time_s in ("1200", "6000", "36000", "1e7"):
        _, out, _ = call("etc", "tau Cet", "--time-s", time_s, "--band", "F520", "--separation-arcsec", "0.5", "--json")
        (answer,) = json.loads(out)["answers"]
        snr.append(answer["snr"])
        assert answer["time_s"] <= float(time_s) * (1 + 1e-12)
    assert all(longer >= shorter for shorter, longer in itertools.pairwise(snr))


@pytest.mark.parametrize(
    "extra", [["--phase-deg", "60"], ["--albedo", "saturn"], ["--planet-radius-rjup", "2"], ["--contrast-limit"]]
)
def test_options_without_meaning_are_refused(call, extra):
    status, _, err = call("etc", "tau Cet", "--contrast", "1e-9", *extra)
    assert status == 2
    assert "--contrast" in err


@pytest.mark.parametrize(
    ("work", "arguments"),
    [
        ("cpic_planner.api.prepared", ("rank",)),
        ("cpic_planner.api.answered", ("etc", "tau Cet", "--snr", "5")),
        ("cpic_planner.confirm.plan_job", ("plan", "--dry-run")),
        ("cpic_planner.jobs.check_tree", ("check", ".")),
        ("catalogs.refresh_stars", ("catalog", "refresh", "--out", "{}/stars.ecsv")),
    ],
)
def test_sigterm_says_how_to_go_on(call, monkeypatch, tmp_path, work, arguments):
    def terminated(*given, **more):
        os.kill(os.getpid(), signal.SIGTERM)
        time.sleep(5)
        raise AssertionError("it went on")

    assert signal.getsignal(signal.SIGTERM) is signal.SIG_DFL
    monkeypatch.setattr(work, terminated)
    status, out, err = call(*(word.format(tmp_path) for word in arguments))
    assert (status, out) == (143, "")
    assert err.splitlines()[-1].startswith("cpic: terminated; no file is left half written")
    assert err.endswith("continues when it is started again with the same --out\n")
    assert signal.getsignal(signal.SIGTERM) is signal.SIG_DFL


@pytest.mark.long
@pytest.mark.parametrize(("number", "status"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_interrupted_plan_says_how_to_go_on(tmp_path, number, status):
    out = str(tmp_path / "o")
    stars = tmp_path / "stars.csv"
    stars.write_text(STARS)
    process = subprocess.Popen(
        [
            sys.executable,
            "-m",
            "cpic_planner.cli.main",
            "plan",
            "--catalog",
            str(stars),
            *split("--planets 500 --top 3 --workers 2 --out"),
            out,
            *split("--time-s 1000 --band F520 --realisations 1"),
        ],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        # a suite that runs in the background inherits an ignored SIGINT; a person's terminal does not
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )
    deadline = time.monotonic() + 60
    while not list(tmp_path.glob("o/parts/*.json")) and time.monotonic() < deadline:
        time.sleep(0.05)
    os.killpg(process.pid, number)  # as terminals and batch schedulers do: to every process of the group
    _, err = process.communicate(timeout=60)
    assert process.returncode == status
    assert "continues when it is started again" in err
    assert len([line for line in err.splitlines() if " so far" not in line]) <= 3


def test_closed_pipe_is_quiet():
    command = f"{sys.executable} -m cpic_planner.cli.main rank {' '.join(ROUGH)} --json | head -1"
    done = subprocess.run(["bash", "-c", command], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "{"
    assert [line for line in done.stderr.splitlines() if not line.endswith(" so far)")] == []  # of a busy machine


def test_shipped_schemas_match_the_models_and_describe_the_output(ranked):
    from cpic_planner.results import RankResult
    from cpic_planner.schemas import RESULTS, generated, schema_text

    for name in RESULTS:
        assert schema_text(name) == generated(name), "run python -m tools.schemas"
    RankResult.model_validate_json(ranked)


@pytest.mark.parametrize("arguments", [("known", "eps Eri", "--date", "2030-01-01"), ("rank", "--v-mag-max", "2")])
def test_answers_say_what_made_them(arguments, capsys):
    assert main([*arguments, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["fingerprint"] == str(fingerprint())
