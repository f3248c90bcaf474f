"""Damaged bytes of Level-0 files: always found, whatever is hit."""

import shutil

import numpy as np
import pytest
from astropy.io import fits

from simulator.products import check_level0


def errors(path):
    return [finding for finding in check_level0(path) if finding.severity == "error"]


@pytest.mark.parametrize("place", ["data", "header"])
def test_a_flipped_bit_is_found(good, tree, place):
    shutil.rmtree(tree / "Truth")
    with fits.open(good) as units:
        info = units[2].fileinfo()
    data = bytearray(good.read_bytes())
    if place == "data":
        data[info["datLoc"] + 5] ^= 1
    else:
        spot = data.index(b"MYKEY", info["hdrLoc"])
        data[spot : spot + 5] = b"MYKEZ"
    good.write_bytes(bytes(data))
    findings = errors(good)
    expected = {"CHECKSUM", "DATASUM"} if place == "data" else {"CHECKSUM"}
    assert {(f.hdu, f.keyword) for f in findings} == {(2, key) for key in expected}


@pytest.mark.parametrize("keep", [0, 100, 2880, 10000, -2880, -100])
def test_truncated_files_are_named(good, keep):
    data = good.read_bytes()
    good.write_bytes(data[:keep])
    findings = errors(good)
    assert findings
    texts = " ".join(f.message for f in findings)
    assert "truncated" in texts or "not readable as FITS" in texts or "images" in texts, texts
    assert all(f.path in (good, *good.parents[2].rglob("*_TRUTH.fits")) for f in findings)


def test_surplus_bytes_are_named(good):
    good.write_bytes(good.read_bytes() + bytes(2880))
    assert any("behind its last unit" in f.message for f in errors(good))


@pytest.mark.parametrize("content", [b"", b"hello", b"\x00" * 5760, b"SIMPLE  =                    T" + b" " * 2850])
def test_what_is_not_fits_is_named(good, content):
    good.write_bytes(content)
    assert errors(good)
    assert all(f.path == good for f in errors(good))


def test_damaged_truth_is_found(tree, good):
    truth = next((tree / "Truth").rglob("*.fits"))
    data = truth.read_bytes()
    with fits.open(truth, disable_image_compression=True) as units:
        mask, sources = units["MASK", 2].fileinfo(), units["SOURCES"].fileinfo()
        number = units.index_of(("MASK", 2))
    for info, hdu in ((mask, number), (sources, 3)):
        damaged = bytearray(data)
        damaged[info["datLoc"] + 11] ^= 1
        truth.write_bytes(bytes(damaged))
        assert {(f.path, f.hdu, f.keyword) for f in errors(good)} == {
            (truth, hdu, "CHECKSUM"),
            (truth, hdu, "DATASUM"),
        }
    truth.write_bytes(data[:-2880])
    assert any("truncated" in f.message or "FRAMES" in f.message for f in errors(good))


@pytest.mark.parametrize("seed", range(25))
def test_no_damage_stops_the_check(tree, good, seed):
    rng = np.random.default_rng(seed)
    for path in (good, next((tree / "Truth").rglob("*.fits"))):
        data = bytearray(path.read_bytes())
        # most of a small file is headers
        for spot in rng.integers(0, len(data), 6):
            data[spot] = rng.integers(32, 127)
        path.write_bytes(bytes(data[: rng.integers(len(data) // 2, 2 * len(data))]))
    assert errors(good)
    assert errors(tree)
