import json
import tempfile
from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import given, settings, strategies as st

from cpic_core import InputError, stream
from cpic_planner.jobs import DamagedPartError
from cpic_planner.jobs.folder import open_run_folder
from cpic_planner.results import Column
from cpic_planner.survey.tables import ResultStore, Table

YIELDS = Table(
    "yields",
    (
        Column("strategy", "string", "name of the strategy"),
        Column("draw", "int64", "number of the universe"),
        Column("found", "float64", "planets found"),
        Column("time_s", "float64", "time used", "s"),
        Column("complete", "bool", "whether the time budget was used up"),
    ),
    key=("strategy", "draw"),
)
STARS = Table(
    "stars",
    (Column("hip", "int32", "Hipparcos number"), Column("visits", "int64", "visits, all universes")),
    key=("hip",),
)
TABLES = (YIELDS, STARS)
N_PARTS = 6


def part(index):
    """Rows of one part, a pure function of its number; keys interleave with those of the others, unsorted."""
    rng = stream(5, "part", index)
    stars = np.arange(index, 40 if index else 0, N_PARTS)  # part 0 has none
    draws = np.arange(index, 60, N_PARTS)[::-1]
    n = len(draws)
    return {
        "yields": {
            "strategy": np.where(np.arange(n) % 2 == 0, "wide", "deep"),
            "draw": draws,
            "found": np.where(draws % 7 == 0, np.nan, rng.poisson(2.0, n)),
            "time_s": rng.exponential(1e6, n),
            "complete": draws % 3 == 0,
        },
        "stars": {"hip": stars, "visits": 2 * stars},
    }


def merged(folder, indices=range(N_PARTS), expected=None):
    store = ResultStore(folder, TABLES)
    for index in indices:
        store.save_part(f"part {index}", part(index))
    return {name: path.read_bytes() for name, path in store.merge(expected).items()}


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory):
    with open_run_folder(tmp_path_factory.mktemp("serial"), kind="whatif", config_hash="c0ffee") as folder:
        return merged(folder)


@pytest.fixture
def folder(tmp_path):
    with open_run_folder(tmp_path / "out", kind="whatif", config_hash="c0ffee") as opened:
        yield opened


