import io

import numpy as np
import pytest
from astropy.io import fits
from astropy.table import Table

from simulator.products import keywords as units
from simulator.products.keywords import load_keywords

RNG = np.random.default_rng(5)
IMAGES = {
    "u2": RNG.integers(0, 65536, (7, 13)).astype(np.uint16),
    "u1": RNG.integers(0, 256, (13, 7)).astype(np.uint8),
    "f4": RNG.normal(size=(1, 1)).astype(np.float32),
    "f8": RNG.normal(size=(3, 480)),
}


def opened(file):
    file.seek(0)
    found = fits.open(file, checksum=True)
    found.verify("exception")
    return found


@pytest.mark.parametrize("kind", IMAGES)
def test_astropy_reads_images_as_they_were(kind):
    image, file = IMAGES[kind], io.BytesIO()
    units.append_primary(file, [("OBSID", "40000000001", "number")])
    first = units.append_image(file, image, [("MYKEY", 2.5, "")], "IMAGE", 1)
    units.append_image(file, image[::-1, ::-1], [], "IMAGE", 2)
    assert len(file.getvalue()) % 2880 == 0
    with opened(file) as found:
        assert found[0].header["OBSID"] == "40000000001"
        assert found[0].data is None
        assert found[1].header["MYKEY"] == 2.5
        assert found[1].header["DATASUM"] == first
        assert found[1].data.dtype.newbyteorder("=") == image.dtype
        assert np.array_equal(found["IMAGE", 1].data, image)
        assert np.array_equal(found["IMAGE", 2].data, image[::-1, ::-1])


@pytest.mark.parametrize("shape", [(1, 1), (5, 9), (1050, 1080)])
def test_astropy_reads_compressed_images_as_they_were(shape):
    mask, file = np.zeros(shape, np.uint8), io.BytesIO()
    mask[RNG.random(shape) < 0.01] = 17
    mask[-1, 0] = 255
    units.append_primary(file, [])
    units.append_compressed(file, mask, "MASK", 1)
    units.append_compressed(file, mask.T, "MASK", 2)
    if mask.size > 1000:
        assert len(file.getvalue()) < mask.size
    with opened(file) as found:
        assert isinstance(found[1], fits.CompImageHDU)
        assert found["MASK", 1].data.dtype == np.uint8
        assert np.array_equal(found["MASK", 1].data, mask)
        assert np.array_equal(found["MASK", 2].data, mask.T)


def test_astropy_reads_tables_as_they_were():
    file, columns = io.BytesIO(), {"name": ["star", "b"], "x": [1.5, -2.0], "n": [3, 2**40]}
    units.append_primary(file, [])
    units.append_table(file, columns, {"x": "arcsec", "other": "s"}, "SOURCES")
    with opened(file) as found:
        table = Table.read(found["SOURCES"])
        assert {key: table[key].tolist() for key in table.colnames} == columns
        assert str(table["x"].unit) == "arcsec"


def test_the_same_content_gives_the_same_bytes_at_any_time(monkeypatch):
    def written():
        file = io.BytesIO()
        units.append_primary(file, [("A", 1, "x")])
        units.append_image(file, IMAGES["u2"], [], "IMAGE", 1)
        units.append_compressed(file, IMAGES["u1"], "MASK", 1)
        units.append_table(file, {"a": [1]}, {}, "T")
        return file.getvalue()

    first = written()
    units._card_text.cache_clear()
    monkeypatch.setattr("time.time", lambda: 4e9)
    assert written() == first


def test_cards_keep_type_and_text():
    file = io.BytesIO()
    values = [
        ("AA", True, ""),
        ("BB", 1, ""),
        ("CC", 1.0, ""),
        ("DD", "it's / 'quoted'", "note"),
        ("EE", "x" * 300, ""),
        ("FF", "", ""),
        ("GG", -1.2345678901234567e-300, "n"),
    ]
    units.append_primary(file, values)
    with opened(file) as found:
        header = found[0].header
        for name, value, _ in values:
            # a number has twenty characters
            assert header[name] == (pytest.approx(value, rel=1e-12) if name == "GG" else value)
            assert type(header[name]) is type(value)


def test_every_keyword_fits_its_card(recwarn):
    table = load_keywords()
    longest = {"str": "x" * 18, "int": -(10**18), "float": -1.234567890123456e-123, "bool": True}
    file = io.BytesIO()
    values = {keyword.name: longest[keyword.kind] for keyword in table}
    units.append_primary(file, units.header_cards(values, table, table.profile("csst")))
    with opened(file) as found:
        for keyword in table:
            assert found[0].header.comments[keyword.name] == keyword.note, keyword.name
    assert not recwarn.list
