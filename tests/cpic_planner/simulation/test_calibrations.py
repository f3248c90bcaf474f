"""A programme with all that its reduction needs."""

import json

import numpy as np
import pytest
from astropy.io import fits

from cpic_planner.jobs import check_tree
from cpic_planner.simulation import simulate, simulation_from, with_calibrations
from cpic_planner.validation import calibrated_cube
from simulator import load_instrument, observe
from simulator.config import load_simulation
from simulator.products import check_level0

INSTRUMENT = {"detector": {"n_columns": 236, "n_rows": 206, "star_column": 118, "star_row": 100}}
SCENE = {"name": "star", "cstar": {"v_mag": 2.0, "teff_k": 5200, "ra": 10, "dec": 20}}
VISITS = {"band": "F520", "exposure_s": (30,), "em_gain": (20,), "frames": 2, "fidelity": "quick"}
PLACE = (68 * 0.016153, 60 * 0.016153)


def planned(**settings):
    return simulation_from(
        [SCENE], settings=VISITS | settings, instrument=INSTRUMENT, calibration_frames=3, off_mask_arcsec=PLACE
    )[0]


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    out = tmp_path_factory.mktemp("programme") / "out"
    simulate(planned(), out)
    return out, json.loads((out / "programme.json").read_text())


def test_every_band_gain_and_exposure_has_its_calibrations():
    entries = planned(band="F520,F662".split(","), em_gain=(20.0, 300.0), exposure_s=(10.0, 30.0)).sequences
    found = [
        (entry.kind, *step, entry.frames) for entry in entries[1:] for step in entry.grid() if entry.kind != "CALS"
    ]
    assert found == [
        *(("BIAS", "", 0.0, gain, 3) for gain in (1.0, 20.0, 300.0)),
        *(("DARK", "", exposure_s, gain, 3) for exposure_s in (10.0, 30.0) for gain in (20.0, 300.0)),
        *(("FLAT", band, 1.0, 1.0, 3) for band in ("F520", "F662")),
    ]
    stars = [(*entry.band, *entry.em_gain) for entry in entries if entry.kind == "CALS"]
    assert stars == [(band, gain) for band in ("F520", "F662") for gain in (20.0, 300.0)]
    assert entries[0].references == 1


def test_the_star_off_the_mask_is_bright_and_nowhere_saturated(made):
    out, programme = made
    row = next(row for row in programme["calibrations"] if row["kind"] == "CALS")
    with fits.open(out / row["file"]) as units:
        header = units[1].header
        frames = np.array([unit.data.astype(float) for unit in units[1:]])
        counts = [[unit.header[key] for key in ("NSAT", "NREGSAT", "NCLIP")] for unit in units[1:]]
    assert np.array(counts).sum() == 0
    image = frames.mean(axis=0) - header["BIASLEV"]
    peak = np.unravel_index(image.argmax(), image.shape)
    # half of the register, which at this gain holds least; the noise of three frames and two digits of the exposure
    assert 0.4 < image.max() * header["GAIN"] / 730_000 < 0.53
    assert np.hypot(peak[1] - row["star_x_pixel"], peak[0] - row["star_y_pixel"]) < 1
    assert (row["star_x_pixel"] - 118) * header["PIXSCALE"] == pytest.approx(PLACE[0])


def test_the_list_says_what_each_file_is_and_is_for(made):
    out, programme = made
    assert [item for item in check_level0(out) if item.severity == "error"] == []
    headers = {}
    for row in [*programme["sequences"], *programme["calibrations"]]:
        with fits.open(out / row["file"]) as units:
            headers[row["file"]] = dict(units[1].header) | dict(units[0].header)
    for file, row in ((row["file"], row) for row in [*programme["sequences"], *programme["calibrations"]]):
        header = headers[file]
        if row["star_x_pixel"] is not None:
            assert (row["star_x_pixel"] + 1, row["star_y_pixel"] + 1) == (header["CRPIX1"], header["CRPIX2"])
            assert row["roll_deg"] == header["POS_ANG1"]
        same = {"bias": ("EMGAIN",), "dark": ("EMGAIN",), "flat": ("FILTER",), "star": ("FILTER", "EMGAIN", "OBJECT")}
        for key, names in same.items():
            kind = "CALS" if key == "star" else key.upper()
            if row[key] is None:
                assert header["OBSTYPE"] not in ("SCI", "CALS") or (key, header["OBSTYPE"]) == ("star", "CALS")
                continue
            assert headers[row[key]]["OBSTYPE"] == kind
            assert [headers[row[key]][name] for name in names] == [header[name] for name in names]
    visit = programme["sequences"][0]
    assert headers[visit["dark"]]["EXPTIME"] == headers[visit["file"]]["EXPTIME"]


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"n_frames": 7}, "NFRAME: is 3, programme.json says 7"),
        ({"file": "CAL/nowhere.fits"}, "lists CAL/nowhere.fits, which is no Level-0 file"),
    ],
)
def test_a_list_that_is_not_that_of_the_calibrations_is_found(made, change, said):
    out, programme = made
    rows = [programme["calibrations"][0] | change, *programme["calibrations"][1:]]
    text = (out / "programme.json").read_text()
    (out / "programme.json").write_text(json.dumps(programme | {"calibrations": rows}))
    found = [str(item) for item in check_level0(out) if item.severity == "error"]
    (out / "programme.json").write_text(text)
    assert len(found) == 1
    assert said in found[0]


