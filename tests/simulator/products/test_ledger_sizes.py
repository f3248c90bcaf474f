"""Predicted sizes of the effect ledger in the products."""

import json

import numpy as np
from astropy.io import fits
from astropy.table import Table

from simulator import observe
from simulator.products import check_level0, write_level0


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
