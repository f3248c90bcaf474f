"""Mean count rates in the photometric aperture, per target, position and planet.

Light of a star is its own, its neighbours', and the sky's around it. The stars of a scene are those of its images:
`simulator.target.scene_sources` gives their light to both. Planets reflect light towards the observer; a stated
reference planet is what the numbers of a ranked star refer to.

A planet with a separation and no position angle stands on the diagonal of a dark quadrant, the upper right one if it is
dark. Around a star whose companion lights the hole it stands in the quadrant that holds least of that light. The noise
of a measurement is that of the whole annulus (`simulator.signal.light`), nearly the same for all quadrants; but
the scatter of the planet's own aperture is least there.
"""

import functools
import math
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import scipy

from cpic_core import ArrayLike, BoolArray, FloatArray, InputError, IntArray, NDArray, Record
from cpic_planner.etc.model import EtcModel, check_range
from cpic_planner.etc.searches import CaseArrays
from cpic_planner.queries import ReferencePlanet
from cpic_planner.targets import Targets
from simulator.config import AlbedoSpec, Instrument
from simulator.effects import sky_rates_e_s_arcsec2, stray_light_map
from simulator.imaging import AnnulusLight, PsfMetrics, light_around, quadrant_of
from simulator.signal import (
    CompanionTables,
    ProgrammeLaw,
    annulus_apertures,
    aperture_exozodi,
    companion_tables,
    error_variance_nm2,
    lit_rows,
    programme_parts,
    sky_pixel_e_s,
)
from simulator.target import albedo_notes, albedo_source, contrast_at, needs_insolation, phase_value, sin_phase

if TYPE_CHECKING:
    from simulator.target import Source


def light_of(model: EtcModel, targets: Targets, band: str) -> tuple[FloatArray, FloatArray]:
    """Return the electrons per second of stars on the clear disc, and of their sky in an aperture, ``(n,)`` each.

    Those of a single star are kept: whoever asks about it asks again, about another place or time.

    Parameters
    ----------
    model : EtcModel
    targets : Targets
        ``n`` stars.
    band : str

    Raises
    ------
    InputError
        As `aperture_sky_e_s`.
    """
    return _kept(model, targets, band) if len(targets) == 1 else _light(model, targets, band)


_STRIPED = 0.8
"""Light of a neighbour's wings that rules a filter with inverse variances for weights, over their mean in an aperture:
they have stripes finer than lambda/D. Mean of images of sources at 2 to 20 arcsec: 0.86 in F520, 0.82 in F662, 0.74 in
F720 and F850, where it falls to 0.62 at 2 arcsec; 0.55 to 0.9 for single sources."""


@functools.lru_cache(maxsize=1024)
def _kept(model: EtcModel, star: Targets, band: str) -> tuple[FloatArray, FloatArray]:
    found = _light(model, star, band)
    for array in found:
        array.flags.writeable = False
    return found


def _light(model: EtcModel, targets: Targets, band: str) -> tuple[FloatArray, FloatArray]:
    if targets.scene is None:
        own = star_e_s(model, band, targets, targets.v_mag, targets.teff_k)
    else:
        own = np.full(len(targets), _scene_stars(model, targets, band)[0].rate_e_s)
    return own, aperture_sky_e_s(model, targets, band)


@functools.lru_cache(maxsize=64)
def _scene_stars(model: EtcModel, targets: Targets, band: str) -> "tuple[Source, ...]":
    """Return the stars that images of the targets' scene show, the central one first."""
    from simulator.target import scene_sources

    assert targets.scene is not None
    return scene_sources(targets.scene.without_planets(), model.instrument, band)


class Neighbours(NamedTuple):
    """Stars beside the targets whose light and place are known, ``(k,)`` each.

    Attributes
    ----------
    row : ndarray of int
        Number of the target beside which the star stands.
    separation_arcsec, pa_deg : ndarray
        Its place at the targets' roll; the angle is nan where it is not known.
    rate_e_s : ndarray
        Its light on the clear disc.
    """

    row: IntArray
    separation_arcsec: FloatArray
    pa_deg: FloatArray
    rate_e_s: FloatArray

    def where(self, chosen: BoolArray) -> "Neighbours":
        """Return some of them."""
        place = self.separation_arcsec[chosen], self.pa_deg[chosen]
        return Neighbours(self.row[chosen], *place, self.rate_e_s[chosen])


