"""The noise of a pixel in one frame, and the frames that tracks of cosmic rays through an aperture cost."""

import functools
import math
from collections.abc import Mapping
from dataclasses import field

import numpy as np

from cpic_core import ArrayLike, FloatArray, Record, checked_scalar, special
from simulator.config import AnyDetector, CosmicRayConfig, Detector, Instrument
from simulator.detectors import FrameTerm, added_variance, excess_noise_factor2, frame_variance_e2
from simulator.effects import TemplateSet, cosmic_ray_rate, generated_projection_um, read_templates


class FrameNoise(Record):
    """Variance of a pixel of one frame, referred to the register input.

    Attributes
    ----------
    factor2 : float
        Variance over mean of the electrons that are counted: squared excess noise factor, or that of a fitted ramp.
    clock_e : float
        Clock-induced electrons a frame.
    read_e2, rounding_e2 : float
        Variance of the amplifier and of the converter.
    dark_e : float
        Dark current a frame.
    photons : bool
        Whether counts are drawn.
    added : mapping of str to FrameTerm
        What further effects of the detector add to a pixel, by term in budgets of noise: electrons at the register
        input, variance behind the register over its squared gain, and what comes back of earlier frames.
    """

    factor2: float
    clock_e: float
    read_e2: float
    rounding_e2: float
    dark_e: float
    photons: bool
    added: Mapping[str, FrameTerm] = field(default_factory=dict)

    @classmethod
    def of(cls, detector: AnyDetector, em_gain: float, exposure_s: float) -> "FrameNoise":
        """Return the noise of a frame with what is switched on.

        Parameters
        ----------
        detector : Detector or InfraredDetector
        em_gain : float
            Gain of the register, 1 without one.
        exposure_s : float
            Of the frame.

        Returns
        -------
        FrameNoise
            Without a register the variances of several reads together, and of the light what they make of it
            (`simulator.detectors.variance.ramp_factors`).
        """
        terms = added_variance(detector, exposure_s)
        cic, read, rounding, dark = (terms.pop(name, FrameTerm()) for name in ("cic", "read_noise", "rounding", "dark"))
        return cls(
            factor2=float(register_factor2(detector, em_gain, exposure_s)),
            clock_e=float(cic.charge_e),
            read_e2=float(read.output_e2) / em_gain**2,
            rounding_e2=float(rounding.output_e2) / em_gain**2,
            dark_e=float(dark.rate_e_s) * exposure_s,
            photons=detector.switches.photon_noise,
            added={
                name: FrameTerm(0.0, one.charge_e + one.rate_e_s * exposure_s, one.output_e2 / em_gain**2, one.of_past)
                for name, one in terms.items()
            },
        )

    @functools.cached_property
    def _rest(self) -> FrameTerm:
        return FrameTerm.total([FrameTerm(), *self.added.values()])

    @property
    def rest_e(self) -> float:
        """Electrons at the register input that further effects of the detector add."""
        return float(self._rest.charge_e)

    @property
    def rest_e2(self) -> float:
        """Variance behind the register that they add, over its squared gain."""
        return float(self._rest.output_e2)

    @property
    def of_past(self) -> float:
        """Electrons that come back for each that the frames before collected, where all have the same light."""
        return self._rest.of_past

    @property
    def gaussian_e2(self) -> float:
        """Variance of amplifier and converter together, and what else comes behind the register."""
        return self.read_e2 + self.rounding_e2 + self.rest_e2

    @property
    def pedestal_e(self) -> float:
        """Mean electrons of a pixel without light."""
        return self.dark_e * (1.0 + self.of_past) + self.clock_e + self.rest_e

    def variance_e2(self, light_e: ArrayLike) -> FloatArray:
        """Return the variance of pixels that light leaves so many electrons in, here and in the frames before."""
        counted_e = (np.asarray(light_e, dtype=np.float64) + self.dark_e) * self.photons
        return self.charge_variance_e2(counted_e * (1.0 + self.of_past) + self.clock_e + self.rest_e)

    def charge_variance_e2(self, charge_e: ArrayLike) -> FloatArray:
        """Return the variance of pixels that hold so many electrons on average, with dark and clock-induced ones."""
        return np.asarray(frame_variance_e2(np.asarray(charge_e, float), self.factor2, self.gaussian_e2, 1.0))


