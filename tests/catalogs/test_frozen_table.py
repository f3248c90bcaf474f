"""Tables that nobody can change: mappings, arrays, copies with other columns, and travel to worker processes."""

import pickle

import numpy as np
import pytest

from catalogs import load_known_planets, load_stars


@pytest.mark.parametrize("load", [load_stars, load_known_planets])
def test_nothing_of_a_table_can_be_changed_and_it_travels_whole(load):
    table = load()
    name = next(iter(table.columns))
    with pytest.raises(TypeError):
        table.columns[name] = np.zeros(len(table))
    with pytest.raises(ValueError, match="read-only"):
        table.columns[name][0] = table.columns[name][1]
    back = pickle.loads(pickle.dumps(table))
    assert type(back) is type(table)
    assert len(back) == len(table) > 200
    for column, values in table.columns.items():
        np.testing.assert_array_equal(back.columns[column], values)
    with pytest.raises(TypeError):
        back.columns[name] = np.zeros(len(table))


def test_a_copy_with_other_columns_leaves_the_table_as_it_is():
    stars = load_stars()
    moved = stars.with_columns({"ra_deg": np.zeros(len(stars)), "more": np.ones(len(stars))})
    assert not moved.column("ra_deg").any()
    assert moved.column("more").all()
    assert "more" not in stars.columns
    assert stars.column("ra_deg").any()
    with pytest.raises(ValueError, match="read-only"):
        moved.column("more")[0] = 2.0
