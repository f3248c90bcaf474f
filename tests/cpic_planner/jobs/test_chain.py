"""Everything in the folder of a run is as its list says, made by what the list says; what is not is named."""

import hashlib
import json
import random

import numpy as np
import pyarrow.parquet as pq
import pytest
from astropy.io import fits

from cpic_core import InputError
from cpic_planner.jobs import check_tree
from cpic_planner.jobs.folder import LIST_NAME, open_run_folder
from cpic_planner.jobs.job import RECORD
from cpic_planner.results import Column
from cpic_planner.survey.tables import ResultStore, Table

MINE = "0000000a-0000000b-0000000c-0000000d-0000000e"
TUNED = MINE.replace("0e", "ff")
OTHER = "ffffffff-0000000b-0000000c-eeeeeeee-0000000e"
TABLE = Table("visits", (Column("star", "string", "star"), Column("snr", "float64", "SNR")), key=("star",))
PARTS = ("parts/survey_*.json", "parts/block_*.blob")
NAMES = (*PARTS, "whatif.json", "SCI/61771/a.fits", "visits.parquet", "visits.ecsv")
SILENT = ("known.json", "ranking.csv")
"""Files that only the list speaks for."""
ANOTHER_SUM = f"has another sha256 than {LIST_NAME} says"


@pytest.fixture
def made(tmp_path):
    """A run of every kind of file, gone on with on another processor."""
    where = {"kind": "whatif", "config_hash": "aaaa"}
    with open_run_folder(tmp_path, fingerprint=MINE, **where) as folder:
        folder.save_part("survey 1", {"value": 1})
        folder.write("whatif.json", json.dumps({"kind": "whatif", "fingerprint": MINE, "config_hash": "bbbb"}))
        folder.write("visits.ecsv", f"# %ECSV 1.0\n# meta: !!omap\n# - {{fingerprint: {MINE}}}\nstar\nsun\n")
    with open_run_folder(tmp_path, fingerprint=TUNED, **where) as folder:
        store = ResultStore(folder, (TABLE,))
        store.save_part("block 1", {"visits": {"star": ["a"], "snr": [5.0]}})
        store.merge()
        folder.write("known.json", '{"no": "result"}')
        folder.write("ranking.csv", "name\n")
        unit = fits.PrimaryHDU(header=fits.Header({"SWNAME": "cpic-planner", "FPRINT": TUNED}))
        unit.writeto(tmp_path / "made.fits")
        folder.write_bytes("SCI/61771/a.fits", (tmp_path / "made.fits").read_bytes())
        end(folder)
    return tmp_path


def end(folder):
    """Write the record as a run does at its end."""
    known = hashlib.sha256((folder.path / LIST_NAME).read_bytes()).hexdigest()
    record = {"fingerprint": folder.fingerprint, "config_hash": folder.config_hash, "list_sha256": known}
    folder.write(RECORD, json.dumps(record))


def found(root):
    """Findings by name of the file below a folder, errors all."""
    findings = check_tree(root)
    assert {item.severity for item in findings} <= {"error"}
    return {(item.path.relative_to(root).as_posix(), item.message) for item in findings}


def test_a_run_on_two_processors_is_whole(made):
    assert check_tree(made) == []


def test_a_run_that_goes_on_after_its_end_is_whole_and_so_is_one_that_stops_then(made):
    with open_run_folder(made, kind="whatif", config_hash="aaaa", fingerprint=MINE) as folder:
        assert check_tree(made) == []
        folder.write("ranking.csv", "name,again\n")
        assert check_tree(made) == []
        end(folder)
    assert check_tree(made) == []


@pytest.mark.parametrize("name", [*NAMES, *SILENT, RECORD])
def test_a_flipped_bit_of_any_file_is_named(made, name):
    (path,) = made.glob(name)
    content, draw = bytearray(path.read_bytes()), random.Random(name)
    for _ in range(10):
        changed = content.copy()
        changed[draw.randrange(len(content))] ^= 1 << draw.randrange(8)
        path.write_bytes(changed)
        assert (path.relative_to(made).as_posix(), ANOTHER_SUM) in found(made)


def test_a_flipped_bit_at_any_place_of_the_list_is_found(made):
    """The record has its sum, and it has that of the record."""
    path = made / LIST_NAME
    content, draw = path.read_bytes(), random.Random(1)
    for place in range(content.rstrip(b"\n").rfind(b"\n") + 1, len(content)):  # the last line is that of the record
        path.write_bytes(content[:place] + bytes([content[place] ^ 1]) + content[place + 1 :])
        assert check_tree(made) != []
    for _ in range(200):
        place = draw.randrange(len(content))
        path.write_bytes(content[:place] + bytes([content[place] ^ 1 << draw.randrange(8)]) + content[place + 1 :])
        assert check_tree(made) != []


