"""The project around the code: documents that stay true, commands that say what to do."""

import csv
import itertools
import json
import math
import os
import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import beta

from cpic_planner import __version__

ROOT = Path(__file__).resolve().parents[2]


def text(name):
    return (ROOT / name).read_text(encoding="utf-8")


def test_readme_quotes_the_committed_report():
    report, readme = text("reports/first_plan/report.md"), " ".join(text("README.md").split())
    ratio = re.search(r"SNR: ([\d.]+) \+- ([\d.]+) over (\d+) measurements", report)
    assert f"is {ratio[1]} ± {ratio[2]} of the predicted one" in readme
    assert f"Over {ratio[3]} simulated measurements" in readme
    counts = re.search(r"(\d+) stars ranked, (\d+) with a reference planet", report)
    assert f"of {counts[1]} stars, {counts[2]} have" in readme
    limits = dict(re.findall(r"(\w+) limited by (\w+)", report))
    told = re.search(r"(\d+) are limited by speckles .*? (\d+) by background and (\d+) by photons", readme)
    assert dict(zip(told.groups(), ("speckles", "background", "photons"), strict=True)) == limits
    for what, pattern in (("etc", r"`cpic etc .*?\| ([\d.]+) \|"), ("rank", r"`cpic rank`.*?\| ([\d.]+) \|")):
        seconds = re.search(pattern, report)[1]
        assert re.search(rf"`cpic {what}`.*?{float(seconds):.1f} s", readme), (what, seconds)
    plan = re.search(r"plan of 5 targets x 4 bands, 2 workers, 1 run \| (\d+) \|", report)[1]
    assert f"in 4 bands {plan} s" in readme


@pytest.mark.parametrize(
    ("name", "heading"),
    [
        ("first_plan", "| instead | reference planets detected"),
        ("etc_accuracy", "|  | asked | found | met |"),
        ("blind_validator", "|  | asked | found | met |"),
        ("whatif", "|  | asked | found | met |"),
    ],
)
def test_readme_quotes_the_tables_of_ranking_and_etc(name, heading):
    """Line by line, but for rows that nothing was asked of."""
    lines = text(f"reports/{name}/report.md").splitlines()
    start = next(i for i, line in enumerate(lines) if line.startswith(heading)) + 2
    rows = list(itertools.takewhile(lambda line: line.startswith("|"), lines[start:]))
    readme = text("README.md").splitlines()
    assert len(rows) > 4
    for row in rows:
        assert row in readme or "|  | +" in row, row


def test_readme_quotes_the_default_strategies():
    """The yields of the best and of the simplest of the five, and the false alarms beside them."""
    readme = " ".join(text("README.md").split())
    strategies = {item["name"]: item for item in json.loads(text("reports/whatif/whatif.json"))["strategies"]}
    best = max(strategies.values(), key=lambda item: item["new_planets"]["mean"])
    single = strategies["single_visit"]
    words = [
        f"{best['name']} finds {best['new_planets']['mean']:.2f} new planets in {best['hours']['mean']:.0f} h",
        f"one visit of each star finds {single['new_planets']['mean']:.2f} in {single['hours']['mean']:.0f} h",
        f"and {best['background_alarms']['mean']:.1f} background stars",
    ]
    for sentence in words:
        assert sentence in readme, sentence


def test_readme_quotes_the_law_of_a_detection():
    readme = " ".join(text("README.md").split())
    found = json.loads(text("reports/whatif/results.json"))["detection_law"]
    gaussian, tails = found["blind"]["coefficients"][:2]
    assert f"In {sum(row['realisations'] for row in found['rows'])} simulated sequences of such visits" in readme
    assert f"half of the planets at {math.exp(gaussian):.2f} of the threshold where noise is Gaussian" in readme
    assert f"and at {math.exp(gaussian + tails):.2f} where all of it is light" in readme
    assert f"the known place at {math.exp(found['known']['coefficients'][0]):.2f};" in readme


