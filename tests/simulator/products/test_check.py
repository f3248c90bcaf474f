"""What the check of Level-0 products finds: keywords, pixels, names, trees, damage."""

import bz2
import gzip
import json
import lzma
import shutil
from pathlib import Path

import numpy as np
import pytest
import yaml
from astropy.io import fits

from simulator import load_instrument
from simulator.products import check_level0, write_level0

STEM = "CSST_CPIC_VIS_SCI_20280304050607_20280304050639_40000000012_X_L0_V01"


def changed(path, change, **options):
    """Change the units of a file; its checksums are right again afterwards."""
    with fits.open(path, **options) as units:
        change(units)
        units.writeto(path.with_suffix(".new"), checksum=True, output_verify="ignore")
    path.with_suffix(".new").replace(path)


def found(path, severity="error"):
    return [finding for finding in check_level0(path) if finding.severity == severity]


def only(path, keyword, *words, hdu=...):
    """The one error of a file: it names keyword, unit and the words."""
    findings = found(path)
    assert [finding.keyword for finding in findings] == [keyword], [str(finding) for finding in findings]
    assert all(word in findings[0].message for word in words), findings[0].message
    assert hdu is ... or findings[0].hdu == hdu
    return findings[0]


def test_good_products_have_no_error_as_file_and_as_tree(tree, good):
    assert check_level0(good) == check_level0(tree) == []


def test_whole_frames_have_no_finding_at_all(sequence, tmp_path):
    one = sequence(shape=(1050, 1080), star=(536.0, 514.0), n_frames=2)
    write_level0(one, tmp_path)
    assert check_level0(tmp_path) == []


def test_a_path_that_is_not_there_is_refused(refused, tmp_path):
    refused("path = .*nothing", check_level0, tmp_path / "nothing")


def test_a_finding_prints_file_unit_and_keyword(good):
    changed(good, lambda units: units[2].header.__delitem__("GAIN"))
    text = str(only(good, "GAIN", "missing", "GAIN1", hdu=2))
    assert text == f"error: {good}[2]: GAIN: is missing (or GAIN1)"


HEADERS = yaml.safe_load(Path(__file__).with_name("headers.yaml").read_text(encoding="utf-8"))


@pytest.mark.parametrize(("hdu", "keyword", "value", "word"), HEADERS["wrong"])
def test_wrong_keywords_are_named(good, hdu, keyword, value, word):
    def change(units):
        if value is None:
            del units[hdu].header[keyword]
        else:
            units[hdu].header[keyword] = value

    shutil.rmtree(good.parents[2] / "Truth")  # which disagrees too
    changed(good, change)
    findings = [f for f in found(good) if f.hdu == hdu]
    # a wrong scale or place may show in what is compared with it
    named = {"PIXSCALE": "CD1_1", "EXPBEG": "EXPEND", "EXPTIME": "EXPEND" if hdu else "EXPTIME", "READTIME": "EXPEND"}
    assert {f.keyword for f in findings} & {keyword, named.get(keyword)}, [str(f) for f in found(good)]
    assert any(word in f.message for f in findings)


def test_turned_mirrored_and_skewed_skies_are_named(good):
    def turned(units):
        for unit in units[1:]:
            unit.header["CD1_2"], unit.header["CD2_2"] = -unit.header["CD1_2"], unit.header["CD2_2"]
            unit.header["CD2_1"] = -unit.header["CD2_1"]

    shutil.rmtree(good.parents[2] / "Truth")  # which disagrees too
    changed(good, turned)
    assert {f.keyword for f in found(good)} == {"CD1_2"}
    assert all("330.000" in f.message for f in found(good))


def test_singular_world_coordinates_are_named(good):
    def flat(units):
        for key in ("CD1_1", "CD1_2", "CD2_1", "CD2_2"):
            units[1].header[key] = 0.0

    shutil.rmtree(good.parents[2] / "Truth")
    changed(good, flat)
    assert only(good, "CD1_1", "singular", hdu=1)


