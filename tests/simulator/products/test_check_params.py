"""What the check of a tree finds in its parameters: every change, and what disagrees with the headers."""

import hashlib
import json
import os

import pytest
import yaml
from astropy.io import fits

from simulator.products import PARAMS_FILES, check_level0

NAMES = tuple(PARAMS_FILES)


@pytest.fixture
def params(tree):
    return tree / "Params" / "40000000012" / "V01"


def found(path, severity="error"):
    return [finding for finding in check_level0(path) if finding.severity == severity]


def forget_sums(good, params):
    """Make the tree one of a writer that keeps no sums."""
    tree = json.loads((params / "configuration.json").read_text())
    del tree["files"]
    (params / "configuration.json").write_text(json.dumps(tree))
    with fits.open(good) as units:
        del units[0].header["PARMSUM"]
        units.writeto(good.with_suffix(".new"), checksum=True)
    good.with_suffix(".new").replace(good)


def test_sums_chain_from_the_header_over_the_configuration_to_the_others(good, params):
    configuration = (params / "configuration.json").read_bytes()
    assert fits.getheader(good)["PARMSUM"] == hashlib.sha256(configuration).hexdigest()[:16]
    sums = {name: hashlib.sha256((params / name).read_bytes()).hexdigest() for name in NAMES[1:]}
    assert json.loads(configuration)["files"] == sums


@pytest.mark.parametrize("name", NAMES)
def test_every_changed_byte_of_a_sidecar_is_named_with_its_file(tree, params, name):
    """Emptied, altered and broken ones were once "nothing wrong"."""
    path = params / name
    good = path.read_bytes()
    digits = [place for place, byte in enumerate(good) if chr(byte).isdigit()]
    for place in (digits[0], digits[-1], len(good) - 1):
        path.write_bytes(good[:place] + bytes([good[place] ^ 1]) + good[place + 1 :])
        findings = found(tree)
        assert findings[0].path == path, place
        assert "not what was written" in findings[0].message
    for content in (b"", good[: len(good) // 2]):
        path.write_bytes(content)
        assert found(tree)[0].path == path
    path.write_bytes(good)
    assert found(tree) == []


def test_parameters_without_sums_are_compared_with_the_headers(tree, good, params):
    forget_sums(good, params)
    assert check_level0(tree) == []
    for name, old, new, words in (
        ("attitude.csv", "2028-03-04T05:06:07.250", "2028-03-04T05:06:08.250", "2028-03-04T05:06:08.250"),
        ("attitude.csv", "utc,ra_deg", "utc,right", "no column ra_deg"),
        ("attitude.csv", "30.000000", "31.000000", "pos_ang_deg = 31.000000 in its first row, POS_ANG0 is 30"),
        ("attitude.csv", ",30.", ",30 deg", "cannot be read"),
        ("attitude.csv", "utc,ra_deg", '"x"utc,ra_deg', "cannot be read"),
        ("temperature.csv", "193.0", "293.0", "293.0 K in row 1, CCDTEMP is 193.0"),
        ("temperature.csv", "193.0", "nan", "no number in row 1, column detector_k"),
        ("temperature.csv", "193.0", "193.0,7", "another number of cells in row 1"),
        ("temperature.csv", "2028", "yesterday", "no time in row 1"),
        ("keywords.yaml", "keywords:", "keywords: [", "cannot be read"),
        ("keywords.yaml", "keywords:", "words:", "no table of keywords"),
        ("keywords.yaml", "schema_version: 2", "schema_version: 3", "version 3, KEYTABLE is 2"),
        ("configuration.json", '"band": "F662"', '"band": "F999"', "FILTER: is 'F662', that of configuration.json is"),
        ("configuration.json", "{", "[", "cannot be read"),
        ("configuration.json", '"SEED": 7', '"SEED": 8', "SEED: is 7, that of configuration.json is 8"),
        ("configuration.json", "_X_L0_V01.fits", "_X_L0_V02.fits", "of another file"),
        ("configuration.json", '"obsid": "40000000012"', '"obsid": "40000000013"', "OBSID: is '40000000012'"),
    ):
        path = params / name
        text = path.read_text()
        assert old in text, (name, old)
        path.write_text(text.replace(old, new, 1))
        texts = " ".join(str(finding) for finding in found(tree))
        path.write_text(text)
        assert words in texts, (name, old, texts)
    lines = (params / "attitude.csv").read_text().splitlines(keepends=True)
    (params / "attitude.csv").write_text("".join(lines[:-1]))
    assert "has 3 rows for 3 exposures" in " ".join(map(str, found(tree)))


def test_keywords_of_the_primary_header_are_those_of_the_configuration(tree, good):
    """A header that was changed together with its checksums is found by the configuration beside it."""
    with fits.open(good) as units:
        for key, value in (("SEED", 8), ("POSI0_X", 1.0), ("OBJECT", "tau Cet"), ("TARGET", "tau Cet")):
            units[0].header[key] = value
        units.writeto(good.with_suffix(".new"), checksum=True)
    good.with_suffix(".new").replace(good)
    named = {finding.keyword for finding in found(tree) if "configuration.json" in finding.message}
    assert named == {"SEED", "POSI0_X", "OBJECT"}


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("kind", ["pipe", "link to a device", "folder", "huge", "link that leads nowhere"])
def test_what_is_no_regular_file_is_named_and_not_opened(tree, params, name, kind):
    path = params / name
    path.unlink()
    if kind == "pipe":
        os.mkfifo(path)
    elif kind == "folder":
        path.mkdir()
    elif kind == "huge":
        with path.open("wb") as file:
            file.truncate(10**12)
    else:
        path.symlink_to("/dev/zero" if kind == "link to a device" else "nowhere")
    (finding, *more) = [finding for finding in found(tree) if finding.path == path]
    assert "cannot be read" in finding.message or "regular file" in finding.message
    assert len(more) <= 1
    assert "\n" not in finding.message


@pytest.mark.parametrize("content", ["[" * 100_000, '{"a":' * 100_000, "1" * 5000, "null", "[]", '"text"', "\x00"])
def test_configurations_that_nobody_writes_are_named(tree, params, content):
    (params / "configuration.json").write_text(content)
    assert found(tree)[0].path == params / "configuration.json"


def test_surplus_and_unclaimed_parameters_are_warned_of(tree, good, params):
    (params / "notes.txt").write_text("mine")
    assert [(item.path, item.message) for item in found(tree, "warning")] == [
        (params / "notes.txt", "does not belong among parameters")
    ]
    other = params.parents[1] / "40000000013" / "V01"
    other.mkdir(parents=True)
    (other / "attitude.csv").write_text("")
    (warning,) = (item for item in found(tree, "warning") if item.path == other)
    assert "a Level-0 file that is not there" in warning.message


def test_the_table_of_keywords_beside_a_file_is_the_shipped_one(params):
    from simulator.products.keywords import KEYWORD_FILE

    assert yaml.safe_load((params / "keywords.yaml").read_text()) == yaml.safe_load(KEYWORD_FILE.read_text())
