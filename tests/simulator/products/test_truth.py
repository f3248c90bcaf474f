import json

import numpy as np
import pytest
from astropy.io import fits
from astropy.table import Table

from simulator import load_scene, observe
from simulator.products import check_level0, write_level0


def truth_of(path):
    found = fits.open(path.parents[2] / "Truth" / path.parent.name / f"{path.stem}_TRUTH.fits", checksum=True)
    found.verify("exception")
    return found


def test_truth_is_what_the_sequence_knows(sequence, tmp_path):
    one = sequence()
    path = write_level0(one, tmp_path)
    with truth_of(path) as truth, fits.open(path) as units:
        assert truth[0].header["L0FILE"] == path.name
        assert truth[0].header["SEED"] == 7
        for name, expected, unit in (("EXPECTED_ADU", one.expected, "adu"), ("EXPECTED_E", one.expected_e, "electron")):
            assert np.allclose(truth[name].data, expected, rtol=1e-7, atol=0)
            assert truth[name].header["BUNIT"] == unit
            assert truth[name].header["CRVAL1"] == units[1].header["CRVAL1"]
        for number in (1, 2, 3):
            assert np.array_equal(truth["MASK", number].data, one.mask(number - 1))
        frames = Table.read(truth["FRAMES"])
        assert frames["frame"].tolist() == [1, 2, 3]
        assert frames["n_cosmic_rays"].tolist() == [0, 1, 2]
        assert frames["charge_photons_e"].tolist() == [1000.0, 1001.0, 1002.0]
        assert frames["charge_read_out_e"].tolist() == [990.0, 991.0, 992.0]
        assert frames["begin_mjd"].tolist() == [units[number].header["EXPBEG"] for number in (1, 2, 3)]
        assert frames["datasum"].tolist() == [int(units[number].header["DATASUM"]) for number in (1, 2, 3)]


def test_sources_have_their_places(sequence, tmp_path):
    one = sequence(roll_deg=0.0)
    with truth_of(write_level0(one, tmp_path)) as truth:
        table = Table.read(truth["SOURCES"])
    star, planet = table
    assert (star["name"], star["kind"], planet["kind"]) == ("alpha Cen B", "cstar", "planet")
    assert star["ra_deg"] == pytest.approx(one.scene.cstar.ra_deg, abs=1e-10)
    # position angle 315 at roll 0: north-west, right of the star
    assert planet["x_pixel"] - star["x_pixel"] == pytest.approx(0.65 / 2**0.5 / 0.016153, rel=1e-6)
    assert planet["dec_deg"] - star["dec_deg"] == pytest.approx(0.65 / 2**0.5 / 3600, rel=1e-4)
    assert planet["ra_deg"] < star["ra_deg"]
    assert planet["rate_to_first"] == pytest.approx(planet["rate_e_s"] / star["rate_e_s"])
    assert planet["rate_to_first"] == pytest.approx(one.truth.sources[1].contrast)
    assert planet["flags"] == "; ".join(one.truth.sources[1].flags)


def test_sources_without_coordinates_have_offsets(sequence, tmp_path):
    scene = load_scene({"name": "β", "cstar": {"name": "β A", "v_mag": 3, "spectral_type": "G2V"}})
    with truth_of(write_level0(sequence(scene=scene), tmp_path)) as truth:
        table = Table.read(truth["SOURCES"])
    assert not {"ra_deg", "dec_deg"} & set(table.colnames)
    assert table["name"][0].encode().decode("unicode_escape") == "β A"


def test_calibrations_have_no_sources(kind_of, tmp_path):
    with truth_of(write_level0(kind_of("DARK"), tmp_path)) as truth:
        assert [unit.name for unit in truth] == ["PRIMARY", "EXPECTED_ADU", "EXPECTED_E", *["MASK"] * 3, "FRAMES"]


def test_truth_is_left_out_if_not_asked_for(sequence, tmp_path):
    write_level0(sequence(), tmp_path, truth=False)
    assert not (tmp_path / "Truth").exists()


def test_steps_of_the_charge_may_differ_from_frame_to_frame(sequence, tmp_path):
    class Varied(type(sequence())):
        def frame(self, index):
            frame = super().frame(index)
            return type(frame)(adu=frame.adu, mask=frame.mask, charge={f"step{index}": 5.0})

    with truth_of(write_level0(Varied(), tmp_path)) as truth:
        table = Table.read(truth["FRAMES"])
    assert table["charge_step1_e"].tolist() == [0.0, 5.0, 0.0]


def test_sizes_go_into_header_configuration_and_truth(tmp_path):
    scene = {"name": "s", "cstar": {"name": "s", "v_mag": 6.0, "teff_k": 5800}}
    seen = observe(scene, band="F662", exposure_s=0.1, tolerance=0.1)
    path = write_level0(seen, tmp_path)
    assert check_level0(tmp_path) == []
    header = fits.getheader(path)
    assert header["TOLERANC"] == 0.1
    assert header["FIDELITY"] == "custom"
    cards = [header[f"EFF{number:03d}"] for number in range(1, header["NEFFECT"] + 1)]
    (configuration,) = (json.loads(found.read_text()) for found in tmp_path.rglob("configuration.json"))
    rows = configuration["effects"]
    assert [row["key"] for row in rows] == [row.key for row in seen.ledger]
    assert [row["size"] for row in rows] == [row.size for row in seen.ledger]
    for card, row in zip(cards, seen.ledger, strict=True):
        ends = "" if row.size is None else f" | {row.size:.3g}"
        assert card == f"{row.decision} | {row.effect} | {row.reason}{ends}"
    (truth,) = (found for found in tmp_path.rglob("*.fits") if found != path)
    with fits.open(truth) as units:
        table = Table.read(units["EFFECTS"])
    assert list(table["key"]) == [row.key for row in seen.ledger]
    sizes = np.array([np.nan if row.size is None else row.size for row in seen.ledger])
    np.testing.assert_array_equal(np.array(table["size"]), sizes)
    assert {"kept", "skipped"} == set(table["decision"])


def test_without_a_tolerance_there_are_none(tmp_path):
    seen = observe({"name": "s", "cstar": {"name": "s", "v_mag": 6.0, "teff_k": 5800}}, band="F662", exposure_s=0.1)
    path = write_level0(seen, tmp_path)
    assert fits.getheader(path)["TOLERANC"] == 0.0
    (truth,) = (found for found in tmp_path.rglob("*.fits") if found != path)
    with fits.open(truth) as units:
        assert "EFFECTS" not in units