def neighbours(model: EtcModel, targets: Targets, band: str) -> Neighbours:
    """Return all other stars of a target's scene, or the nearest companions of catalogue stars, where these count.

    Parameters
    ----------
    model : EtcModel
    targets : Targets
        ``n`` stars.
    band : str
    """
    if targets.scene is not None:
        from simulator.target import detector_to_sky

        stars = _scene_stars(model, targets, band)[1:]
        x, y, rate = (np.array([getattr(star, key) for star in stars]) for key in ("x_arcsec", "y_arcsec", "rate_e_s"))
        separation, pa_deg = detector_to_sky(x, y, parity=model.instrument.detector.parity)
        row = np.repeat(np.arange(len(targets)), len(stars))
        found = Neighbours(row, *(np.tile(part, len(targets)) for part in (separation, pa_deg, rate)))
    else:
        known = np.isfinite(targets.companion_v_mag) & np.isfinite(targets.companion_separation_arcsec)
        row = np.flatnonzero(known & (targets.companions != "off"))
        if not row.size:
            return Neighbours(row, *np.zeros((3, 0)))
        near = targets.select(row)
        light = star_e_s(model, band, near, near.companion_v_mag, near.companion_teff_k)
        found = Neighbours(row, near.companion_separation_arcsec, near.companion_pa_deg, light)
    return found._replace(pa_deg=found.pa_deg - np.broadcast_to(targets.roll_deg, len(targets))[found.row])


def star_e_s(model: EtcModel, band: str, targets: Targets, v_mag: FloatArray, teff_k: FloatArray) -> FloatArray:
    """Return the light of stars on the clear disc, e-/s, with surface gravity and metallicity of the targets, ``(n,)``.

    Parameters
    ----------
    model : EtcModel
    band : str
    targets : Targets
        ``n`` stars.
    v_mag, teff_k : ndarray, shape (n,)
        Of the stars, or of their companions.
    """
    area = model.instrument.telescope.area_cm2
    rate = model.passbands.star_rate_e_s(v_mag, teff_k, targets.log_g, targets.metallicity, area)
    return np.asarray(rate[:, model.passbands.names.index(band)])


def aperture_sky_e_s(model: EtcModel, targets: Targets, band: str) -> FloatArray:
    """Return the electrons per second of sky, earthshine and stray light in an aperture of the hole.

    Returns
    -------
    ndarray, shape (n_targets,)
        A map of stray light counts with its mean over the hole.

    Raises
    ------
    InputError
        If the sky is that of a date and a target has no place.
    """
    instrument, metrics = model.instrument, model.metrics[band]
    start = targets.date_utc or instrument.mission.start_utc
    sky = sky_pixel_e_s(
        metrics, sky_rates_e_s_arcsec2(instrument, band, targets.ra_deg, targets.dec_deg, start, model.passbands)
    )
    return np.asarray((sky + _stray_e_s_pixel(instrument, band, metrics)) * metrics.aperture_pixels)


def sky_in_core(
    model: EtcModel, band: str, sky_e_s: FloatArray, x_arcsec: FloatArray, y_arcsec: FloatArray
) -> FloatArray:
    """Return what an aperture at (x, y) gets of the light of `aperture_sky_e_s`.

    Parameters
    ----------
    model : EtcModel
    band : str
    sky_e_s : ndarray
        Broadcasts with the places.
    x_arcsec, y_arcsec : ndarray
    """
    metrics = model.metrics[band]
    share, pixels = metrics.sky_share(x_arcsec, y_arcsec), metrics.core_pixels(x_arcsec, y_arcsec)
    if isinstance(share, float) and isinstance(pixels, float):
        return sky_e_s
    stray = _stray_e_s_pixel(model.instrument, band, metrics) * metrics.aperture_pixels
    return np.asarray((stray + (sky_e_s - stray) * share) * (pixels / metrics.aperture_pixels))


def _stray_e_s_pixel(instrument: Instrument, band: str, metrics: PsfMetrics) -> float:
    """Return the mean stray light on the pixels of the hole that lie on the detector."""
    detector = instrument.detector_of(band)
    stray = stray_light_map(instrument, band, (detector.n_rows, detector.n_columns))
    if stray is None:
        return 0.0
    rows, columns = np.nonzero(metrics.hole)
    row = rows - metrics.hole.shape[0] // 2 + detector.star_row
    column = columns - metrics.hole.shape[1] // 2 + detector.star_column
    inside = (row >= 0) & (row < stray.shape[0]) & (column >= 0) & (column < stray.shape[1])
    return float(stray[row[inside], column[inside]].mean()) if inside.any() else 0.0


EVERY_ANGLE_DEG = tuple(np.arange(36) * 10.0 + 2.5)
"""Position angles over which the light of a companion is averaged whose own is not known."""