def test_other_spellings_are_accepted_and_have_to_agree(good):
    def respelled(units):
        header = units[0].header
        del header["OBSTYPE"], header["TARGET"]
        for unit in units:
            unit.header.rename_keyword("RA_OBJ", "OBJ_RA")
            unit.header.rename_keyword("DEC_OBJ", "OBJ_DEC")
        for unit in units[1:]:
            unit.header.rename_keyword("DETNAM", "DETECTOR")
            unit.header.rename_keyword("RDNOISE", "RDNOISE1")

    changed(good, respelled)
    assert found(good) == []
    # It follows the early profile, which has one more spelling of its own.
    assert {(f.keyword, f.message) for f in found(good, "warning")} == {("GAIN1", "is missing, GAIN stands for it")}
    changed(good, lambda units: units[0].header.set("OBSTYPE", "DSF"))
    assert {f.keyword for f in found(good)} == {"FILETYPE", "OBSTYPE"}


def test_pixels_above_the_converter_are_named(good, tree):
    def bright(units):
        units[2].data[3, 4] = 16384

    shutil.rmtree(tree / "Truth")
    changed(good, bright)
    only(good, "ADCBITS", "16384 ADU", "16383", hdu=2)


def test_signed_and_real_pixels_are_named(good, tree):
    shutil.rmtree(tree / "Truth")

    def signed(units):
        header = units[2].header.copy()
        for key in ("BZERO", "BSCALE"):
            header.remove(key, ignore_missing=True)
        units[2] = fits.ImageHDU(units[2].data.astype(np.int16), header)

    def real(units):
        header = units[3].header.copy()
        for key in ("BZERO", "BSCALE"):
            header.remove(key, ignore_missing=True)
        units[3] = fits.ImageHDU(units[3].data.astype(np.float32), header)

    changed(good, signed)
    only(good, "BZERO", "32768", hdu=2)
    changed(good, real)
    assert [(f.hdu, f.keyword) for f in found(good)] == [(2, "BZERO"), (3, "BITPIX")]


def test_images_of_other_shapes_and_kinds_are_named(good, tree):
    shutil.rmtree(tree / "Truth")

    def other(units):
        units[2] = fits.ImageHDU(np.zeros((24, 38), np.uint16), units[2].header)
        cube = units[3].header.copy()
        units[3] = fits.ImageHDU(np.zeros((2, 24, 40), np.uint16), cube)

    changed(good, other)
    assert [(f.hdu, f.keyword) for f in found(good)] == [(2, "NAXIS1"), (2, "OVERSCAN"), (3, "NAXIS")]
    changed(
        good, lambda units: units.__setitem__(1, fits.BinTableHDU.from_columns([fits.Column("A", "E", array=[1.0])]))
    )
    assert (1, "XTENSION") in [(f.hdu, f.keyword) for f in found(good)]


def test_a_keyword_that_stands_twice_is_named(good):
    changed(good, lambda units: units[2].header.append(("GAIN", 60.0)))
    only(good, "GAIN", "twice", hdu=2)


def test_a_card_that_cannot_be_read_is_named(good, tree):
    shutil.rmtree(tree / "Truth")
    data = good.read_bytes().replace(b"GAIN    =                 59.0", b"GAIN    =                 5..0", 1)
    good.write_bytes(data)
    findings = found(good)
    assert {(f.hdu, f.keyword) for f in findings} == {(1, "GAIN"), (1, "CHECKSUM")}
    assert any("cannot be read" in f.message for f in findings)


def test_missing_and_surplus_images_are_named(good):
    changed(good, lambda units: units.pop(2))
    assert {"NEXTEND", "NFRAME", "EXTVER"} <= {f.keyword for f in found(good)}
    changed(good, lambda units: [units.pop(1) for _ in range(2)])
    assert any(f.message == "has no image" for f in found(good))


