import math
from pathlib import Path

import cpic_core
from cpic_core import Provenance, load_yaml, parse_yaml, split_sourced


def test_inf_and_nan_are_numbers_for_the_model_to_refuse():
    tree = parse_yaml("a: .inf\nb: -.inf\nc: .nan")
    assert tree["a"] == math.inf
    assert tree["b"] == -math.inf
    assert math.isnan(tree["c"])


def test_missing_file_and_wrong_encoding_are_named(refused, tmp_path):
    refused("nothing.yaml", load_yaml, tmp_path / "nothing.yaml")
    bad = tmp_path / "latin.yaml"
    bad.write_bytes(b"name: \xe9toile")
    refused("UTF-8", load_yaml, bad)


def test_values_and_their_standing_are_separated():
    tree = {
        "a": {"b": {"value": 3, "unit": "nm", "source": "paper", "confidence": "P", "range": [1, 5]}, "c": 4},
        "d": [{"value": 1}],
    }
    values, provenance = split_sourced(tree)
    assert values == {"a": {"b": 3, "c": 4}, "d": [1]}
    assert provenance["a.b"] == Provenance("paper", "P", "nm", (1.0, 5.0))
    assert set(provenance) == {"a.b", "d[0]"}


def test_shipped_files_are_read_alike_by_both_loaders():
    root = Path(cpic_core.__file__).resolve().parents[1]
    found = [path for floor in ("catalogs", "simulator", "cpic_planner") for path in (root / floor).rglob("*.yaml")]
    assert len(found) > 20
    for path in found:
        assert repr(load_yaml(path, shipped=True)) == repr(load_yaml(path)), path