def register_factor2(detector: AnyDetector, em_gain: ArrayLike, exposure_s: float | None = None) -> FloatArray:
    """Return the variance over the mean of the electrons that a camera counts.

    Parameters
    ----------
    detector : Detector or InfraredDetector
    em_gain : array_like
        Gain of the register, 1 without one.
    exposure_s : float, optional
        Exposure of the frame; one that has room for all reads of a ramp if not given.

    Returns
    -------
    ndarray
        Squared excess noise factor of the register, 1 where it is switched off; what a fitted ramp makes of the light.
    """
    if isinstance(detector, Detector):
        factor2 = excess_noise_factor2(em_gain, detector.register_stages)
        return factor2 if detector.switches.em_register else np.ones_like(factor2)
    return np.full(np.shape(em_gain), detector.ramp(exposure_s)[1])


_CM_PER_UM = 1e-4
# Pixels that the circle cuts bring in charge from beyond it: on average the mean distance from the middle of a pixel.
_CUT_PIXEL = 0.25
# Stretch of a long track whose charge decides whether an electron is left at some distance.
_STRETCH_SIGMA = 4.0
_DIRECTIONS = 90
_SERIES_TERMS = 10


def aperture_loss_per_s(
    instrument: Instrument,
    band: str,
    *,
    aperture_radius_pixel: float | None = None,
    start_utc: str | float | None = None,
) -> float:
    """Return the rate at which tracks of cosmic rays touch an aperture.

    Parameters
    ----------
    instrument : Instrument
    band : str
        Names the detector and the aperture.
    aperture_radius_pixel : float, optional
        Radius, above 0 to 1000 pixels; that of the photometric aperture of the band by default.
    start_utc : str or float, optional
        ISO date or decimal year of the observation; that of ``instrument.mission`` by default.

    Returns
    -------
    float
        Tracks per second, at least 0; 0 where the detector's switch ``cosmic_rays`` is off.

    Raises
    ------
    InputError
        If a band is unknown, a radius or date out of range, or a file of templates cannot be used.

    Notes
    -----
    Straight tracks of mean projected length ``L``, placed and turned at random, touch a disc of radius ``R`` at the
    rate ``flux (pi R^2 + 2 R L)`` (Crofton: area, and perimeter times ``L / pi``). ``R`` is the radius of the aperture,
    the distance at which diffusion leaves one electron of a track (3.1 sigma at normal incidence), and a quarter of a
    pixel for the pixels that the circle cuts. Against tracks drawn on pixels of 13 and 15 um, counting a frame as hit
    where the aperture sum gains an electron, the rate is good to 5 %. Templates from a file count with the area and
    perimeter of their hulls.

    A frame that is hit is left out of this one aperture, and out of no other. Not counted are tails that a hit leaves
    along row or column (register, transfer), hits in the background apertures, whose median they do not move, and
    tracks that arrive during the readout.
    """
    detector = instrument.detector_of(band)
    if aperture_radius_pixel is None:
        radius = instrument.aperture_radius_arcsec(band) / instrument.pixel_scale_arcsec(band)
    else:
        radius = checked_scalar("aperture_radius_pixel", aperture_radius_pixel, low=1e-3, high=1e3, unit="px")
    when = instrument.mission.start_utc if start_utc is None else start_utc
    flux = cosmic_ray_rate(instrument.cosmic_rays, when)
    if not detector.switches.cosmic_rays:
        return 0.0
    area, perimeter, reach = _mean_shape_um(instrument.cosmic_rays)
    reached = (radius + _CUT_PIXEL) * detector.pixel_um + reach
    return flux * _CM_PER_UM**2 * (math.pi * reached**2 + perimeter * reached + area)