class ApertureRates(CaseArrays, Record):
    """Rates inside one aperture; all arrays broadcast against each other.

    Attributes
    ----------
    planet_e_s, halo_e_s, companion_e_s, sky_e_s, exozodi_e_s, dark_e_s : ndarray
        Detected electrons per second in the aperture: planet, residual star light behind the coronagraph, wings of
        companions and of a scene's other stars, sky, dust around the star, dark current. The planet's are those that
        the subtraction leaves (``planet_left``). Star and companions light the hole unevenly: theirs is the mean over
        the apertures that measure the noise (`simulator.imaging.annuli`).
    planet_left : ndarray
        Part of the planet's light that is left once the references, which may show it at another roll, and the mean of
        the background, which holds its wings, are subtracted.
    core : ndarray
        Part of a planet's light that its aperture gets (`simulator.imaging.metrics.PsfMetrics.core_throughput`).
    speckle : ProgrammeLaw
        Spatial variance of aperture sums of the star light that RDI leaves, (e-/s)^2, against the length of a visit;
        frames do not average it.
    wings_e2_s2 : ndarray
        The same of the light of companions whose wings lie elsewhere in the references; it is the same for all visits.
    peak_in_hole_e_s, peak_planet_e_s : ndarray
        Hottest pixel inside the hole, planet included: it must not saturate pixel, register or converter; and the
        planet's part of it.
    peak_frame_e_s : ndarray
        Hottest pixel of the central star anywhere.
    peak_columns_e_s : ndarray
        Hottest pixel of the central star in the columns that cross the hole: it must not bloom into it.
    register_tail_e_s : ndarray
        Light of the central star beside the hole that must fit the register, lest charge trails into the hole.
    aperture_pixels : ndarray or float
        Pixels in the aperture.
    noise_fraction : float
        Sum of squared pixel weights over the area of the aperture: pixels that the circle cuts count with their
        weight squared in the variance of a sum.
    source_noise_fraction : ndarray
        The same weighted by the planet's own light, for each electron of ``planet_e_s``: the light of both rolls makes
        noise, and their difference is the signal.
    background_apertures : ndarray
        Aperture areas in the annulus of the hole that measures the background.
    loss_per_s : float
        Rate of particles whose tracks touch the aperture and void it in that frame.
    errors_e_s : ndarray
        Part of ``halo_e_s`` that wavefront errors of the visits scatter: photons of it make noise, as all light does.
    reference_light_e_s, reference_halo : ndarray
        What the light and dark charge of a reference frame add to the variance, once scaled to the science frames; and
        what they add of ``halo_e_s``.
    reference_scale : ndarray
        The same for its clock-induced charge and read noise: the square of that scale.
    smear_e, reference_smear_e : ndarray
        Electrons that smear into the aperture in every frame, whatever its exposure; and what those of a reference
        frame add to the variance, once scaled.
    variance_factor : float
        1, or 1/2 where both halves of the frames show the planet (two rolls).
    parts : tuple of ProgrammeLaw
        Residual in units of the star's light: cross term with the static field, and light of the errors.
    """

    planet_e_s: FloatArray
    halo_e_s: FloatArray
    companion_e_s: FloatArray
    sky_e_s: FloatArray
    exozodi_e_s: FloatArray
    dark_e_s: FloatArray
    errors_e_s: FloatArray
    planet_left: FloatArray
    core: FloatArray
    speckle: ProgrammeLaw
    wings_e2_s2: FloatArray
    peak_in_hole_e_s: FloatArray
    peak_planet_e_s: FloatArray
    peak_frame_e_s: FloatArray
    peak_columns_e_s: FloatArray
    register_tail_e_s: FloatArray
    aperture_pixels: FloatArray | float
    noise_fraction: float
    source_noise_fraction: FloatArray
    background_apertures: FloatArray
    loss_per_s: float
    reference_light_e_s: FloatArray
    reference_halo: FloatArray
    reference_scale: FloatArray
    smear_e: FloatArray
    reference_smear_e: FloatArray
    variance_factor: float
    parts: tuple[ProgrammeLaw, ...] = ()

    @property
    def background_e_s(self) -> FloatArray:
        """All light and dark charge under the planet."""
        return self.halo_e_s + self.companion_e_s + self.sky_e_s + self.exozodi_e_s + self.dark_e_s


