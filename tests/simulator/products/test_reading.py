"""Files that no writer of products makes: a check of them ends soon, and takes little memory."""

import os
import tracemalloc

import pytest
from astropy.io import fits

from simulator.products import check as reading, check_level0

NAME = "CSST_CPIC_VIS_SCI_20280304050607_20280304050639_40000000012_X_L0_V01.fits"
SIMPLE = "SIMPLE  =                    T"


def header(*cards):
    """Bytes of a header."""
    text = "".join(card.ljust(80) for card in (*cards, "END")).encode()
    return text.ljust(-(-len(text) // 2880) * 2880)


PRIMARY = header(SIMPLE, "BITPIX  =                    8", "NAXIS   =                    0", "EXTEND  =   T".ljust(30))
EMPTY = header("XTENSION= 'IMAGE   '", "BITPIX  =                   16", "NAXIS   =                    0")


def image(side):
    axes = (f"NAXIS{axis}  = {side:>20d}" for axis in (1, 2))
    return header("XTENSION= 'IMAGE   '", "BITPIX  =                   16", "NAXIS   =                    2", *axes)


@pytest.mark.parametrize(
    ("content", "size", "words"),
    [
        (SIMPLE.ljust(80).encode(), 10**10, "header of more than 4000000 bytes"),
        (SIMPLE.ljust(80).encode(), 10**12, "at most 200000000000 bytes"),
        (PRIMARY + b"XTENSION= 'IMAGE   '", 10**10, "header of more than 4000000 bytes"),
        (PRIMARY + image(70_000), 9_801_000_000, "unit 1 has 9800000640 bytes"),
        (b"\0", 10**11, "not readable as FITS"),
    ],
)
def test_files_of_absurd_size_are_refused_by_it(tmp_path, content, size, words):
    path = tmp_path / NAME
    with path.open("wb") as file:
        file.write(content)
        file.truncate(size - size % 2880)
    tracemalloc.start()
    findings = check_level0(path)
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert any(words in finding.message for finding in findings), [str(finding) for finding in findings]
    assert most < 100e6


def test_too_many_units_and_faults_are_named_once(tmp_path, monkeypatch):
    path = tmp_path / NAME
    path.write_bytes(PRIMARY + EMPTY * 120)
    findings = check_level0(path)
    assert len(findings) == 1001
    assert findings[-1].message == "has more than 1000 faults: the rest is not listed"
    monkeypatch.setattr(reading, "_MOST_UNITS", 100)
    assert "more than 100 units" in " ".join(map(str, check_level0(path)))


def test_a_header_of_many_cards_is_read(tmp_path):
    """A ledger and a list of calibration files of 999 rows each."""
    path = tmp_path / NAME
    cards = fits.Header([(f"EFF{row:03d}", "because " * 30) for row in range(1, 1000)])
    fits.PrimaryHDU(header=cards).writeto(path)
    assert not any("not readable" in finding.message for finding in check_level0(path))


@pytest.mark.parametrize("kind", ["pipe", "device", "link to a device"])
def test_a_path_that_is_neither_file_nor_folder_is_refused(refused, tmp_path, kind):
    path = tmp_path / NAME
    if kind == "pipe":
        os.mkfifo(path)
    elif kind == "device":
        path = "/dev/zero"
    else:
        path.symlink_to("/dev/zero")
    refused("path = .*allowed: a regular file or a folder.*neither: a pipe, a socket or a device", check_level0, path)


def test_what_is_no_file_in_a_tree_is_named_and_folders_are_not_entered_through_links(tree, good):
    day = good.parent
    os.mkfifo(tree / "notes")
    (day / "link.fits").symlink_to("/dev/zero")
    (day / "folder.fits").mkdir()
    (tree / "round").symlink_to(tree)
    (tree / "Truth" / "61834" / "pipe").symlink_to("/dev/random")
    said = {str(item.path.relative_to(tree)): f"{item.severity} {item.message}" for item in check_level0(tree)}
    assert said == {
        "notes": "error is no regular file: it is not opened",
        "round": "warning is a link to a folder: it is not followed",
        "SCI/61834/folder.fits": "error is a folder, and has the name of a file",
        "SCI/61834/link.fits": said["SCI/61834/link.fits"],
        "Truth/61834/pipe": "error is no regular file: it is not opened",
    }
    assert "this is a device" in said["SCI/61834/link.fits"]


def test_a_folder_that_cannot_be_looked_into_is_no_good_folder(tree, good, monkeypatch):
    scandir = os.scandir

    def closed(path):
        if str(path).endswith("Params"):
            raise PermissionError(13, "Permission denied", str(path))
        return scandir(path)

    monkeypatch.setattr(os, "scandir", closed)
    assert [str(item) for item in check_level0(tree)] == [
        f"error: {tree / 'Params'}: cannot be looked into: Permission denied"
    ]
