import numpy as np
import pytest
from astropy.io import fits

from simulator.products.keywords import ALL_ONES, checked_value, encode, escaped, load_keywords, ones_sum

TABLE = load_keywords()

# What other CSST code and documents read, and what is proposed for Level 0 of CPI-C.
PRIMARY = tuple(
    """
    FILENAME INSTRUME OBSID OBSTYPE FILETYPE OBJECT RA_OBJ DEC_OBJ OBJ_RA OBJ_DEC DATE-OBS EXPSTART EXPTIME
    RA_PNT0 DEC_PNT0 RA_PNT1 DEC_PNT1 POS_ANG1 POSI0_X POSI0_Y POSI0_Z VELO0_X VELO0_Y VELO0_Z TELESCOP TARGET
    EXPEND TIMESYS SUNANGL0 SUNANGL1 MOONANG0 MOONANG1 TEL_ALT0 TEL_ALT1 NEXTEND SWNAME SWVER CONFHASH SEED
""".split()
)

IMAGE = tuple(
    """
    DETNAM DETECTOR FILTER CCDLABEL GAIN1 RDNOISE1 IMG_VER BUNIT CRPIX1 CRVAL1 CTYPE1 CD1_1 RADESYS EQUINOX
    FRAMEID NFRAME CAMERA EXPBEG EXPEND EXPTIME EMSET EMGAIN EMVOLT GAIN RDNOISE BIASLEV CCDTEMP FULLWELL
    PRESCAN OVERSCAN DARKREG PIXSCALE MASKROT
""".split()
)


def test_table_has_what_readers_look_for_where_they_look():
    for names, home in ((PRIMARY, "primary"), (IMAGE, "image")):
        for name in names:
            keyword = TABLE.keywords[TABLE.canonical(name)]
            assert keyword.hdu in (home, "both"), name
    for name in ("DMFILE", "PSFFILE"):
        assert name in TABLE.keywords


def test_table_is_consistent():
    spellings = [name for keyword in TABLE for name in (keyword.name, *keyword.aliases)]
    assert len(spellings) == len(set(spellings))
    for keyword in TABLE:
        assert keyword.hdu in ("primary", "image", "both")
        assert keyword.kind in ("str", "int", "float", "bool")
        assert keyword.required in ("always", "sky", "coordinates", "no")
        assert keyword.confidence in ("P", "I", "A")
        assert keyword.comment
        for name in (keyword.name, *keyword.aliases):
            assert len(name) <= 8
    for profile in TABLE.profiles.values():
        for name, spellings in profile.items():
            assert set(spellings) <= {name, *TABLE.keywords[name].aliases}


def test_any_spelling_is_found(refused):
    assert TABLE.find({"FILETYPE": "SCI"}, "OBSTYPE") == ("FILETYPE", "SCI")
    assert TABLE.value({"DETECTOR": "x"}, "DETNAM") == "x"
    assert TABLE.find({}, "OBSTYPE") is None
    assert TABLE.canonical("OBJ_RA") == "RA_OBJ"
    refused(r"keyword_profile = mine.*csst", TABLE.profile, "mine")


def test_values_take_the_type_of_their_keyword():
    assert checked_value(TABLE, "EXPTIME", 3) == 3.0
    assert type(checked_value(TABLE, "EXPTIME", np.float32(3))) is float
    assert type(checked_value(TABLE, "NFRAME", np.int16(3))) is int
    assert str(checked_value(TABLE, "MASKROT", -0.0)) == "0.0"
    assert checked_value(TABLE, "OBJECT", "α Cen\nB") == "\\u03b1 Cen\\nB"
    assert checked_value(TABLE, "MYKEY", np.bool_(True)) is True
    assert escaped("plain ~ text") == "plain ~ text"


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
