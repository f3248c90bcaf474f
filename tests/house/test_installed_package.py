"""The wheel, installed where nothing else of the project is, does the main job from another folder."""

import fnmatch
import json
import os
import re
import site
import subprocess
import sys
import zipfile
from pathlib import Path
from shlex import split

import pytest

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    """Build from a copy of the tracked files, so that the clone stays clean."""
    source, out = tmp_path_factory.mktemp("source"), tmp_path_factory.mktemp("wheel")
    listed = subprocess.run(
        ["git", "ls-files", "--cached", "--others", "--exclude-standard"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    )
    for name in listed.stdout.splitlines():
        if (ROOT / name).is_file():
            (source / name).parent.mkdir(parents=True, exist_ok=True)
            (source / name).write_bytes((ROOT / name).read_bytes())
    command = [sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", str(out), str(source)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-2000:]
    return next(out.glob("*.whl"))


@pytest.fixture(scope="module")
def installed(wheel, tmp_path_factory):
    """A new environment that holds the wheel; third-party packages are borrowed by path, the clone is not."""
    folder = tmp_path_factory.mktemp("environment")
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", str(folder)], check=True)
    python = folder / "bin" / "python"
    options = "--quiet --no-compile --no-deps --no-index".split()
    pip = [sys.executable, "-m", "pip", "--python", str(python), "install"]
    subprocess.run([*pip, *options, str(wheel)], check=True)
    home = Path(
        subprocess.run(
            [str(python), "-c", "import site; print(site.getsitepackages()[0])"],
            capture_output=True,
            text=True,
            check=True,
        ).stdout.strip()
    )
    (home / "borrowed.pth").write_text("\n".join(site.getsitepackages()))
    return folder / "bin"


def run(installed, work, *arguments):
    environment = {"PATH": f"{installed}:/usr/bin:/bin", "HOME": str(work), "CPIC_CACHE_DIR": str(work / "cache")}
    environment |= {key: os.environ[key] for key in ("NUMBA_CACHE_DIR", "TMPDIR") if key in os.environ}
    return subprocess.run(
        [str(installed / "cpic"), *arguments], cwd=work, env=environment, capture_output=True, text=True, check=False
    )


def test_wheel_holds_what_it_needs_and_nothing_else(wheel):
    # Of which 2.2 MB are the maps that tell the light of companions, 0.9 MB the states of the mirror, 1.5 MB code and
    # 0.04 MB the description of the pages for programs.
    assert wheel.stat().st_size <= 13.2e6
    names = zipfile.ZipFile(wheel).namelist()
    tops = {name.split("/")[0] for name in names}
    assert {top for top in tops if not top.endswith(".dist-info")} == {
        "cpic_core",
        "catalogs",
        "simulator",
        "cpic_planner",
    }
    packages = ("cpic_core", "catalogs", "simulator", "cpic_planner")
    tracked = subprocess.run(
        ["git", "ls-files", *packages], cwd=ROOT, capture_output=True, text=True, check=True
    ).stdout.split()
    missing = [name for name in tracked if name not in names]
    assert missing == []
    assert any(name.endswith("licenses/LICENSE") for name in names)
    for licence in ("STARS_LICENCE.md", "DATA_LICENCES.md"):
        assert any(name.endswith(licence) and "dist-info" in name for name in names)


def test_every_data_file_of_the_wheel_has_one_entry_with_its_licence(wheel):
    text = (ROOT / "catalogs/data/DATA_LICENCES.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| `([^`]+)` \| (.+) \| (.+) \|$", text, re.MULTILINE)
    data = [
        name
        for name in zipfile.ZipFile(wheel).namelist()
        if ".dist-info/" not in name and not name.endswith((".py", ".pyi", "py.typed"))
    ]
    entries = {name: [row for row in rows if fnmatch.fnmatchcase(name, row[0])] for name in data}
    assert len(data) > 100
    assert {name: found for name, found in entries.items() if len(found) != 1} == {}
    assert [row[0] for row in rows if not fnmatch.filter(data, row[0])] == []
    built = json.loads((ROOT / "catalogs/data/PROVENANCE.json").read_text(encoding="utf-8"))["files"]
    for file in built:
        assert entries[f"catalogs/data/{file['data_file']}"][0][2] == file["licence"]


def test_etc_from_another_folder(installed, tmp_path):
    done = run(installed, tmp_path, "etc", "tau Cet", "--snr", "5", "--json")
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["hip"] == 8102


def test_packages_come_from_the_wheel(installed, tmp_path):
    done = run(installed, tmp_path, "--version")
    assert done.returncode == 0
    assert done.stdout.count("(ok)") == 3


@pytest.mark.long
def test_plan_from_another_folder(installed, tmp_path):
    done = run(
        installed,
        tmp_path,
        *split("plan --top 1 --band F520 --time-s 300 --realisations 1 --planets 200 --out here --json"),
    )
    assert done.returncode == 0, done.stderr
    plan = json.loads(done.stdout)
    assert plan == json.loads((tmp_path / "here" / "plan.json").read_text())
    assert len(plan["targets"]) == 1
    assert (
        sorted(p.name for p in (tmp_path / "here").iterdir() if p.is_file())
        == """
        cpic-run.jsonl known.json measurements.csv plan.json ranking.csv ranking.ecsv report.html run.json run.lock
        sensitivity.json
    """.split()
    )
