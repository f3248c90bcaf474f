"""Checksums of FITS units (FITS standard 4.0, appendix J): one's-complement sums of 32-bit words, as text.

Header and data units as bytes, one at a time, so that a file never has to be in memory.

astropy lays out every card; units are put together here, because a header of astropy takes ten times as long to make as
the image behind it takes to write, and because its checksums carry the time of day.
"""

import functools
import gzip
import io
from collections.abc import Iterable, Mapping
from typing import IO, Any, TypeAlias

import numpy as np

from cpic_core import NDArray
from simulator.products.keywords import KeywordTable, Profile, Value

ALL_ONES = 0xFFFFFFFF
_OFFSET = 0x30
_PUNCTUATION = frozenset([*range(0x3A, 0x41), *range(0x5B, 0x61)])


def ones_sum(data: bytes | bytearray | memoryview, start: int = 0) -> int:
    """Return the one's-complement sum of big-endian 32-bit words.

    Parameters
    ----------
    data : bytes
        A multiple of 4 bytes.
    start : int
        Sum of what precedes.
    """
    total = start + int(np.frombuffer(data, dtype=">u4").sum(dtype=np.uint64))
    while total > ALL_ONES:
        total = (total & ALL_ONES) + (total >> 32)
    return total


def encode(total: int) -> str:
    """Return the sixteen letters and digits for the card ``CHECKSUM`` that make the unit sum to ``ALL_ONES``.

    Parameters
    ----------
    total : int
        Sum of the unit while the card holds sixteen zeros.
    """
    letters = [""] * 16
    for byte, value in enumerate((~total & ALL_ONES).to_bytes(4, "big")):
        quarter, rest = divmod(value, 4)
        codes = [quarter + _OFFSET + rest, *[quarter + _OFFSET] * 3]
        while _PUNCTUATION & set(codes):
            # Neighbours move apart by one, which keeps their sum.
            for pair in (0, 2):
                if _PUNCTUATION & {codes[pair], codes[pair + 1]}:
                    codes[pair] += 1
                    codes[pair + 1] -= 1
        for row, code in enumerate(codes):
            letters[4 * row + byte] = chr(code)
    # The value of the card begins one byte past a word, hence one place to the right.
    return "".join(letters[-1:] + letters[:-1])


Card: TypeAlias = tuple[str, Value, str]
_BLOCK = 2880
_CHECKSUM_NOTE = "sum of this unit"
_TYPE, _AXES, _GROUPS = "array data type", "number of array dimensions", "number of groups"
_BITPIX = {"u2": 16, "f4": -32, "f8": -64, "u1": 8}


def header_cards(values: Mapping[str, Value], table: KeywordTable, profile: Profile) -> list[Card]:
    """Return the cards of values under the names of the table.

    Those of the table come first, in its order and in the spellings of the profile; others behind them.

    Parameters
    ----------
    values : mapping of str to Value
        Values by the table's names.
    table : KeywordTable
    profile : Profile
    """
    cards: list[Card] = []
    for keyword in table:
        if keyword.name in values:
            cards += [(name, values[keyword.name], keyword.note) for name in profile.spellings(keyword.name)]
    return cards + [(name, value, "") for name, value in values.items() if name not in table.keywords]


def append_primary(file: IO[bytes], cards: Iterable[Card]) -> None:
    """Write a primary unit without data."""
    structure: list[Card] = [
        ("SIMPLE", True, "conforms to FITS standard"),
        ("BITPIX", 8, _TYPE),
        ("NAXIS", 0, _AXES),
        ("EXTEND", True, "extensions follow"),
    ]
    _append(file, [*structure, *cards], b"")


def append_image(file: IO[bytes], data: NDArray[Any], cards: Iterable[Card], name: str, version: int) -> str:
    """Write an image extension; return its ``DATASUM``.

    Parameters
    ----------
    data : ndarray, 2-D
        Unsigned 16-bit (stored with ``BZERO`` 32768), unsigned 8-bit or real.
    """
    rows, columns = data.shape
    kind = f"{data.dtype.kind}{data.dtype.itemsize}"
    structure: list[Card] = [
        *(("XTENSION", "IMAGE", "Image extension"), ("BITPIX", _BITPIX[kind], _TYPE)),
        *(("NAXIS", 2, _AXES), ("NAXIS1", columns, "columns"), ("NAXIS2", rows, "rows")),
        *(("PCOUNT", 0, "number of parameters"), ("GCOUNT", 1, _GROUPS)),
    ]
    if kind == "u2":
        structure += [("BSCALE", 1, "unsigned integers"), ("BZERO", 32768, "unsigned integers")]
        data = np.bitwise_xor(data, np.uint16(0x8000))
    structure += [("EXTNAME", name, "name of this extension"), ("EXTVER", version, "its number")]
    stored = data.astype(data.dtype.newbyteorder(">"), copy=False)
    return _append(file, [*structure, *cards], np.ascontiguousarray(stored).data.cast("B"))


