"""Point-spread functions made by other software, as stamps in npz or FITS files; and ours, written as such files."""

import functools
import hashlib
import io
import math
from pathlib import Path
from typing import Any

import numpy as np

from cpic_core import (
    ArrayLike,
    FloatArray,
    InputError,
    NDArray,
    Record,
    as_path,
    check_number,
    check_word,
    check_writable,
    numeric_context,
    write_named,
    write_npz,
)
from simulator.config import Instrument, InstrumentLike, content_hash, load_instrument, map_files
from simulator.imaging.aperture import core_cells, figures_of_stamps
from simulator.imaging.metrics import StampMetrics
from simulator.imaging.sampling import displaced, open_pixels, unpixelled
from simulator.imaging.zones import BandGeometry

_CARDS = {"mask_half_width_arcsec": "MASKHW", "apodizer_energy": "APODENER"}
_BAND_CARDS = ("BAND", "FILTER")
FITS_SUFFIXES = (".fits", ".fit", ".fts")


def read_stamps(path: str | Path) -> dict[str, Any]:
    """Return the stamps of a file and what goes with them, unchecked, by the names of `ExternalPsf`.

    What the file does not say is left out; see `load_psf` for its layout.

    Raises
    ------
    InputError
        If the file cannot be read, has no off-axis image, or holds something else under a known name.
    """
    file = map_files.read_maps("psf", path)
    return _from_fits(path, file) if file.is_fits else _from_npz(path, file)


def _fits_bytes(known: dict[str, Any]) -> bytes:
    from astropy.io import fits

    primary = fits.PrimaryHDU()
    primary.header["PIXSCALE"] = (known["pixel_scale_arcsec"], "arcsec per pixel")
    if "band" in known:
        primary.header["BAND"] = known["band"]
    for name, card in _CARDS.items():
        if name in known:
            primary.header[card] = (known[name], name)
    hdus = fits.HDUList([primary])
    for name in ("off_axis", "on_axis"):
        hdus.append(fits.ImageHDU(known[name], name=name.upper()))
        hdus[-1].header["BUNIT"] = ("", "fraction of the energy on the clear disc")
    for hdu in hdus:
        hdu.add_checksum(when="of this unit")  # the default comment is the time of day
    buffer = io.BytesIO()
    hdus.writeto(buffer)
    return buffer.getvalue()


def _from_npz(path: str | Path, file: map_files.MapFile) -> dict[str, Any]:
    known: dict[str, Any] = {name: item.data for name in ("off_axis", "on_axis") if (item := file.named(name))}
    if "off_axis" not in known:
        allowed = "an npz file with an array named off_axis"
        raise InputError("psf", str(path), allowed=allowed, hint=f"it has {', '.join(item.name for item in file.maps)}")
    names = ("pixel_scale_arcsec", *_CARDS)
    numbers = {name: map_files.array_number(f"psf {name}", path, file.named(name)) for name in names}
    known |= {name: value for name, value in numbers.items() if value is not None}
    if (band := file.named("band")) is not None:
        if band.data.size != 1 or band.data.dtype.kind not in "US":
            raise InputError("psf band", str(band.data.tolist())[:40], allowed="one name", hint=str(path))
        word = band.data.reshape(()).item()
        known["band"] = word.decode("ascii", "replace") if isinstance(word, bytes) else word
    return known


def _from_fits(path: str | Path, file: map_files.MapFile) -> dict[str, Any]:
    off_axis, on_axis = file.named("OFF_AXIS"), file.named("ON_AXIS")
    if off_axis is None and on_axis is None and len(file.maps) == 1:
        off_axis = file.maps[0]
    if off_axis is None:
        allowed = "a FITS file with an image OFF_AXIS, or a single image"
        raise InputError("psf", str(path), allowed=allowed, hint=f"its images are {[item.name for item in file.maps]}")
    found = [map_files.pixel_scale("psf", path, item.header) for item in (off_axis, on_axis) if item is not None]
    scales = [scale for scale in found if scale is not None]
    if scales and abs(scales[-1] / scales[0] - 1) > map_files.SCALE_TOLERANCE:
        raise InputError("psf pixel_scale_arcsec", scales[-1], unit="arcsec", allowed=f"that of OFF_AXIS, {scales[0]}")
    numbers = {name: map_files.header_number("psf", path, off_axis.header, card) for name, card in _CARDS.items()}
    named = [str(off_axis.header[card]).strip() for card in _BAND_CARDS if card in off_axis.header]
    known: dict[str, Any] = {name: value for name, value in numbers.items() if value is not None}
    known |= {"on_axis": on_axis.data} if on_axis is not None else {}
    known |= {"pixel_scale_arcsec": scales[0]} if scales else {}
    return known | {"off_axis": off_axis.data, "band": next(iter(named), "")}


