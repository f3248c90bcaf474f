import csv
import json
import os
import tracemalloc
import weakref
from pathlib import Path

import numpy as np
import pytest
import yaml
from astropy.io import fits
from astropy.wcs import WCS

from cpic_core import InputError
from simulator import load_instrument, load_scene
from simulator.products import check_level0, write_level0
from simulator.products.keywords import KEYWORD_FILE, load_keywords

HEADERS = yaml.safe_load(Path(__file__).with_name("headers.yaml").read_text(encoding="utf-8"))
SCENE = load_scene("paper_example")
VIS_KINDS = ("SCI", "DSF", "CALS", "BIAS", "DARK", "FLAT", "BKG", "LASER")


def opened(path):
    """Open with checksums; warnings are errors here."""
    found = fits.open(path, checksum=True)
    found.verify("exception")
    return found


def files(folder):
    return sorted(str(path.relative_to(folder)) for path in Path(folder).rglob("*") if path.is_file())


def errors(path):
    return [str(finding) for finding in check_level0(path) if finding.severity == "error"]


def without_coordinates(scene=SCENE):
    return scene.model_copy(update={"cstar": scene.cstar.model_copy(update={"ra_deg": None, "dec_deg": None})})


def test_tree_of_a_science_sequence(sequence, tmp_path):
    path = write_level0(sequence(), tmp_path / "new" / "tree", obsid=40000000012)
    root = tmp_path / "new" / "tree"
    stem = "CSST_CPIC_VIS_SCI_20280304050607_20280304050639_40000000012_X_L0_V01"
    assert path == root / "SCI" / "61834" / f"{stem}.fits"
    assert files(root) == [
        "Params/40000000012/V01/attitude.csv",
        "Params/40000000012/V01/configuration.json",
        "Params/40000000012/V01/keywords.yaml",
        "Params/40000000012/V01/temperature.csv",
        f"SCI/61834/{stem}.fits",
        f"Truth/61834/{stem}_TRUTH.fits",
    ]
    umask = os.umask(0)
    os.umask(umask)
    assert path.stat().st_mode & 0o777 == 0o666 & ~umask
    assert errors(root) == []


def test_frames_come_back_bit_for_bit(sequence, tmp_path):
    one = sequence()
    with opened(write_level0(one, tmp_path)) as units:
        assert len(units) == one.n_frames + 1
        assert units[0].data is None
        for number, unit in enumerate(units[1:], start=1):
            assert (unit.name, unit.ver) == ("IMAGE", number)
            assert (unit.header["BITPIX"], unit.header["BZERO"]) == (16, 32768)
            assert unit.data.dtype == np.uint16
            assert np.array_equal(unit.data, one.adu(number - 1))


def test_extreme_pixels_come_back(sequence, tmp_path):
    class Extreme(type(sequence())):
        def adu(self, index):
            return np.resize(np.array([0, 1, 32767, 32768, 32769, 65535], np.uint16), self.shape)

    instrument = load_instrument({"detector": {"adc_bits": 16}})
    one = Extreme(instrument=instrument)
    with opened(write_level0(one, tmp_path)) as units:
        assert np.array_equal(units[2].data, one.adu(1))
    assert errors(tmp_path) == []