def test_readme_quotes_seasons_and_assumed_contrasts():
    readme = " ".join(text("README.md").split())
    found = json.loads(text("reports/whatif/results.json"))
    seasons, optics = found["seasons"], found["optics"]
    assert (
        f"From {seasons['start_utc'][:10]} the median of {seasons['stars']} ranked stars can be observed on "
        f"{seasons['days'][2]:.0f} of 366 days, and then for {seasons['minutes'][2]:.0f} min of an orbit of "
        f"{seasons['period_min']:.1f} min."
    ) in readme
    for key, sentence in (("ratio", "predicted SNRs are {} times those of images"), ("scaled", "would give {} times")):
        ends = [f"{end(row[key] for row in optics):.2f}" for end in (min, max)]
        assert sentence.format(" to ".join(ends)) in readme


def test_readme_quotes_what_a_blind_search_asks_for():
    results = json.loads(text("reports/blind_validator/results.json"))
    asked = [row["search_threshold"] for row in results["unaltered"]["rows"] if row["search_threshold"]]
    assert f"a matched-filter SNR of {min(asked):.1f} to {max(asked):.1f}" in " ".join(text("README.md").split())


def test_readme_quotes_the_errors_of_the_parametric_albedo():
    readme = " ".join(text("README.md").split())
    with (ROOT / "reports/spectra/errors.csv").open(encoding="utf-8", newline="") as stream:
        rows = list(csv.DictReader(stream))
    # "At most" rounds up.
    worst = (max(float(row[f"{kind}_median_2au"]) for row in rows) for kind in ("fitted", "held_out"))
    fitted, held_out = (math.ceil(1000 * value) / 1000 for value in worst)
    assert f"at most {fitted:.3f} in a fitted band at 2 au" in readme
    assert f"at most {held_out:.3f} in a band that was left out of the fit" in readme


def test_readme_quotes_the_tiers_of_the_speed_report():
    report, readme = text("reports/imaging_speed/report.md"), text("README.md")
    for tier in ("quick", "standard", "reference"):
        rows = re.findall(rf"^\| `{tier}` \| F\d+ \| (.*) \|$", report, re.M)
        errors = [[float(value) for value in row.split("|")] for row in rows]
        assert len(errors) == 4
        worst = [f"{max(column):.0e}" for column in zip(*errors, strict=True)]
        seconds = re.search(rf"^\| four bands, 137 px, `{tier}` \| ([\d.]+) \|", report, re.M)
        assert f"| `{tier}` | {seconds[1]} | {' | '.join(worst)} |" in readme


def test_readme_quotes_the_dial_of_its_reports():
    report, readme = text("reports/speed_accuracy/report.md"), " ".join(text("README.md").split())
    rows = re.findall(r"^\| (?:closed form|`\w+`) \|.*\|$", report.split("## Tiers over all scenes")[1], re.M)[:4]
    assert len(rows) == 4
    for row in rows:
        assert row in readme
    scenes = list(csv.DictReader(text("reports/effect_ledger/scenes.csv").splitlines()))
    missed = sum(row["kept"] != "True" for row in scenes)
    bound = beta.ppf(0.95, missed + 1, len(scenes) - missed)
    assert bound <= 0.01
    faster = np.median([float(row["speed_up"]) for row in scenes])
    sums = list(csv.DictReader(text("reports/effect_ledger/sums.csv").splitlines()))
    summed = np.median([float(row["speed_up"]) for row in sums])
    assert (
        f"Of {len(scenes)} random scenes {missed or 'none'} moved by more than its tolerance (upper 95 % bound of the "
        f"rate {100 * bound:.2f} %); a tolerance made them {faster:.1f} times faster, sums instead of whole frames "
        f"{summed:.0f} times (medians; [reports/effect_ledger/report.md](reports/effect_ledger/report.md))"
    ) in readme


def test_readme_quotes_the_speed_of_the_camera():
    readme = " ".join(text("README.md").split())
    times, peers = (
        list(csv.DictReader(text(f"reports/camera_speed/{name}.csv").splitlines())) for name in ("times", "peers")
    )
    seconds = {row["job"]: float(row["cpu_s"]) for row in times}
    jobs = (
        "dark, 30 s, gain 300",
        "star of V = 5, F662, 30 s, gain 300",
        "paper's example, F520, 17 s, gain 20",
        "paper's example, F520, 300 s, gain 20 (blooms)",
    )
    for job in jobs:
        assert f"| {job} | {1000 * seconds[job]:.0f} |" in readme, job
    flats = [1000 * value for job, value in seconds.items() if job.startswith("flat of")]
    assert f"| flats of 50 to 20000 e-, gain 1 to 300 | {min(flats):.0f} to {max(flats):.0f} |" in readme
    ours = {row["scene"]: float(row["cpu_s"]) for row in peers if row["simulator"] == "ours"}
    for simulator, mode in (("emccd-detect", "fast, no register CIC"), ("getframes", "double")):
        found = [
            float(row["cpu_s"]) / ours[row["scene"]]
            for row in peers
            if (row["simulator"], row["mode"]) == (simulator, mode)
        ]
        assert f"{simulator} ({mode}) {min(found):.1f} to {max(found):.1f} times" in readme, simulator
    exact = next(float(row["cpu_s"]) / ours[row["scene"]] for row in peers if row["mode"] == "exact")
    assert f"emccd-detect's exact mode ({exact:.0f} times)" in readme