def test_data_in_the_primary_unit_are_named(good):
    changed(good, lambda units: units.__setitem__(0, fits.PrimaryHDU(np.zeros((2, 2)), units[0].header)))
    assert any("primary unit" in f.message for f in found(good))


def test_missing_checksums_are_named(good):
    with fits.open(good) as units:
        for unit in units:
            for key in ("CHECKSUM", "DATASUM"):
                unit.header.remove(key)
        units.writeto(good.with_suffix(".new"))
    good.with_suffix(".new").replace(good)
    assert [(f.hdu, f.keyword) for f in found(good) if "missing" in f.message] == [
        (number, key) for number in range(4) for key in ("CHECKSUM", "DATASUM")
    ]


@pytest.mark.parametrize("name", ["image.fits", f"{STEM}.fit.fits", STEM.replace("_X_", "_01_") + ".fits"])
def test_other_names_are_named(good, name):
    other = good.rename(good.parent / name)
    assert any("no Level-0 name" in f.message for f in found(other))


def test_a_renamed_file_is_found_out(good):
    other = good.rename(good.with_name(STEM.replace("050607", "050606").replace("SCI_", "DSF_") + ".fits"))
    assert {"FILENAME", "OBSTYPE", "DATE-OBS"} <= {f.keyword for f in found(other)}
    backwards = other.rename(good.with_name(STEM.replace("20280304050639", "20270304050639") + ".fits"))
    assert any("ends before it starts" in f.message for f in found(backwards))


def test_a_file_in_the_wrong_folder_is_found(tree, good):
    moved = tree / "SCI" / "61835"
    good.parent.rename(moved)
    assert [f.keyword for f in found(moved / good.name)] == ["EXPSTART"]
    wrong = tree / "CAL" / "61834"
    wrong.parent.mkdir()
    moved.rename(wrong)
    assert [f.message for f in found(wrong / good.name)] == ["stands in CAL, SCI belongs in SCI"]


def test_truth_of_another_run_is_found(sequence, tree, good):
    write_level0(sequence(seed=8), tree.parent / "other", obsid=40000000012)
    truth = next((tree / "Truth").rglob("*.fits"))
    shutil.copy(next((tree.parent / "other" / "Truth").rglob("*.fits")), truth)
    findings = found(good)
    assert all(f.path == truth for f in findings)
    assert {f.keyword for f in findings} == {"SEED", "DATASUM"}


def test_truth_that_lacks_parts_is_found(tree, good):
    truth = next((tree / "Truth").rglob("*.fits"))
    raw = {"disable_image_compression": True}
    changed(truth, lambda units: units.pop(units.index_of(("MASK", 2))), **raw)
    assert any("2 masks for 3 images" in f.message for f in found(good))
    changed(truth, lambda units: [units.pop(units.index_of(name)) for name in ("EXPECTED_E", "FRAMES")], **raw)
    assert {"has no EXPECTED_E", "has no FRAMES"} <= {f.message for f in found(good)}


def test_numbers_used_twice_are_found_in_a_tree(sequence, tree):
    write_level0(sequence(start_utc="2028-04-01"), tree.parent / "other", obsid=40000000012)
    shutil.copytree(tree.parent / "other", tree, dirs_exist_ok=True)
    (finding,) = (f for f in found(tree) if f.keyword == "OBSID")
    assert STEM in finding.message
    assert "20280401" in finding.path.name


def test_litter_and_orphans_are_warnings(tree, good):
    (good.parent / ".x.fits.abc.part").write_bytes(b"")
    (good.parent / "notes.txt").write_text("x")
    good.unlink()
    shutil.rmtree(tree / "Params")
    warnings = " ".join(f.message for f in found(tree, "warning"))
    assert "interrupted" in warnings
    assert "does not belong" in warnings
    assert "truth of a Level-0 file that is not there" in warnings
    assert [f.message for f in found(tree)] == ["has no Level-0 file"]