DAMAGES = {
    "cut": lambda content: content[: len(content) // 2],
    "empty": lambda content: b"",
    "bit": lambda content: content[:-20] + bytes([content[-20] ^ 4]) + content[-19:],
    "head": lambda content: b"{" + content,
    "other configuration": lambda content: content.replace(b"c0ffee", b"decade", 1),
    "not a mapping": lambda content: b"[1]\n" + content.partition(b"\n")[2],
}


@given(
    steps=st.lists(
        st.tuples(st.integers(0, N_PARTS - 1), st.sampled_from([None, None, *sorted(DAMAGES)])), max_size=2 * N_PARTS
    )
)
@settings(max_examples=20)
def test_any_history_ends_in_the_same_bytes(undisturbed, steps):
    """Parts written in any order, some twice, some damaged afterwards; then a run that does what is not whole."""
    with tempfile.TemporaryDirectory() as place:
        whole = set()
        with open_run_folder(place, kind="whatif", config_hash="c0ffee") as folder:
            store = ResultStore(folder, TABLES)
            for index, damage in steps:
                before = set(folder.blob_paths())
                store.save_part(f"part {index}", part(index))
                whole.add(index)
                if damage is not None and (new := set(folder.blob_paths()) - before):
                    path = new.pop()
                    path.write_bytes(DAMAGES[damage](path.read_bytes()))
                    whole.discard(index)
        with open_run_folder(place, kind="whatif", config_hash="c0ffee") as folder:
            assert folder.resumed
            done = ResultStore(folder, TABLES).finished()
            assert done == {f"part {index}" for index in whole}
            assert merged(folder, [index for index in range(N_PARTS) if f"part {index}" not in done]) == undisturbed


@pytest.mark.parametrize("damage", sorted(DAMAGES))
def test_a_damaged_part_is_named_and_never_merged(folder, damage, caplog):
    merged(folder)
    path = folder.blob_paths()[2]
    path.write_bytes(DAMAGES[damage](path.read_bytes()))
    store = ResultStore(folder, TABLES)
    assert store.finished() == {f"part {index}" for index in range(N_PARTS) if index != 2}
    assert path.name in caplog.text
    assert "doing it again" in caplog.text
    with pytest.raises(DamagedPartError, match=path.name):
        store.merge()
    with pytest.raises(DamagedPartError, match=path.name):
        store.read("yields")


def test_rows_are_those_of_all_parts_by_key(folder):
    merged(folder)
    table = ResultStore(folder, TABLES).read("yields")
    rows = [
        tuple(np.asarray(column)[i] for column in part(k)["yields"].values()) for k in range(N_PARTS) for i in range(10)
    ]
    rows.sort(key=lambda row: (str(row[0]), int(row[1])))
    assert table["strategy"].tolist() == [row[0] for row in rows]
    for place, name in enumerate(("draw", "found", "time_s", "complete"), start=1):
        np.testing.assert_array_equal(table[name], [row[place] for row in rows])
    assert table["complete"].dtype == bool
    assert ResultStore(folder, TABLES).read("stars")["hip"].tolist() == [hip for hip in range(40) if hip % 6]


def test_a_file_says_what_is_in_it(folder):
    merged(folder)
    table = pq.read_table(folder.path / "yields.parquet")
    about = json.loads(table.schema.metadata[b"cpic_planner"])
    assert (about["table"], about["key"], about["config_hash"]) == ("yields", ["strategy", "draw"], "c0ffee")
    units = {field.name: field.metadata[b"unit"].decode() for field in table.schema}
    assert units == {"strategy": "", "draw": "", "found": "", "time_s": "s", "complete": ""}
    assert table.schema.field("found").metadata[b"description"] == b"planets found"
    for name, column in ResultStore(folder, TABLES).read("yields").items():
        np.testing.assert_array_equal(table.column(name).to_numpy(), column)
    assert table.column("found").type == pa.float64()
    assert pq.read_schema(folder.path / "stars.parquet").field("hip").type == pa.int32()


def test_pandas_reads_it(folder):
    merged(folder)
    frame = pd.read_parquet(folder.path / "yields.parquet")
    assert list(frame.columns) == [column.name for column in YIELDS.columns]
    assert len(frame) == 60
    assert not frame.duplicated(list(YIELDS.key)).any()
    assert frame.set_index(list(YIELDS.key)).index.is_monotonic_increasing


def test_neither_clock_nor_place_is_in_the_files(undisturbed, tmp_path):
    with open_run_folder(tmp_path / "elsewhere", kind="whatif", config_hash="c0ffee") as folder:
        assert merged(folder, reversed(range(N_PARTS))) == undisturbed
        assert str(tmp_path).encode() not in b"".join(undisturbed.values())
        about = json.loads(pq.read_schema(folder.path / "yields.parquet").metadata[b"cpic_planner"])
    assert set(about) == {"schema_version", "table", "key", "config_hash", "fingerprint"}


def test_a_key_that_occurs_twice_is_refused(refused, folder):
    store = ResultStore(folder, TABLES)
    rows = part(1)
    store.save_part("a", rows | {"stars": {"hip": [7, 8, 7], "visits": [1, 2, 3]}})
    refused(r"stars key = \{'hip': 7\}", store.read, "stars")
    store.save_part("a", rows)
    store.save_part("b", part(2) | {"stars": rows["stars"]})
    refused("stars key", store.read, "stars")
    refused("stars key", store.merge)


def test_parts_that_are_missing_or_nobody_asked_for_stop_the_merge(refused, folder):
    names = [f"part {index}" for index in range(N_PARTS)]
    refused("part 5 is missing", merged, folder, range(5), expected=names)
    refused("part 4 is not one of them", merged, folder, range(5), expected=names[:4])
    assert set(merged(folder, [5], expected=names)) == {"yields", "stars"}


def changed(name, values):
    rows = part(1)
    return rows | {"stars": rows["stars"] | {name: values}}


N_STARS = len(part(1)["stars"]["hip"])


@pytest.mark.parametrize(
    "columns",
    [
        {"yields": part(1)["yields"]},
        part(1) | {"stars": {"hip": [1]}},
        changed("visits", [1]),
        changed("visits", np.zeros((N_STARS, 1), dtype=int)),
        changed("visits", np.full(N_STARS, 0.5)),
        changed("hip", np.arange(N_STARS) + 2**31),
        changed("hip", ["x"] * N_STARS),
        part(1) | {"yields": part(1)["yields"] | {"strategy": [1] * 10}},
        part(1) | {"yields": part(1)["yields"] | {"complete": [1] * 10}},
    ],
)
def test_what_does_not_fit_is_not_written(folder, columns):
    store = ResultStore(folder, TABLES)
    with pytest.raises((KeyError, pa.ArrowException)):
        store.save_part("a", columns)
    assert store.finished() == frozenset()


def test_a_part_of_an_older_table_is_not_mixed_in(folder):
    ResultStore(folder, [STARS]).save_part("a", {"stars": part(1)["stars"]})
    wider = Table("stars", (*STARS.columns, Column("score", "float64", "score")), key=("hip",))
    with pytest.raises(DamagedPartError, match="other columns"):
        ResultStore(folder, [wider]).read("stars")


def test_another_configuration_takes_nothing_over(tmp_path):
    with open_run_folder(tmp_path, kind="whatif", config_hash="aaaa") as folder:
        merged(folder)
    with pytest.raises(InputError, match="aaaa"), open_run_folder(tmp_path, kind="whatif", config_hash="bbbb"):
        pass
    Path(tmp_path / "mine.parquet").write_text("precious")
    with open_run_folder(tmp_path, kind="whatif", config_hash="bbbb", force=True) as folder:
        assert ResultStore(folder, TABLES).finished() == frozenset()
        assert [path.name for path in tmp_path.glob("*.parquet")] == ["mine.parquet"]


def test_parts_alone_keep_a_folder_from_being_taken_over(tmp_path):
    with open_run_folder(tmp_path, kind="whatif", config_hash="aaaa") as folder:
        ResultStore(folder, TABLES).save_part("a", part(0))
    with pytest.raises(InputError, match="aaaa"), open_run_folder(tmp_path, kind="plan", config_hash="bbbb"):
        pass


def test_a_blob_of_somebody_else_is_no_part(tmp_path):
    with open_run_folder(tmp_path, kind="whatif", config_hash="aaaa") as folder:
        ResultStore(folder, TABLES).save_part("a", part(0))
        (tmp_path / "parts" / "mine.blob").write_text("precious")
        assert ResultStore(folder, TABLES).finished() == {"a"}
        ResultStore(folder, TABLES).merge(["a"])
    assert (tmp_path / "parts" / "mine.blob").read_text() == "precious"
