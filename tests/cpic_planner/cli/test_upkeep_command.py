import json

import pytest

from cpic_planner import calibrate, write_level0

COMMAND = "check"


@pytest.fixture
def product(tmp_path):
    return write_level0(calibrate("BIAS", n_frames=2, camera="NIR"), tmp_path / "tree")


def test_a_clean_tree(call, done, product, tmp_path):
    status, out, err = call(tmp_path / "tree")
    assert (status, out, err) == (0, "1 Level-0 file checked: nothing wrong\n", "")
    out, _ = done(product, tmp_path / "tree", "--json")
    result = json.loads(out)
    assert (result["n_files"], result["n_errors"], result["n_warnings"], result["findings"]) == (1, 0, 0, [])


def test_a_flipped_bit_is_status_1_and_named(call, product):
    data = bytearray(product.read_bytes())
    data[-10_000] ^= 1
    product.write_bytes(data)
    status, out, _ = call(product)
    assert status == 1
    for word in (str(product), "DATASUM", "error", "checked: "):
        assert word in out
    status, out, _ = call(product, "--json")
    assert status == 1
    result = json.loads(out)
    assert result["n_errors"] == len(result["findings"]) >= 1
    assert {(item["hdu"], item["severity"], item["path"]) for item in result["findings"]} == {
        (2, "error", str(product))
    }


def test_warnings_count_only_when_strict(call, done, product, tmp_path):
    (tmp_path / "tree" / "CAL" / product.parent.name / "notes.txt").write_text("mine")
    out, _ = done(tmp_path / "tree")
    assert "notes.txt" in out
    assert "0 errors, 1 warning" in out
    assert call(tmp_path / "tree", "--strict")[0] == 1


def test_nothing_to_check_is_an_error_of_the_tree(call, tmp_path):
    status, out, _ = call(tmp_path)
    assert status == 1
    assert "no Level-0 file" in out


def test_a_path_that_is_not_there_is_bad_input(call, refuses, product, tmp_path):
    refuses([product, tmp_path / "nowhere"], ["nowhere"])
    assert call()[0] == 2
