"""Level-1 files: pairs of a reduced image and its mask, with the errors in a file beside them.

A Level-1 file has an empty primary unit, then one pair of units a frame, ``REDUCED`` and ``MASK``, as the Level-1 data
model has them; any reader that takes units two by two reads it. The errors of a frame are in a file of their own beside
it, ``NAME_ERROR.fits``, since all frames of a file share them: ``ERROR``, of one frame, and ``MASTERS``, the part of
it that comes from the calibration and does not average out over frames. Everything is on the active pixels.
"""

import contextlib
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from cpic_core import FloatArray, InputError, NDArray, Record, as_path, bounded_fits, fingerprint, open_file, whole_file
from simulator.camera import MaskBit
from simulator.products.keywords import (
    Card,
    KeywordTable,
    Value,
    append_image,
    append_primary,
    escaped,
    header_cards,
    load_keywords,
)
from simulator.products.write import DISTRIBUTION, software_version

_MOST_BYTES = 200_000_000_000
_UNREADABLE = (OSError, ValueError, TypeError, LookupError, AttributeError, ArithmeticError, AssertionError)
NOTES = {
    "L0FILE": "Level-0 file that this was made of",
    "L0SEC": "part of its frames",
    "L1FILE": "Level 1 of these errors",
    "VER_PIPE": "software that reduced it",
    "STA_PIPE": "state of the reduction, 0 is complete",
    "I_MEAN": "[electron] mean of good pixels",
    "I_STD": "[electron] their standard deviation",
    "BP_NAM": "bad pixels from",
    "BP_NUM": "[pix] bad, hot and warm pixels",
    "B_NAM": "bias from",
    "B_MEAN": "[adu] its mean",
    "B_STD": "[adu] its standard deviation",
    "D_NAM": "dark current from",
    "D_MEAN": "[electron] its mean in this exposure",
    "D_STD": "[electron] its standard deviation",
    "F_NAM": "flat from",
    "F_MEAN": "its mean",
    "F_STD": "its standard deviation",
    "CIC_NAM": "clock-induced charge from",
    "NL_NAM": "curves of the non-linearity from",
    "CR_MOD": "how cosmic rays were found",
    "CR_NUM": "[pix] pixels that they hit, with neighbours",
    "SP_NUM": "[pix] saturated pixels",
    "LEVEL": "[adu] level of the bias of this frame",
}
"""Comments of the keywords of the Level-1 data model and of ours, in the order of writing."""
_MOST_TEXT = 60  # characters of a text and its comment in one card
_BITS: list[Card] = [(f"MASK{bit.value:03d}", str(bit.name).lower(), "what this bit says") for bit in MaskBit]
_UNREDUCED = {
    *("NSAT", "NREGSAT", "NCLIP", "BIASLEV", "EPERADU", "NCR", "NNEGRATE"),
    *("NEXTEND", "FILENAME", "BUNIT", "FPRINT", "PARMSUM"),
}


class Level1Frame(Record, eq=False):
    """One frame of a Level-1 file.

    Attributes
    ----------
    image_e : ndarray, shape (y, x)
        Electrons of light at the register input.
    error_e : ndarray, shape (y, x)
        Standard deviation of ``image_e``.
    mask : ndarray of uint8, shape (y, x)
        `simulator.camera.MaskBit`; 0 is good.
    header : mapping
        Header of the image, by the names of the table of keywords.
    """

    image_e: FloatArray
    error_e: FloatArray
    mask: NDArray[np.uint8]
    header: Mapping[str, Any]


class Level1(Record, eq=False):
    """A Level-1 file, whose frames are read one at a time.

    Attributes
    ----------
    path : Path
    header : mapping
        Keywords of the primary unit and of the first image, by the names of the table of keywords. ``CRPIX1`` and
        ``CRPIX2`` are column and row of the star from 1, on the pixels of this file.
    n_frames : int
    error_e : ndarray, shape (y, x)
        Standard deviation of a pixel of one frame, with that of the calibration.
    master_error_e : ndarray, shape (y, x)
        The part of it that all frames share: no mean over frames lowers it.
    """

    path: Path
    header: Mapping[str, Any]
    n_frames: int
    error_e: FloatArray
    master_error_e: FloatArray

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        rows, columns = self.error_e.shape
        return rows, columns

    def iter_frames(self) -> Iterator[Level1Frame]:
        """Yield the frames; one is in memory at a time."""
        with fits_units(self.path) as units:
            for reduced, bits in zip(units[1::2], units[2::2], strict=True):
                yield Level1Frame(
                    _image(reduced), self.error_e, np.array(bits.data, dtype=np.uint8), named_header(reduced.header)
                )
                del reduced.data, bits.data


def level1_name(level0: Path) -> str:
    """Return the name of the Level-1 file of a Level-0 file: ``_L1_`` in the place of ``_L0_``, or at the end."""
    stem = level0.name.split(".fits")[0].split(".fit")[0]
    return f"{stem.replace('_L0_', '_L1_', 1) if '_L0_' in stem else f'{stem}_L1'}.fits"


def error_file(path: Path) -> Path:
    """Return the file of the errors of a Level-1 file."""
    return path.with_name(f"{path.stem}_ERROR.fits")