def append_compressed(file: IO[bytes], data: NDArray[np.uint8], name: str, version: int) -> str:
    """Write an image of bytes, compressed without loss as one tile (FITS standard 4.0, section 10.1, GZIP_1).

    Parameters
    ----------
    file : IO[bytes]
    data : ndarray of uint8
        Image of bytes, (y, x).
    name : str
        Name of the extension.
    version : int
        Its version.
    """
    rows, columns = data.shape
    packed = gzip.compress(np.ascontiguousarray(data).data, 1, mtime=0)
    cards: list[Card] = [
        *(("XTENSION", "BINTABLE", "binary table extension"), ("BITPIX", 8, _TYPE)),
        *(("NAXIS", 2, _AXES), ("NAXIS1", 8, "bytes of a row"), ("NAXIS2", 1, "rows")),
        *(("PCOUNT", len(packed), "bytes behind the table"), ("GCOUNT", 1, _GROUPS)),
        *(("TFIELDS", 1, "columns"), ("TTYPE1", "COMPRESSED_DATA", ""), ("TFORM1", f"1PB({len(packed)})", "")),
        *(("ZIMAGE", True, "a compressed image"), ("ZTENSION", "IMAGE", "Image extension")),
        *(("ZCMPTYPE", "GZIP_1", "compression"), ("ZBITPIX", 8, _TYPE)),
        *(("ZNAXIS", 2, _AXES), ("ZNAXIS1", columns, "columns"), ("ZNAXIS2", rows, "rows")),
        *(("ZTILE1", columns, "columns of a tile"), ("ZTILE2", rows, "rows of a tile")),
        *(("ZPCOUNT", 0, "number of parameters"), ("ZGCOUNT", 1, _GROUPS)),
        *(("EXTNAME", name, "name of this extension"), ("EXTVER", version, "its number")),
    ]
    return _append(file, cards, np.array([len(packed), 0], dtype=">i4").tobytes() + packed)


def append_table(file: IO[bytes], columns: Mapping[str, Any], units: Mapping[str, str], name: str) -> str:
    """Write a table extension of equally long columns; a column without an entry in ``units`` has none.

    Parameters
    ----------
    file : IO[bytes]
    columns : mapping
        Columns by name, of one length.
    units : mapping of str to str
        Unit by column.
    name : str
        Name of the extension.
    """
    from astropy.io import fits
    from astropy.table import Table

    table = Table({key: np.asarray(column) for key, column in columns.items()})
    for key, unit in units.items():
        if key in columns:
            table[key].unit = unit
    hdu = fits.table_to_hdu(table)
    hdu.name = name
    buffer = io.BytesIO()
    hdu.writeto(buffer, output_verify="exception")
    # astropy puts an empty primary unit in front of an extension.
    data = buffer.getbuffer()[_BLOCK + len(hdu.header.tostring()) :]
    return _append(file, [(card.keyword, card.value, card.comment) for card in hdu.header.cards], data)


def _append(file: IO[bytes], cards: Iterable[Card], data: bytes | memoryview) -> str:
    """Write one unit with its checksums; return the ``DATASUM``."""
    padding = bytes(-len(data) % _BLOCK)
    words = len(data) // 4 * 4
    data_sum = ones_sum(data[:words])
    if padding:
        data_sum = ones_sum(bytes(data[words:]) + padding[: -(len(data) - words) % 4], data_sum)
    text = "".join(_card_text(*card) for card in [*cards, ("DATASUM", str(data_sum), "sum of its data")])
    zeros = _card_text("CHECKSUM", "0" * 16, _CHECKSUM_NOTE)
    end = "END".ljust(80)
    length = len(text) + len(zeros) + len(end)
    blank = " " * (-length % _BLOCK)
    total = ones_sum(f"{text}{zeros}{end}{blank}".encode("ascii"), data_sum)
    checksum = _card_text("CHECKSUM", encode(total), _CHECKSUM_NOTE)
    file.write(f"{text}{checksum}{end}{blank}".encode("ascii"))
    file.write(data)
    file.write(padding)
    return str(data_sum)


@functools.lru_cache(maxsize=4096, typed=True)
def _card_text(name: str, value: Value, note: str) -> str:
    """Return the layout of one card, of several where a text is long."""
    from astropy.io import fits

    return str(fits.Card(name, value, note).image)
