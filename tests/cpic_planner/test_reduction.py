"""A run of ``cpic reduce``: a folder of files that another program wrote, told, resumed and checked."""

import json
import shutil

import numpy as np
import pytest
from astropy.io import fits

from cpic_core import InputError
from cpic_planner import read_level1, reduce_products
from cpic_planner.cli.main import main
from cpic_planner.jobs.chain import check_tree


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Return a folder of small bias, dark and science frames, with a truth and a file that is none of ours."""
    root, rng = tmp_path_factory.mktemp("level0"), np.random.default_rng(2)
    for kind, exposure_s, level in (("BIAS", 0.0, 0.0), ("DARK", 10.0, 1.0), ("SCI", 10.0, 101.0)):
        frames = np.rint(300.0 + (rng.poisson(level, (6, 40, 40)) + rng.normal(0.0, 5.0, (6, 40, 40))) / 2.0)
        header = {"OBSTYPE": kind, "EXPTIME": exposure_s, "GAIN": 2.0, "RDNOISE": 5.0, "EMGAIN": 1.0, "BIASLEV": 300.0}
        place = root / ("SCI" if kind == "SCI" else "CAL") / "1"
        place.mkdir(parents=True, exist_ok=True)
        hdu = fits.PrimaryHDU(frames.astype(np.uint16), header=fits.Header(header))
        hdu.writeto(place / f"CSST_CPIC_VIS_{kind}_1_X_L0_V01.fits")
    (root / "Truth").mkdir()
    shutil.copy(place / "CSST_CPIC_VIS_SCI_1_X_L0_V01.fits", root / "Truth" / "x_TRUTH.fits")
    fits.PrimaryHDU(np.zeros((4, 4))).writeto(root / "picture.fits")
    return root


def test_a_folder_is_reduced_resumed_and_checked(folder, tmp_path, capsys):
    out = tmp_path / "out"
    result = reduce_products(folder, out=out)
    (made,) = result.sequences
    assert made.file == "SCI/1/CSST_CPIC_VIS_SCI_1_X_L1_V01.fits"
    assert (made.n_frames, made.kind, sorted(one.kind for one in result.masters)) == (6, "SCI", ["BIAS", "DARK"])
    assert "picture.fits" in result.left_out[0]
    assert made.steps["dark"].startswith("dark_gain1_10s")
    level1 = read_level1(out / made.file)
    assert np.mean([frame.image_e.mean() for frame in level1.iter_frames()]) == pytest.approx(100.0, abs=1.0)
    counts = {"good": 0, "cosmic_ray": 0}
    for frame in level1.iter_frames():
        counts["good"] += int(np.count_nonzero(frame.mask == 0))
        counts["cosmic_ray"] += int(np.count_nonzero(frame.mask & 16))
    assert {key: made.mask_counts[key] for key in counts} == counts
    assert result.to_pandas()["file"].tolist() == [made.file]
    assert check_tree(out) == []
    assert main(["reduce", str(folder), "--out", str(out), "--json"]) == 0
    shown = capsys.readouterr()
    assert "reused 3 finished pieces" in shown.err
    assert (
        json.loads(shown.out)["sequences"][0]["file"]
        == made.file
        == json.loads((out / "reduction.json").read_text())["sequences"][0]["file"]
    )


def test_the_cost_is_told_without_work(folder, tmp_path, capsys):
    assert main(["reduce", str(folder), "--out", str(tmp_path / "none"), "--dry-run"]) == 0
    assert "1 sequence, 6 frames" in capsys.readouterr().out
    assert not (tmp_path / "none").exists()


def test_what_cannot_be_reduced_is_refused(folder, tmp_path):
    with pytest.raises(InputError, match=r"picture\.fits.*OBSTYPE|OBSTYPE.*picture\.fits"):
        reduce_products(folder / "picture.fits", out=tmp_path / "a")
    with pytest.raises(InputError, match="exists"):
        reduce_products(folder / "absent.fits", out=tmp_path / "a")
    with pytest.raises(InputError, match="other than bias"):
        reduce_products(folder / "CAL", out=tmp_path / "a")
    science = next(folder.glob("SCI/1/*.fits"))
    shutil.copy(science, tmp_path)
    with pytest.raises(InputError, match="same name"):
        reduce_products([science, tmp_path / science.name], out=tmp_path / "a")