def mean_projection_um(depth_um: float, max_length_um: float) -> float:
    """Return the mean length on the detector of the chords of a layer.

    Parameters
    ----------
    depth_um : float
        Depth of the layer, above 0.
    max_length_um : float
        Longest chord, above ``depth_um``.

    Returns
    -------
    float
        ``d (arccos m - m sqrt(1 - m^2)) / (1 - m^2)`` with ``m = d / longest``, in um: the mean of
        ``d sqrt(1 / mu^2 - 1)`` where ``mu^2`` is uniform from ``m^2`` to 1, as for an isotropic flux
        (`simulator.effects.cosmic_rays`). ``pi d / 2`` without a longest chord.
    """
    depth = checked_scalar("depth_um", depth_um, low=1e-6, high=1e9, unit="um")
    longest = checked_scalar("max_length_um", max_length_um, low=depth * (1.0 + 1e-6), high=1e12, unit="um")
    # With m = cos x the mean is d (2 x - sin 2 x) / (2 sin^2 x), free of cancellation in this form of the sine.
    sine2 = (longest - depth) * (longest + depth) / longest**2
    return depth * _less_sine(2.0 * math.atan2(math.sqrt(sine2), depth / longest)) / (2.0 * sine2)


def _less_sine(angle: float) -> float:
    """Return the ``angle - sin(angle)``, by its series where the two cancel."""
    if angle > 1.0:
        return angle - math.sin(angle)
    total, square = 1.0, angle * angle
    for k in range(_SERIES_TERMS, 1, -1):
        total = 1.0 - total * square / (2.0 * k * (2.0 * k + 1.0))
    return angle * square / 6.0 * total


def _mean_shape_um(rays: CosmicRayConfig) -> tuple[float, float, float]:
    """Return the mean area and perimeter of a track's convex hull (um^2, um), and its charge's reach beyond (um)."""
    tracks, streaks = rays.physical, rays.paper
    if rays.model == "paper":
        length, sigma = mean_projection_um(streaks.depth_um, streaks.max_length_um), streaks.width_um
    elif rays.model == "template" and rays.template.template_file is not None:
        return _mean_hull_um(read_templates(rays.template.template_file))
    else:
        sigma = tracks.diffusion_um
        if rays.model == "template":
            length = generated_projection_um(rays.template, tracks)
        else:
            length = mean_projection_um(tracks.depth_um, tracks.max_length_um)
    if rays.model == "physical":
        near_e = tracks.mean_loss_e_um * tracks.depth_um
    else:
        near_e = streaks.mean_charge_e * min(1.0, _STRETCH_SIGMA * sigma / length)
    return 0.0, 2.0 * length, sigma * -float(special().ndtri(1.0 / max(near_e, 2.0)))


def _mean_hull_um(templates: TemplateSet) -> tuple[float, float, float]:
    """Return the mean hull of the samples of a set; a sample reaches half its side."""
    angle = 2.0 * np.pi * np.arange(_DIRECTIONS) / _DIRECTIONS
    areas, perimeters = [], []
    for first, last in zip(templates.start[:-1], templates.start[1:], strict=True):
        x, y = templates.column_um[first:last], templates.row_um[first:last]
        corner = np.argmax(np.outer(np.cos(angle), x) + np.outer(np.sin(angle), y), axis=1)
        x, y = x[corner], y[corner]
        after_x, after_y = np.roll(x, -1), np.roll(y, -1)
        areas.append(0.5 * float(np.sum(x * after_y - y * after_x)))
        perimeters.append(float(np.sum(np.hypot(after_x - x, after_y - y))))
    return float(np.mean(areas)), float(np.mean(perimeters)), 0.5 * templates.pixel_um