def test_headers_say_what_the_sequence_is(sequence, tmp_path):
    one = sequence(calibration_files=("flat.fits", "/a/very/long/" + "path/" * 30 + "dark.fits"))
    path = write_level0(one, tmp_path, obsid="40000000012")
    with opened(path) as units:
        primary, image = units[0].header, units[3].header
    expected = HEADERS["primary"] | {
        "FILENAME": path.name,
        "CONFHASH": one.instrument.content_hash,
        "SCENHASH": one.scene.content_hash,
        "CALF002": one.calibration_files[1],
    }
    assert {key: primary[key] for key in expected} == expected
    assert primary["EFF002"] == f"skipped | a long one | {one.ledger[1].reason}"
    assert primary["RA_OBJ"] == pytest.approx(SCENE.cstar.ra_deg, abs=1e-9)
    assert primary["EXPSTART"] == pytest.approx(61834 + (5 * 3600 + 6 * 60 + 7.25) / 86400, abs=1e-9)
    assert np.hypot(primary["POSI0_X"], np.hypot(primary["POSI0_Y"], primary["POSI0_Z"])) == pytest.approx(6778.137)
    assert np.hypot(primary["VELO1_X"], np.hypot(primary["VELO1_Y"], primary["VELO1_Z"])) == pytest.approx(
        7.67, abs=0.01
    )
    assert all(0 <= primary[f"{key}{end}"] <= 180 for key in ("SUNANGL", "MOONANG") for end in "01")
    assert "modelled" in primary.comments["TEL_ALT0"]
    expected = HEADERS["image"]
    assert {key: image[key] for key in expected} == expected
    assert (image["EXPEND"] - image["EXPBEG"]) * 86400 == pytest.approx(10.0, abs=1e-5)
    assert (image["EXPBEG"] - primary["EXPSTART"]) * 86400 == pytest.approx(22.2, abs=1e-5)
    assert image["EXPEND"] == primary["EXPEND"]
    assert image["PRESCAN"] == "[1:4,1:24]"
    assert "DARKREG4" not in image  # a section of no pixels
    assert 20 < image["EMVOLT"] < 50


@pytest.mark.parametrize("camera", ["VIS", "NIR"])
@pytest.mark.parametrize("kind", VIS_KINDS)
def test_every_kind_of_both_cameras_passes_the_check(kind_of, kind, camera, tmp_path):
    one = kind_of(kind, camera)
    path = write_level0(one, tmp_path)
    assert errors(tmp_path) == []
    science = kind in ("SCI", "DSF", "CALS")
    with opened(path) as units:
        assert units[0].header["OBSTYPE"] == kind
        assert ("RA_OBJ" in units[0].header) == science
        assert ("CTYPE1" in units[1].header) == science
        assert ("EMGAIN" in units[1].header) == (camera == "VIS")
        assert units[0].header["OBJECT"] == (SCENE.name if science else kind)


@pytest.mark.parametrize("profile", ["csst", "early"])
@pytest.mark.parametrize(("roll_deg", "parity"), [(0.0, -1), (77.0, -1), (77.0, 1)])
def test_world_coordinates_find_the_planet_of_the_truth(sequence, tmp_path, roll_deg, parity, profile):
    instrument = load_instrument({"mission": {"keyword_profile": profile}, "detector": {"parity": parity}})
    planet = SCENE.planets[0].model_copy(update={"pa_deg": 90.0})
    scene = SCENE.model_copy(update={"planets": (planet,)})
    one = sequence(roll_deg=roll_deg, scene=scene, instrument=instrument, parity=parity)
    path = write_level0(one, tmp_path)
    with opened(path) as units, opened(next(tmp_path.glob("Truth/*/*.fits"))) as truth:
        primary, world = units[0].header, WCS(units[1].header).celestial
        assert (primary["RA"], primary["DEC"]) == (units[1].header["RA"], units[1].header["DEC"])
        row = truth["SOURCES"].data[1]
        assert (row["x_arcsec"] < 0) or roll_deg > 0
    ra, dec = world.pixel_to_world_values(row["x_pixel"], row["y_pixel"])
    assert (ra - row["ra_deg"]) * 3600 == pytest.approx(0.0, abs=1e-6)
    assert (dec - row["dec_deg"]) * 3600 == pytest.approx(0.0, abs=1e-6)
    # PA 90 is due east: 0.65 arcsec at a larger right ascension and the declination of the star
    assert (ra - primary["RA"]) * 3600 * np.cos(np.deg2rad(primary["DEC"])) == pytest.approx(0.65, rel=1e-5)
    assert (dec - primary["DEC"]) * 3600 == pytest.approx(0.0, abs=2e-5)
    assert errors(tmp_path) == []


