"""What an outside attack and the fuzzer found: each of these once had a traceback, a warning, or no end."""

import json
import os
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from astropy.io import fits

import cpic_planner as cp
from cpic_core import InputError, Reason, parse_json, parse_yaml
from cpic_planner.cli.main import main
from cpic_planner.confirm import etc_images
from simulator.knobs import dial_of
from simulator.products import check_level0
from simulator.products.check import Report, check_sums, open_units
from tests.fuzz import product_files, watched
from tests.fuzz.python_calls import HELD, NOWHERE, held, prepare
from tests.fuzz.values import STARS
from tests.simulator.products.conftest import FakeSequence

STAR = ("etc", "tau Cet", "--band", "F520")
SMALL_SIMULATION = {
    "kind": "simulation",
    "name": "small",
    "instrument": {"detector": {"n_columns": 60, "n_rows": 50, "star_column": 30, "star_row": 25}},
    "defaults": {"frames": 1},
    "sequences": [{"kind": "BIAS"}],
}
OWN = ("etc", "--v-mag", "5", "--sp-type", "G2V", "--band", "F520", "--snr", "5")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ((*STAR, "--snr", "1e308"), ("--snr = 1e+308", "1e-06 to 1e+06")),
        ((*STAR, "--snr", "1e-308"), ("--snr = 1e-308", "1e-06 to 1e+06")),
        ((*STAR, "--time-s", "1e5", "--em-gain", "0"), ("--em-gain = 0.0", "1 to 1000")),
        ((*STAR, "--snr", "5", "--em-gain", "1e308"), ("--em-gain = 1e+308", "1 to 1000")),
        ((*STAR, "--time-s", "1e-308"), ("--time-s = 1e-308 s", "0.001 to 1e+09")),
        ((*STAR, "--time-s", "1e308"), ("--time-s = 1e+308 s", "0.001 to 1e+09")),
        ((*STAR, "--sigma", "1e308"), ("--sigma = 1e+308", "1e-06 to 1e+06")),
        ((*STAR, "--snr", "5", "--exposure-s", "1e-308"), ("--exposure-s = 1e-308 s", "0.01 to 1e+06")),
        ((*STAR, "--snr", "5", "--tolerance=1e308"), ("--tolerance = 1e+308", "0 to 0.5")),
        ((*STAR, "--snr", "5", "--phase-deg=1e-308"), ("--phase-deg = 1e-308 deg", "at least 1e-12, below 180")),
        ((*STAR, "--snr", "5", "--separation-au", "1e308"), ("--separation-au = 1e+308 au", "0 to 43")),
        ((*STAR, "--snr", "5", "--semi-major-axis-au", "1e4"), ("--semi-major-axis-au = 10000.0 au", "0.001 to 43")),
        ((*STAR, "--snr", "5", "--reference-ratio", "5e-324"), ("--reference-ratio = 5e-324", "0.001 to 1000")),
        ((*STAR, "--snr", "5", "--threshold-sigma", "1e-30"), ("--threshold-sigma = 1e-30", "0.01 to 20")),
        ((*OWN, "--distance-pc", "1e308"), ("--distance-pc = 1e+308 pc", "0.01 to 100000")),
        ((*OWN, "--distance-pc", "1e-308"), ("--distance-pc = 1e-308 pc", "0.01 to 100000")),
        (("rank", "--planets", "9" * 30), ("--planets = 9999", "1 to 1000000")),
        (("rank", "--planets", "9" * 5000), ("--planets", "an integer")),
        (("simulate", "--dry-run", "n" * 300), ("WHAT = nnn", "that exists")),
        (("whatif", "--dry-run", "n" * 5000), ("nnn...", "allowed")),
        (("check", "n" * 5000), ("path = nnn", "that exists")),
        (("rank", "x" * 5000), ("unexpected extra argument", "...")),
        ((*STAR, "--snr", "5", "--band", "\x1b[31mF\x07\u202e\ud800"), ("\\x1b[31mF\\x07\\u202e\\ud800", "F520, F662")),
    ],
)
def test_commands_are_refused_in_one_line_with_key_value_and_range(arguments, words, capsys):
    assert watched.of_command(list(arguments)) == "refused"
    assert main(list(arguments)) == 2
    said = capsys.readouterr().err
    assert [word for word in words if word not in said] == [], said