@pytest.mark.parametrize("name", [*NAMES, *SILENT, RECORD])
def test_a_file_that_is_gone_is_named_once_the_run_is_finished(made, name):
    (path,) = made.glob(name)
    path.unlink()
    said = f"is not there, and {LIST_NAME} says that it was written"
    assert found(made) == {(path.relative_to(made).as_posix(), said)}
    (made / LIST_NAME).write_text((made / LIST_NAME).read_text().rpartition('{"file": "run.json"')[0])
    (made / RECORD).unlink(missing_ok=True)
    assert found(made) == set()  # a run that was stopped may lack it


@pytest.mark.parametrize("name", NAMES)
def test_what_other_software_made_is_named(made, name):
    """Also where the list was told of it, as where folders of two runs are laid over each other."""
    (path,) = made.glob(name)
    before = path.read_bytes()
    if path.suffix == ".parquet":
        rows = pq.read_table(path)
        about = {key: text.replace(TUNED.encode(), OTHER.encode()) for key, text in rows.schema.metadata.items()}
        pq.write_table(rows.replace_schema_metadata(about), path)
    else:
        content = path.read_bytes()
        changed = content.replace(MINE.encode(), OTHER.encode()).replace(TUNED.encode(), OTHER.encode())
        assert changed != content
        path.write_bytes(changed)
    key, said = (
        path.relative_to(made).as_posix(),
        f"was made with other code and libraries than {LIST_NAME} says: {OTHER}",
    )
    assert found(made) == {(key, ANOTHER_SUM), (key, said)}
    tell(made, path, before)
    assert found(made) == {(key, said)}


def tell(made, path, before):
    """Give the list the sums of a file, and the record those of the list, as if a run had written it."""
    listed, record = made / LIST_NAME, made / RECORD
    sums = [hashlib.sha256(content).hexdigest() for content in (before, path.read_bytes())]
    sizes = [f'"size_bytes": {size}, ' for size in (len(before), path.stat().st_size)]
    lines = [line for line in listed.read_text().splitlines(keepends=True) if RECORD not in line]
    text = "".join(lines).replace(f'{sizes[0]}"sha256": "{sums[0]}', f'{sizes[1]}"sha256": "{sums[1]}')
    about = json.loads(record.read_text()) | {"list_sha256": hashlib.sha256(text.encode()).hexdigest()}
    record.write_text(json.dumps(about))
    last = {"file": RECORD, "size_bytes": record.stat().st_size}
    last["sha256"] = hashlib.sha256(record.read_bytes()).hexdigest()
    listed.write_text(text + json.dumps(last) + "\n")


@pytest.mark.parametrize("name", [*PARTS, "visits.parquet"])
def test_what_is_of_another_configuration_is_named(made, tmp_path_factory, name):
    where = tmp_path_factory.mktemp("other")
    with open_run_folder(where, kind="whatif", config_hash="cccc", fingerprint=MINE) as folder:
        folder.save_part("survey 1", {"value": 1})
        store = ResultStore(folder, (TABLE,))
        store.save_part("block 1", {"visits": {"star": ["a"], "snr": [5.0]}})
        store.merge()
    (path,) = made.glob(name)
    before = path.read_bytes()
    path.write_bytes((where / path.relative_to(made)).read_bytes())
    tell(made, path, before)
    said = f"is of configuration cccc, not aaaa as {LIST_NAME} says"
    assert found(made) == {(path.relative_to(made).as_posix(), said)}


def test_a_list_that_mixes_software_is_named(made):
    path = made / LIST_NAME
    path.write_text(path.read_text().replace(f'{{"fingerprint": "{TUNED}"}}', f'{{"fingerprint": "{OTHER}"}}'))
    assert (LIST_NAME, f"names processes that differ in code, libraries: {OTHER}") in found(made)


@pytest.mark.parametrize("name", NAMES)
def test_what_does_not_say_what_made_it_is_named(made, name):
    (path,) = made.glob(name)
    path.write_bytes(b'{"obsid": 1, "software": 7}\n')
    said = {message.partition(": ")[0] for _, message in found(made)}
    assert said == {ANOTHER_SUM, "does not say what made it"}


def test_a_list_without_a_record_that_knows_it_is_named(made):
    record = made / RECORD
    record.write_text(record.read_text().replace("list_sha256", "another"))
    assert (RECORD, "does not say what its list was: KeyError") in found(made)
    text = (made / LIST_NAME).read_text()
    (made / LIST_NAME).write_text(text.rpartition('{"file": "run.json"')[0])
    assert found(made) == {(LIST_NAME, f"does not name {RECORD}, which is there")}


def test_a_link_on_the_way_is_named(made):
    (made / "SCI").rename(made / "elsewhere")
    (made / "SCI").symlink_to("elsewhere")
    ((name, said),) = found(made)
    assert name == "SCI/61771/a.fits"
    assert said.startswith(f"is not where {LIST_NAME} says: ")


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