def aperture_rates(
    model: EtcModel,
    targets: Targets,
    band: str,
    x_arcsec: ArrayLike,
    y_arcsec: ArrayLike,
    contrast: ArrayLike,
    *,
    zodis: ArrayLike | None = None,
    at_place: bool = False,
) -> ApertureRates:
    """Return the rates for every target at the given positions.

    Parameters
    ----------
    model : EtcModel
    targets : Targets
        ``n`` stars.
    band : str
    x_arcsec, y_arcsec : array_like
        Positions on the detector relative to the star, broadcastable to ``(n, ...)`` (conventions of the instrument).
    contrast : array_like
        Planet-to-star ratio of detected rates, same shape rule.
    zodis : array_like, optional
        Dust around the star at each position, at least 0, same shape rule; by default that of the instrument's sky.
    at_place : bool
        Take the light of companions in the aperture itself: that of a search, which judges a place by its own light. By
        default it is the mean of the apertures that measure the noise, as of photometry.

    Returns
    -------
    ApertureRates
        Arrays that broadcast to ``(n, ...)``.

    Notes
    -----
    ``rate = F_phot * area * t_opt * QE * core(x, y)``: ``core`` holds apodizer, mask and aperture loss, so that
    every loss is counted once; two rolls then take the light of the planet's negative image off. A companion stands
    where its position angle has it at the targets' roll; one without position angle leaves the mean of its light over
    all of them.
    """
    instrument, metrics, strategy = model.instrument, model.metrics[band], model.strategy
    star, of_sky = light_of(model, targets, band)
    x, y = np.broadcast_arrays(np.asarray(x_arcsec, float), np.asarray(y_arcsec, float))
    ratio, separation = np.asarray(contrast, float), np.hypot(x, y)
    star = star.reshape(star.shape + (1,) * max(0, x.ndim - 1, ratio.ndim - 1))
    planet_total = star * ratio
    dims = max(star.ndim, x.ndim)
    sky = of_sky.reshape(-1, *(1,) * (dims - 1))
    wings_e_s, columns_e_s, wings_e2_s2, brightest_e_s = _companions(model, targets, band, x, y)
    if at_place:
        wings_e_s = _companions_at(model, targets, band, x, y)
    seen = _light_around(model, band, x, y)
    errors = star * error_variance_nm2(instrument.drift) * seen.errors
    halo = star * seen.star + errors
    area, core = metrics.core_pixels(x, y), metrics.core_throughput(x, y)
    exozodi = star * aperture_exozodi(metrics, instrument.sky.exozodi_zodis if zodis is None else zodis, x, y, core)
    dark = np.full((1,) * dims, model.camera(band).dark_e_s) * area
    width, ratio_of_lengths = strategy.annulus_lambda_d, strategy.reference_ratio
    parts = programme_parts(metrics, instrument.drift, separation, width, ratio_of_lengths, model.timing)
    reference, rolled = model.library_noise(band, star), _planet_left(model, band, x, y)
    left = rolled * seen.planet_left
    smear = _smear(model, band, x, star, columns_e_s, sky)
    brightest, peak_planet = star * reference.peak, planet_total * metrics.peak_off_axis
    peak_companion = brightest_e_s.reshape((-1,) + (1,) * (dims - 1))
    shown = sky_in_core(model, band, sky, x, y)
    return ApertureRates(
        planet_e_s=planet_total * core * left,
        halo_e_s=halo,
        companion_e_s=wings_e_s,
        sky_e_s=shown,
        exozodi_e_s=exozodi,
        dark_e_s=dark,
        planet_left=left,
        core=core,
        speckle=parts[0].beside(parts[1]).scaled(star**2 * reference.speckle),
        parts=parts,
        wings_e2_s2=wings_e2_s2,
        peak_in_hole_e_s=brightest * metrics.peak_on_axis_hole + peak_planet + peak_companion,
        peak_planet_e_s=peak_planet,
        peak_frame_e_s=brightest * metrics.peak_on_axis_frame,
        peak_columns_e_s=brightest * metrics.peak_on_axis_columns,
        register_tail_e_s=brightest * metrics.register_tail,
        aperture_pixels=area,
        noise_fraction=metrics.noise_fraction,
        source_noise_fraction=metrics.source_noise_fraction * (2.0 - rolled) / left,
        background_apertures=annulus_apertures(metrics, strategy.annulus_lambda_d, separation),
        loss_per_s=model.loss_per_s(band),
        reference_light_e_s=reference.light(halo + exozodi, wings_e_s, shown + dark),
        errors_e_s=errors,
        reference_halo=reference.halo,
        reference_scale=reference.scale,
        smear_e=smear.star_e + smear.companion_e + smear.even_e,
        reference_smear_e=reference.light(*smear),
        variance_factor=reference.variance_factor,
    )


def _light_around(model: EtcModel, band: str, x: FloatArray, y: FloatArray) -> AnnulusLight:
    """Return the star's light in the apertures that measure the noise of places, and what their mean takes of a planet.

    Two rolls leave as much of a planet as of its negative image in the mean of the background.
    """
    instrument, width = model.instrument, model.strategy.annulus_lambda_d
    of_errors = {"psd_slope": instrument.drift.psd_slope, "wavelength_nm": instrument.band(band).center_nm}
    found = light_around(model.metrics[band], width, x, y, **of_errors)
    return found if len(model.strategy.rolls_deg) == 1 else found._replace(planet_left=np.ones((1,) * x.ndim))