def test_planets_without_light_are_ranked(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("stars.csv").write_text(STARS)
    ranked = ["rank", "--catalog", "stars.csv", "--planets", "20", "--band", "F520", "--albedo"]
    assert [watched.of_command([*ranked, albedo]) for albedo in ("0", "-0.0", "5e-324")] == ["answered"] * 3
    assert {row.status for row in cp.rank_targets(catalog="stars.csv", planet={"albedo": 0.0}).targets} == {
        "unreachable"
    }


def test_a_place_at_the_star_itself_is_outside_the_field(capsys):
    for place in ("--separation-arcsec", "--separation-au"):
        assert main([*STAR, "--snr", "5", place, "1e-308", "--json"]) == 0
        (answer,) = json.loads(capsys.readouterr().out)["answers"]
        assert (answer["status"], answer["reason"]) == ("outside_field", "inside_inner_edge")


PLACED = {"bands": ["F520"], "separation_arcsec": 0.5, "time_s": 1e5}


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: cp.signal_to_noise("tau Cet", **PLACED | {"time_s": 10**400}), "time_s = 1000"),
        (lambda: cp.signal_to_noise("tau Cet", **PLACED | {"time_s": 10**5000}), "time_s = a int of too many digits"),
        (lambda: cp.signal_to_noise(None, **PLACED), "target = missing"),
        (lambda: cp.signal_to_noise(42, **PLACED), "target.0 = 42"),
        (lambda: cp.signal_to_noise("tau Cet", **PLACED, distance_pc=-1.0), "distance_pc = -1.0 pc"),
        (lambda: cp.signal_to_noise("tau Cet", **PLACED | {"bands": [["F520"]]}), "bands.0 = "),
        (lambda: cp.optimise("tau Cet", snr=5.0, strategy=5, visits=2), "strategy = 5"),
        (lambda: cp.star_visibility([]), "target = "),
        (lambda: cp.load_targets(v_mag_max=[1.0]), "v_mag_max = "),
        (lambda: cp.load_targets(dwarfs_only=NotImplemented), "dwarfs_only = NotImplemented"),
        (lambda: cp.calibrate(np.array([])), "kind = "),
        (lambda: cp.calibrate("BIAS", band=np.array([])), "band = "),
        (lambda: cp.calibrate("BIAS", camera=np.ones(2)), "camera = "),
        (lambda: cp.planet_albedo(10**400), "wavelength_nm = 1000"),
        (lambda: cp.single_band_psf(["F520"]), "band = "),
        (lambda: cp.single_band_psf("F520", fidelity=[["quick"]]), "fidelity = "),
        (lambda: cp.check_level0(5), "path = 5"),
        (lambda: cp.save_psf(None, "a.fits"), "psf = None"),
        (lambda: cp.write_level0(None, "out"), "observation = None"),
        (lambda: cp.scenes_from_table(None), "table = None"),
        (lambda: cp.Strategy(n_modes="x"), "n_modes = x"),
        (lambda: cp.Scene(star=5), "star"),
        (lambda: cp.load_population({"radius_rjup": 10**400}), "radius_rjup"),
        (lambda: cp.load_known_planets(candidates=NotImplemented), "candidates = NotImplemented"),
        (lambda: cp.single_band_psf("F520", engine=np.array([1, "a"], object)), "engine = array([1, 'a']"),
        (lambda: cp.signal_to_noise("tau Cet", **PLACED, catalog=np.array([1.0, 2.0])), "catalog = array([1., 2.])"),
        (lambda: cp.rank_targets(exclusions=np.ma.masked), "exclusions = masked"),
        (lambda: cp.rank_targets(stars="x" * 5000, bands=["F520"], n_planets=20), "nothing similar"),
        (lambda: cp.make_plan(out=NOWHERE, scheduler=NotImplemented), "--scheduler = NotImplemented"),
        (lambda: cp.make_plan(out=NOWHERE, simulator_overrides=np.array(5.0)), "simulator_overrides = array(5.)"),
        (lambda: cp.load_targets(companions=np.ones(2)), "companions = array"),
        (lambda: cp.planet_albedo(600.0, model=np.ones(2)), "model = array"),
        (lambda: cp.star_photlam(5.0, "G2V", model="x" * 5000), "grid, blackbody, pickles"),
        (lambda: cp.observe("paper_example", band="F520", exposure_s=1.0, quantity=np.ones(2)), "quantity = array"),
        (lambda: cp.observe("paper_example", band="F520", exposure_s=1.0, timing=None), "timing = None"),
        (lambda: cp.single_band_psf("F520", fidelity="quick", spectrum=0), "spectrum = 0"),
        (lambda: cp.load_psf("psf.npz", band=np.ones(2)), "band = array([1., 1.])"),
        (lambda: cp.load_psf("psf.npz", energy=1j), "energy = 1j"),
        (lambda: cp.load_psf("psf.npz", energy=10**400), "energy = 1"),
        (lambda: cp.load_dm_surface("surface.npz", unit=True), "dm_surface unit = True"),
        (lambda: cp.load_dm_surface("surface.npz", samples="x"), "samples = x"),
        (lambda: cp.write_level0(FakeSequence(), "out", truth=np.ones(2)), "truth = array([1., 1.])"),
        (lambda: cp.write_level0(FakeSequence(), "out", overwrite=NotImplemented), "overwrite = NotImplemented"),
        (lambda: cp.write_level0(FakeSequence(), "out", progress=5), "progress = 5"),
        (lambda: cp.write_level0(FakeSequence(), b"out"), "out_dir = b'out'"),
        (lambda: cp.write_level0(FakeSequence(), NOWHERE), "a writable folder"),
        (lambda: cp.observe("paper_example", band="F520", exposure_s=1.0, psf=np.ones(2)), "psf = array([1., 1.])"),
        (lambda: cp.observe("paper_example", band="F520", exposure_s=1.0, psf=NotImplemented), "psf = NotImplemented"),
        (lambda: cp.calibrate("BIAS", exposure_s=np.ones(2)), "exposure_s = [1.0, 1.0] s"),
        (lambda: cp.calibrate("BIAS", switches=np.ones(2)), "switches = array"),
        (lambda: cp.confirm_scene("paper_example", out=HELD, bands="\ud800"), "--out = held"),
    ],
)
def test_values_of_another_type_are_refused_by_functions_and_models(call, words, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    prepare(tmp_path)
    with held(tmp_path), pytest.raises(InputError) as caught:
        call()
    watched.check_refusal(str(caught.value))
    assert words in str(caught.value)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("a: " + "9" * 10_000, "more than 4300 digits"),
        ('a: "\\UFFFFFFFF"', "an escape of no character"),
        ("a: " + "[" * 3000, "nested too deeply"),
    ],
)
def test_yaml_that_python_cannot_hold_is_refused(text, words, refused):
    refused(words, parse_yaml, text)


