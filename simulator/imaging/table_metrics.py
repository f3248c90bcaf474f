"""Figures of one band whose coronagraph is a table: what the exposure-time calculator reads, without any optics.

The table says what happens in the core of a source at every separation. Light beside the core, which companions and a
second roll leave, is that of a clear pupil behind the coronagraph: round, with a round obstruction and nothing else.
Its separations are in lambda/D, its brightness is the fraction of the collected light per square lambda/D.
"""

import functools
import math
from dataclasses import replace
from typing import Any, Self

import numpy as np

from cpic_core import ArrayLike, FloatArray
from cpic_core.runtime import special
from simulator.config import CoronagraphTable, Instrument
from simulator.detectors import aperture_noise_pixels
from simulator.imaging.metrics import PsfMetrics
from simulator.imaging.sampling import separations
from simulator.imaging.zones import BandGeometry

_WAVELENGTHS = 24
# Mean light of a wavefront error of 1 nm rms at 662 nm that falls as f^-2.5, relative to the peak, times u^2.5 with u
# in lambda/D: at most 1.7 times too large in the dark holes of the visible bands (60 screens each).
_ERROR_LIGHT_AT_1_NM = 2.4e-5
_DISC_POINTS = 300
FIELD_ARCSEC = 17.2


def airy(separation_lambda_d: ArrayLike, obstruction: float = 0.0, relative_width: float = 0.0) -> FloatArray:
    """Return the brightness of the diffraction pattern of the pupil over a band.

    Parameters
    ----------
    separation_lambda_d : array_like
        From the source, at the middle of the band.
    obstruction : float
        Diameter of the obstruction over that of the pupil, 0 to below 1.
    relative_width : float
        Width of the band over its middle, evenly lit.
    """
    u = np.asarray(separation_lambda_d, dtype=np.float64)
    total = np.zeros(u.shape)
    nodes = (np.arange(_WAVELENGTHS) + 0.5) / _WAVELENGTHS - 0.5 if relative_width > 0 else np.zeros(1)
    for stretch in 1.0 + relative_width * nodes:
        v = np.pi * np.maximum(u / stretch, 1e-9)
        field = 2.0 * special().j1(v) / v
        if obstruction > 0:
            field = field - obstruction**2 * 2.0 * special().j1(obstruction * v) / (obstruction * v)
        total += (field / (1.0 - obstruction**2)) ** 2 / stretch**2
    return np.asarray(np.pi / 4.0 * (1.0 - obstruction**2) * total / len(nodes))


def scattered_light(separation_lambda_d: ArrayLike, rms_nm: float, slope: float, wavelength_nm: float) -> FloatArray:
    """Return the mean light that a wavefront error scatters, relative to the peak of a source; at most 1.

    Parameters
    ----------
    separation_lambda_d : array_like
        From the source; below 1 the value at 1.
    rms_nm, slope : float
        Of the error: its rms, and the exponent with which its power falls.
    wavelength_nm : float
        Middle of the band.

    Notes
    -----
    ``2.4e-5 (rms / nm)^2 (662 nm / lambda)^2 u^-slope``: the power spectrum of the screens seen through the telescope,
    its scale measured in the dark holes of the visible bands.
    """
    u = np.maximum(np.asarray(separation_lambda_d, dtype=np.float64), 1.0)
    return np.minimum(_ERROR_LIGHT_AT_1_NM * (rms_nm * 662.0 / wavelength_nm) ** 2 * u**-slope, 1.0)


@functools.lru_cache(maxsize=4)
def _disc() -> tuple[FloatArray, FloatArray]:
    """Return the points that fill a unit disc evenly, x and y."""
    number = np.arange(_DISC_POINTS)
    radius, angle = np.sqrt((number + 0.5) / _DISC_POINTS), number * np.pi * (3.0 - np.sqrt(5.0))
    return radius * np.cos(angle), radius * np.sin(angle)