@pytest.mark.parametrize(("camera", "said"), [("VIS", "(adu - BIASLEV) * GAIN / EMGAIN"), ("NIR", "* GAIN")])
def test_headers_say_how_counts_become_electrons(kind_of, camera, said, tmp_path):
    one = kind_of("SCI", camera)
    with opened(write_level0(one, tmp_path)) as units:
        for unit in units:
            assert str(unit.header["COMMENT"][0]).endswith(said)
        header = units[1].header
        assert header["EPERADU"] == header["GAIN"] / header.get("EMGAIN", 1.0)
        if camera == "VIS":
            # the electrons of the sequence are those in the pixels, its register multiplies them
            electrons = (one.expected - header["BIASLEV"]) * header["EPERADU"]
            assert electrons == pytest.approx(one.expected_e)


def test_a_target_without_coordinates(sequence, tmp_path):
    one = sequence(scene=without_coordinates())
    with opened(write_level0(one, tmp_path)) as units:
        assert not {"RA", "RA_OBJ", "RA_PNT0", "SUNANGL0"} & set(units[0].header)
        assert units[1].header["CTYPE1"] == "EAST"
        assert "no coordinates of the star" in str(units[1].header["COMMENT"])
        assert "RADESYS" not in units[1].header
        WCS(units[1].header)
    assert errors(tmp_path) == []


def test_names_in_other_alphabets(sequence, tmp_path):
    scene = SCENE.model_copy(update={"name": "半人马座 α B"})
    with opened(write_level0(sequence(scene=scene), tmp_path)) as units:
        text = units[0].header["OBJECT"]
    assert text.encode().decode("unicode_escape") == scene.name
    assert errors(tmp_path) == []


def test_other_spellings_are_a_setting(sequence, tmp_path):
    early = load_instrument({"mission": {"keyword_profile": "early"}})
    with opened(write_level0(sequence(instrument=early), tmp_path)) as units:
        assert units[0].header["FILETYPE"] == "SCI"
        assert units[0].header["OBJ_RA"] == pytest.approx(SCENE.cstar.ra_deg)
        assert units[1].header["DETECTOR"] == "VIS"
        assert units[1].header["GAIN1"] == 59.0
        assert not {"OBSTYPE", "RA_OBJ"} & set(units[0].header)
    assert errors(tmp_path) == []


def test_supplied_keywords_win_over_the_configuration_but_not_over_the_writer(sequence, tmp_path):
    one = sequence(
        extra={"RDNOISE": 99.0, "NFRAME": 1000, "OBJ_RA": 12.5, "CCDLABEL": "EM1", "IWA": None, "RADESYS": "FK5"}
    )
    with opened(write_level0(one, tmp_path)) as units:
        assert units[1].header["RDNOISE"] == 99.0
        assert units[1].header["CCDLABEL"] == "EM1"
        assert units[1].header["RADESYS"] == "FK5"
        assert units[0].header["NFRAME"] == 3
        assert units[0].header["RA_OBJ"] == 12.5
        assert "IWA" not in units[0].header


def test_two_writes_give_the_same_bytes(sequence, tmp_path):
    first, second = (write_level0(sequence(), tmp_path / name) for name in "ab")
    assert files(tmp_path / "a") == files(tmp_path / "b")
    for name in files(tmp_path / "a"):
        assert (tmp_path / "a" / name).read_bytes() == (tmp_path / "b" / name).read_bytes(), name
    assert first.name == second.name


def test_nothing_is_overwritten_unasked(sequence, tmp_path):
    one = sequence()
    path = write_level0(one, tmp_path)
    before = {name: (tmp_path / name).read_bytes() for name in files(tmp_path)}
    again = sequence()
    with pytest.raises(InputError) as refused:
        write_level0(again, tmp_path)
    assert str(path) in str(refused.value)
    assert "overwrite=True" in str(refused.value)
    assert again.made == []  # refused before any frame is made
    assert {name: (tmp_path / name).read_bytes() for name in files(tmp_path)} == before
    assert write_level0(sequence(seed=8), tmp_path, obsid=path.name.split("_")[6], overwrite=True) == path
    with opened(path) as units:
        assert units[0].header["SEED"] == 8
    assert errors(tmp_path) == []


