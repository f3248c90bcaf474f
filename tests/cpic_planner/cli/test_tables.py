"""A telescope that nobody here knows, as a YAML file beside a CSV file: no line of code knows its names."""

import json
from shlex import split

import numpy as np
import pytest
from photutils.aperture import CircularAperture, aperture_photometry

from tests.yield_packages import PIXEL, RADIUS, source, write

TABLE = """# made for this test; columns as a spreadsheet has them
Separation [mas];Core throughput [%];Raw contrast;Contrast stability;Occulter transmission;Core area (lambda/D)^2
60;8;4e-9;3e-10;0.30;1.4
90;12;2e-9;2e-10;0.45;1.5
400;12;1e-9;1e-10;0.50;1.6
700;11;2e-9;1e-10;0.50;1.6
"""
TELESCOPE = """
name: Laplace-4
telescope: {diameter_m: 4.1, obstruction_diameter_ratio: 0.14, area_m2: 12.5}
coronagraph: {table: laplace.csv, stability_averages: visits}
bands:
  green_2: {center_nm: 550, width_nm: 55, t_opt: 0.35, qe: 0.9}
  Far-Red: {center_nm: 810, width_nm: 81, t_opt: 0.33, qe: 0.6}
detector:
  pixel_scale_arcsec: 0.013
  em_gain_max: 1
  read_noise_e: 1.5
  gain_e_adu: 1
  full_well_e: 60000
  switches: {em_register: false, smear: false}
drift: {visit_nm: 0}
"""
STRATEGIES = """
strategies:
  - name: once
    targets: {names: [tau Cet, eps Eri]}
    visit: {bands: [green_2]}
"""


