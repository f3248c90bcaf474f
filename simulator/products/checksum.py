"""Checksums of FITS units (FITS standard 4.0, appendix J): one's-complement sums of 32-bit words, as text."""

from __future__ import annotations

import numpy as np

__all__ = ["ALL_ONES", "encode", "ones_sum"]

ALL_ONES = 0xFFFFFFFF
_OFFSET = 0x30
_PUNCTUATION = frozenset([*range(0x3A, 0x41), *range(0x5B, 0x61)])


def ones_sum(data: bytes | bytearray | memoryview, start: int = 0) -> int:
    """One's-complement sum of big-endian 32-bit words.

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
    """Sixteen letters and digits for the card ``CHECKSUM`` that make the unit sum to ``ALL_ONES``.

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