def disc_light(
    separation_lambda_d: FloatArray, radius_lambda_d: float, obstruction: float, relative_width: float
) -> FloatArray:
    """Return the part of the collected light in discs of a radius whose middles are so far from the source, shape (n,).

    Parameters
    ----------
    separation_lambda_d : ndarray, shape (n,)
    radius_lambda_d : float
    obstruction, relative_width : float
        As of `airy`.
    """
    x, y = _disc()
    fine = np.linspace(0.0, float(separation_lambda_d.max()) + radius_lambda_d, 8 * len(separation_lambda_d) + 2000)
    light = airy(fine, obstruction, relative_width)
    at = np.hypot(separation_lambda_d[:, None] + radius_lambda_d * x, radius_lambda_d * y)
    return np.asarray(np.interp(at, fine, light).mean(axis=1) * np.pi * radius_lambda_d**2)


_MOST_HALF_STAMP = 600
_WING_STEP_ARCSEC, _WING_POINTS = 0.15, 5
_NEAR_LAMBDA_D, _NEAR_STEP_LAMBDA_D, _NEAR_ARCSEC = 60.0, 0.6, 8.0
_ROWS = 400
# Of the matched filters of the default instrument, lengths in lambda/D: what a table without images is taken to have.
_GAIN, _FIFTHS, _SQUARE, _TAILS = 1.15, (0.3, 0.55, 0.8, 1.2, 2.0), 1.6, 0.8
_POSITIONS, _ROUGH = 2.4, 1.25