def test_stamps_whose_sum_is_infinite_are_refused(tmp_path, refused):
    stamp = np.zeros((21, 21))
    stamp[10, 9:12] = 1e308
    np.savez(tmp_path / "psf.npz", off_axis=stamp, pixel_scale_arcsec=0.016153)
    refused("psf off_axis = .*at most 1e.100", cp.load_psf, tmp_path / "psf.npz", energy=0.5)


def test_more_images_than_anybody_draws_are_an_answer():
    """Not an overflow in their number: ``--tolerance 5e-324``."""
    task = SimpleNamespace(predictions=[{"snr": 5.0, "significance": 6.0}], n_all_frames=100)
    for tolerance in (5e-324, 1e-300, 1e-6):
        with pytest.raises(etc_images._Refused) as caught:
            etc_images._wanted(task, dial_of(tolerance=tolerance), 50)
        assert caught.value.reason is Reason.TOLERANCE_NOT_MET
    assert etc_images.FEWEST <= etc_images._wanted(task, dial_of(tolerance=0.2), 50) <= etc_images.MOST_FOR_TOLERANCE


def test_json_in_brackets_without_end_is_none():
    with pytest.raises(ValueError, match="nested too deeply"):
        parse_json("[" * 100_000)


def test_headers_that_count_without_end_are_damage(tmp_path):
    path = tmp_path / "map.fits"
    unit = fits.PrimaryHDU(np.zeros((4, 4)))
    unit.header["BUNIT"] = "nm"
    unit.writeto(path)
    whole = path.read_bytes()
    assert cp.load_dm_surface(path).shape == (4, 4)
    place = whole.index(b"NAXIS1  =")
    for card, words in (
        (f"NAXIS   = {'9' * 60}", "NAXIS is above 999"),
        (f"TFIELDS = {'9' * 60}", "TFIELDS is above 999"),
        (f"NAXIS1  = {-32:20}", "NAXIS1 is below 0"),
        (f"GCOUNT  = {-1:20}", "GCOUNT is below 0"),
    ):
        path.write_bytes(whole[:place] + card.ljust(80).encode() + whole[place + 80 :])
        with pytest.raises(InputError, match=words):
            cp.load_dm_surface(path)
        assert any(words in str(finding) for finding in check_level0(path))


