"""Point-spread functions of a band: the star behind the mask, and a source off the axis."""

import functools
import math
from typing import get_args

import numpy as np

from catalogs import Spectrum
from cpic_core import FloatArray, InputError, Keyed, Record, check_word, numeric_context, overlap_weights
from simulator.config import Instrument, InstrumentLike, load_instrument
from simulator.imaging.aperture import aperture_sums
from simulator.imaging.build import build_imager, hole_state_of
from simulator.imaging.imager import Engine, Imager
from simulator.imaging.metrics import PsfMetrics
from simulator.imaging.sampling import centred_axis
from simulator.imaging.scene_image import BandTransfer, PointSources, scene_image
from simulator.imaging.zones import BandGeometry, HoleStatus
from simulator.knobs import FIDELITIES, Knobs
from simulator.target import stellar_spectrum

LARGE_STAMP_PIXELS = 401
N_KEPT = 12  # of optical models with their stamps, some 3 MB each
KEPT_PUPIL = 256**2  # most samples of a pupil that is kept


class PsfError(Record):
    """Estimated numerical error of a PSF: its difference from the reference settings.

    Attributes
    ----------
    tier : str
        ``quick``, ``standard``, ``reference``, or ``custom``.
    peak, aperture : float
        Relative errors of the peak pixel and of the light in the photometric aperture, unmasked source.
    hole_mean : float
        Relative error of the mean starlight in the dark hole.
    hole_rms : float
        Rms error of the pixels in the hole, in raw contrast.
    """

    tier: str
    peak: float
    aperture: float
    hole_mean: float
    hole_rms: float