class TableMetrics(PsfMetrics, eq=False, kw_only=True):
    """Figures of merit of one band of which a table is known.

    Attributes
    ----------
    table : CoronagraphTable
    stability_fraction : float or None
        Residual of a visit over the raw contrast, where the table has no column for it.
    stability_is_common : bool
        Whether the residual is the same in all visits.
    contrast_factor : float
        Raw contrast over that of the table.
    pixel_share : float
        ``noise_fraction`` where the table does not say.
    """

    table: CoronagraphTable
    stability_fraction: float | None = None
    stability_is_common: bool = True
    contrast_factor: float = 1.0
    pixel_share: float = 1.0

    def core_throughput(self, x_arcsec: ArrayLike, y_arcsec: ArrayLike) -> FloatArray:
        """Return the light of a unit source at (x, y) in its core; beyond the table that of its first or last row."""
        return self.table.at_place("core_throughput", x_arcsec, y_arcsec)

    def halo_aperture(self, x_arcsec: ArrayLike, y_arcsec: ArrayLike) -> FloatArray:
        """Return the starlight in the core at (x, y): raw contrast times core throughput."""
        contrast = self.table.at_place("raw_contrast", x_arcsec, y_arcsec)
        return self.contrast_factor * contrast * self.core_throughput(x_arcsec, y_arcsec)

    def starlight(self, separation_arcsec: ArrayLike) -> FloatArray:
        """Return the starlight in a core at separations."""
        contrast = self.table.at("raw_contrast", separation_arcsec)
        return self.contrast_factor * contrast * self.table.at("core_throughput", separation_arcsec)

    def noise_light(self, x_arcsec: ArrayLike, y_arcsec: ArrayLike) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return what the table has for `simulator.imaging.annuli.AnnulusLight` at (x, y): its starlight and no other.

        Where it does not say, all starlight is in its raw contrast, and the background holds nothing of a source.
        """
        star = self.halo_aperture(x_arcsec, y_arcsec)
        if "noise_contrast" in self.table:
            contrast = self.table.at_place("noise_contrast", x_arcsec, y_arcsec)
            star = self.contrast_factor * contrast * self.core_throughput(x_arcsec, y_arcsec)
        said = (("error_light_per_nm2", 0.0), ("planet_left", 1.0))
        errors, left = (
            self.table.at_place(name, x_arcsec, y_arcsec) if name in self.table else np.full(star.shape, usual)
            for name, usual in said
        )
        return star, errors, left

    def core_pixels(self, x_arcsec: FloatArray, y_arcsec: FloatArray) -> FloatArray | float:
        """Return the area in pixels of the core at (x, y)."""
        if "core_area_arcsec2" not in self.table or not self.table.varies("core_area_arcsec2"):
            return self.aperture_pixels
        return self.table.at_place("core_area_arcsec2", x_arcsec, y_arcsec) / self.pixel_scale_arcsec**2

    def sky_share(self, x_arcsec: FloatArray, y_arcsec: FloatArray) -> FloatArray | float:
        """Return the light of an even sky on a pixel at (x, y), over that of `apodizer_energy`."""
        name = sky_column(self.table)
        if name is None or not self.table.varies(name):
            return 1.0
        return self.table.at_place(name, x_arcsec, y_arcsec) / self.apodizer_energy

    def dust_transmission(self, x_arcsec: FloatArray, y_arcsec: FloatArray, core: FloatArray) -> FloatArray:
        """Return the part of the light of dust around the star that reaches a core at (x, y), as extended sources."""
        if "occulter_transmission" not in self.table:
            return np.full(np.shape(core), self.apodizer_energy)
        return self.table.at_place("occulter_transmission", x_arcsec, y_arcsec)

    @functools.cached_property
    def noise_fraction(self) -> float:
        """Sum of squared weights of the pixels of a core over its area: 1 of whole pixels, if it does not say."""
        said = self.table.constant("noise_fraction")
        return self.pixel_share if said is None else said

    def measured(self) -> Self:
        """Return the figures of cores that are summed in images, where pixels at the edge count in part."""
        radius = self.aperture_radius_arcsec / self.pixel_scale_arcsec
        return replace(self, pixel_share=float(aperture_noise_pixels(max(radius, 1.0))) / self.aperture_pixels)

    def stability(self, separation_arcsec: FloatArray) -> tuple[FloatArray, bool] | None:
        """Return the variance of core sums that subtracting one visit leaves, and whether all visits share it."""
        if self.stability_fraction is not None:
            rms = self.stability_fraction * self.starlight(separation_arcsec)
        elif "contrast_stability" in self.table:
            throughput = self.table.at("core_throughput", separation_arcsec)
            rms = self.table.at("contrast_stability", separation_arcsec) * throughput
        else:
            return None
        return np.asarray(rms**2), self.stability_is_common

    @property
    def median_contrast(self) -> float:
        """Median raw contrast of the places of the zone, as the table has it."""
        separation = separations(len(self.raw_contrast), self.pixel_scale_arcsec)[self.hole]
        return self.contrast_factor * float(np.median(self.table.at("raw_contrast", separation)))

    def brightened(self, factor: float) -> Self:
        """Return the figures with ``factor`` times the starlight; see `PsfMetrics.brightened`.

        A residual that is a fraction of the raw contrast grows with it, one of the table stays.
        """
        return replace(super().brightened(factor), contrast_factor=factor * self.contrast_factor)

    def column_aperture(self, x_arcsec: ArrayLike) -> FloatArray:
        """Return the starlight of whole columns under a core at x; see `PsfMetrics.column_aperture`."""
        if "star_columns" not in self.table:
            return super().column_aperture(x_arcsec)
        return self.table.at("star_columns", math.sqrt(2.0) * np.abs(np.asarray(x_arcsec, dtype=np.float64)))


def sky_column(table: CoronagraphTable) -> str | None:
    """Return the name of the column that has the transmission of an even sky, if there is one."""
    return next((name for name in ("sky_transmission", "occulter_transmission") if name in table), None)


def table_metrics(instrument: Instrument, band: str, table: CoronagraphTable) -> TableMetrics:
    """Return the figures of a band from its table.

    Parameters
    ----------
    instrument : Instrument
    band : str
        Name of a band of the instrument.
    table : CoronagraphTable

    Notes
    -----
    Without the columns that say more, the brightest pixel of the star is the brightest of the zone's mean light, a
    source's brightest pixel is that of a clear pupil whose core holds as much, and the drift of the wavefront scatters
    light as in a clear telescope: ``a = 4 C E`` and ``b = 2 E^2`` per nm^2 and nm^4 with C the starlight in a core and
    E that of an error of 1 nm.
    """
    reach = instrument.hole_outer_arcsec(band) + 2.0 * instrument.aperture_radius_arcsec(band)
    half = min(math.ceil(reach / instrument.pixel_scale_arcsec(band)) + 1, _MOST_HALF_STAMP)
    geometry = BandGeometry.of(instrument, band, 2 * half + 1)
    core = table.columns["core_throughput"]
    sky = sky_column(table)
    energy = 1.0 if sky is None else float(table.columns[sky].mean())
    pupil = _pupil_light(instrument, band, geometry, _open(table))
    peak = table.constant("source_peak_pixel")
    if peak is None:
        peak = min(float(core.max()) * pupil.pop("peak_over_core"), 1.0)
    pupil.pop("peak_over_core", None)
    light = table.columns["raw_contrast"] * core / geometry.aperture_pixels
    separation = separations(geometry.stamp_pixels, geometry.pixel_scale_arcsec)
    starlight = np.exp(np.interp(separation, table.separation_arcsec, np.log(np.maximum(light, 1e-300))))
    brightest = float(light.max())
    said = {
        name: brightest if table.constant(column) is None else table.constant(column)
        for name, column in (
            ("peak_on_axis_hole", "star_peak_zone"),
            ("peak_on_axis_frame", "star_peak_frame"),
            ("peak_on_axis_columns", "star_peak_columns"),
            ("register_tail", "star_register_tail"),
        )
    }
    values: dict[str, Any] = geometry.figures() | pupil | said | _floor(instrument, band, table)
    settings, fraction = instrument.coronagraph, instrument.coronagraph.stability_fraction
    source = table.constant("source_noise_fraction")
    return TableMetrics(
        band=band,
        strehl=None,
        hole_state="table",
        apodizer_energy=energy,
        core_open=float(core.max()),
        core_continuous=float(core.max()),
        core_table=np.array([[0.0, 0.0], [0.0, float(core.max())]]),
        core_table_half_arcsec=geometry.aperture_radius_arcsec,
        peak_off_axis=peak,
        iwa_arcsec=_half_way(table),
        raw_contrast=starlight / peak,
        halo_map=starlight * geometry.aperture_pixels,
        column_light=starlight.sum(axis=0),
        source_noise_fraction=1.0 if source is None else source,
        table=table,
        stability_fraction=fraction,
        stability_is_common=settings.stability_averages == "never",
        **values,
    )


def _open(table: CoronagraphTable) -> float:
    """Return the light that passes far from the star: the most that the table has, all of it where it does not say."""
    name = sky_column(table)
    return 1.0 if name is None else float(table.columns[name].max())


def _half_way(table: CoronagraphTable) -> float:
    """Return where the core throughput first has half its maximum; the table's first separation if it has more."""
    core, place = table.columns["core_throughput"], table.separation_arcsec
    above = int(np.argmax(core >= 0.5 * core.max()))
    if above == 0:
        return float(place[0])
    return float(np.interp(0.5 * core.max(), core[above - 1 : above + 1], place[above - 1 : above + 1]))


