"""Tables of a user's own that are refused, in one line with file, row, column, value and range."""

import pytest
from astropy.table import Table
from hypothesis import given, settings
from hypothesis import strategies as st

from catalogs.catalogue import open_catalogue
from catalogs.errors import InputError

TEXT = st.text(st.characters(codec="utf-8", categories=["L", "N"]), min_size=1, max_size=12)


def test_columns_of_arrays_are_refused(tmp_path):
    Table({"name": ["a"], "dist": [[1.0, 2.0]], "V": [5.0], "SpT": ["G2V"]}).write(tmp_path / "t.fits")
    with pytest.raises(InputError, match=r"t\.fits column dist = 2-dimensional"):
        open_catalogue(tmp_path / "t.fits")


@settings(max_examples=200, deadline=None)
@given(
    data=st.binary(max_size=300)
    | TEXT.map(str.encode)
    | st.lists(st.text("abc,;\n\t\"'#|0.5- ", max_size=40), max_size=6).map(lambda parts: "\n".join(parts).encode())
)
def test_any_file_is_read_or_refused_in_one_line(tmp_path_factory, data):
    path = tmp_path_factory.getbasetemp() / "any.csv"
    path.write_bytes(data)
    refused = None
    try:
        open_catalogue(path)
    except InputError as refusal:
        refused = str(refusal)
    assert refused is None or ("\n" not in refused and "any.csv" in refused)