SIDES = (9, 2201)
ROUNDING = 1e-6
NEGATIVE = 1e-9
"""Largest negative pixel, relative to the peak, that counts as rounding."""


class ExternalPsf(Record, eq=False):
    """Point-spread functions of one band, known on star-centred stamps only; centre pixel ``n // 2``.

    Attributes
    ----------
    band : str
        Name of the band; empty if neither file nor caller named one.
    on_axis : ndarray, shape (n, n)
        The star behind the cross mask: fraction of the energy on the clear disc in each pixel.
    off_axis : ndarray, shape (n, n)
        A source far from the mask, placed on the centre pixel; same unit.
    pixel_scale_arcsec : float
        Pixel of the detector.
    instrument : Instrument
        Whose band, hole and aperture the metrics use.
    mask_half_width_arcsec : float
        Half width of the bars of the cross: the file's, else the instrument's.
    apodizer_energy : float
        Energy behind the apodizer: the file's, else the sum of ``off_axis``.
    flags : tuple of str
        ``energy_scaled`` (scaled to a given sum), ``sums_to_one`` (perhaps normalised to its own sum),
        ``on_axis_derived`` (off-axis image behind the cross, as there is no Lyot stop),
        ``apodizer_energy_of_stamp``, ``mask_of_file`` (another than the instrument's), ``negative_rounding``,
        ``core_beyond_stamp`` (the stamp is smaller than the photometric aperture).
    file : str
        Name of the file, without its folder; empty if there is none.
    """

    band: str
    on_axis: FloatArray
    off_axis: FloatArray
    pixel_scale_arcsec: float
    instrument: Instrument
    mask_half_width_arcsec: float
    apodizer_energy: float
    flags: tuple[str, ...] = ()
    file: str = ""

    @functools.cached_property
    def content_hash(self) -> str:
        """Hash of the images and of what goes with them (16 hex digits): whose frames are the same."""
        digest = hashlib.sha256()
        for image in (self.on_axis, self.off_axis):
            digest.update(np.ascontiguousarray(image, dtype="<f8").data)
        parts = (self.pixel_scale_arcsec, self.mask_half_width_arcsec, self.apodizer_energy)
        return content_hash({"images": digest.hexdigest(), "numbers": [float(part) for part in parts]})

    @property
    def hole_state(self) -> str:
        """``external``: nothing is known of how it was made."""
        return "external"

    @functools.cached_property
    def geometry(self) -> BandGeometry:
        """Hole and apertures, those of the instrument's band, with the mask of these images.

        Raises
        ------
        InputError
            If no band was named: aperture and hole depend on it.
        """
        return BandGeometry.of(self.instrument, self._named_band, len(self.on_axis), self.mask_half_width_arcsec)

    @property
    def _named_band(self) -> str:
        if not self.band:
            raise InputError("band", "missing", allowed=", ".join(self.instrument.bands), hint="load_psf(..., band=)")
        return self.band

    @functools.cached_property
    def metrics(self) -> StampMetrics:
        """Figures of merit that follow from the stamps; see `StampMetrics`.

        Raises
        ------
        InputError
            If no band was named.
        """
        geometry = self.geometry
        cells, _ = core_cells(geometry.pixel_scale_arcsec, geometry.aperture_radius_arcsec)
        core = unpixelled(self.off_axis, cells)
        figures = figures_of_stamps(self.on_axis, self.off_axis, core, geometry, geometry.zone.diagonal)
        figures |= geometry.figures() | {"column_light": self.on_axis.sum(axis=0)}
        return StampMetrics(band=self._named_band, strehl=None, apodizer_energy=self.apodizer_energy, **figures)

    @functools.cached_property
    def _open(self) -> FloatArray:
        return open_pixels(len(self.off_axis), self.pixel_scale_arcsec, self.mask_half_width_arcsec)

    def passed(self, x_arcsec: ArrayLike, y_arcsec: ArrayLike) -> FloatArray:
        """Return the light of a source at (x, y) over that of `off_axis`, as its coronagraph's table says; else 1.

        The kernel is that of a source where the core throughput has its most.
        """
        table = self.instrument.table(self.band) if self.band else None
        if table is None:
            return np.ones(np.broadcast_shapes(np.shape(x_arcsec), np.shape(y_arcsec)))
        most = table.maps.get("core_throughput", table.columns["core_throughput"]).max()
        return table.at_place("core_throughput", x_arcsec, y_arcsec) / float(most)

    def extended(self, x_arcsec: ArrayLike, y_arcsec: ArrayLike) -> FloatArray:
        """Return the same of extended light."""
        return self.passed(x_arcsec, y_arcsec)

    def at(self, x_arcsec: float, y_arcsec: float, *, margin_pixels: int | None = None) -> FloatArray:
        """Return the image of a unit source at any sub-pixel position, behind the mask, on the star-centred stamp.

        Whole pixels are moved as they are, the rest is a Fourier shift of the kernel, exact but for its cut edge. Light
        beyond the kernel's own stamp is not known and 0: a source outside the stamp leaves only what reaches in.
        Pixels that the edge of the cross cuts get their open fraction of the light, which there is wrong by up to 1 %
        of the peak for a source close to that edge.

        Parameters
        ----------
        x_arcsec, y_arcsec : float
            Position on the detector relative to the star; x grows with the column.
        margin_pixels : int, optional
            Has no meaning for stamps, beyond which nothing is known.

        Returns
        -------
        ndarray, shape (n, n)
            Fraction of the energy on the clear disc in each pixel, nowhere negative.

        Raises
        ------
        InputError
            If a coordinate is not finite.
        """
        if not (math.isfinite(x_arcsec) and math.isfinite(y_arcsec)):
            raise InputError("x_arcsec, y_arcsec", (x_arcsec, y_arcsec), unit="arcsec", allowed="finite numbers")
        offset = (float(part) / self.pixel_scale_arcsec for part in (y_arcsec, x_arcsec))
        return displaced(self.off_axis, *offset) * self._open * float(self.passed(x_arcsec, y_arcsec))


