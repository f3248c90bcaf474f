import numpy as np
import pytest
from astropy.io import fits

from simulator.products.checksum import ALL_ONES, encode, ones_sum


def plain_sum(data):
    total = 0
    for start in range(0, len(data), 4):
        total += int.from_bytes(data[start : start + 4], "big")
        total = (total & ALL_ONES) + (total >> 32)
    return total


@pytest.mark.parametrize("size", [0, 4, 2880, 28800])
@pytest.mark.parametrize("fill", ["random", "ones", "zeros"])
def test_sum_is_the_sum_of_words_with_end_around_carry(size, fill):
    rng = np.random.default_rng(3)
    data = {"random": rng.bytes(size), "ones": b"\xff" * size, "zeros": bytes(size)}[fill]
    assert ones_sum(data) == plain_sum(data)
    half = size // 8 * 4
    assert ones_sum(data[half:], ones_sum(data[:half])) == ones_sum(data)


def test_text_is_that_of_astropy():
    rng = np.random.default_rng(4)
    card = fits.ImageHDU()
    values = [0, 1, ALL_ONES, 0x3A3A3A3A, *(int(value) for value in rng.integers(0, ALL_ONES, 2000))]
    for value in values:
        text = encode(value)
        assert text == card._char_encode(~value & ALL_ONES)
        assert text.isalnum()
        assert text.isascii()