def test_committed_plan_is_of_this_version_and_schema():
    from cpic_planner.models import PlanResult

    plan = PlanResult.model_validate_json(text("reports/first_plan/plan.json"))
    assert plan.version == __version__


def test_versions_agree():
    assert f"version: {__version__}" in text("CITATION.cff")


def test_readme_commands_and_files_exist():
    readme = text("README.md")
    targets = set(re.findall(r"^([a-z-]+):", text("Makefile"), re.M))
    assert set(re.findall(r"`make ([a-z-]+)", readme)) <= targets
    for link in re.findall(r"\]\(([^)#]+)\)", readme):
        assert link.startswith("http") or (ROOT / link).exists(), link


@pytest.mark.parametrize("name", ["python3", "none"])
def test_makefile_names_the_remedy_when_python_is_missing_or_has_no_venv(tmp_path, name):
    tools = tmp_path / "bin"
    tools.mkdir()
    for tool in ("bash", "make", "awk", "test", "touch", "env"):
        if (path := shutil.which(tool)) is not None:
            (tools / tool).symlink_to(path)
    if name != "none":
        fake = tools / name
        # answers the version check, but has neither venv nor ensurepip
        fake.write_text('#!/bin/bash\n[[ "$2" == *venv* ]] && exit 1\nexit 0\n')
        fake.chmod(0o755)
    for item in ("Makefile", "pyproject.toml", "constraints.txt"):
        (tmp_path / item).write_text(text(item))
    environment = {key: value for key, value in os.environ.items() if key not in ("PYTHON", "MAKEFLAGS", "MAKELEVEL")}
    done = subprocess.run(
        ["make", "plan"],
        cwd=tmp_path,
        env=environment | {"PATH": str(tools)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode != 0
    assert "python3-venv" in done.stderr
    assert not (tmp_path / ".venv").exists()


def test_public_signatures_are_those_that_other_people_call():
    import inspect

    import cpic_planner
    from cpic_planner import validation
    from simulator import camera

    def names(function):
        return list(inspect.signature(function).parameters)

    assert names(cpic_planner.planet_contrast) == [
        "radius_rjup",
        "separation_ra_au",
        "separation_dec_au",
        "phase_deg",
        "geometric_albedo",
    ]
    assert names(cpic_planner.star_photlam)[:5] == ["magnitude_v", "spectral_type", "teff_k", "log_g", "metallicity"]
    assert names(cpic_planner.lambert_phase) == ["phase_deg"]
    assert names(cpic_planner.single_band_psf)[:2] == ["band", "fidelity"]
    assert names(cpic_planner.load_psf)[0] == "path"
    assert names(cpic_planner.load_dm_surface)[0] == "path"
    expected = {
        "scene",
        "band",
        "exposure_s",
        "n_frames",
        "em_gain",
        "seed",
        "fidelity",
        "tolerance",
        "roll_deg",
        "instrument",
    }
    assert set(names(cpic_planner.observe)) >= expected
    assert names(camera.multiply) == ["electrons", "gain", "rng", "stages"]
    assert names(validation.rdi_subtract) == ["science", "references", "n_modes", "region", "centering"]
    assert names(validation.detection_threshold) == ["n_resolution_elements", "sigma"]


def test_notebook_outputs_are_committed_and_small():
    for path in (ROOT / "notebooks").glob("*.ipynb"):
        notebook = json.loads(path.read_text(encoding="utf-8"))
        assert any(cell.get("outputs") for cell in notebook["cells"])
        assert path.stat().st_size < 1_000_000
