"""Files that ship because reading is quicker than making hold what their sources make."""

import numpy as np
import pytest

from cpic_core import read_npz
from tools.parsed import FILES, FOLDER, documents


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.name)
def test_files_are_what_their_sources_make(path):
    stored, made = read_npz(path), FILES[path]()
    assert stored.keys() == made.keys()
    for name, array in made.items():
        assert stored[name].dtype == array.dtype
        if array.dtype.kind == "f":  # sums of another processor differ in their last digit
            np.testing.assert_allclose(stored[name], array, rtol=1e-11)
        else:
            np.testing.assert_array_equal(stored[name], array)


def test_documents_are_those_of_their_texts_and_no_others():
    made = documents()
    assert {path.name for path in FOLDER.iterdir()} == {path.name for path in made}
    for path, text in made.items():
        assert path.read_text(encoding="utf-8") == text
