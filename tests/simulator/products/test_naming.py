import re
import subprocess
import sys

import numpy as np
import pytest
from astropy.wcs import WCS

from simulator import load_instrument, load_scene
from simulator.products import ProductName, checked_obsid, product_name, sequence_times
from simulator.products.sequence import (
    claim,
    clear_stale_parts,
    obsid_of,
    pointing_deg,
    sky_places,
    star_deg,
    temporary_folders,
)


class Stop(RuntimeError):
    pass


def below(root):
    return sorted(str(path.relative_to(root)) for path in root.rglob("*"))


def fill(root):
    for name in ("SCI/1/a.fits", "Params/4/V01/log.csv"):
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).write_text("x")


def guarded(root):
    return temporary_folders(
        [root / "SCI/1", root / "Params/4"], whole=root / "Params/4/V01", done=root / "SCI/1/b.fits"
    )


def failing(root, *steps):
    """Do something and fail."""
    with guarded(root):
        for step in steps:
            step()
        raise Stop


def test_what_was_made_goes_on_failure_only(tmp_path):
    root = tmp_path / "tree"
    with pytest.raises(Stop):
        failing(root, lambda: fill(root), (root / "SCI/1/a.fits").unlink)
    assert not root.exists()
    with guarded(root):
        fill(root)
    before = below(tmp_path)
    with pytest.raises(Stop):
        failing(root)
    assert below(tmp_path) == before


def test_files_of_others_stay(tmp_path):
    # Somebody was faster, and the parameters are theirs.
    with pytest.raises(Stop):
        failing(tmp_path, lambda: fill(tmp_path), (tmp_path / "SCI/1/b.fits").touch)
    assert "Params/4/V01/log.csv" in below(tmp_path)