def test_a_file_that_appears_while_another_is_written_is_kept(refused, sequence, tmp_path):
    class Slow(type(sequence())):
        def iter_full_frames(self):
            yield from super().iter_full_frames()
            write_level0(sequence(extra={"OTHER": 1}), tmp_path, obsid=40000000001)

    refused("file", write_level0, Slow(), tmp_path, obsid=40000000001)
    (path,) = (tmp_path / "SCI").rglob("*.fits")
    with opened(path) as units:
        assert units[1].header["OTHER"] == 1
    assert not list(tmp_path.rglob("*.part"))


def test_stale_truth_goes_when_a_file_is_replaced_without_truth(sequence, tmp_path):
    write_level0(sequence(), tmp_path)
    assert list((tmp_path / "Truth").rglob("*.fits"))
    write_level0(sequence(), tmp_path, overwrite=True, truth=False)
    assert not list((tmp_path / "Truth").rglob("*.fits"))
    assert errors(tmp_path) == []


def test_a_number_belongs_to_one_observation(sequence, tmp_path):
    path = write_level0(sequence(), tmp_path, obsid=40000000012)
    with pytest.raises(InputError) as refused:
        write_level0(sequence(start_utc="2028-05-01"), tmp_path, obsid=40000000012)
    assert "obsid = 40000000012" in str(refused.value)
    assert str(path) in str(refused.value)
    # another version of the same observation has the same number
    second = load_instrument({"mission": {"product_version": 2}})
    write_level0(sequence(instrument=second), tmp_path, obsid=40000000012)
    assert errors(tmp_path) == []


class Broken(RuntimeError):
    pass


def test_a_sequence_that_fails_leaves_no_file(sequence, tmp_path):
    class Faulty(type(sequence())):
        def iter_full_frames(self):
            yield self.frame(0)
            raise Broken

    with pytest.raises(Broken):
        write_level0(Faulty(), tmp_path)
    assert files(tmp_path) == []
    write_level0(sequence(), tmp_path)
    assert errors(tmp_path) == []


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"start_utc": "tomorrow"}, ("start_utc = tomorrow",)),
        ({"extra": {"GAIN": "high"}}, ("header.GAIN = high", "float")),
    ],
)
def test_bad_sequences_are_refused_before_a_frame_is_made(sequence, tmp_path, values, words):
    one = sequence(**values)
    with pytest.raises(InputError) as refused:
        write_level0(one, tmp_path)
    assert all(word in str(refused.value) for word in words), str(refused.value)
    assert one.made == []
    assert files(tmp_path) == []


def test_out_dir_that_is_a_file_is_refused(refused, sequence, tmp_path):
    (tmp_path / "file").write_text("x")
    refused("out_dir", write_level0, sequence(), tmp_path / "file")


def test_many_frames_stream(sequence, tmp_path):
    count, told, alive, most = 200, [], weakref.WeakSet(), []

    class Counted(type(sequence())):
        def frame(self, index):
            made = super().frame(index)
            alive.add(made)
            most.append(len(alive))
            return made

    one = Counted(n_frames=count, exposure_s=0.01)
    path = write_level0(one, tmp_path, progress=lambda done, total: told.append((done, total)))
    assert told == [(done, count) for done in range(1, count + 1)]
    assert max(most) <= 2
    with opened(path) as units:
        assert len(units) == count + 1
        assert np.array_equal(units[count].data, one.adu(count - 1))


def test_files_are_not_put_together_in_memory(sequence, tmp_path):
    one = sequence(n_frames=100, shape=(200, 300))
    write_level0(sequence(seed=8), tmp_path)  # what is loaded once
    tracemalloc.start()
    path = write_level0(one, tmp_path)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 0.3 * path.stat().st_size