class Psf(Record, eq=False):
    """Point-spread functions of one band on star-centred stamps, ``[y, x]``, star at pixel ``n // 2``.

    Attributes
    ----------
    band : str
        Name of the band.
    on_axis : ndarray, shape (n, n)
        The star behind the cross mask: fraction of the energy on the clear disc in each pixel.
    off_axis : ndarray, shape (n, n)
        A source far from the mask, placed on the centre pixel; same unit.
    pixel_scale_arcsec : float
        Pixel of the detector.
    knobs : Knobs
        Numerical settings.
    imager : Imager
        Optical model behind the stamps.
    instrument : Instrument
        Its configuration.
    spectrum : Spectrum or None
        Photon spectrum that weights the wavelengths; None for the Sun's.
    """

    band: str
    on_axis: FloatArray
    off_axis: FloatArray
    pixel_scale_arcsec: float
    knobs: Knobs
    imager: Imager
    instrument: Instrument
    spectrum: Spectrum | None = None

    @property
    def mask_half_width_arcsec(self) -> float:
        """Half width of the bars of the cross."""
        return self.imager.mask_half_width_arcsec

    @property
    def apodizer_energy(self) -> float:
        """Energy behind the apodizer, relative to the clear disc."""
        return self.imager.apodizer_energy

    @functools.cached_property
    def geometry(self) -> BandGeometry:
        """Hole, mask and apertures on the stamps: all of the metrics that no setting changes, without measuring."""
        return BandGeometry.of(self.instrument, self.band, len(self.on_axis))

    @functools.cached_property
    @numeric_context()
    def metrics(self) -> PsfMetrics:
        """Figures of merit; maps and core at this PSF's settings, wings and speckle floor at the standard ones."""
        from simulator.imaging.measure import stamp_figures, strehl
        from simulator.imaging.store import psf_metrics

        stored = psf_metrics(self.instrument, self.band)
        if self.knobs == Knobs() and self.spectrum is None:
            return stored
        reach = self.imager.zone.outer_arcsec + self.imager.aperture_radius_arcsec
        least = 2 * math.ceil(reach / self.pixel_scale_arcsec) + 1
        if self.knobs.stamp_pixels < least:
            allowed = f"at least {least} for metrics: the dark hole and an aperture"
            raise InputError("stamp_pixels", self.knobs.stamp_pixels, unit="px", allowed=allowed)
        figures = stamp_figures(self.imager, self.on_axis, self.off_axis) | {"strehl": strehl(self.imager)}
        arrays = stored.to_arrays() | {name: np.asarray(value) for name, value in figures.items()}
        return PsfMetrics.from_arrays(arrays)

    @functools.cached_property
    def flags(self) -> tuple[str, ...]:
        """What to know before trusting it: ``single_precision``, or ``hole_not_reached``."""
        flags = ["single_precision"] if self.knobs.precision == "single" else []
        if self.hole_state == "not_reached":
            flags.append("hole_not_reached")
        return tuple(flags)

    @functools.cached_property
    def hole_state(self) -> HoleStatus:
        """Whether the dark hole of these images is as dark as asked; see `simulator.imaging.build.hole_state_of`."""
        light = self.on_axis[self.geometry.hole]
        return hole_state_of(self.instrument, self.band, float(light.mean() / self.off_axis.max()))

    @functools.cached_property
    @numeric_context()
    def estimated_error(self) -> PsfError:
        """How far these stamps are from those at reference settings; about half a second."""
        finer = FIDELITIES["reference"].model_copy(update={"stamp_pixels": self.knobs.stamp_pixels})
        best = single_band_psf(self.band, fidelity=finer, instrument=self.instrument, spectrum=self.spectrum)
        weights = overlap_weights(self.imager.aperture_radius_arcsec / self.pixel_scale_arcsec)
        middle = len(self.off_axis) // 2
        cores = [aperture_sums(psf.off_axis, weights)[middle, middle] for psf in (self, best)]
        peak, hole = float(best.off_axis.max()), self.geometry.hole
        difference = (self.on_axis - best.on_axis)[hole] / peak
        return PsfError(
            tier=self.knobs.tier,
            peak=abs(float(self.off_axis.max()) / peak - 1.0),
            aperture=abs(float(cores[0] / cores[1]) - 1.0),
            hole_mean=abs(float(self.on_axis[hole].mean() / best.on_axis[hole].mean()) - 1.0),
            hole_rms=float(np.sqrt((difference**2).mean())),
        )

    @numeric_context()
    def at(self, x_arcsec: float, y_arcsec: float, *, margin_pixels: int | None = None) -> FloatArray:
        """Return the image of a unit source at any sub-pixel position, behind the mask, on the star-centred stamp.

        The field is computed at the exact offsets, so a source far outside the stamp (a companion 8 arcsec away)
        leaves its true wings on it.

        Parameters
        ----------
        x_arcsec, y_arcsec : float
            Position on the detector relative to the star; x grows with the column.
        margin_pixels : int, optional
            Work out only the rows and columns of the dark hole and so many beside them, which takes a fraction of the
            time; other pixels are 0.

        Returns
        -------
        ndarray, shape (n, n)
            Fraction of the energy on the clear disc in each pixel.

        Raises
        ------
        InputError
            If a coordinate is not finite.
        """
        if not (math.isfinite(x_arcsec) and math.isfinite(y_arcsec)):
            raise InputError("x_arcsec, y_arcsec", (x_arcsec, y_arcsec), unit="arcsec", allowed="finite numbers")
        source = float(x_arcsec), float(y_arcsec)
        if margin_pixels is None:
            axis = self.imager.stamp_axis(masked=True)
            return self.imager.image(axis, axis, source_arcsec=source)
        offset = centred_axis(len(self.on_axis), self.pixel_scale_arcsec)
        near = np.ones(2 * margin_pixels + 1)
        wanted = [np.flatnonzero(np.convolve(self.geometry.hole.any(axis=k), near, "same") > 0.5) for k in (1, 0)]
        y, x = (self.imager.axis(offset[part], masked=True) for part in wanted)
        image = np.zeros(self.on_axis.shape)
        image[np.ix_(*wanted)] = self.imager.image(y, x, source_arcsec=source)
        return image