def test_what_cannot_be_calibrated_is_refused(refused):
    single = load_simulation({"name": "x", "sequences": [{"scene": SCENE} | VISITS]})
    refused(r"programme = x.*a simulation with a programme", with_calibrations, single, 3)
    settings = {"settings": VISITS, "instrument": INSTRUMENT, "calibration_frames": 3}
    refused(r"off_mask_arcsec = .* arcsec.*on the detector in F520", simulation_from, [SCENE], **settings)


@pytest.fixture(scope="module")
def cubes(made):
    """The files for VIP of a folder that is there already."""
    done = simulate(planned(), made[0], cubes=("vip", "pyklip"))
    assert done.computed_parts == 0
    assert [str(item) for item in check_tree(made[0]) if item.severity == "error"] == []
    folder = made[0] / "Cubes" / "vip" / "F520_30s_gain20"
    images = {path.stem: fits.getdata(path) for path in folder.glob("*.fits")}
    return images, json.loads((folder / "about.json").read_text())


def test_the_star_off_the_mask_is_in_the_middle_with_the_light_of_the_truth(made, cubes):
    (out, programme), (images, about) = made, cubes
    psf = images["psf"]
    middle = len(psf) // 2
    assert len(psf) % 2 == 1
    assert np.unravel_index(psf.argmax(), psf.shape) == (middle, middle)
    row = next(row for row in programme["calibrations"] if row["kind"] == "CALS")
    with fits.open(next(out.glob(f"Truth/*/*{row['obsid']}*.fits"))) as units:
        light = units["EXPECTED_E"].data
    x, y = round(row["star_x_pixel"]), round(row["star_y_pixel"])
    core = slice(-5, 6)
    expected = light[y + core.start : y + core.stop, x + core.start : x + core.stop].sum()
    found = psf[middle + core.start : middle + core.stop, middle + core.start : middle + core.stop].sum()
    assert found * about["star_exposure_s"] == pytest.approx(expected, rel=0.02)


def test_frames_are_odd_calibrated_and_each_has_its_angle(made, cubes):
    images, about = cubes
    assert images["science"].shape == images["reference"].shape == (2, 137, 137)
    assert images["angles"].tolist() == [0.0, 0.0]
    assert about["star_pixel"] == [68, 68]
    assert (about["band"], about["wavelength_um"], about["unit"]) == ("F520", 0.52, "electron/s")
    with fits.open(next(made[0].glob("visit_001_science/Truth/*/*.fits"))) as units:
        light = units["EXPECTED_E"].data[100 - 68 : 100 + 69, 118 - 68 : 118 + 69] / 30
    # without the pedestal of dark current and clock-induced charge, which is a few electrons a frame
    assert np.median(images["science"] - light) == pytest.approx(0.0, abs=0.2)
    assert np.corrcoef(images["science"].mean(axis=0).ravel(), light.ravel())[0, 1] > 0.99


@pytest.mark.parametrize(("parity", "roll_deg"), [(-1, 0.0), (-1, 20.0), (1, 20.0)])
def test_turning_a_frame_by_its_angle_puts_a_source_at_its_position_angle(parity, roll_deg):
    beside = {"name": "beside", "v_mag": 5, "teff_k": 5200, "separation_arcsec": 0.8, "pa_deg": 130.0}
    instrument = load_instrument({"detector": INSTRUMENT["detector"] | {"parity": parity}})
    seen = observe(
        SCENE | {"stars": [beside]},
        band="F520",
        exposure_s=0.1,
        roll_deg=roll_deg,
        instrument=instrument,
        fidelity="quick",
        switches=dict.fromkeys(("photon_noise", "read_noise", "cosmic_rays"), False),
    )
    image = calibrated_cube(seen, [0]).rate_e_s[0]
    rows, columns = np.mgrid[:137, :137] - 68
    image[np.hypot(rows, columns) * 0.016153 < 0.6] = 0
    row, column = np.unravel_index(image.argmax(), image.shape)
    # counterclockwise from up, as VIP and pyKLIP turn
    assert np.degrees(np.arctan2(68 - column, row - 68)) + roll_deg == pytest.approx(130.0, abs=1.0)
    assert np.hypot(row - 68, column - 68) * 0.016153 == pytest.approx(0.8, abs=0.02)


def test_cubes_without_a_star_off_the_mask_are_refused(refused, tmp_path):
    bare = simulation_from([SCENE], settings=VISITS | {"visits": 2}, instrument=INSTRUMENT)[0]
    refused(r"cubes = given.*star off the mask", simulate, bare, tmp_path / "out", cubes=("vip",))
    off = observe(SCENE, band="F520", exposure_s=1, instrument=INSTRUMENT, star_offset_arcsec=(0.001, 0.0))
    refused(r"star_offset_arcsec = .*whole pixels", calibrated_cube, off, [0])