def test_parts_of_the_dead_go_and_those_of_the_living_stay(tmp_path):
    path = tmp_path / "a.fits"
    mine, dead, other = (tmp_path / name for name in (".a.fits.1.part", ".a.fits.2.part", ".b.fits.1.part"))
    other.write_text("x")
    script = (
        "import sys\nfrom simulator.products.sequence import claim\n"
        f"file = open({str(dead)!r}, 'wb')\nclaim(file)\nprint('ready', flush=True)\nsys.stdin.read()"
    )
    with (
        subprocess.Popen([sys.executable, "-c", script], stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process,
        mine.open("wb") as file,
    ):
        assert process.stdout is not None
        assert process.stdout.readline() == b"ready\n"
        claim(file)
        clear_stale_parts(path)
        assert mine.exists()
        assert dead.exists()  # its writer lives
        process.kill()
        process.wait()
        clear_stale_parts(path)
        assert mine.exists()
        assert not dead.exists()
    clear_stale_parts(path)
    assert below(tmp_path) == [".b.fits.1.part"]


SCENE = load_scene("paper_example")


@pytest.mark.parametrize("roll", [0.0, 30.0, 215.0])
def test_places_are_those_of_the_world_coordinates(sequence, roll):
    one = sequence(roll_deg=roll)
    world = WCS({key: value for key, value in one.header.items() if key[:2] in ("CT", "CU", "CR", "CD")})
    x, y = np.array([0.0, 3.0, -5.0, 8.0]), np.array([0.0, -4.0, 1.0, 8.0])
    pixel = one.instrument.detector.pixel_scale_arcsec
    expected = world.pixel_to_world_values(one.star[0] + x / pixel, one.star[1] + y / pixel)
    found = sky_places(one, x, y)
    # a plane and a sphere differ by 1e-8 arcsec at 11 arcsec
    assert np.abs(np.subtract(found, expected)).max() * 3600 < 1e-6


def test_orientation_as_seen_on_the_sky(sequence):
    ra, dec = star_deg(sequence())
    # at roll 0 a source on the left is east: larger right ascension; up is north
    east = sky_places(sequence(roll_deg=0.0), -1.0, 0.0)
    north = sky_places(sequence(roll_deg=0.0), 0.0, 1.0)
    assert (east[0] - ra) * 3600 * np.cos(np.deg2rad(dec)) == pytest.approx(1.0, rel=1e-5)
    assert (north[1] - dec) * 3600 == pytest.approx(1.0, rel=1e-5)


def test_mask_and_star_part_when_the_star_is_offset(sequence):
    shifted = sequence(roll_deg=0.0, extra={"STAROFFX": 2.0, "STAROFFY": -1.0})
    ra, dec = star_deg(shifted)
    pointing = pointing_deg(shifted)
    # star right of the mask: the mask is east of the star
    assert (pointing[0] - ra) * 3600 * np.cos(np.deg2rad(dec)) == pytest.approx(2.0, rel=1e-4)
    assert (pointing[1] - dec) * 3600 == pytest.approx(1.0, rel=1e-4)
    assert pointing_deg(sequence()) == star_deg(sequence())


def test_without_coordinates_there_are_no_places(sequence):
    star = SCENE.cstar.model_copy(update={"ra_deg": None, "dec_deg": None})
    bare = sequence(scene=SCENE.model_copy(update={"cstar": star}), extra={"STAROFFX": 2.0})
    assert star_deg(bare) is pointing_deg(bare) is sky_places(bare, 1.0, 1.0) is None
    assert star_deg(sequence(scene=None)) is None


KINDS = {"SCI": ("SCI", "DSF", "CALS"), "CAL": ("BIAS", "DARK", "FLAT", "BKG", "LASER")}


def name_of(sequence, obsid=None):
    times = sequence_times(sequence.start_utc, sequence.exposure_s, sequence.readout_s, sequence.n_frames)
    return product_name(sequence, times, obsid)


@pytest.mark.parametrize("camera", ["VIS", "NIR"])
@pytest.mark.parametrize(("branch", "kind"), [(branch, kind) for branch, kinds in KINDS.items() for kind in kinds])
def test_name_and_folder_of_every_kind(kind_of, camera, branch, kind):
    name = name_of(kind_of(kind, camera), 40000000012)
    end = "20280304050609" if kind == "BIAS" else "20280304050639"
    assert name.file.parts == (
        branch,
        "61834",
        f"CSST_CPIC_{camera}_{kind}_20280304050607_{end}_40000000012_X_L0_V01.fits",
    )
    assert ProductName.parse(name.file.name, 61834) == name


def test_the_day_is_that_of_the_begin(sequence):
    late = name_of(sequence(start_utc="2028-03-04T23:59:59"))
    assert late.day == 61834
    assert late.end.startswith("20280305")


@pytest.mark.parametrize(
    "text",
    """
        x.fits CSST_CPIC_VIS_SCI_2028030405060_20280304050639_40000000012_X_L0_V01.fits
        CSST_CPIC_UV_SCI_20280304050607_20280304050639_40000000012_X_L0_V01.fits
        CSST_CPIC_VIS_SCIE_20280304050607_20280304050639_40000000012_X_L0_V01.fits
        CSST_CPIC_VIS_SCI_20280304050607_20280304050639_400000012_X_L0_V01.fits
        CSST_CPIC_VIS_SCI_20280304050607_20280304050639_40000000012_01_L0_V01.fits
        CSST_CPIC_VIS_SCI_20280304050607_20280304050639_40000000012_X_L1_V01.fits
        CSST_CPIC_VIS_SCI_20280304050607_20280304050639_40000000012_X_L0_V1.fits
        CSST_CPIC_VIS_SCI_20280304050607_20280304050639_40000000012_X_L0_V01.fits.gz
    """.split(),
)
def test_other_names_are_none(text):
    assert ProductName.parse(text) is None


def test_numbers_are_made_from_content(sequence):
    first = obsid_of(sequence())
    assert re.fullmatch(r"4\d{10}", first)
    assert obsid_of(sequence()) == first
    others = [
        sequence(seed=8),
        sequence(exposure_s=10.5),
        sequence(n_frames=4),
        sequence(em_gain=21.0),
        sequence(start_utc="2028-03-04T05:06:08"),
        sequence(roll_deg=31.0),
        sequence(kind="CALS"),
        sequence(extra={"ROLE": "reference"}),
        sequence(band="F520"),
        sequence(instrument=load_instrument({"detector": {"bias_adu": 201}})),
    ]
    assert len({first, *(obsid_of(other) for other in others)}) == 1 + len(others)
    longer = load_instrument({"mission": {"obsid_prefix": "4123"}})
    assert re.fullmatch(r"4123\d{7}", obsid_of(sequence(instrument=longer)))


def test_numbers_are_eleven_digits_of_the_instrument(refused):
    assert checked_obsid(40000000001, "4") == checked_obsid("40000000001", "4") == "40000000001"
    for wrong in (4, "4000000001", "10000000001", "4000000000x", "٤0000000001", 4e10, None, True, " 40000000001"):
        refused("obsid.*11 digits that begin with 4", checked_obsid, wrong, "4")


def test_version_of_a_product(sequence):
    second = load_instrument({"mission": {"product_version": 2}})
    assert name_of(sequence(instrument=second)).file.name.endswith("_X_L0_V02.fits")