def test_missing_parameters_are_warned_of(tree, good):
    shutil.rmtree(tree / "Params")
    assert any("configuration.json" in f.message for f in found(good, "warning"))


def test_a_file_outside_a_tree_is_checked_on_its_own(good, tmp_path):
    alone = shutil.copy(good, tmp_path / good.name)
    assert found(alone) == []
    assert check_level0(alone) == []


def test_the_current_folder_is_a_tree_too(tree, good, monkeypatch):
    monkeypatch.chdir(good.parent)
    assert found(".") == found(good.name) == []
    (tree / "Params" / "40000000012" / "V01" / "keywords.yaml").unlink()
    assert any("keywords.yaml" in f.message for f in found(good.name, "warning"))


@pytest.mark.parametrize(("gone", "stands"), [("OBJECT", "TARGET"), ("TARGET", "OBJECT"), ("OBSTYPE", "FILETYPE")])
def test_a_spelling_of_the_profile_that_is_gone_is_warned_of(tree, good, gone, stands):
    changed(good, lambda units: units[0].header.__delitem__(gone))
    assert found(good) == []
    assert [(f.keyword, f.hdu, f.message) for f in found(good, "warning")] == [
        (gone, 0, f"is missing, {stands} stands for it")
    ]


def test_files_of_another_profile_have_no_finding(sequence, tmp_path):
    early = load_instrument({"mission": {"keyword_profile": "early"}})
    write_level0(sequence(instrument=early), tmp_path)
    assert check_level0(tmp_path) == []


def test_missing_truth_is_warned_of_unless_the_tree_has_none(tree, good):
    truth = next((tree / "Truth").rglob("*.fits"))
    truth.unlink()
    (finding,) = check_level0(tree)
    assert (finding.severity, finding.path) == ("warning", good)
    assert truth.name in finding.message
    shutil.rmtree(tree / "Truth")
    assert check_level0(tree) == []


def test_frames_of_any_size_are_compared_with_what_their_header_names(sequence, tmp_path):
    good = write_level0(sequence(shape=(30, 50)), tmp_path / "a")
    assert check_level0(good) == []
    alone = shutil.copy(good, tmp_path / good.name)
    changed(alone, lambda units: [unit.header.__delitem__("OVERSCAN") for unit in units[1:]])
    (finding,) = check_level0(alone)
    assert (finding.severity, finding.keyword, finding.hdu) == ("warning", "NAXIS1", 1)
    assert "50 x 30 pixels, 1500" in finding.message
    assert "1380" in finding.message


def test_frames_of_another_size_than_their_configuration_are_named(tree, good):
    shutil.rmtree(tree / "Truth")
    path = tree / "Params" / "40000000012" / "V01" / "configuration.json"
    configuration = json.loads(path.read_text())
    configuration["sequence"]["shape"] = [1050, 1080]
    path.write_text(json.dumps(configuration))
    changed_file, size = found(good)
    assert (changed_file.path, size.path, size.keyword, size.hdu) == (path, good, "NAXIS1", 1)
    assert "40 x 24" in size.message
    assert "1080 x 1050" in size.message


@pytest.mark.parametrize("place", ["data", "header"])
def test_a_flipped_bit_is_found(good, tree, place):
    shutil.rmtree(tree / "Truth")
    with fits.open(good) as units:
        info = units[2].fileinfo()
    data = bytearray(good.read_bytes())
    if place == "data":
        data[info["datLoc"] + 5] ^= 1
    else:
        spot = data.index(b"MYKEY", info["hdrLoc"])
        data[spot : spot + 5] = b"MYKEZ"
    good.write_bytes(bytes(data))
    findings = found(good)
    expected = {"CHECKSUM", "DATASUM"} if place == "data" else {"CHECKSUM"}
    assert {(f.hdu, f.keyword) for f in findings} == {(2, key) for key in expected}


