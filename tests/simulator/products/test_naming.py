import re

import pytest

from catalogs.errors import InputError
from simulator import load_instrument
from simulator.products.naming import ProductName, checked_obsid, obsid_of, product_name
from simulator.products.times import sequence_times

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
    [
        "x.fits",
        "CSST_CPIC_VIS_SCI_2028030405060_20280304050639_40000000012_X_L0_V01.fits",
        "CSST_CPIC_UV_SCI_20280304050607_20280304050639_40000000012_X_L0_V01.fits",
        "CSST_CPIC_VIS_SCIE_20280304050607_20280304050639_40000000012_X_L0_V01.fits",
        "CSST_CPIC_VIS_SCI_20280304050607_20280304050639_400000012_X_L0_V01.fits",
        "CSST_CPIC_VIS_SCI_20280304050607_20280304050639_40000000012_01_L0_V01.fits",
        "CSST_CPIC_VIS_SCI_20280304050607_20280304050639_40000000012_X_L1_V01.fits",
        "CSST_CPIC_VIS_SCI_20280304050607_20280304050639_40000000012_X_L0_V1.fits",
        "CSST_CPIC_VIS_SCI_20280304050607_20280304050639_40000000012_X_L0_V01.fits.gz",
    ],
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


def test_numbers_are_eleven_digits_of_the_instrument():
    assert checked_obsid(40000000001, "4") == checked_obsid("40000000001", "4") == "40000000001"
    for wrong in (4, "4000000001", "10000000001", "4000000000x", "٤0000000001", 4e10, None, True, " 40000000001"):
        with pytest.raises(InputError, match="obsid.*11 digits that begin with 4"):
            checked_obsid(wrong, "4")


def test_version_of_a_product(sequence):
    second = load_instrument({"mission": {"product_version": 2}})
    assert name_of(sequence(instrument=second)).file.name.endswith("_X_L0_V02.fits")
