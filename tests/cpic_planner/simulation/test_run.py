"""Products that do not depend on how they were made."""

import hashlib
import json
import math
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from astropy.io import fits

from cpic_core import fingerprint
from cpic_planner.cli.main import main
from cpic_planner.jobs import check_tree
from cpic_planner.simulation import simulate
from simulator.config import load_simulation
from simulator.products import check_level0

TREE = {
    "kind": "simulation",
    "name": "x",
    "instrument": {"detector": {"n_columns": 236, "n_rows": 206, "star_column": 118, "star_row": 100}},
    "defaults": {
        "scene": {"name": "star", "cstar": {"v_mag": 2.0, "teff_k": 5200}},
        "fidelity": "quick",
        "band": "F520",
        "exposure_s": 30,
        "em_gain": 20,
        "frames": 25,
    },
    "sequences": [
        {},
        {"kind": "BIAS"},
        {"kind": "FLAT"},
        {"role": "reference"},
        {"kind": "DARK"},
        {"visits": 2, "frames": 2},
    ],
}
STORY = ("run.json", "run.lock", "cpic-run.jsonl")


def made_of(*sequences, **more):
    """A simulation of these sequences on the small camera."""
    return load_simulation({"name": "x", "instrument": TREE["instrument"], "sequences": list(sequences)} | more)


BIAS_AND_DARK = {"kind": "BIAS", "frames": 3}, {"kind": "DARK", "frames": 2, "exposure_s": 5}


def content(folder):
    """Hash of every file that is a result."""
    return {
        path.relative_to(folder).as_posix(): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(folder.rglob("*"))
        if path.is_file() and path.name not in STORY
    }


def arguments(tmp_path, out, *more):
    path = tmp_path / "x.yaml"
    path.write_text(json.dumps(TREE))
    return ["simulate", str(path), "--out", str(out), *more]


def started(tmp_path, out, *more):
    """The command in a process of its own, to be killed."""
    command = [sys.executable, "-m", "cpic_planner.cli.main", *arguments(tmp_path, out, *more)]
    return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    out = tmp_path_factory.mktemp("simulation") / "whole"
    return out, simulate(load_simulation(TREE), out)


def test_the_result_says_what_the_files_hold(whole):
    out, done = whole
    assert (done.resumed_parts, done.computed_parts) == (0, 9)
    assert json.loads((out / "simulation.json").read_text()) == done.result.model_dump(mode="json")
    for item in done.result.sequences:
        path = out / item.file
        assert hashlib.sha256(path.read_bytes()).hexdigest() == item.sha256
        with fits.open(path) as units:
            frames = np.array([unit.data for unit in units[1:]])
            assert (units[0].header["OBSID"], units[0].header["OBSTYPE"]) == (item.obsid, item.kind)
            rays = sum(unit.header["NCR"] for unit in units[1:])
        with fits.open(out / item.truth) as units:
            saturated = max(int((unit.data & 8 != 0).sum()) for unit in units if unit.name == "MASK")
        assert len(frames) == item.n_frames == (2 if item.visit else 25)
        assert (int(frames.min()), int(frames.max())) == (item.adu_min, item.adu_max)
        assert (item.cosmic_rays, item.saturated_pixels) == (rays, saturated)
        files = [path, out / item.truth, *(out / item.params).iterdir()]
        assert item.size_bytes == sum(file.stat().st_size for file in files)
    assert done.result.n_frames == 133


def test_products_are_without_errors(whole):
    assert [str(item) for item in check_tree(whole[0]) if item.severity == "error"] == []


def test_every_product_says_what_made_it(whole):
    out, done = whole
    mark = str(fingerprint())
    for item in done.result.sequences:
        headers = [fits.getheader(out / name) for name in (item.file, item.truth)]
        about = json.loads((out / item.params / "configuration.json").read_text())["software"]
        assert [*(header["FPRINT"] for header in headers), about["fingerprint"]] == [mark] * 3
    assert done.result.fingerprint == json.loads((out / "programme.json").read_text())["fingerprint"] == mark


def turns_from_node(header):
    """Place in the orbit from the state vector: z and its rate are a sine and a cosine of the angle from the node."""
    rate = 2 * math.pi / 5553.6
    return math.atan2(rate * header["POSI0_Z"], header["VELO0_Z"]) / (2 * math.pi)