@numeric_context()
def load_psf(
    path: str | Path, *, instrument: InstrumentLike = None, band: str | None = None, energy: float | None = None
) -> ExternalPsf:
    """Load point-spread functions made by other software.

    Each pixel holds the fraction of the energy that the clear telescope disc collects (so an apodizer's loss is in
    it), ``[y, x]``, with the source on the centre pixel ``n // 2``.

    Parameters
    ----------
    path : str or Path
        An npz file with arrays ``off_axis`` (a source on the centre pixel, no mask), ``pixel_scale_arcsec`` and, if
        known, ``on_axis`` (the star behind the cross mask), ``band``, ``mask_half_width_arcsec``, ``apodizer_energy``.
        Or a FITS file with images ``OFF_AXIS`` and ``ON_AXIS`` (``EXTNAME``; a single image is ``OFF_AXIS``), pixel
        scale from ``PIXSCALE`` or ``PIXELSCL`` (arcsec) or ``CD``/``CDELT`` (degrees unless ``CUNIT`` says otherwise),
        and cards ``BAND`` (or ``FILTER``), ``MASKHW`` (arcsec), ``APODENER``.
    instrument : Instrument, mapping or str, optional
        Whose detector, hole and aperture go with it; the default one if omitted.
    band : str, optional
        Band, where the file does not tell; needed for the metrics.
    energy : float, optional
        Scale both images so that ``off_axis`` sums to this, 0 to 1: for kernels normalised to their peak or sum.
        Flagged.

    Returns
    -------
    ExternalPsf

    Raises
    ------
    InputError
        If the file cannot be read or lacks something; if an image is not square of equal odd side (9 to 2201), not
        finite, negative, off centre, or holds more energy than the disc collects; or if its pixel is not the
        detector's to 1e-3.

    Examples
    --------
    >>> import tempfile
    >>> from simulator import load_psf, save_psf, single_band_psf
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     psf = load_psf(save_psf(single_band_psf("F662"), f"{folder}/psf.fits"))
    >>> psf.band, psf.off_axis.shape
    ('F662', (137, 137))
    """
    chosen = instrument if isinstance(instrument, Instrument) else load_instrument(instrument)
    if band is not None:
        check_word("band", band, chosen.bands)
    found = read_stamps(path)
    name = _band(path, found.get("band"), band, chosen)
    flags: list[str] = []
    off_axis = _image(path, "off_axis", found["off_axis"], flags)
    _check_centre(path, off_axis)
    on_axis = _image(path, "on_axis", found["on_axis"], flags) if "on_axis" in found else None
    if on_axis is not None and on_axis.shape != off_axis.shape:
        allowed = f"the shape of off_axis, {off_axis.shape}"
        raise InputError("psf on_axis", str(path), allowed=allowed, hint=f"found {on_axis.shape}")
    pixel = _pixel(path, found.get("pixel_scale_arcsec"), chosen, name)
    scale = _scale(path, float(off_axis.sum()), energy, flags)
    off_axis = off_axis * scale
    width = chosen.mask_half_width_arcsec(name) if name else chosen.coronagraph.mask_half_width_arcsec
    stated = found.get("mask_half_width_arcsec")
    if stated is not None and abs(stated - width) > ROUNDING:
        if not 0 <= stated <= 4:
            raise InputError("psf mask_half_width_arcsec", stated, unit="arcsec", allowed="0 to 4", hint=str(path))
        width = stated
        flags.append("mask_of_file")
    if on_axis is None:
        on_axis = off_axis * open_pixels(len(off_axis), pixel, width)
        flags.append("on_axis_derived")
    else:
        on_axis = on_axis * scale
        if on_axis.sum() > 1 + ROUNDING:
            raise InputError("psf on_axis", str(path), allowed="a sum of at most 1", hint=f"found {on_axis.sum():.6g}")
    behind = found.get("apodizer_energy")
    if behind is None or energy is not None:
        behind = float(off_axis.sum())
        flags.append("apodizer_energy_of_stamp")
    elif not off_axis.sum() - ROUNDING <= behind <= 1 + ROUNDING:
        allowed = f"{off_axis.sum():.6g} (sum of off_axis) to 1"
        raise InputError("psf apodizer_energy", behind, allowed=allowed, hint=str(path))
    if name and len(off_axis) / 2 < chosen.aperture_radius_arcsec(name) / pixel + 1:
        flags.append("core_beyond_stamp")
    for image in (on_axis, off_axis):
        image.flags.writeable = False
    kept = tuple(dict.fromkeys(flags))
    return ExternalPsf(name, on_axis, off_axis, pixel, chosen, width, float(behind), kept, Path(path).name)