def _pupil_light(instrument: Instrument, band: str, geometry: BandGeometry, passed: float) -> dict[str, Any]:
    """Return the wings, columns and apertures around a source, and its brightest pixel over the light of its core."""
    configuration, unit = instrument.band(band), geometry.lambda_d_arcsec
    pixel, radius = geometry.pixel_scale_arcsec, geometry.aperture_radius_arcsec / unit
    shape = instrument.telescope.obstruction_diameter_ratio, configuration.width_nm / configuration.center_nm
    per_pixel = passed * (pixel / unit) ** 2
    n_profile = math.ceil(FIELD_ARCSEC / pixel) + 1
    fine = np.concatenate([np.linspace(0.0, 30.0, 3001), np.geomspace(30.01, 1.5 * FIELD_ARCSEC / unit + 31.0, 4000)])
    course = per_pixel * airy(fine, *shape)

    def light(separation_arcsec: FloatArray) -> FloatArray:
        return np.asarray(np.interp(separation_arcsec / unit, fine, course))

    profile = light(pixel * np.arange(n_profile, dtype=np.float64))
    arm = np.arange(0, FIELD_ARCSEC - 2 * _WING_STEP_ARCSEC, _WING_STEP_ARCSEC)
    centre = np.concatenate([-arm[:0:-1], arm])
    within = ((np.arange(_WING_POINTS) + 0.5) / _WING_POINTS - 0.5) * _WING_STEP_ARCSEC
    axis = (centre[:, None] + within).ravel()
    boxes = light(np.asarray(np.hypot(axis[:, None], axis))).reshape(
        len(centre), _WING_POINTS, len(centre), _WING_POINTS
    )
    reach = int(min(_NEAR_ARCSEC / unit, _NEAR_LAMBDA_D) / _NEAR_STEP_LAMBDA_D)
    steps = np.arange(-reach, reach + 1) * _NEAR_STEP_LAMBDA_D
    course_s = np.linspace(0.0, math.sqrt(2.0) * reach * _NEAR_STEP_LAMBDA_D + 1.0, 20 * reach + 100)
    around = passed * disc_light(course_s, radius, *shape)
    row = np.concatenate([np.linspace(0.0, 10.0 * unit, _ROWS), np.geomspace(10.01 * unit, FIELD_ARCSEC, _ROWS)])
    column = pixel * np.arange(n_profile)
    half = 2.0 / pixel * np.array([float(np.trapezoid(light(np.asarray(np.hypot(at, row))), row)) for at in column])
    core = float(disc_light(np.zeros(1), radius, *shape)[0])
    return {
        "wing_profile": profile,
        "wing_map": boxes.mean(axis=(1, 3)),
        "wing_map_step_arcsec": _WING_STEP_ARCSEC,
        "aperture_map": np.interp(np.hypot(steps[:, None], steps), course_s, around),
        "aperture_map_step_arcsec": _NEAR_STEP_LAMBDA_D * unit,
        "column_profile": np.concatenate([half[:0:-1], half]),
        # A pixel is no brighter than the middle of the source, nor holds more than its core.
        "peak_over_core": min(float(airy(0.0, *shape)) * (pixel / unit) ** 2 / core, 1.0),
    }


