"""The project around the code: documents that stay true, commands that say what to do."""

import os
import re
import shutil
import subprocess
from pathlib import Path

import pytest

from cpic_planner import __version__

ROOT = Path(__file__).resolve().parents[2]


def text(name):
    return (ROOT / name).read_text(encoding="utf-8")


def test_committed_plan_is_of_this_version_and_schema():
    from cpic_planner.results import PlanResult

    plan = PlanResult.model_validate_json(text("reports/examples/first_plan/plan.json"))
    assert plan.version == __version__


def test_versions_agree():
    assert f"version: {__version__}" in text("CITATION.cff")


def _pins(name):
    return dict(re.findall(r"^([A-Za-z0-9._-]+)==(\S+)", text(name).lower().replace("_", "-"), re.M))


def test_locked_versions_are_those_that_the_suite_runs_with():
    locked, run_with = _pins("requirements-lock.txt"), _pins("constraints.txt")
    differing = {name: version for name, version in locked.items() if run_with.get(name, version) != version}
    assert not differing
    named = re.findall(
        r'^    "([A-Za-z0-9._-]+)', text("pyproject.toml").split("\ndependencies = [")[1].split("\n]")[0], re.M
    )
    assert len(named) > 20
    assert set(named) <= set(locked)
    hashes = text("requirements-lock.txt").count("--hash=sha256:")
    assert hashes >= len(locked)


@pytest.mark.parametrize("package", "numpy scipy astropy astroquery pyvo synphot hcipy pandas sep matplotlib".split())
def test_the_packages_that_serve_users_come_with_the_ordinary_install_and_are_used(package):
    ordinary, extras = text("pyproject.toml").split("\ndependencies = [")[1].split("\n[project.optional-dependencies]")
    assert f'"{package}>=' in ordinary
    assert f'"{package}>=' not in extras.partition("\n[project.scripts]")[0]
    assert package in _pins("constraints-lowest.txt")
    used = re.compile(rf"^\s*(?:import|from) {package}\b|load_quietly\(\"{package}[\".]", re.MULTILINE)
    folders = ("cpic_core", "catalogs", "simulator", "cpic_planner")
    assert any(used.search(path.read_text("utf-8")) for folder in folders for path in (ROOT / folder).rglob("*.py"))


@pytest.mark.parametrize("page", ["README.md", "CONTRIBUTING.md", "ARCHITECTURE.md"])
def test_commands_and_files_of_a_page_exist(page):
    page_text = text(page)
    targets = set(re.findall(r"^([a-z-]+):", text("Makefile"), re.M))
    assert set(re.findall(r"(?:`|\$ )make ([a-z-]+)", page_text)) <= targets
    for link in re.findall(r"\]\(([^)#]+)\)", page_text):
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

    called = {
        cpic_planner.planet_contrast: "radius_rjup separation_ra_au separation_dec_au phase_deg geometric_albedo",
        cpic_planner.star_photlam: "magnitude_v spectral_type teff_k log_g metallicity",
        cpic_planner.lambert_phase: "phase_deg",
        cpic_planner.single_band_psf: "band fidelity",
        cpic_planner.load_psf: "path",
        cpic_planner.load_dm_surface: "path",
        cpic_planner.time_for_rates: "planet_rate background_rate snr floor_rate convention",
        camera.multiply: "electrons gain rng stages",
        validation.rdi_subtract: "science references n_modes region centering",
        validation.detection_threshold: "n_resolution_elements sigma",
    }
    for function, names in called.items():
        assert list(inspect.signature(function).parameters)[: len(names.split())] == names.split()
    observed = set(inspect.signature(cpic_planner.observe).parameters)
    assert observed >= set("scene band exposure_s n_frames em_gain seed fidelity tolerance roll_deg instrument".split())
    for name in (
        "exposure_time",
        "signal_to_noise",
        "contrast_limit",
        "optimise",
        "rank_targets",
        "make_plan",
        "load_targets",
    ):
        assert callable(getattr(cpic_planner, name))