@pytest.fixture
def laplace(tmp_path, monkeypatch):
    """The telescope in the working folder."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "laplace.csv").write_text(TABLE, encoding="utf-8")
    (tmp_path / "laplace.yaml").write_text(TELESCOPE, encoding="utf-8")
    (tmp_path / "once.yaml").write_text(STRATEGIES, encoding="utf-8")
    return tmp_path


def test_its_answers_about_a_star(laplace, done):
    asked = "etc '47 UMa' --instrument laplace.yaml --separation-arcsec 0.25 --contrast 1e-8 --time-s 36000 --json"
    out, _ = done(*split(asked))
    answers = json.loads(out)["answers"]
    assert [answer["band"] for answer in answers] == ["green_2", "Far-Red"]
    # Between 90 and 400 mas, where the table has 12 %.
    assert [answer["core_throughput"] for answer in answers] == pytest.approx([0.12, 0.12])
    assert all(answer["value"] > 1 for answer in answers)
    assert answers[0]["value"] > answers[1]["value"]
    out, _ = done("etc", "47 UMa", "--instrument", "laplace.yaml", "--separation-arcsec", 0.9, "--time-s", 3600)
    assert "leaves the dark hole" in " ".join(out.split()) or "outside" in out
    out, _ = done(
        "etc", "alpha Cen B", "--instrument", "laplace.yaml", "--band", "green_2", "--detect", "--plot", "limit.png"
    )
    assert (laplace / "limit.png").stat().st_size > 5000


def test_its_ranking(laplace, done):
    options = "--instrument laplace.yaml --dwarfs --limit 3 --time-s 36000 --planets 300 --out rank.json"
    done("rank", *split(options))
    found = json.loads((laplace / "rank.json").read_text())
    best = found["targets"][0]
    assert best["band"] in ("green_2", "Far-Red")
    assert best["status"] == "ok"
    assert 0.06 <= best["separation_arcsec"] <= 0.7


def test_its_surveys(laplace, done):
    options = "--instrument laplace.yaml --universes 20 --images 1 --workers 1 --no-facts --days 90 --out survey"
    done("whatif", "once.yaml", *split(options))
    found = json.loads((laplace / "survey/whatif.json").read_text())
    images = found["strategies"][0]["images"]
    assert images["images"] > 0  # of the detections that were sampled
    assert "table" not in images["note"]
    assert (laplace / "survey/report.html").is_file()


def test_what_it_is(laplace, done):
    out, _ = done("instrument", "show", "laplace.yaml", "--key", "coronagraph.table")
    assert "laplace.csv" in out
    out, _ = done("instrument", "keys", "coronagraph")
    assert "coronagraph.stability_averages" in out
    out, _ = done("instrument", "diff", "laplace.yaml", "roman_hlc_like", "--key", "telescope")
    assert "4.1" in out
    assert "2.363" in out


@pytest.mark.parametrize("preset", ["roman_hlc_like", "hwo_like"])
def test_shipped_telescopes_answer(done, preset):
    out, _ = done(
        "etc", "tau Cet", "--instrument", preset, "--separation-arcsec", 0.2, "--contrast", 1e-8, "--snr", 5, "--json"
    )
    assert all(answer["value"] > 0 for answer in json.loads(out)["answers"])


def test_our_own_as_a_table(laplace, done, refuses):
    done("instrument", "table", "--band", "F662", "--out", "f662.csv")
    (laplace / "ours.yaml").write_text("coronagraph: {table: {F662: f662.csv}, zone: quadrants}\n", encoding="utf-8")
    asked = ("etc", "tau Cet", "--band", "F662", "--separation-arcsec", 0.6, "--contrast", 1e-8, "--snr", 5, "--json")
    ours, theirs = (
        json.loads(done(*asked, "--instrument", name)[0])["answers"][0] for name in ("cpic_default", "ours.yaml")
    )
    assert theirs["value"] == pytest.approx(ours["value"], rel=5e-3)
    refuses(("instrument", "table", "--out", "x.csv"), "--band")
    refuses(("instrument", "table", "--band", "F662", "--out", "x.txt"), ".csv")
    refuses(("instrument", "table", "--band", "F662", "--out", "no/such/folder/x.csv"), "writable file")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("rank", "--instruments", 3, "--limit", 2), "no ensemble of instruments"),
        (("etc", "tau Cet", "--band", "F662", "--time-s", 3600), "green_2, Far-Red"),
    ],
)
def test_what_a_table_cannot_do_is_refused_in_one_line(laplace, refuses, arguments, words):
    refuses((*arguments, "--instrument", "laplace.yaml"), words)


def test_images_of_a_table(laplace, done):
    """A file of images is not needed."""
    asked = ("paper_example", "--instrument", "laplace.yaml", "--band", "green_2")
    frames = ("--frames", 2, "--exposure-s", 0.01, "--out", "frames")
    assert "_SCI_" in done("simulate", *asked, *frames)[0]
    settings = ("--realisations", 2, "--fidelity", "quick", "--time-s", 3600, "--companions", "off", "--json")
    (band,) = json.loads(done("confirm", *asked, *settings)[0])["bands"]
    assert band["band"] == "green_2"
    assert band["status"] in ("ok", "saturated", "outside_field")


@pytest.fixture
def package(laplace):
    """The telescope with a yield input package for its coronagraph."""
    write(laplace / "yip")
    text = TELESCOPE.replace("laplace.csv", "yip, star_diameter_mas: 2.5")
    (laplace / "package.yaml").write_text(text, encoding="utf-8")
    return laplace


def test_a_yield_input_package_answers_about_a_star(package, done):
    """At 0.1 arcsec, 3.6 lambda/D in green: the light of a source in an exact aperture, linear between its offsets."""
    asked = ("etc", "47 UMa", "--instrument", "package.yaml", "--band", "green_2", "--time-s", 36000, "--json")
    answer = json.loads(done(*asked, "--contrast", 1e-7, "--separation-arcsec", 0.1)[0])["answers"][0]
    place = 0.1 / np.degrees(550e-9 / 4.1) / 3600.0

    def light(offset):
        aperture = CircularAperture((30.0 + offset / PIXEL, 30.0), RADIUS / PIXEL)
        return float(aperture_photometry(source(offset, 0.0, 30.0), aperture)["aperture_sum"][0])

    expected = np.interp(place, [3.5, 4.0], [light(3.5), light(4.0)])
    assert answer["core_throughput"] == pytest.approx(expected, rel=1e-3)
    assert answer["status"] == "ok"
    larger = json.loads(
        done(*asked, "--contrast", 1e-7, "--separation-arcsec", 0.1, "--set", "coronagraph.star_diameter_mas=5")[0]
    )
    assert larger["answers"][0]["value"] < answer["value"]
    beyond = json.loads(done(*asked, "--contrast", 1e-7, "--separation-arcsec", 0.18)[0])["answers"][0]
    assert (beyond["status"], beyond["value"]) == ("outside_field", None)


def test_what_was_read_of_a_package_or_a_table_is_shown(package, done):
    out, _ = done("instrument", "show", "package.yaml", "--key", "coronagraph.table", "--json")
    source_words = json.loads(out)["values"][0]["source"]
    for words in ("offax_psf.fits (13 offsets)", "stellar_intens.fits", "sky_trans.fits", "not used: the images"):
        assert words in source_words
    out, _ = done("instrument", "show", "laplace.yaml", "--key", "coronagraph.table", "--json")
    assert "raw_contrast from Raw contrast" in json.loads(out)["values"][0]["source"]


def test_a_star_wider_than_the_images_of_a_package_is_refused_in_one_line(package, refuses):
    wide = ("--set", "coronagraph.star_diameter_mas=50")
    refuses(("etc", "tau Cet", "--time-s", 3600, *wide, "--instrument", "package.yaml"), "0 to 0.2 lambda/D")


def test_a_package_without_one_of_its_files_is_refused_in_one_line(package, refuses):
    (package / "yip" / "sky_trans.fits").unlink()
    refuses(("etc", "tau Cet", "--instrument", "package.yaml", "--time-s", 3600), "without sky_trans.fits")


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("12;2e-9", "120;2e-9", "laplace.csv row 2 (90) column Core throughput"),
        ("12;2e-9", "12;dark", "laplace.csv row 2 (90) column Raw contrast"),
        ("Raw contrast", "Brightness", "raw_contrast"),
        ("[mas]", "[kg]", "unit"),
        ("90;", "60;", "every separation once"),
    ],
)
def test_a_bad_table_is_refused_in_one_line(laplace, refuses, old, new, words):
    (laplace / "laplace.csv").write_text(TABLE.replace(old, new, 1), encoding="utf-8")
    refuses(("etc", "tau Cet", "--instrument", "laplace.yaml", "--time-s", 3600), words)


def test_a_table_that_is_not_there_is_refused_in_one_line(laplace, refuses):
    (laplace / "laplace.csv").unlink()
    refuses(("etc", "tau Cet", "--instrument", "laplace.yaml", "--time-s", 3600), "coronagraph.table")