def test_visits_are_folders_at_one_phase_of_the_orbit(whole):
    out, done = whole
    (programme,) = done.result.programmes
    assert json.loads((out / "programme.json").read_text()) == programme.model_dump(mode="json")
    found = [(row.folder, row.visit, row.n_visits, row.role) for row in programme.sequences]
    assert found == [(f"visit_00{k}_{role}", k, 2, role) for k in (1, 2) for role in ("science", "reference")]
    begins, phases, names = [], [], set()
    for row, item in zip(programme.sequences, done.result.sequences[5:], strict=True):
        assert item.file == row.file == f"{row.folder}/SCI/{int(row.begin_mjd)}/{Path(row.file).name}"
        assert {Path(part).parts[0] for part in (item.truth, item.params)} == {row.folder}
        with fits.open(out / row.file) as units:
            header = units[0].header
        assert [header[key] for key in ("VISIT", "NVISITS", "VISWIN", "ROLE")] == [row.visit, 2, 1, row.role]
        begins.append(header["EXPSTART"])
        phases.append(turns_from_node(header))
        names.add(tuple(row.streams))
    assert len(names) == 4
    assert np.diff(begins) * 86400 == pytest.approx(5553.6, abs=1e-4)
    # The node turns by a third of a degree an orbit, which moves z by as much less than the angle as the tilt is steep.
    assert phases == pytest.approx([phases[0]] * 4, abs=1e-4)
    assert programme.span_days == pytest.approx((3 * 5553.6 + 2 * 30 + 1) / 86400, abs=2e-5)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"visit": 2}, "VISIT: is 1, programme.json says 2"),
        ({"begin_mjd": 61771.5}, "EXPSTART"),
        ({"file": "nowhere.fits"}, "lists nowhere.fits, which is no Level-0 file"),
        (None, "cannot be read: KeyError"),
    ],
)
def test_a_list_that_is_not_that_of_the_visits_is_found(whole, tmp_path, change, said):
    programme = json.loads((whole[0] / "programme.json").read_text())
    row = programme["sequences"][0]
    shutil.copytree(whole[0] / row["folder"], tmp_path / row["folder"])
    tree = {"sequences": [row if change is None else row | change]}
    (tmp_path / "programme.json").write_text(json.dumps({} if change is None else tree))
    (found,) = [str(item) for item in check_level0(tmp_path) if item.severity == "error"]
    assert said in found
    (tmp_path / "programme.json").write_text(json.dumps({"sequences": [row]}))
    assert [item for item in check_level0(tmp_path) if item.severity == "error"] == []


def test_result_holds_no_clock_host_or_path(whole):
    out, _ = whole
    text = (out / "simulation.json").read_text()
    run = json.loads((out / "run.json").read_text())
    for word in (str(out), run["started_utc"][:16], run["host"]["python"]):
        assert word not in text


@pytest.mark.long
def test_killed_half_way_and_started_again_gives_the_same_bytes(whole, tmp_path, capsys):
    """One process, then two; the same of a plan is the other way round."""
    out = tmp_path / "again"
    process = started(tmp_path, out, "--workers", "1")
    deadline = time.monotonic() + 120
    while time.monotonic() < deadline:  # in the middle of a sequence, with another one finished
        if list(out.glob("parts/*.json")) and list(out.glob(".cpic-*/*/*/*/.*.part")):
            break
        time.sleep(0.01)
    os.kill(process.pid, signal.SIGKILL)
    process.wait()
    assert 1 <= len(list(out.glob("parts/*.json"))) < 9
    assert not (out / "simulation.json").exists(), "it had finished before the kill"
    assert main(arguments(tmp_path, out, "--workers", "2")) == 0
    assert "of an earlier run" in capsys.readouterr().err
    assert content(out) == content(whole[0])
    run = json.loads((out / "run.json").read_text())
    assert run["resumed_parts"] >= 1
    assert run["resumed_parts"] + run["computed_parts"] == 9