def companion_saturates(model: EtcModel, targets: Targets, band: str, exposure_s: ArrayLike) -> NDArray[np.bool_]:
    """Return whether a companion that falls on the frame overflows its pixels in one exposure; shape ``(n,)``.

    Its blooming column and register tail are not followed; the flag says that they exist.

    Parameters
    ----------
    model : EtcModel
    targets : Targets
        ``n`` stars.
    band : str
    exposure_s : array_like
        Of one frame; broadcasts to ``(n,)``.
    """
    metrics, detector = model.metrics[band], model.instrument.detector_of(band)
    over = np.zeros(len(targets), bool)
    exposure = np.broadcast_to(np.asarray(exposure_s, float), over.shape)
    for near, angles in _by_place(model, targets, band):
        column, row = (part / metrics.pixel_scale_arcsec for part in _place(model, near, angles))
        on_frame = (detector.star_column + column >= 0) & (detector.star_column + column < detector.n_columns)
        on_frame &= (detector.star_row + row >= 0) & (detector.star_row + row < detector.n_rows)
        peak = near.rate_e_s * metrics.peak_off_axis * exposure[near.row]
        over[near.row[on_frame.any(axis=1) & (peak > detector.full_well_e)]] = True
    return over


def _place(model: EtcModel, near: Neighbours, turns_deg: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Return offsets x and y of ``k`` neighbours on the detector, ``(k, a)``, at ``a`` rolls beside the targets'."""
    from simulator.target import sky_to_detector

    turned = np.nan_to_num(near.pa_deg)[:, None] - np.asarray(turns_deg, float)
    return sky_to_detector(near.separation_arcsec[:, None], turned, parity=model.instrument.detector.parity)


def _by_place(model: EtcModel, targets: Targets, band: str) -> Iterator[tuple[Neighbours, tuple[float, ...]]]:
    """Yield the neighbours whose position angle is known with the one angle, then the others with all of them."""
    every = neighbours(model, targets, band)
    unknown = np.isnan(every.pa_deg)
    for chosen, angles in ((~unknown, (0.0,)), (unknown, EVERY_ANGLE_DEG)):
        if chosen.any():
            yield every.where(chosen), angles


def companions_of(model: EtcModel, targets: Targets, band: str) -> Iterator[tuple[Neighbours, bool, CompanionTables]]:
    """Yield neighbours of known or unknown position angle, whether it is known, and the light of each.

    Parameters
    ----------
    model : EtcModel
    targets : Targets
        ``n`` stars.
    band : str
        Name of a band of the instrument, such as ``F520``.
    """
    detector, strategy = model.instrument.detector_of(band), model.strategy
    active, rolls = detector.sections["active"][0], strategy.reference_library.wings_deg(strategy)
    rows = active.start - detector.star_row, active.stop - detector.star_row
    for near, angles in _by_place(model, targets, band):
        place, *difference = (_place(model, near, np.add(angles, roll)) for roll in (0.0, *rolls))
        width = strategy.annulus_lambda_d
        yield near, len(angles) == 1, companion_tables(model.metrics[band], place, difference, width, rows=rows)


def _companions(model: EtcModel, targets: Targets, band: str, x: FloatArray, y: FloatArray) -> tuple[FloatArray, ...]:
    """Return the light of neighbours in apertures, in the columns under them, and what references leave, ``(n, ...)``.

    And on the brightest pixel of the hole, ``(n,)``; of several neighbours at most as much.
    """
    upright = (-1,) + (1,) * max(0, x.ndim - 1)
    shape = np.broadcast_shapes((len(targets), *upright[1:]), x.shape)
    found = (*np.zeros((3, *shape)), np.zeros(len(targets)))
    places = [np.atleast_1d(part) for part in (x, y)]
    for near, _, tables in companions_of(model, targets, band):
        light = tables.around(*(part[near.row] if len(part) == len(targets) else part for part in places))
        star = near.rate_e_s.reshape(upright)
        parts = star * light.aperture, star * light.column, star**2 * light.left, near.rate_e_s * tables.brightest
        for whole, part in zip(found, parts, strict=True):
            np.add.at(whole, near.row, part)
    return found


def _companions_at(model: EtcModel, targets: Targets, band: str, x: FloatArray, y: FloatArray) -> FloatArray:
    """Return the light of neighbours in the apertures, as a search's weights see it, ``(n, ...)``.

    It is the mean over unknown angles.
    """
    upright = (-1,) + (1,) * max(0, x.ndim - 1)
    found = np.zeros(np.broadcast_shapes((len(targets), *upright[1:]), x.shape))
    x, y = (np.broadcast_to(part, found.shape) for part in (x, y))
    for near, angles in _by_place(model, targets, band):
        columns, rows = _place(model, near, angles)
        for number in range(columns.shape[1]):
            at = x[near.row] - columns[:, number].reshape(upright), y[near.row] - rows[:, number].reshape(upright)
            light = _STRIPED * near.rate_e_s.reshape(upright) * model.metrics[band].source_aperture(*at)
            np.add.at(found, near.row, light / columns.shape[1])
    return found


def _planet_left(model: EtcModel, band: str, x: FloatArray, y: FloatArray) -> FloatArray:
    """Return the part of a planet's light that its negative image in the other roll leaves in its aperture."""
    rolls_deg = model.strategy.rolls_deg
    if len(rolls_deg) == 1:
        return np.ones((1,) * x.ndim)
    first, second = (np.exp(1j * np.radians(roll)) for roll in rolls_deg)
    apart = (x + 1j * y) * (second - first)
    metrics = model.metrics[band]
    middle = len(metrics.aperture_map) // 2
    at = [part / metrics.aperture_map_step_arcsec + middle for part in (apart.imag, apart.real)]
    source = scipy.ndimage.map_coordinates(_spline(metrics), at, order=3, prefilter=False, mode="nearest")
    return np.asarray(1.0 - source / metrics.aperture_map[middle, middle])


@functools.lru_cache(maxsize=16)
def _spline(metrics: PsfMetrics) -> FloatArray:
    """Return the cubic spline's coefficients through a source's light in apertures (lines miss 0.1 of its middle)."""
    return np.asarray(scipy.ndimage.spline_filter(metrics.aperture_map, order=3))


class _Smear(NamedTuple):
    """Electrons per frame that smear into an aperture, whatever the exposure: from the star, companions, the sky."""

    star_e: FloatArray
    companion_e: FloatArray
    even_e: FloatArray


def _smear(
    model: EtcModel, band: str, x: FloatArray, star_e_s: FloatArray, companion_e_s: FloatArray, sky_e_s: FloatArray
) -> _Smear:
    """Return the light that smears into apertures while the frame is shifted into the store: there is no shutter.

    Every pixel passes under the light of its column for ``line_shift_s`` a row: it collects ``line_shift_s`` times the
    light of all other rows, once a frame (`simulator.camera.camera`). Calibration takes the mean off; the noise stays.
    The planet, dust around the star and dark current are left out: they add less than 2e-3 s of their own light.
    """
    shift, metrics = model.camera(band).line_shift_s, model.metrics[band]
    if shift == 0.0:
        return _Smear(*np.zeros((3,)))
    rows = model.instrument.detector_of(band).sections["active"][0]
    return _Smear(
        star_e=shift * star_e_s * metrics.column_aperture(x),
        companion_e=shift * companion_e_s,
        even_e=shift * lit_rows(metrics, rows) * sky_e_s,
    )


NEAREST_ARCSEC, FARTHEST_ARCSEC = 1e-6, 120.0
"""Where a planet can be asked for, and the nearest place at which the light of a modelled one is worked out: inside
it is none, as at the star itself, and no double holds the contrast of a planet at 1e-308 arcsec."""


def reference_distance_au(targets: Targets, separation_arcsec: FloatArray, planet: ReferencePlanet) -> FloatArray:
    """Return the true star-planet distance in au, shape ``(n_star, n_separation)``; 1 arcsec at 1 pc is 1 au.

    Separations are the same for all stars, ``(n_separation,)``, or one row for each.

    Parameters
    ----------
    targets : Targets
    separation_arcsec : ndarray
        Projected.
    planet : ReferencePlanet
    """
    projected = targets.distance_pc[:, None] * np.atleast_2d(separation_arcsec)
    return np.asarray(projected / sin_phase(planet.phase_deg))


def reference_notes(
    model: EtcModel, targets: Targets, band: str, separation_arcsec: float, planet: ReferencePlanet, star: int = 0
) -> tuple[str, ...]:
    """Return what was clamped or extrapolated in the reference planet of one star, as flags.

    Parameters
    ----------
    model : EtcModel
    targets : Targets
    band : str
        Name of a band of the instrument, such as ``F520``.
    separation_arcsec : float
        Projected separation from the star, arcsec, above 0.
    planet : ReferencePlanet
    star : int, optional
        Number of the star.
    """
    distance = float(targets.distance_pc[star] * separation_arcsec / sin_phase(planet.phase_deg))
    notes = albedo_notes(planet.albedo, distance / float(np.sqrt(targets.luminosity_lsun[star])))
    beyond = model.passbands.albedo_flags(albedo_source(planet.albedo))[model.passbands.index(band)]
    return (*notes, "extrapolated") if beyond else notes


def reference_contrast(
    model: EtcModel, targets: Targets, band: str, separation_arcsec: FloatArray, planet: ReferencePlanet
) -> FloatArray:
    """Return the contrast of the reference planet in one band, ``(n_star, n_separation)``; as `reference_distance_au`.

    Parameters
    ----------
    model : EtcModel
    targets : Targets
    band : str
        Name of a band of the instrument, such as ``F520``.
    separation_arcsec : ndarray
        Projected separation from the star, arcsec, above 0.
    planet : ReferencePlanet
    """
    distance = reference_distance_au(targets, separation_arcsec, planet)
    return reflected_contrast(model, targets, band, planet.albedo, planet.radius_rjup, distance, planet.phase_deg)


def insolation_distance_au(targets: Targets, distance_au: FloatArray) -> FloatArray:
    """Return the distances from the Sun of the same insolation, ``r / sqrt(L)``, shape ``(n, k)``.

    Parameters
    ----------
    targets : Targets
        ``n`` stars.
    distance_au : ndarray, shape (n, k)
        From each star.
    """
    return np.asarray(distance_au / np.sqrt(targets.luminosity_lsun)[:, None])


def reflected_share(
    model: EtcModel, targets: Targets, band: str, albedo: AlbedoSpec, distance_au: FloatArray, phase_deg: ArrayLike
) -> FloatArray:
    """Return the geometric albedo in a band times the phase function.

    Parameters
    ----------
    model : EtcModel
    targets : Targets
        ``n`` stars, whose spectra weigh the albedo.
    band : str
        One band at a time: a user's albedo need not reach the bands that are not asked about.
    albedo : AlbedoSpec
        One that follows the insolation takes it as ``r / sqrt(L)``.
    distance_au : ndarray, shape (n, k)
        True distance of planets from their star.
    phase_deg : array_like
        Their phase angles, of the same shape or one that is broadcast to it.

    Returns
    -------
    ndarray, shape (n, k)
    """
    own = insolation_distance_au(targets, distance_au) if needs_insolation(albedo) else None
    stars = (targets.teff_k[:, None], targets.log_g[:, None], targets.metallicity[:, None])
    reflected = model.passbands.band_albedo(albedo_source(albedo), *stars, insolation_au=own, only=band)
    share = reflected * phase_value(albedo, phase_deg, insolation_au=own)
    return np.broadcast_to(share, np.shape(distance_au))


def reflected_contrast(
    model: EtcModel,
    targets: Targets,
    band: str,
    albedo: AlbedoSpec,
    radius_rjup: ArrayLike,
    distance_au: FloatArray,
    phase_deg: ArrayLike,
) -> FloatArray:
    """Return the contrast of planets of one albedo, shape ``(n, k)``.

    Parameters
    ----------
    model, targets, band, albedo, distance_au, phase_deg
        As of `reflected_share`.
    radius_rjup : array_like
        Of the planets.
    """
    share = reflected_share(model, targets, band, albedo, distance_au, phase_deg)
    return np.asarray(contrast_at(radius_rjup, distance_au, phase_deg, 1.0, phase_value=share))


def kinds_by_albedo(albedos: Sequence[AlbedoSpec]) -> list[tuple[AlbedoSpec, list[int]]]:
    """Return the different albedos with the numbers of the kinds that have them."""
    found: dict[AlbedoSpec, list[int]] = {}
    for number, spec in enumerate(albedos):
        found.setdefault(spec, []).append(number)
    return list(found.items())


def mixture_contrast(
    model: EtcModel,
    targets: Targets,
    band: str,
    albedos: Sequence[AlbedoSpec],
    kind: IntArray,
    radius_rjup: FloatArray,
    distance_au: FloatArray,
    phase_deg: FloatArray,
) -> FloatArray:
    """Return the contrast of planets of several kinds.

    Parameters
    ----------
    model, targets, band
        As of `reflected_share`.
    albedos : sequence of AlbedoSpec
        By kind.
    kind, radius_rjup, distance_au, phase_deg : ndarray, shape (n, k)
        Of the planets of each star.

    Returns
    -------
    ndarray, shape (n, k)
    """
    share = np.zeros(distance_au.shape)
    for spec, numbers in kinds_by_albedo(albedos):
        mine = np.isin(kind, numbers)
        some = mine.any(axis=0)
        if some.any():
            own = reflected_share(model, targets, band, spec, distance_au[:, some], phase_deg[:, some])
            share[:, some] = np.where(mine[:, some], own, share[:, some])
    return np.asarray(contrast_at(radius_rjup, distance_au, phase_deg, 1.0, phase_value=share))


QUADRANTS = ("upper right", "upper left", "lower right", "lower left")
"""Quadrants on the detector by their number, +x to the right and +y up."""


def dark_quadrants(model: EtcModel, targets: Targets, band: str) -> IntArray:
    """Return the number of the quadrant of each star in which its planet is put, shape ``(n,)``.

    Parameters
    ----------
    model : EtcModel
    targets : Targets
        ``n`` stars; a companion without position angle lights all quadrants alike.
    band : str
        Name of a band of the instrument, such as ``F520``.
    """
    found = np.full(len(targets), quadrant_of(*model.metrics[band].zone.diagonal))
    for near, placed, tables in companions_of(model, targets, band):
        if placed:
            light = np.zeros((len(targets), 4))
            np.add.at(light, near.row, near.rate_e_s[:, None] * tables.quadrants)
            found[near.row] = np.argmin(light[near.row], axis=1)
    return found


def planet_offsets(model: EtcModel, targets: Targets, band: str, separation_arcsec: Any) -> tuple[Any, Any]:
    """Return the detector offsets of planets: on the diagonal, or half the roll beside it for a library of two rolls.

    Parameters
    ----------
    model : EtcModel
    targets : Targets
        ``n`` stars.
    band : str
        Name of a band of the instrument, such as ``F520``.
    separation_arcsec : array_like
        Projected separations from the stars, arcsec, above 0, ``(n or 1, ...)``.

    Returns
    -------
    x_arcsec, y_arcsec : ndarray
        Shape of the separations, or ``(n, ...)`` where the stars' quadrants differ.
    """
    offset, number = np.asarray(separation_arcsec, float) / math.sqrt(2.0), dark_quadrants(model, targets, band)
    same = bool(np.all(number == number[0]))
    number = number[0] if same else number.reshape((-1,) + (1,) * (offset.ndim - 1))
    x, y = np.where(number % 2, -offset, offset), np.where(number // 2, -offset, offset)
    rolls = model.strategy.rolls_deg
    if len(rolls) == 1:
        return x, y
    half = math.radians(rolls[1])
    return x * math.cos(half) - y * math.sin(half), x * math.sin(half) + y * math.cos(half)


def diagonal_pa_deg(model: EtcModel, target: Targets, band: str) -> float:
    """Return the position angle of the diagonal on which the planet of one star is put, at roll 0.

    Parameters
    ----------
    model : EtcModel
    target : Targets
        One star.
    band : str
        Name of a band of the instrument, such as ``F520``.
    """
    from simulator.target import detector_to_sky

    (number,) = dark_quadrants(model, target, band)
    _, pa = detector_to_sky(1 - 2 * (number % 2), 1 - 2 * (number // 2), parity=model.instrument.detector.parity)
    return float(pa)


class Planets(Record):
    """Planets of a question: projected separations, with a model each or a given contrast each."""

    separation_arcsec: FloatArray
    models: tuple[ReferencePlanet, ...]
    contrast: FloatArray | None

    def __len__(self) -> int:
        return len(self.separation_arcsec)


def planets_of(
    separation_arcsec: float | Sequence[float],
    planet: ReferencePlanet | Sequence[ReferencePlanet] | None = None,
    contrast: float | Sequence[float] | None = None,
) -> Planets:
    """Return planets from one value or a sequence of each; sequences have one length.

    Parameters
    ----------
    separation_arcsec : float or sequence of float
        Projected, 0 to 120 arcsec.
    planet : ReferencePlanet or sequence of it, optional
    contrast : float or sequence of float, optional
        Instead of a model, 0 to 1.

    Raises
    ------
    InputError
        For values out of range or lengths that differ.
    """
    places = np.atleast_1d(np.asarray(separation_arcsec, dtype=object))
    bodies = list(planet) if isinstance(planet, Sequence) else [planet or ReferencePlanet()]
    ratios = None if contrast is None else np.atleast_1d(np.asarray(contrast, dtype=object))
    sizes = {len(places), len(bodies), 1 if ratios is None else len(ratios)} - {1}
    if len(sizes) > 1 or 0 in sizes or places.ndim != 1:
        raise InputError("separation_arcsec", len(places), allowed="as many as there are planets and contrasts, or one")
    n = max(sizes, default=1)
    where = np.array([check_range("separation_arcsec", value, 0.0, FARTHEST_ARCSEC, "arcsec") for value in places])
    given = None
    if ratios is not None:
        given = np.broadcast_to(np.array([check_range("contrast", value, 0.0, 1.0, "") for value in ratios]), n)
    models = tuple(bodies * (n if len(bodies) == 1 else 1))
    return Planets(np.broadcast_to(where, n), models, given)
