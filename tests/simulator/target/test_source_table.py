"""The table of a scene's sources, and that of many scenes."""

import pickle

import numpy as np
import pytest

from cpic_core import InputError
from simulator import load_instrument, load_scene, spectrum_generator
from simulator.target import scene_sources

STAR = {"v_mag": 1.35, "spectral_type": "K1V", "distance_pc": 1.35}
PLANET = {"name": "b", "radius_rjup": 1, "phase_deg": 90, "separation_arcsec": 0.65, "pa_deg": 315}
INSTRUMENT = load_instrument()


def scene(**parts):
    return load_scene({"name": "s", "cstar": STAR} | parts)


def test_table_is_read_by_row_by_name_and_by_column():
    table = spectrum_generator(
        scene(planets=[PLANET], stars=[{"v_mag": 9, "teff_k": 4000, "separation": 2, "pa": 180}])
    )
    assert len(table) == 3
    assert [row.name for row in table] == list(table.name) == ["s", "b", "star 1"]
    assert table.kind == table["kind"] == ("cstar", "planet", "star")
    assert table["b"] is table[1]
    assert table[1:] == (table[1], table[2])
    assert table[1]["x_arcsec"] == table.x_arcsec[1]
    assert {"name", "kind", "x_arcsec", "y_arcsec", "spectrum"} <= set(table.columns)
    assert all(np.shape(table[column])[0] == 3 for column in ("x_arcsec", "y_arcsec", "distance_au"))
    assert len(table.spectrum) == 3
    with pytest.raises(InputError, match="x_arcsec"):
        table["z"]
    with pytest.raises(InputError, match="x_arcsec"):
        table[0]["z"]
    with pytest.raises(IndexError):
        table[3]


def test_table_in_pandas_and_astropy():
    import astropy.units as u

    table = spectrum_generator(scene(planets=[PLANET]))
    frame = table.to_pandas()
    assert list(frame.name) == ["s", "b"]
    np.testing.assert_array_equal(frame.x_arcsec, table.x_arcsec)
    quantities = table.to_table()
    assert quantities["distance_au"][1].to_value(u.km) == pytest.approx(0.8775 * 149597870.7)
    batch = spectrum_generator([scene(planets=[PLANET]), scene()])
    assert list(batch.to_pandas().scene) == ["s", "s", "s"]
    assert len(batch.to_table()) == 3


def test_a_batch_is_its_scenes_one_by_one():
    trees = [
        {"name": f"s{n}", "cstar": STAR | {"v_mag": float(n)}, "planet": PLANET | {"pa_deg": 10.0 * n}}
        for n in range(5)
    ]
    batch = spectrum_generator([*trees[:4], load_scene(trees[4])])
    assert len(batch) == 5
    assert batch["s3"] is batch[3]
    assert [table.scene for table in batch[1:3]] == ["s1", "s2"]
    for tree, table in zip(trees, batch, strict=True):
        alone = spectrum_generator(tree)
        np.testing.assert_array_equal(alone.x_arcsec, table.x_arcsec)
        np.testing.assert_array_equal(alone["b"].photlam, table["b"].photlam)
    assert len(spectrum_generator([])) == 0
    with pytest.raises(InputError, match="allowed: the name of a scene"):
        batch["s9"]


def test_faults_found_late_name_the_scene_of_the_batch(refused):
    cold = {"name": "cold", "cstar": {"v_mag": 3, "teff_k": 2500}}
    batch = spectrum_generator([{"name": "a", "cstar": STAR}, cold])
    with pytest.raises(InputError, match=r"scenes.1.cstar.teff_k = 2500"):
        _ = batch["cold"][0].photlam
    refused(r"scene.cstar.teff_k = 2500", scene_sources, load_scene(cold), INSTRUMENT, "F520")


def test_tables_travel_to_other_processes():
    table = spectrum_generator(scene(planets=[PLANET]))
    again = pickle.loads(pickle.dumps(table))
    np.testing.assert_array_equal(again["b"].photlam, table["b"].photlam)