def test_columns_that_are_named_by_numbers_are_a_finding(tmp_path):
    product_files.prepare(tmp_path)
    tree = tmp_path / "good" / "tree"
    (truth,) = (tree / "Truth").rglob("*.fits")
    assert not list(check_level0(tree))
    whole = truth.read_bytes()
    place = whole.rindex(b"TTYPE1  =")  # of the table of the frames
    truth.write_bytes(whole[:place] + f"TTYPE1  = {999:20}".ljust(80).encode() + whole[place + 80 :])
    assert any("Column name must be a string" in str(finding) for finding in check_level0(tree))


def test_the_sum_of_a_unit_is_not_read_beyond_the_file(tmp_path):
    path = tmp_path / "cut.fits"
    fits.PrimaryHDU(np.zeros((4, 4))).writeto(path, checksum=True)
    report = Report(path)
    with open_units(report) as units:
        described = dict(units[0].header)
        units[0]._data_size = 10**12  # what a header may claim
        assert watched.of_function(lambda: check_sums(report, units, 0, described)) == "answered"


def test_a_lock_in_no_encoding_is_somebody_elses(tmp_path):
    out = tmp_path / "out"
    out.mkdir()
    (out / "run.lock").write_bytes(b"\xff\xfe")
    status = watched.of_command(["simulate", "--kind", "BIAS", "--frames", "1", "--out", str(out)])
    assert status == "refused"
    assert (out / "run.lock").read_bytes() == b"\xff\xfe"


@pytest.mark.long
def test_work_of_minutes_says_what_it_does(monkeypatch):
    monkeypatch.setattr("cpic_planner.cli.progress.SHOW_AFTER_S", 2.0)
    assert watched.of_command([*STAR, "--snr", "5", "--separation-arcsec", "0.5", "--tolerance", "0"]) == "at work"


def test_small_files_are_read_without_the_memory_of_the_largest(tmp_path):
    """In a process of its own: the limit holds for all of it."""
    (tmp_path / "stars.csv").write_text("name,distance_pc,v_mag,sp_type\nA one,5,4,G2V\n")
    text = (
        "import resource, cpic_planner as cp; cp.load_targets('stars.csv'); "
        "used = int(open('/proc/self/statm').read().split()[0]) * resource.getpagesize(); "
        "resource.setrlimit(resource.RLIMIT_AS, (used + 200_000_000,) * 2); print(len(cp.load_targets('stars.csv')))"
    )
    where = {"cwd": tmp_path, "env": os.environ | {"PYTHONPATH": str(Path(cp.__file__).parents[1])}}
    done = subprocess.run([sys.executable, "-c", text], capture_output=True, text=True, check=False, **where)
    assert done.stdout.strip() == "1", done.stderr


@pytest.mark.long
def test_names_that_are_no_utf_8_are_written_and_read_back(tmp_path, monkeypatch):
    """A folder may have any name, and run.json has the command."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "x.yaml").write_text(json.dumps(SMALL_SIMULATION))
    name = os.fsdecode(b"run \xff")
    command = [sys.executable, "-m", "cpic_planner.cli.main", "simulate", "x.yaml", "--out", name, "-q"]
    done = subprocess.run(command, capture_output=True, check=False)
    assert (done.returncode, done.stderr) == (0, b"")
    assert json.loads((tmp_path / name / "run.json").read_text())["command"][3] == name
    assert main(["check", name]) == 0
    small = {"name": "\ud800"} | SMALL_SIMULATION["instrument"]
    cp.write_level0(cp.calibrate("BIAS", n_frames=1, em_gain=1.0, instrument=small), "level0")
    assert check_level0("level0") == []