def read_level1(path: str | Path) -> Level1:
    """Open a Level-1 file that `write_level1` wrote.

    Parameters
    ----------
    path : str or Path

    Returns
    -------
    Level1

    Raises
    ------
    InputError
        If the file or that of its errors is missing, no FITS, or not made of pairs of images of one shape.
    """
    place = as_path("file", path)
    errors = error_file(place)
    with fits_units(place) as units:
        n_frames, rest = divmod(len(units) - 1, 2)
        names = [unit.name for unit in units[1:]]
        if rest or not n_frames or names != ["REDUCED", "MASK"] * n_frames:
            raise InputError("file", str(path), allowed="Level 1: pairs of units REDUCED and MASK, one pair a frame")
        shapes = {tuple(unit.shape) for unit in units[1:]}
        header = named_header(units[1].header) | named_header(units[0].header)
    with fits_units(errors) as units:
        found = {unit.name: _image(unit) for unit in units[1:]}
    for name in ("ERROR", "MASTERS"):
        if name not in found or shapes != {found[name].shape}:
            allowed = f"a file with an image {name} of the shape of the frames"
            raise InputError("file", str(errors), allowed=allowed, hint=f"it belongs to {place.name}")
    return Level1(place, header, n_frames, found["ERROR"], found["MASTERS"])


def write_level1(
    path: str | Path,
    primary: Mapping[str, Value],
    shared: Mapping[str, Value],
    frames: Iterable[tuple[FloatArray, NDArray[np.uint8], Mapping[str, Value]]],
    errors: Callable[[], tuple[FloatArray, FloatArray]],
    *,
    n_frames: int,
) -> None:
    """Write a Level-1 file and that of its errors.

    Parameters
    ----------
    path : str or Path
        A file that is there is replaced; its folder is made.
    primary, shared : mapping of str to Value
        Values of the primary header, and those that all images share, by the names of the table of keywords. What
        describes raw frames alone is left out.
    frames : iterable of (ndarray, ndarray of uint8, mapping)
        Electrons of light, mask, and values of its own header, of one frame after the other; (y, x).
    errors : callable
        Returns error of a frame and error of the masters (e-, both (y, x)) once the frames are written.
    n_frames : int
    """
    place = as_path("path", path)
    place.parent.mkdir(parents=True, exist_ok=True)
    table = load_keywords()

    def cards(values: Mapping[str, Value]) -> list[Card]:
        return _cards({key: value for key, value in values.items() if key not in _UNREDUCED}, table)

    own: dict[str, Value] = {"VER_PIPE": f"{DISTRIBUTION} {software_version()}", "STA_PIPE": 0, "NFRAME": n_frames}
    with whole_file(error_file(place)) as beside, whole_file(place) as file:
        extensions: Card = ("NEXTEND", 2 * n_frames, "extensions in this file")
        append_primary(file, [*identity(place), extensions, *cards({**primary, **own})])
        for number, (image, mask, values) in enumerate(frames, start=1):
            found: list[Card] = [("BUNIT", "electron", "of light at the register input"), *cards({**shared, **values})]
            append_image(file, image.astype(np.float32), found, "REDUCED", number)
            append_image(file, mask, _BITS, "MASK", number)
        append_primary(beside, [*identity(error_file(place)), card_of("L1FILE", place.name, NOTES["L1FILE"])])
        for title, image in zip(("ERROR", "MASTERS"), errors(), strict=True):
            append_image(beside, image.astype(np.float32), [("BUNIT", "electron", "standard deviation")], title, 1)


def _cards(values: Mapping[str, Value], table: KeywordTable) -> list[Card]:
    """Return the cards: those of the table of keywords, those of the data model, and others."""
    known = header_cards(
        {key: value for key, value in values.items() if key not in NOTES}, table, table.profile("csst")
    )
    return known + [card_of(key, values[key], note) for key, note in NOTES.items() if key in values]


def identity(path: Path) -> list[Card]:
    """Return the cards that say which file this is and which code made it."""
    return [card_of("FILENAME", path.name, "this file"), ("FPRINT", str(fingerprint()), "its fingerprint")]


def card_of(key: str, value: Value, note: str) -> Card:
    """Return a card; a text has its comment where both fit.

    Parameters
    ----------
    key : str
    value : str, int, float or bool
    note : str
        Comment.
    """
    text = escaped(value) if isinstance(value, str) else value
    return key, text, "" if isinstance(text, str) and len(text) + len(note) > _MOST_TEXT else note


def named_header(header: Any) -> dict[str, Any]:
    """Return a header by the names of the table of keywords, the values as they stand in the cards.

    Parameters
    ----------
    header : Header
        Of astropy. Its items have a text such as ``"mode: 3"`` as a number under another keyword.
    """
    table = load_keywords()
    cards = [card for card in header.cards if card.rawkeyword not in ("", "COMMENT", "HISTORY")]
    return {table.canonical(card.rawkeyword): card.rawvalue for card in cards}


def _image(unit: Any) -> FloatArray:
    return np.array(unit.data, dtype=np.float64)


@contextlib.contextmanager
def fits_units(path: Path) -> Iterator[Any]:
    """Open the units of a FITS file, each read when its data are asked for; refused in one line if it is none.

    Parameters
    ----------
    path : Path

    Raises
    ------
    InputError
        Naming the file and the damage.
    """
    from astropy.io import fits

    allowed = "a FITS file that is not packed"
    with open_file(path, key="file", allowed=allowed, max_bytes=_MOST_BYTES) as file:
        try:
            # Not mapped: a mapped file keeps every page that was read.
            with fits.open(bounded_fits(file), memmap=False) as units:
                len(units)
                yield units
        except (*_UNREADABLE, fits.VerifyError) as error:
            if isinstance(error, InputError):
                raise
            raise InputError("file", str(path), allowed=allowed, hint=str(error).splitlines()[0]) from None