def save_psf(psf: Any, path: str | Path) -> Path:
    """Write point-spread functions to a file that `load_psf` reads back, bit for bit; whole or not at all.

    Parameters
    ----------
    psf : Psf, ExternalPsf or the like
        Anything with ``band``, ``on_axis``, ``off_axis`` and ``pixel_scale_arcsec``. ``mask_half_width_arcsec`` and
        ``apodizer_energy`` are written if it has them.
    path : str or Path
        A name that ends in ``.npz`` or ``.fits``. FITS carries checksums.

    Returns
    -------
    Path

    Raises
    ------
    InputError
        For another suffix, stamps that could not be read back, or a place that cannot be written.
    OSError
        If the disk is full or broken.
    """
    place = as_path("path", path)
    if not all(hasattr(psf, name) for name in ("band", "on_axis", "off_axis", "pixel_scale_arcsec")):
        raise InputError("psf", psf, allowed="what single_band_psf or load_psf returns")
    known: dict[str, Any] = {name: np.asarray(getattr(psf, name), np.float64) for name in ("off_axis", "on_axis")}
    for name, image in known.items():
        _image(place, name, image, [])
    known["pixel_scale_arcsec"] = float(psf.pixel_scale_arcsec)
    others = {name: getattr(psf, name, None) for name in ("band", *_CARDS)}
    known |= {name: value for name, value in others.items() if value is not None and value != ""}
    if place.suffix.lower() == ".npz":
        check_writable(place, key="psf")
        write_npz(place.resolve(), known)
        return place
    if place.suffix.lower() not in FITS_SUFFIXES:
        raise InputError("psf", str(place), allowed="a name that ends in .npz or .fits")
    return write_named(place, _fits_bytes(known), key="psf")