def test_configuration_makes_the_same_instrument_and_scene_again(sequence, tmp_path):
    mine = load_instrument({"detector": {"read_noise_e": 123}, "name": "mine"})
    one = sequence(instrument=mine)
    write_level0(one, tmp_path, obsid=40000000012)
    folder = tmp_path / "Params" / "40000000012" / "V01"
    tree = json.loads((folder / "configuration.json").read_text())
    assert load_instrument(tree["instrument"]).content_hash == mine.content_hash == tree["configuration_hash"]
    assert load_scene(tree["scene"]).content_hash == one.scene.content_hash
    assert tree["sequence"]["start_utc"] == "2028-03-04T05:06:07.250000"
    assert tree["sequence"]["exposure_s"] == 10.0
    assert tree["provenance"]["detector.read_noise_e"]["source"] == "user"
    assert [row["effect"] for row in tree["effects"]] == ["photon noise", "a long one"]
    assert tree["file"].endswith("40000000012_X_L0_V01.fits")
    assert (folder / "keywords.yaml").read_bytes() == KEYWORD_FILE.read_bytes()


def test_logs_have_a_row_for_every_begin_and_the_end(sequence, tmp_path):
    path = write_level0(sequence(), tmp_path, obsid=40000000012)
    folder = tmp_path / "Params" / "40000000012" / "V01"
    rows = list(csv.DictReader((folder / "attitude.csv").read_text().splitlines()))
    warmth = list(csv.DictReader((folder / "temperature.csv").read_text().splitlines()))
    assert len(rows) == len(warmth) == 4
    assert {row["detector_k"] for row in warmth} == {"193.0"}
    with opened(path) as units:
        header = units[0].header
    for row, end in ((rows[0], "0"), (rows[-1], "1")):
        assert float(row["ra_deg"]) == pytest.approx(header[f"RA_PNT{end}"], abs=1e-8)
        assert float(row["x_km"]) == pytest.approx(header[f"POSI{end}_X"], abs=1e-5)
        assert float(row["sun_deg"]) == pytest.approx(header[f"SUNANGL{end}"], abs=1e-5)
        assert float(row["limb_deg"]) == pytest.approx(header[f"TEL_ALT{end}"], abs=1e-5)
    assert (rows[0]["utc"], rows[-1]["utc"]) == (header["DATE-OBS"], header["DATE-END"])


def test_every_keyword_that_is_written_stands_in_its_place(sequence, tmp_path):
    table = load_keywords()
    with opened(write_level0(sequence(), tmp_path)) as units:
        for unit, homes in ((units[0], ("primary", "both")), (units[1], ("image", "both"))):
            for key in unit.header:
                keyword = table.keywords.get(table.canonical(key))
                assert keyword is None or keyword.hdu in homes, key


@pytest.mark.parametrize(
    ("start", "exposure_s", "readout_s"),
    [
        ("2016-12-31T23:59:55", 3.0, 0.5),
        ("2016-12-31T23:59:60.25", 0.0, 0.0),
        ("2031-06-30T23:59:59.9999996", 300.0, 1.1),
        ("2099-12-31", 1e-6, 0.0),
        ("2028-02-28T12:00:00", 86400.0, 10.0),
    ],
)
def test_times_of_all_sorts_agree_with_themselves(sequence, tmp_path, start, exposure_s, readout_s):
    write_level0(sequence(start_utc=start, exposure_s=exposure_s, readout_s=readout_s), tmp_path)
    assert errors(tmp_path) == []


def test_level_of_the_bias_is_that_of_its_map(sequence, tmp_path):
    hdu = fits.PrimaryHDU(np.full((1050, 1080), 321.0))
    hdu.header["BUNIT"] = "adu"
    hdu.writeto(tmp_path / "bias.fits")
    files = {"detector": {"calibration_files": {"bias": str(tmp_path / "bias.fits")}}}
    with opened(write_level0(sequence(instrument=load_instrument(files)), tmp_path)) as units:
        assert units[1].header["BIASLEV"] == 321.0