@pytest.mark.parametrize("damage", ["missing", "shorter", "one bit", "no truth", "no log", "no record"])
def test_what_was_damaged_is_made_again(tmp_path, damage):
    first = simulate(made_of(*BIAS_AND_DARK), tmp_path)
    before = content(tmp_path)
    file = tmp_path / first.result.sequences[1].file
    if damage == "missing":
        file.unlink()
    elif damage == "shorter":
        file.write_bytes(file.read_bytes()[:-2880])
    elif damage == "one bit":
        data = bytearray(file.read_bytes())
        data[-5000] ^= 1
        file.write_bytes(data)
    elif damage == "no truth":
        (tmp_path / first.result.sequences[1].truth).unlink()
    elif damage == "no log":
        (tmp_path / first.result.sequences[1].params / "attitude.csv").unlink()
    else:
        next(tmp_path.glob("parts/40000000002*")).unlink()
    again = simulate(made_of(*BIAS_AND_DARK), tmp_path)
    assert (again.resumed_parts, again.computed_parts) == (1, 1)
    after = content(tmp_path)
    kept = after.pop(f"{first.result.sequences[1].file}.changed-1", None)  # never removed: it may be somebody's work
    assert (kept is not None) == (damage in ("shorter", "one bit"))
    assert after == before
    assert again.result == first.result


def test_another_configuration_needs_force_and_leaves_nothing_of_the_first(refused, tmp_path):
    out = tmp_path / "o"

    def run(frames, **more):
        return simulate(made_of(*[{"kind": "BIAS", "frames": frames}] * (4 - frames)), out, **more)

    run(2)
    refused("--force", run, 3)
    refused("--force", run, 2, truth=False)
    (out / "SCI" / "mine").mkdir(parents=True)
    (out / "SCI" / "mine" / "notes.txt").write_text("precious")
    run(3, force=True)
    simulate(made_of({"kind": "BIAS", "frames": 3}), tmp_path / "fresh")
    left = content(out)
    assert left.pop("SCI/mine/notes.txt")
    assert left == content(tmp_path / "fresh")


def test_a_file_that_the_configuration_names_counts_by_its_content(refused, tmp_path):
    spectrum = tmp_path / "flux.txt"
    spectrum.write_text("wavelength_nm photlam\n400 1\n1000 2\n")
    scene = {"name": "s", "cstar": {"v_mag": 3, "spectrum": str(spectrum)}}
    sequence = {"scene": scene, "band": "F520", "fidelity": "quick"}
    first = simulate(made_of(sequence), tmp_path / "o")
    assert simulate(made_of(sequence), tmp_path / "o").resumed_parts == 1
    spectrum.write_text("wavelength_nm photlam\n400 2\n1000 1\n")
    refused("--force", simulate, made_of(sequence), tmp_path / "o")
    assert simulate(made_of(sequence), tmp_path / "o", force=True).result.config_hash != first.result.config_hash


def test_without_truth_there_is_none(tmp_path):
    done = simulate(made_of({"kind": "BIAS"}), tmp_path, truth=False)
    assert done.result.sequences[0].truth is None
    assert not (tmp_path / "Truth").exists()
    assert [str(item) for item in check_level0(tmp_path) if item.severity == "error"] == []


def test_progress_counts_every_frame(tmp_path):
    told = []

    def advance(text, steps=1, /):
        told.append((text.split()[0], steps))

    simulate(made_of(*BIAS_AND_DARK), tmp_path, advance=advance)
    assert told == [("BIAS", 1)] * 3 + [("DARK", 1)] * 2
    told.clear()
    simulate(made_of(*BIAS_AND_DARK), tmp_path, advance=advance)
    assert told == [("40000000001", 3), ("40000000002", 2)]


def test_a_disk_without_room_is_refused_before_anything_is_written(refused, tmp_path):
    large = made_of(*[{"kind": "BIAS", "frames": 1_000_000}] * 40, instrument="cpic_default")
    refused("MB to spare", simulate, large, tmp_path / "o")
    assert not (tmp_path / "o").exists()


def test_what_a_disk_lacks_is_said_however_little_it_is(refused, tmp_path, monkeypatch):
    """It was once refused 0.01 GB with 0.01 GB free."""
    room = SimpleNamespace(free=0)
    monkeypatch.setattr("shutil.disk_usage", lambda place: room)
    asked = made_of({"kind": "BIAS", "frames": 25})
    for free in (0, 1_000_000):
        room.free = free
        text = refused("MB are free there", simulate, asked, tmp_path / "o")
        needed_mb, free_mb, lacking_mb = (float(word.replace(",", "")) for word in re.findall(r"([\d.,]+) MB", text))
        assert needed_mb > free_mb == free / 1e6
        assert lacking_mb == pytest.approx(needed_mb - free_mb, abs=0.11)
