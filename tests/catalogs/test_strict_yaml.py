import math

import pytest

from catalogs.errors import InputError
from catalogs.strict_yaml import Provenance, load_yaml, parse_yaml, split_sourced


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("1e-8", 1e-8),
        ("1E5", 1e5),
        ("-2.5", -2.5),
        (".5", 0.5),
        ("3", 3),
        ("1_000", "1_000"),
        ("on", "on"),
        ("no", "no"),
        ("12:30", "12:30"),
        ("true", True),
        ("~", None),
        ("2026-11-21", "2026-11-21"),
        ("0o17", "0o17"),
    ],
)
def test_plain_scalars_mean_what_people_write(text, value):
    got = parse_yaml(f"key: {text}")["key"]
    assert got == value
    assert type(got) is type(value)


def test_inf_and_nan_are_numbers_for_the_model_to_refuse():
    tree = parse_yaml("a: .inf\nb: -.inf\nc: .nan")
    assert tree["a"] == math.inf
    assert tree["b"] == -math.inf
    assert math.isnan(tree["c"])


@pytest.mark.parametrize(
    ("text", "word"),
    [
        ("a: 1\na: 2", "duplicate key 'a'"),
        ("x: {b: 1, b: 2}", "duplicate key 'b'"),
        ("a: &n [1]\nb: *n", "aliases"),
        ("a: !!python/object/apply:os.getcwd []", "constructor"),
        ("a: [1, 2", "line 1"),
        ("? [1, 2]\n: 3", "key must be a plain word"),
    ],
)
def test_doubtful_yaml_is_refused_in_one_line_with_its_place(text, word):
    with pytest.raises(InputError) as caught:
        parse_yaml(text)
    assert word in str(caught.value)
    assert "\n" not in str(caught.value)


def test_missing_file_and_wrong_encoding_are_named(tmp_path):
    with pytest.raises(InputError, match="nothing.yaml"):
        load_yaml(tmp_path / "nothing.yaml")
    bad = tmp_path / "latin.yaml"
    bad.write_bytes(b"name: \xe9toile")
    with pytest.raises(InputError, match="UTF-8"):
        load_yaml(bad)


def test_values_and_their_standing_are_separated():
    tree = {
        "a": {"b": {"value": 3, "unit": "nm", "source": "paper", "confidence": "P", "range": [1, 5]}, "c": 4},
        "d": [{"value": 1}],
    }
    values, provenance = split_sourced(tree)
    assert values == {"a": {"b": 3, "c": 4}, "d": [1]}
    assert provenance["a.b"] == Provenance("paper", "P", "nm", (1.0, 5.0))
    assert set(provenance) == {"a.b", "d[0]"}
