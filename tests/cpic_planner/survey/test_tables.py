"""Tables of a survey: every column declared, keys unique, universes numbered over all blocks."""

import numpy as np

from cpic_planner.jobs.folder import open_run_folder
from cpic_planner.survey.play import play
from cpic_planner.survey.store import ResultStore, read_table
from cpic_planner.survey.tables import TABLES, rows_of


def test_columns_are_those_declared(plain, tmp_path):
    survey = plain.surveys[0]
    parts = [
        rows_of(play(survey, block=block, n=60, seed=1), name, 100 * block)
        for block in (0, 1)
        for name in ("one", "two")
    ]
    for part in parts:
        assert {table.name: {column.name for column in table.columns} for table in TABLES} == {
            name: set(columns) for name, columns in part.items()
        }
    with open_run_folder(tmp_path, kind="whatif", config_hash="1") as folder:
        store = ResultStore(folder, TABLES)
        for number, part in enumerate(parts):
            store.save_part(f"part {number}", part)
        paths = store.merge()
        universes, detections = store.read("universes"), store.read("detections")
    assert len(universes["universe"]) == 240
    assert set(universes["universe"]) == set(range(60)) | set(range(100, 160))
    assert set(detections["universe"]) <= set(universes["universe"])
    stored = read_table(paths["detections"])
    assert stored.units["separation_arcsec"] == "arcsec"
    assert stored.key == ("strategy", "universe", "star", "planet")
    # What the detections count is what the universes say.
    for name in ("one", "two"):
        mine = detections["strategy"] == name
        total = (universes["new_planets"] + universes["known_planets"])[universes["strategy"] == name].sum()
        assert mine.sum() == total > 0


def test_units_stand_in_the_names():
    suffixes = {"h": "_h", "d": "day", "R_Jup": "_rjup", "au": "_au", "deg": "_deg", "arcsec": "_arcsec"}
    for table in TABLES:
        for column in table.columns:
            assert column.description
            assert column.name.endswith(suffixes.get(column.unit, "")), column.name


def test_an_empty_block_has_its_columns(plain):
    from dataclasses import replace

    survey = plain.surveys[0]
    nothing = replace(survey, schedule=replace(survey.schedule, visits=()))
    rows = rows_of(play(nothing, block=0, n=5, seed=1), "none", 0)
    assert np.array_equal(rows["universes"]["universe"], np.arange(5))
    assert all(len(values) == 0 for values in rows["detections"].values())
