"""A programme with all that its reduction needs."""

import json

import numpy as np
import pytest
from astropy.io import fits

from cpic_planner.simulation import simulate, simulation_from, with_calibrations
from simulator.config import load_simulation
from simulator.products import check_level0

INSTRUMENT = {"detector": {"n_columns": 236, "n_rows": 206, "star_column": 118, "star_row": 100}}
SCENE = {"name": "star", "cstar": {"v_mag": 2.0, "teff_k": 5200, "ra": 10, "dec": 20}}
VISITS = {"band": "F520", "exposure_s": (30,), "em_gain": (20,), "frames": 2, "fidelity": "quick"}
PLACE = (1.2, 1.0)


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
