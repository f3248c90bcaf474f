"""Images of a coronagraph that is a table: a Gaussian core, and speckles that are as stable as the table says.

Starlight is ``|E0 + m dE|^2``: E0 is the same in all visits, as bright as the table has it or a file of images shows
it, and dE is what the wavefront of a visit adds, a random Gaussian field behind a clear pupil. Where no file shows the
static speckles, m is a field of such of the mean light 1: the residual varies from place to place as if it beat with
them; else it is of that light everywhere. Sums over a core that the star lights with C vary by ``2 k C L + q L^2`` with
L the light of dE in it, and k and q what a sum leaves of the variance of coherent light; L is such that this is the
variance of the table.

`write_coronagraph_table` writes the coronagraph of an instrument as a table that `coronagraph.table` reads.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from pathlib import Path

import numpy as np

from cpic_core import (
    ArrayLike,
    ComplexArray,
    FloatArray,
    InputError,
    as_path,
    check_writable,
    numeric_context,
    overlap_weights,
    stream,
    visible,
    write_named,
)
from simulator.config import Instrument, InstrumentLike, load_instrument
from simulator.imaging.annuli import light_around
from simulator.imaging.external import ExternalPsf, load_psf
from simulator.imaging.sampling import centred_axis, separations
from simulator.imaging.store import psf_metrics
from simulator.imaging.table_metrics import TableMetrics

_CORE_SIGMA = 0.4374  # of a Gaussian as wide at half its maximum as the image of a clear pupil, in lambda/D
_MOST = 4.0  # rms of a Gaussian field that hardly any speckle passes
_RINGS = 30  # of a stamp, over each of which the pattern of static speckles has the mean 1


class TablePsf(ExternalPsf, eq=False, kw_only=True):
    """Point-spread functions of a table, with speckles that change from visit to visit; made by `psf_of_table`.

    Attributes
    ----------
    pattern : ndarray of complex, shape (n, n)
        Factor ``m`` of the fields of visits.
    figures : TableMetrics
        What the table says.
    """

    pattern: ComplexArray
    figures: TableMetrics

    @property
    def hole_state(self) -> str:
        """``table``: what is known of it is that."""
        return "table"

    @functools.cached_property
    def coherence(self) -> tuple[float, float]:
        """Factors ``k`` and ``q`` of the module."""
        at = self.geometry
        both, four = core_coherence(at.aperture_radius_arcsec, at.lambda_d_arcsec, at.pixel_scale_arcsec)
        return both, both if self.file else 2.0 * both + four

    @functools.cached_property
    def _separation(self) -> FloatArray:
        return separations(len(self.on_axis), self.pixel_scale_arcsec)

    @functools.cached_property
    def field(self) -> FloatArray:
        """Field of the star without errors."""
        return np.sqrt(self.on_axis)

    def extended(self, x_arcsec: ArrayLike, y_arcsec: ArrayLike) -> FloatArray:
        """Return the light of an extended source at (x, y) over that of ``off_axis``: all that passes, not cores."""
        shape = np.broadcast_shapes(np.shape(x_arcsec), np.shape(y_arcsec))
        place = np.broadcast_to(np.asarray(x_arcsec, float), shape), np.broadcast_to(np.asarray(y_arcsec, float), shape)
        return self.figures.dust_transmission(*place, np.zeros(shape)) / float(self.off_axis.sum())

    def moved(self, separation_arcsec: FloatArray, variance: FloatArray, rng: np.random.Generator) -> ComplexArray:
        """Return a field that makes sums over a core vary as much.

        Parameters
        ----------
        separation_arcsec, variance : ndarray, shape (k,)
            Variance by separation, ascending; of a star of the light 1 on the collecting area.
        rng : numpy.random.Generator
            Source of random numbers; a seed gives the same draws.

        Returns
        -------
        ndarray of complex, shape (n, n)
        """
        side, unit = len(self.on_axis), self.geometry.lambda_d_arcsec / self.pixel_scale_arcsec
        return np.asarray(self._rms(separation_arcsec, variance) * coherent_field(side, unit, rng))

    def brightest(self, separation_arcsec: FloatArray, variance: FloatArray) -> FloatArray:
        """Return the brightest that a pixel of such visits is: in more by less than once in 1e7 speckles."""
        return np.asarray((self.field + _MOST * np.abs(self._rms(separation_arcsec, variance))) ** 2)

    def _rms(self, separation_arcsec: FloatArray, variance: FloatArray) -> ComplexArray:
        crossed, lit = self.coherence
        half = crossed / lit * self.figures.starlight(separation_arcsec)
        light = np.sqrt(half**2 + variance / lit) - half
        on_pixel = np.interp(self._separation, separation_arcsec, light / self.figures.aperture_pixels)
        return np.asarray(self.pattern * np.sqrt(on_pixel))


def coherent_field(side: int, lambda_d_pixels: float, rng: np.random.Generator) -> ComplexArray:
    """Return a random Gaussian field behind a clear round pupil, mean light 1.

    Parameters
    ----------
    side : int
        Pixels of the image.
    lambda_d_pixels : float
        lambda/D.
    rng : numpy.random.Generator
        Source of random numbers; a seed gives the same draws.

    Returns
    -------
    ndarray of complex, shape (side, side)
        Points of the field in the middle of pixels; its edges continue at the opposite ones.
    """
    cycles = np.fft.fftfreq(side) * lambda_d_pixels
    pupil = np.hypot(cycles[:, None], cycles) <= 0.5
    waves = np.where(pupil, rng.standard_normal((2, side, side)), 0.0)
    return np.asarray(np.fft.ifft2(waves[0] + 1j * waves[1]) * side**2 / math.sqrt(2.0 * np.count_nonzero(pupil)))


def core_coherence(radius_arcsec: float, lambda_d_arcsec: float, pixel_arcsec: float) -> tuple[float, float]:
    """Return what a sum over a disc of pixels leaves of the variance of products of two and of four Gaussian fields.

    Parameters
    ----------
    radius_arcsec, lambda_d_arcsec, pixel_arcsec : float

    Notes
    -----
    ``sum(w_i w_j rho_ij^p) / sum(w)^2`` with p of 2 and 4, and the correlation of the fields,
    ``rho = 2 J1(pi u) / (pi u)`` at u lambda/D.
    """
    from scipy.special import j1

    weights = overlap_weights(radius_arcsec / pixel_arcsec)
    axis = centred_axis(len(weights), pixel_arcsec) / lambda_d_arcsec
    x, y, w = (part.ravel() for part in (*np.meshgrid(axis, axis), weights))
    apart = np.pi * np.hypot(x[:, None] - x, y[:, None] - y)
    correlation = np.where(apart > 0, 2.0 * j1(apart) / np.maximum(apart, 1e-12), 1.0)
    two, four = (float(w @ correlation**power @ w / w.sum() ** 2) for power in (2, 4))
    return two, four


def psf_of_table(instrument: Instrument, band: str) -> TablePsf | None:
    """Return images of a band whose coronagraph is a table; None where it is none.

    Parameters
    ----------
    instrument : Instrument
    band : str
        Name of a band of the instrument.

    Raises
    ------
    InputError
        As `load_psf`, where the instrument names a file of images.

    Notes
    -----
    Without a file the core is that of a clear pupil, a Gaussian of 1.03 lambda/D at half its maximum, as bright as puts
    the largest core throughput into the area of the core; the star behind the mask is as even as the table has it.
    """
    figures = psf_metrics(instrument, band)
    if not isinstance(figures, TableMetrics):
        return None
    path = instrument.psf_file(band)
    known = None if path is None else load_psf(path, instrument=instrument, band=band)
    side = len(figures.raw_contrast if known is None else known.on_axis)
    pixel, unit = figures.pixel_scale_arcsec, figures.lambda_d_arcsec
    pattern = coherent_field(side, unit / pixel, stream(1, "static speckles of a table", band))
    if known is not None:
        parts = {item.name: getattr(known, item.name) for item in dataclasses.fields(known)}
        return TablePsf(**parts, pattern=pattern / np.abs(pattern), figures=figures)
    sigma, radius = _CORE_SIGMA * unit / pixel, figures.aperture_radius_arcsec / pixel
    # Pixels widen the image, and exact apertures by as much again.
    held = -math.expm1(-(radius**2) / (2.0 * (sigma**2 + 1.0 / 6.0)))
    line = _pixel_integrals(side, sigma)
    ring = np.rint(separations(side, 1.0) * (_RINGS / side)).astype(int)
    level = np.bincount(ring.ravel(), np.abs(pattern.ravel()) ** 2) / np.maximum(np.bincount(ring.ravel()), 1)
    return TablePsf(
        band=band,
        on_axis=figures.raw_contrast * figures.peak_off_axis,
        off_axis=figures.core_open / held * np.outer(line, line),
        pixel_scale_arcsec=pixel,
        instrument=instrument,
        mask_half_width_arcsec=0.0,
        apodizer_energy=figures.apodizer_energy,
        pattern=pattern / np.sqrt(level[ring]),
        figures=figures,
    )


def _pixel_integrals(side: int, sigma_pixels: float) -> FloatArray:
    """Return the shares of a Gaussian in the pixels of a line, centred on the middle one."""
    from scipy.special import ndtr

    edges = (np.arange(side + 1) - 0.5 - side // 2) / sigma_pixels
    return np.asarray(np.diff(ndtr(edges)))


N_ROWS = 240
ANNULUS_LAMBDA_D = 1.5
"""Half width of the annulus whose light the table has: that of reductions by default."""


@numeric_context()
def write_coronagraph_table(instrument: InstrumentLike, band: str, path: str | Path) -> Path:
    """Write what the coronagraph of an instrument does in one band, by separation on a diagonal of its zone.

    An instrument that has the file as its ``coronagraph.table`` gives the same answers about single stars, with
    ``zone: quadrants`` where its own is of quadrants, and the drift of the wavefront does there what it does here.
    Between the diagonals the coronagraph may differ, and the light of companions is then that of a clear pupil.

    Parameters
    ----------
    instrument : Instrument, mapping, str or Path
        Preset name, YAML file, or mapping.
    band : str
        Name of a band of the instrument.
    path : str or Path
        CSV file to write, a name that ends in ``.csv``.

    Returns
    -------
    Path

    Raises
    ------
    InputError
        For an unknown instrument or band, another name, or a place that cannot be written.
    OSError
        If the disk is full or broken.
    """
    place = as_path("path", path)
    if place.suffix != ".csv":
        raise InputError("path", path, allowed="a name that ends in .csv")
    check_writable(place, key="path")
    chosen = instrument if isinstance(instrument, Instrument) else load_instrument(instrument)
    separation, columns = _columns(chosen, band)
    about = (
        f"Coronagraph of the instrument {chosen.name} ({chosen.content_hash}) in {band}, on a diagonal of its zone.",
        "Written by write_coronagraph_table of cpic-planner; light is over that on the clear pupil.",
    )
    names = ["separation_arcsec", *columns]
    rows = np.column_stack([separation, *(np.broadcast_to(values, separation.shape) for values in columns.values())])
    lines = [*(f"# {line}" for line in about), ",".join(names)]
    lines += [",".join(f"{value:.7g}" for value in row) for row in rows.tolist()]
    return write_named(place, "\n".join(map(visible, lines)) + "\n", key="path")


def _columns(instrument: Instrument, band: str) -> tuple[FloatArray, dict[str, FloatArray | float]]:
    metrics = psf_metrics(instrument, band)
    zone = metrics.zone
    # Both ends of the zone, or of the table, and the rings whose residuals were measured are rows of their own.
    corners = max(zone.inner_corner_arcsec, 1e-3), zone.outer_corner_arcsec
    ends = zone.usable_range_arcsec(metrics.aperture_radius_arcsec) if instrument.coronagraph.is_ring else corners
    grid = np.linspace(*ends, N_ROWS)
    rings = metrics.floor_separation_arcsec
    separation = np.unique(np.concatenate([grid, rings[(rings > grid[0]) & (rings < grid[-1])]]).round(7))
    x, y = (sign * separation / np.sqrt(2.0) for sign in zone.diagonal)
    core = metrics.core_throughput(x, y)
    lit = core > 1e-6 * core.max()
    separation, x, y, core = separation[lit], x[lit], y[lit], core[lit]
    of_errors = {"psd_slope": instrument.drift.psd_slope, "wavelength_nm": instrument.band(band).center_nm}
    around = light_around(metrics, ANNULUS_LAMBDA_D, x, y, **of_errors)
    linear, square = (np.exp(np.interp(separation, rings, logs)) for logs in metrics.floor_logs())
    beyond = np.maximum(separation / rings[-1], 1.0)
    stable = metrics.stability(separation)
    residual: dict[str, FloatArray | float] = (
        {"contrast_stability": np.sqrt(stable[0]) / core}
        if stable is not None
        else {
            "speckle_variance_per_nm2": linear * beyond ** _power(rings, metrics.floor_logs()[0]),
            "speckle_variance_per_nm4": square * beyond ** _power(rings, metrics.floor_logs()[1]),
        }
    )
    return separation, {
        "core_throughput": core,
        "raw_contrast": metrics.halo_aperture(x, y) / core,
        "noise_contrast": around.star / core,
        "error_light_per_nm2": around.errors,
        "planet_left": around.planet_left,
        **residual,
        "occulter_transmission": np.maximum(metrics.dust_transmission(x, y, core), core),
        "sky_transmission": np.maximum(metrics.apodizer_energy * metrics.sky_share(x, y), core),
        "core_area_arcsec2": metrics.core_pixels(x, y) * metrics.pixel_scale_arcsec**2,
        "source_peak_pixel": metrics.peak_off_axis,
        "star_peak_zone": metrics.peak_on_axis_hole,
        "star_peak_columns": metrics.peak_on_axis_columns,
        "star_peak_frame": metrics.peak_on_axis_frame,
        "star_register_tail": metrics.register_tail,
        "star_columns": metrics.column_aperture(x),
        "noise_fraction": metrics.noise_fraction,
        "source_noise_fraction": metrics.source_noise_fraction,
        "filter_gain": np.interp(separation, rings, metrics.filter_gain),
        **{
            f"filter_linear_{number}": np.interp(separation, rings, fifth)
            for number, fifth in enumerate(metrics.filter_linear.T, 1)
        },
        **{name: getattr(metrics, name) for name in _FILTER},
    }


_FILTER = "filter_square", "filter_tails", "filter_positions", "filter_roughness"


def _power(rings: FloatArray, logs: FloatArray) -> float:
    """Return the power of the separation by which a residual falls beyond the last ring; see `speckles`."""
    return 0.0 if len(rings) < 2 else min(float((logs[-1] - logs[-2]) / np.log(rings[-1] / rings[-2])), 0.0)
