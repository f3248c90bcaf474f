"""Every part and product of a run was made by what its list says; what was not is named."""

import json

import numpy as np
import pyarrow.parquet as pq
import pytest
from astropy.io import fits

from cpic_core import InputError
from cpic_planner.jobs import check_tree
from cpic_planner.jobs.folder import open_run_folder
from cpic_planner.jobs.written_files import LIST_NAME
from cpic_planner.results import Column
from cpic_planner.survey.store import ResultStore, Table

MINE = "0000000a-0000000b-0000000c-0000000d-0000000e"
TUNED = MINE.replace("0e", "ff")
OTHER = "ffffffff-0000000b-0000000c-eeeeeeee-0000000e"
TABLE = Table("visits", (Column("star", "string", "star"), Column("snr", "float64", "SNR")), key=("star",))
NAMES = ("parts/survey_*.json", "parts/block_*.blob", "whatif.json", "SCI/61771/a.fits", "visits.parquet")


@pytest.fixture
def made(tmp_path):
    """A run of every kind of file, gone on with on another processor."""
    where = {"kind": "whatif", "config_hash": "aaaa"}
    with open_run_folder(tmp_path, fingerprint=MINE, **where) as folder:
        folder.save_part("survey 1", {"value": 1})
        folder.write("whatif.json", json.dumps({"kind": "whatif", "fingerprint": MINE}))
    with open_run_folder(tmp_path, fingerprint=TUNED, **where) as folder:
        store = ResultStore(folder, (TABLE,))
        store.save_part("block 1", {"visits": {"star": ["a"], "snr": [5.0]}})
        store.merge()
        folder.write("known.json", '{"no": "result"}')
        folder.write("ranking.csv", "name\n")
        unit = fits.PrimaryHDU(header=fits.Header({"SWNAME": "cpic-planner", "FPRINT": TUNED}))
        unit.writeto(tmp_path / "made.fits")
        folder.write_bytes("SCI/61771/a.fits", (tmp_path / "made.fits").read_bytes())
    return tmp_path


def test_a_run_on_two_processors_is_whole(made):
    assert check_tree(made) == []


@pytest.mark.parametrize("name", NAMES)
def test_what_other_software_made_is_named(made, name):
    (path,) = made.glob(name)
    if path.suffix == ".parquet":
        rows = pq.read_table(path)
        about = {key: text.replace(TUNED.encode(), OTHER.encode()) for key, text in rows.schema.metadata.items()}
        pq.write_table(rows.replace_schema_metadata(about), path)
    else:
        content = path.read_bytes()
        changed = content.replace(MINE.encode(), OTHER.encode()).replace(TUNED.encode(), OTHER.encode())
        assert changed != content
        path.write_bytes(changed)
    (finding,) = check_tree(made)
    assert (finding.path, finding.severity) == (path, "error")
    assert finding.message == f"was made with other code and libraries than {LIST_NAME} says: {OTHER}"


@pytest.mark.parametrize("name", NAMES)
def test_what_does_not_say_what_made_it_is_named(made, name):
    (path,) = made.glob(name)
    path.write_bytes(b'{"obsid": 1, "software": 7}\n')
    (finding,) = check_tree(made)
    assert (finding.path, finding.message[:29]) == (path, "does not say what made it: " + finding.message[27:29])


def test_a_check_mends_nothing(made):
    path = made / LIST_NAME
    cut = path.read_text() + '{"file": "parts/c'
    path.write_text(cut)
    assert check_tree(made) == []
    assert path.read_text() == cut
    path.write_text("{}\n" + cut)
    findings = check_tree(made)
    assert [finding.path for finding in findings][-1] == path
    assert "cannot be read" in findings[-1].message


def test_other_paths_are_left_to_the_check_of_level_0(tmp_path):
    with pytest.raises(InputError, match="a regular file or a folder that exists"):
        check_tree(tmp_path / "nowhere")
    np.savetxt(tmp_path / "a.txt", [1.0])
    assert [finding.message for finding in check_tree(tmp_path)] == ["has no Level-0 file"]