def _band(path: str | Path, stated: str | None, asked: str | None, instrument: Instrument) -> str:
    if stated and asked and stated != asked:
        raise InputError("band", asked, allowed=f"{stated}, as the file says", hint=str(path))
    name = asked or stated or ""
    if name:
        instrument.band(name)
    return name


def _pixel(path: str | Path, stated: float | None, instrument: Instrument, band: str) -> float:
    """Return the pixel of the detector, that of the file having been compared with it."""
    detector = instrument.pixel_scale_arcsec(band) if band else instrument.detector.pixel_scale_arcsec
    if stated is None:
        allowed = f"{detector:g}, the detector's"
        raise InputError("psf pixel_scale_arcsec", "missing", unit="arcsec", allowed=allowed, hint=str(path))
    if not (stated > 0 and abs(stated / detector - 1) <= map_files.SCALE_TOLERANCE):
        allowed = f"{detector:g} arcsec, the detector's pixel, to 1e-3"
        hint = "bin or resample the kernel to it, or change the instrument"
        raise InputError("psf pixel_scale_arcsec", stated, unit="arcsec", allowed=allowed, hint=hint)
    return detector


LARGEST = 1e100
"""Largest pixel value of a stamp in units of its own: sums of such stay finite."""


def _image(path: str | Path, name: str, data: NDArray[Any], flags: list[str]) -> FloatArray:
    key = f"psf {name}"
    image = map_files.real_map(key, path, data, sides=SIDES)
    if len(image) % 2 == 0:
        allowed = "an odd number of pixels a side, the source on pixel n // 2"
        raise InputError(key, str(path), allowed=allowed, hint=f"found {len(image)}")
    if image.max() > LARGEST:
        raise InputError(key, str(path), allowed=f"values of at most {LARGEST:g}", hint=f"found {image.max():.3g}")
    negative = image < 0
    if negative.any():
        if image.min() < -NEGATIVE * max(float(image.max()), 0.0):
            allowed = "no negative values"
            raise InputError(key, str(path), allowed=allowed, hint=f"{negative.sum()} are, down to {image.min():.3g}")
        image[negative] = 0.0
        flags.append("negative_rounding")
    return image


def _check_centre(path: str | Path, image: FloatArray) -> None:
    centre, peak = len(image) // 2, np.unravel_index(int(image.argmax()), image.shape)
    if not image.any():
        raise InputError("psf off_axis", str(path), allowed="an image with light in it")
    if max(abs(int(index) - centre) for index in peak) > 1:
        allowed = f"its peak on the centre pixel [{centre}, {centre}]"
        raise InputError("psf off_axis", str(path), allowed=allowed, hint=f"found on [{peak[0]}, {peak[1]}]")


def _scale(path: str | Path, total: float, energy: float | None, flags: list[str]) -> float:
    """Return the factor on the images, 1 if they keep their own normalisation."""
    if energy is not None:
        energy = check_number("energy", energy)
        if not 0 < energy <= 1:
            raise InputError("energy", energy, allowed="above 0, at most 1: the sum of off_axis")
        flags.append("energy_scaled")
        return energy / total
    if total > 1 + ROUNDING:
        allowed = "a sum of at most 1: fractions of the clear disc's energy"
        hint = f"it sums to {total:.6g}; if normalised to its peak, give energy, the sum to scale to"
        raise InputError("psf off_axis", str(path), allowed=allowed, hint=hint)
    if abs(total - 1) <= ROUNDING:
        flags.append("sums_to_one")
    return 1.0