@pytest.mark.parametrize("keep", [0, 100, 2880, 10000, -2880, -100])
def test_truncated_files_are_named(good, keep):
    data = good.read_bytes()
    good.write_bytes(data[:keep])
    findings = found(good)
    assert findings
    texts = " ".join(f.message for f in findings)
    assert "truncated" in texts or "not readable as FITS" in texts or "images" in texts, texts
    assert all(f.path in (good, *good.parents[2].rglob("*_TRUTH.fits")) for f in findings)


def test_surplus_bytes_are_named(good):
    good.write_bytes(good.read_bytes() + bytes(2880))
    assert any("longer than described by" in f.message for f in found(good))


@pytest.mark.parametrize("content", [b"", b"hello", b"\x00" * 5760, b"SIMPLE  =                    T" + b" " * 2850])
def test_what_is_not_fits_is_named(good, content):
    good.write_bytes(content)
    assert found(good)
    assert all(f.path == good for f in found(good))


def test_damaged_truth_is_found(tree, good):
    truth = next((tree / "Truth").rglob("*.fits"))
    data = truth.read_bytes()
    with fits.open(truth, disable_image_compression=True) as units:
        mask, sources = units["MASK", 2].fileinfo(), units["SOURCES"].fileinfo()
        number = units.index_of(("MASK", 2))
    for info, hdu in ((mask, number), (sources, 3)):
        damaged = bytearray(data)
        damaged[info["datLoc"] + 11] ^= 1
        truth.write_bytes(bytes(damaged))
        assert {(f.path, f.hdu, f.keyword) for f in found(good)} == {(truth, hdu, "CHECKSUM"), (truth, hdu, "DATASUM")}
    truth.write_bytes(data[:-2880])
    assert any("truncated" in f.message or "FRAMES" in f.message for f in found(good))


@pytest.mark.parametrize("seed", range(25))
def test_no_damage_stops_the_check(tree, good, seed):
    rng = np.random.default_rng(seed)
    for path in (good, next((tree / "Truth").rglob("*.fits"))):
        data = bytearray(path.read_bytes())
        # most of a small file is headers
        for spot in rng.integers(0, len(data), 6):
            data[spot] = rng.integers(32, 127)
        path.write_bytes(bytes(data[: rng.integers(len(data) // 2, 2 * len(data))]))
    assert found(good)
    assert found(tree)


PACKERS = {".gz": (gzip.compress, "gunzip"), ".bz2": (bz2.compress, "bunzip2"), ".xz": (lzma.compress, "unxz")}


@pytest.mark.parametrize("ending", [*PACKERS, ".fz"])
@pytest.mark.parametrize("renamed", [False, True])
def test_compressed_files_are_called_so(good, tree, ending, renamed):
    shutil.rmtree(tree / "Truth")
    shutil.rmtree(tree / "Params")
    packed = good.with_name(good.name + ending)
    if ending == ".fz":
        with fits.open(good) as units:
            images = [fits.CompImageHDU(unit.data, unit.header) for unit in units[1:]]
            fits.HDUList([units[0], *images]).writeto(packed)
    else:
        packed.write_bytes(PACKERS[ending][0](good.read_bytes()))
    good.unlink()
    packed = packed.rename(good) if renamed else packed
    program = "funpack" if ending == ".fz" else PACKERS[ending][1]
    for place in (packed, tree):
        assert [f.message for f in found(place)] == [f"is compressed: unpack it with {program}"]


@pytest.mark.parametrize("more", [1, 4, 2880, 5000])
def test_bytes_too_many_are_not_called_truncated(good, more):
    size = good.stat().st_size
    with good.open("ab") as file:
        file.write(bytes(more))
    messages = [f.message for f in found(good)]
    assert f"is longer than described by {more} bytes: {size + more} bytes, {size} are described" in messages
    assert not [text for text in messages if "truncated" in text]
