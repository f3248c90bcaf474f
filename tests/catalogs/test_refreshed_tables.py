"""Names of refreshed tables, and when one is set aside."""

from datetime import UTC, datetime
from pathlib import Path

import pytest

from catalogs import file_name, set_aside, stored_tables
from catalogs.archives import loss_refused

WHEN = datetime(2026, 3, 9, 4, 5, 6, tzinfo=UTC)


@pytest.mark.parametrize(
    ("lost", "known", "said"),
    [
        (0, 0, ""),
        (10, 100, ""),
        (11, 100, "11 of 100 stars are not in the new table, more than 10%: is the service whole?"),
        (1, 1, "1 of 1 stars are not in the new table, more than 10%: is the service whole?"),
    ],
)
def test_more_than_a_tenth_may_not_be_lost(lost, known, said):
    assert loss_refused(lost, known, "stars") == said


def test_kinds_are_kept_apart_and_what_is_set_aside_is_none_of_them(data_folder):
    data_folder.mkdir()
    for kind in ("simbad", "archive"):
        path = data_folder / file_name(WHEN, kind)
        path.write_text("")
        set_aside(path).write_text("")
    assert [item.path.name for item in stored_tables("simbad")] == ["simbad_2026-03-09T040506Z.ecsv"]
    assert [item.path.name for item in stored_tables("archive")] == ["archive_2026-03-09T040506Z.ecsv"]
    assert set_aside(Path("a/b.ecsv")) == Path("a/set_aside_b.ecsv")