@numeric_context()
def single_band_psf(
    band: str,
    *,
    fidelity: str | Knobs = "standard",
    instrument: InstrumentLike = None,
    spectrum: str | Spectrum | None = None,
    engine: Engine = "matrix",
) -> Psf:
    """Return the point-spread functions of one band, static wavefront, mirror and pointing jitter included.

    Parameters
    ----------
    band : str
        Band of the instrument, for example ``F662``.
    fidelity : str or Knobs
        ``quick``, ``standard``, ``reference``, or the settings themselves.
    instrument : Instrument, mapping, str or Path, optional
        What `simulator.load_instrument` reads; the default instrument if omitted.
    spectrum : str or Spectrum, optional
        Spectral type (``"K1V"``) or photon spectrum that weights the wavelengths with filter and quantum efficiency;
        the Sun's if omitted.
    engine : {"matrix", "hcipy"}
        Propagator: the project's own matrix products, or HCIPy, if it is installed, as a cross-check.

    Returns
    -------
    Psf
        Its stamps are read-only: calls for the same optics share them (the last 12 are kept).

    Raises
    ------
    InputError
        For an unknown band, fidelity or engine, an even stamp, a spectrum that does not cover the band, or an apodizer
        that does not fit the pupil grid.

    Examples
    --------
    >>> from simulator import single_band_psf
    >>> psf = single_band_psf("F662")
    >>> psf.on_axis.shape
    (137, 137)
    >>> bool(psf.metrics.raw_contrast[psf.metrics.hole].mean() < 1e-9)
    True
    """
    check_word("engine", engine, get_args(Engine))
    if not isinstance(instrument, Instrument):
        instrument = load_instrument(instrument)
    light = stellar_spectrum(0.0, spectrum) if isinstance(spectrum, str) else spectrum
    if not (light is None or isinstance(light, Spectrum)):
        raise InputError("spectrum", spectrum, allowed="a spectral type or a Spectrum")
    built = build_imager(instrument, band, fidelity, spectrum=light)
    if built.knobs.stamp_pixels % 2 == 0:
        raise InputError("stamp_pixels", built.knobs.stamp_pixels, unit="px", allowed="an odd number")
    kept = built.knobs.stamp_pixels < LARGE_STAMP_PIXELS and built.transmission.size <= KEPT_PUPIL
    stamps = _stamps if kept else _stamps.__wrapped__
    imager, on_axis, off_axis = stamps(Keyed(built.content_key, built), engine)
    return Psf(
        band=band,
        on_axis=on_axis,
        off_axis=off_axis,
        pixel_scale_arcsec=imager.pixel_scale_arcsec,
        knobs=imager.knobs,
        imager=imager,
        instrument=instrument,
        spectrum=light,
    )


@functools.lru_cache(maxsize=N_KEPT)
def _stamps(optics: Keyed[Imager], engine: Engine) -> tuple[Imager, FloatArray, FloatArray]:
    """Return both stamps and the model behind them, the first of its content: what it keeps serves all scenes alike."""
    imager = optics.value
    on_axis, off_axis = (_stamp(imager, masked=masked, engine=engine) for masked in (True, False))
    on_axis.flags.writeable = off_axis.flags.writeable = False
    return imager, on_axis, off_axis


def forget_stamps() -> None:
    """Drop the stamps that earlier calls left, so that the next call is timed as the first of a process."""
    _stamps.cache_clear()


def _stamp(imager: Imager, *, masked: bool, engine: Engine) -> FloatArray:
    """Return the unit source on the axis, by nodes in the pixels; large stamps by the closed form (faster there)."""
    if engine == "matrix" and imager.knobs.stamp_pixels >= LARGE_STAMP_PIXELS:
        centres = centred_axis(imager.knobs.stamp_pixels, imager.pixel_scale_arcsec)
        width = imager.mask_half_width_arcsec if masked else 0.0
        star = PointSources([0.0], [0.0], [1.0])
        pixel = imager.pixel_scale_arcsec
        return scene_image(BandTransfer(imager), centres, centres, pixel, star, mask_half_width_arcsec=width)
    axis = imager.stamp_axis(masked=masked)
    return imager.image(axis, axis, engine=engine)


def wide_on_axis(
    band: str,
    instrument: Instrument,
    shape: tuple[int, int],
    star_pixel: tuple[float, float],
    *,
    star_arcsec: tuple[float, float] = (0.0, 0.0),
) -> FloatArray:
    """Return the masked star over a whole frame: one node per pixel, for display and for whole-frame saturation.

    Steps and static wavefront are constant on the pupil grid, so its sampling is exact. One node per pixel makes up
    to 5 % of error on the steepest pixels; nine wavelengths leave the speckles beyond 4 arcsec grainier than the light
    itself is.

    Parameters
    ----------
    band : str
        Band of the instrument.
    instrument : Instrument
        Configuration.
    shape : tuple of int
        Rows and columns of the frame.
    star_pixel : tuple of float
        Row and column of the centre of the mask.
    star_arcsec : tuple of float
        Place of the star relative to that, x and y.

    Returns
    -------
    ndarray, shape ``shape``
    """
    imager = build_imager(instrument, band, Knobs(wavelength_nodes=9, pixel_nodes=1))
    places = zip(shape, star_pixel, strict=True)
    axes = [imager.axis(centred_axis(n, imager.pixel_scale_arcsec, star), masked=True) for n, star in places]
    return imager.image(*axes, source_arcsec=star_arcsec)
