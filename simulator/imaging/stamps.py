"""Stamps of point-spread functions in npz and FITS files: names, cards, and how they are written.

Figures of merit of a point-spread function of which only the stamps are known.
"""

import io
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from cpic_core import FloatArray, InputError, NDArray, check_writable, write_named, write_npz
from simulator.config.map_files import SCALE_TOLERANCE, MapFile, header_number, pixel_scale, read_maps
from simulator.imaging.aperture import core_cells, figures_of_stamps
from simulator.imaging.geometry import BandGeometry
from simulator.imaging.sampling import unpixelled
from simulator.imaging.stamp_metrics import StampMetrics

_CARDS = {"mask_half_width_arcsec": "MASKHW", "apodizer_energy": "APODENER"}
_BAND_CARDS = ("BAND", "FILTER")
FITS_SUFFIXES = (".fits", ".fit", ".fts")


@dataclass(frozen=True, eq=False)
class StampFile:
    """The contents of a file, unchecked; None where it says nothing."""

    off_axis: NDArray[Any]
    on_axis: NDArray[Any] | None = None
    pixel_scale_arcsec: float | None = None
    band: str | None = None
    mask_half_width_arcsec: float | None = None
    apodizer_energy: float | None = None


def read_stamps(path: str | Path) -> StampFile:
    """Read stamps and what goes with them; see `simulator.imaging.external.load_psf` for the layout.

    Raises
    ------
    InputError
        If the file cannot be read, has no off-axis image, or holds something else under a known name.
    """
    file = read_maps("psf", path)
    return _from_fits(path, file) if file.is_fits else _from_npz(path, file)


def write_stamps(stamps: StampFile, path: Path) -> Path:
    """Write stamps to ``.npz`` or ``.fits``, whole or not at all; the same bytes for the same content.

    Raises
    ------
    InputError
        For another suffix, or a place that cannot be written.
    OSError
        If the disk is full or broken.
    """
    known = {name: value for name, value in vars(stamps).items() if value is not None}
    if path.suffix.lower() == ".npz":
        check_writable(path, key="psf")
        write_npz(path.resolve(), known)
        return path
    if path.suffix.lower() not in FITS_SUFFIXES:
        raise InputError("psf", str(path), allowed="a name that ends in .npz or .fits")
    return write_named(path, _fits_bytes(known), key="psf")


def _fits_bytes(known: dict[str, Any]) -> bytes:
    from astropy.io import fits

    primary = fits.PrimaryHDU()
    if "pixel_scale_arcsec" in known:
        primary.header["PIXSCALE"] = (known["pixel_scale_arcsec"], "arcsec per pixel")
    if "band" in known:
        primary.header["BAND"] = known["band"]
    for name, card in _CARDS.items():
        if name in known:
            primary.header[card] = (known[name], name)
    hdus = fits.HDUList([primary])
    for name in ("off_axis", "on_axis"):
        if name in known:
            hdus.append(fits.ImageHDU(known[name], name=name.upper()))
            hdus[-1].header["BUNIT"] = ("", "fraction of the energy on the clear disc")
    for hdu in hdus:
        hdu.add_checksum(when="of this unit")  # the default comment is the time of day
    buffer = io.BytesIO()
    hdus.writeto(buffer)
    return buffer.getvalue()


def _from_npz(path: str | Path, file: MapFile) -> StampFile:
    off_axis, on_axis, band = (file.named(name) for name in ("off_axis", "on_axis", "band"))
    if off_axis is None:
        allowed = "an npz file with an array named off_axis"
        raise InputError("psf", str(path), allowed=allowed, hint=f"it has {', '.join(item.name for item in file.maps)}")
    numbers: dict[str, float] = {}
    for name in ("pixel_scale_arcsec", *_CARDS):
        item = file.named(name)
        if item is None:
            continue
        if item.data.size != 1 or item.data.dtype.kind not in "fiu" or not np.isfinite(item.data).all():
            raise InputError(f"psf {name}", str(item.data.tolist())[:40], allowed="one finite number", hint=str(path))
        numbers[name] = float(item.data.reshape(()))
    word: Any = None
    if band is not None:
        if band.data.size != 1 or band.data.dtype.kind not in "US":
            raise InputError("psf band", str(band.data.tolist())[:40], allowed="one name", hint=str(path))
        word = band.data.reshape(()).item()
        word = word.decode("ascii", "replace") if isinstance(word, bytes) else word
    return StampFile(off_axis.data, None if on_axis is None else on_axis.data, band=word or None, **numbers)


def _from_fits(path: str | Path, file: MapFile) -> StampFile:
    off_axis, on_axis = file.named("OFF_AXIS"), file.named("ON_AXIS")
    if off_axis is None and on_axis is None and len(file.maps) == 1:
        off_axis = file.maps[0]
    if off_axis is None:
        allowed = "a FITS file with an image OFF_AXIS, or a single image"
        raise InputError("psf", str(path), allowed=allowed, hint=f"its images are {[item.name for item in file.maps]}")
    found = [pixel_scale("psf", path, item.header) for item in (off_axis, on_axis) if item is not None]
    scales = [scale for scale in found if scale is not None]
    if scales and abs(scales[-1] / scales[0] - 1) > SCALE_TOLERANCE:
        raise InputError("psf pixel_scale_arcsec", scales[-1], unit="arcsec", allowed=f"that of OFF_AXIS, {scales[0]}")
    numbers = {name: header_number("psf", path, off_axis.header, card) for name, card in _CARDS.items()}
    named = [str(off_axis.header[card]).strip() for card in _BAND_CARDS if card in off_axis.header]
    return StampFile(
        off_axis.data,
        None if on_axis is None else on_axis.data,
        scales[0] if scales else None,
        next(iter(named), None),
        **numbers,
    )


def stamp_metrics(
    on_axis: FloatArray, off_axis: FloatArray, band: str, geometry: BandGeometry, apodizer_energy: float
) -> StampMetrics:
    """Measure the figures on the stamps; aperture and hole are those of the instrument's band.

    Parameters
    ----------
    on_axis, off_axis : ndarray, shape (n, n), n odd
        Fraction of the energy on the clear disc in each pixel.
    band : str
        Name of the band.
    geometry : BandGeometry
        Aperture and hole of the band, and the mask behind which the stamp was made.
    apodizer_energy : float
        Energy behind the apodizer.
    """
    cells, _ = core_cells(geometry.pixel_scale_arcsec, geometry.aperture_radius_arcsec)
    core = unpixelled(off_axis, cells)
    figures = geometry.figures() | figures_of_stamps(on_axis, off_axis, core, geometry, geometry.zone.diagonal)
    light = on_axis.sum(axis=0)
    return StampMetrics(band=band, strehl=None, apodizer_energy=apodizer_energy, column_light=light, **figures)