def _floor(instrument: Instrument, band: str, table: CoronagraphTable) -> dict[str, FloatArray]:
    """Return the variance of core sums between two visits 1 nm off each, and what a filter makes of it."""
    place = table.separation_arcsec
    names = "speckle_variance_per_nm2", "speckle_variance_per_nm4"
    configuration = instrument.band(band)
    core = table.columns["core_throughput"]
    apart = place / instrument.lambda_d_arcsec(band)
    cell = (instrument.lambda_d_arcsec(band) / instrument.pixel_scale_arcsec(band)) ** 2
    fifths = [
        table.columns.get(f"filter_linear_{n}", np.full(place.shape, usual)) for n, usual in enumerate(_FIFTHS, 1)
    ]
    single = (
        *(("filter_square", _SQUARE), ("filter_tails", _TAILS)),
        *(("filter_positions", _POSITIONS * cell), ("filter_roughness", _ROUGH / cell)),
    )
    error = core * scattered_light(apart, 1.0, instrument.drift.psd_slope, configuration.center_nm)
    assumed = 4.0 * table.columns["raw_contrast"] * core * error, 2.0 * error**2
    linear, square = (table.columns.get(name, other) for name, other in zip(names, assumed, strict=True))
    return {
        "floor_separation_arcsec": place,
        "floor_linear": np.concatenate([[linear.mean()], linear]),
        "floor_square": np.concatenate([[square.mean()], square]),
        "filter_gain": table.columns.get("filter_gain", np.full(place.shape, _GAIN)),
        "filter_linear": np.stack(fifths, axis=-1),
        **{name: np.array(usual if (said := table.constant(name)) is None else said) for name, usual in single},
    }
