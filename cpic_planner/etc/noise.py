"""Signal-to-noise ratios from rates: one noise model answers every question.

The signal-to-noise ratio of Zhu et al. 2025 (Eqs. 3 and 4) is a prediction for comparison, never for a decision.

Modes of the references are found in the noise of the references: what they change depends on the frames, and the best
frames depend on it, weakly. Questions go from one to the other until both stand still.
"""

import functools
from collections.abc import Callable
from typing import Any, Literal, NamedTuple

import numpy as np

from cpic_core import ArrayLike, FloatArray, Record, checked_array, checked_scalar
from cpic_planner.etc.model import ONE_VISIT, EtcModel, FrameCamera, Programme
from cpic_planner.etc.photon_counting import counted_terms, counting_probabilities
from cpic_planner.etc.rates import ApertureRates
from cpic_planner.etc.searches import spread
from cpic_planner.queries import Strategy
from simulator.detectors import GAIN_LIMIT, FrameTerm, clean_fraction, frames_per_clean, noise_factor2
from simulator.signal import SpeckleLaw

Objective = Literal["snr", "significance"]
PLAIN = Strategy()
"""References of the same star, as many as science frames; charge is measured."""
# Light and dark charge of the science frames, by origin.
_LIGHT = ("halo", "companion", "sky", "exozodi", "dark")


class StackNoise(Record):
    """Signal and noise of the summed stack of all visits, in input-referred electrons.

    ``snr`` = S / sqrt(Var S) with the source's own noise; ``significance`` = S / sigma without the planet. ``terms``
    are the parts of Var S: light of the science frames by origin, smear, clock-induced charge, read noise and rounding,
    then ``reference`` (all of that in the reference frames), ``background_mean`` (error of the mean background),
    ``speckle`` (what averages over visits only), ``common_speckle`` and ``companion_wings`` (what never averages).
    ``quiet`` is the variance that a significance is measured by: without the planet's own light and the mean's error;
    ``white`` what of it averages with time, ``speckle`` what averages over visits only. ``errors`` is the part of
    ``white`` that photons make which the errors of the wavefront scatter; 0 where photons are counted.
    """

    signal_e: FloatArray
    quiet: FloatArray
    white: FloatArray
    speckle: FloatArray
    errors: FloatArray
    snr: FloatArray
    significance: FloatArray
    _terms: Callable[[], dict[str, FloatArray]]

    @functools.cached_property
    def terms(self) -> dict[str, FloatArray]:
        """Parts of the variance by origin, e-^2, each in the shape of the SNR."""
        return {name: spread(part, self.snr.shape) for name, part in self._terms().items()}

    def at(self, index: Any) -> "StackNoise":
        """Return the noise of some of the cases, without its terms."""
        names = (name for name in self.__dataclass_fields__ if name != "_terms")
        parts = {name: np.broadcast_to(getattr(self, name), self.snr.shape)[index] for name in names}
        return StackNoise(**parts, _terms=dict)


def light_factor2(camera: FrameCamera, em_gain: ArrayLike) -> FloatArray:
    """Return the variance over the mean of the electrons that a camera counts; no checks.

    Parameters
    ----------
    camera : FrameCamera
    em_gain : array_like
        Gains of at least 1.
    """
    gain = np.asarray(em_gain, float)
    if camera.register_stages == 0:
        return np.full(gain.shape, camera.light_factor)
    return noise_factor2(gain, camera.register_stages)


def white_terms(rates: ApertureRates, camera: FrameCamera, reference_ratio: ArrayLike) -> dict[str, FrameTerm]:
    """Return what averages with time, by origin, but the planet's own light: of one science frame with its references.

    Parameters
    ----------
    rates : ApertureRates
    camera : FrameCamera
    reference_ratio : array_like
        Reference frames per science frame.

    Returns
    -------
    dict of str to FrameTerm
        Of a sum over the area of the aperture, before the weights of its pixels and what the subtraction leaves of a
        planet. ``reference`` is everything that the reference frames add, scaled to the science frames.
    """
    light = {name: FrameTerm(rate_e_s=getattr(rates, f"{name}_e_s")) for name in _LIGHT}
    smear = {"smear": FrameTerm(charge_e=rates.smear_e)}
    reference = {"reference": reference_term(rates, camera, reference_ratio)}
    return light | smear | _electronic_terms(rates, camera) | reference


def white_term(rates: ApertureRates, camera: FrameCamera, reference_ratio: ArrayLike) -> FrameTerm:
    """Return the sum of `white_terms`.

    Parameters
    ----------
    rates, camera, reference_ratio
        As of `white_terms`.
    """
    light = FrameTerm(rates.background_e_s, rates.smear_e)
    reference = reference_term(rates, camera, reference_ratio)
    return FrameTerm.total((*_electronic_terms(rates, camera).values(), light, reference))


def _electronic_terms(rates: ApertureRates, camera: FrameCamera) -> dict[str, FrameTerm]:
    """Return what the camera adds to a science frame besides the noise of light and dark charge."""
    area = rates.aperture_pixels
    return {
        "cic": FrameTerm(charge_e=area * camera.cic_e),
        "read_noise": FrameTerm(output_e2=area * camera.read_noise_e**2),
        "rounding": FrameTerm(output_e2=area * camera.rounding_e**2),
    } | {name: added.over(area, rates.background_e_s, rates.smear_e) for name, added in camera.added}


def reference_term(rates: ApertureRates, camera: FrameCamera, reference_ratio: ArrayLike) -> FrameTerm:
    """Return everything that the reference frames of a science frame add."""
    pixels, ratio = rates.reference_scale * rates.aperture_pixels, np.asarray(reference_ratio, float)
    again = 1.0 + camera.of_past
    return FrameTerm(
        (again * rates.reference_light_e_s + pixels * camera.rate_e_s) / ratio,
        (again * rates.reference_smear_e + pixels * camera.charge_e) / ratio,
        pixels * camera.read_variance_e2 / ratio,
    )


def own_noise(rates: ApertureRates, camera: FrameCamera, programme: Programme = ONE_VISIT) -> FloatArray:
    """Return the variance of the planet's own light per second, before the gain register's excess noise, e-^2/s.

    Parameters
    ----------
    rates : ApertureRates
    camera : FrameCamera
    programme : Programme
        Says what modes leave of it.
    """
    share = rates.source_noise_fraction * rates.variance_factor * programme.own_factor
    return np.asarray(camera.light_factor * share * (1.0 + camera.of_past) * rates.planet_e_s)


def error_noise(rates: ApertureRates, camera: FrameCamera, strategy: Strategy, programme: Programme) -> FloatArray:
    """Return the same of the light that errors of the wavefront scatter, of science and reference frames, e-^2/s.

    Parameters
    ----------
    rates : ApertureRates
    camera : FrameCamera
    strategy : Strategy
    programme : Programme
    """
    share = rates.noise_fraction * rates.variance_factor * programme.white_factor
    light = _errors_e_s(rates, programme.frame_ratio(strategy.reference_ratio))
    return np.asarray(camera.light_factor * share * light)


def _errors_e_s(rates: ApertureRates, reference_ratio: ArrayLike) -> FloatArray:
    """Return the scattered light whose photons make noise in the difference of a science frame and its references."""
    return np.asarray(rates.errors_e_s * (1.0 + rates.reference_halo / np.asarray(reference_ratio, float)))


def residual_law(rates: ApertureRates, programme: Programme) -> SpeckleLaw:
    """Return everything that a programme leaves and that frames do not average, before two rolls are averaged.

    Wings of companions are no speckles of the star: modes of its references leave them as they are.
    """
    law = programme.law(rates.speckle)
    wings = rates.wings_e2_s2 if programme.by_mean else rates.wings_e2_s2 * programme.planet_factor2
    return law._replace(k0=law.k0 + wings)


def stack_noise(
    rates: ApertureRates,
    exposure_s: ArrayLike,
    n_frames: ArrayLike,
    em_gain: ArrayLike,
    camera: FrameCamera,
    strategy: Strategy = PLAIN,
    programme: Programme | None = None,
) -> StackNoise:
    """Return signal and noise of visits of ``n_frames`` frames, all visits summed.

    Parameters
    ----------
    rates : ApertureRates
    exposure_s, n_frames, em_gain : array_like
        One frame (s), number of science frames of a visit, gain of the register; broadcast with the rates.
    camera : FrameCamera
    strategy : Strategy
        Says how many references there are, and whether photons are counted above which threshold.
    programme : Programme, optional
        Visits that are reduced together; by default those of the strategy, or one.

    Notes
    -----
    ``Var = {F^2(g) [S + (1 + N/M) (B + smear + a0 cic)] + (1 + N/M) a0 (RN^2 + K^2/12) / g^2} / P``, summed over
    frames, with the weights of cut pixels squared, divided by the fraction ``P`` of frames that no particle voids; plus
    ``(N t sigma)^2`` of the residual light, which visits average and frames do not
    (`simulator.signal.speckles.ProgrammeLaw`). ``snr`` adds the error of the mean background. Where photons are
    counted, the terms of the white noise are ``counting`` (science frames) and ``reference``.

    Modes of the references leave a part of each term and of the planet: a term is that of the flux over what is left of
    it: ``white / T^2``, ``speckle / T^2`` (the common speckles too), ``1 / T`` of the planet's own noise, or, where
    photons are counted, ``white / T^2``, which is within 10 % of it.
    """
    exposure, each, gain = (np.asarray(item, float) for item in (exposure_s, n_frames, em_gain))
    made = Programme.of(strategy) if programme is None else programme
    frames, ratio = each * made.visits, made.frame_ratio(strategy.reference_ratio)
    every = frames * frames_per_clean(rates.loss_per_s, exposure) * rates.variance_factor
    stack = every * made.white_factor
    if strategy.mode == "photon_counting":
        law = counting_probabilities(camera, float(gain.flat[0]), strategy)
        counts, planet = counted_terms(rates, exposure, stack, law, camera, ratio)
        white, errors = np.asarray(sum(counts.values())), np.zeros(1)
    else:
        factor2, share = light_factor2(camera, gain), stack * rates.noise_fraction
        white = share * white_term(rates, camera, ratio).variance_e2(exposure, factor2, gain)
        errors = share * factor2 * _errors_e_s(rates, ratio) * exposure
        planet = every * made.own_factor * factor2 * rates.source_noise_fraction * rates.planet_e_s * exposure
    integrated = (frames * exposure) ** 2 * rates.variance_factor
    wings = integrated * rates.wings_e2_s2 * made.planet_factor2
    visit = each * (exposure + camera.readout_s)
    common = integrated * made.speckle * made.planet_factor2 * rates.speckle.common.variance(visit)
    speckle = integrated * made.law(rates.speckle.averaging()).variance(visit)
    quiet = white + wings + common + speckle
    mean = quiet / rates.background_apertures

    def terms() -> dict[str, FloatArray]:
        if strategy.mode == "photon_counting":
            parts = counts
        else:
            origins = white_terms(rates, camera, ratio)
            parts = {name: share * term.variance_e2(exposure, factor2, gain) for name, term in origins.items()}
        left = {"companion_wings": wings, "background_mean": mean, "speckle": speckle, "common_speckle": common}
        return parts | left | {"planet": planet}

    signal = frames * exposure * rates.planet_e_s
    with np.errstate(divide="ignore", invalid="ignore"):
        snr = np.where(signal > 0, signal / np.sqrt(quiet + mean + planet), 0.0)
        significance = np.where(signal > 0, signal / np.sqrt(quiet), 0.0)
    speckle, errors = (spread(part, snr.shape) for part in (speckle, errors))
    return StackNoise(signal, quiet, white, speckle, errors, snr, significance, terms)


def residuals(rates: ApertureRates, level: FloatArray | float, programme: Programme) -> list[FloatArray]:
    """Return the variance that frames do not average over signal squared, as a polynomial of the visit.

    Parameters
    ----------
    rates : ApertureRates
    level : ndarray or float
        1, or with the error of the mean background.
    programme : Programme
    """
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        scale = level * rates.variance_factor / rates.planet_e_s**2
        return [np.where(part > 0, part * scale, 0.0) for part in residual_law(rates, programme)]


SPECKLE_COHERENCE = 0.37
"""Variance of aperture sums of residual speckles over what pixels in step would give, ``a0^2 sigma_pixel^2``: mean of
the four visible bands, measured on images of the shipped holes at a visit offset of 0.05 nm (0.47 in F520, 0.28 in
F850); 0.7 beyond 0.5 nm."""


def snr_paper(
    rates: ApertureRates,
    exposure_s: ArrayLike,
    n_frames: ArrayLike,
    em_gain: ArrayLike,
    camera: FrameCamera,
    background_pixels: ArrayLike | None = None,
    *,
    reference_ratio: float = 1.0,
    programme: Programme = ONE_VISIT,
) -> FloatArray:
    """Return the signal over the error of Eq. 4, ``S0 / sqrt(S0 + sigma_s^2 a0 (1 + a0 / a_s))``.

    Parameters
    ----------
    rates : ApertureRates
    exposure_s, n_frames, em_gain : array_like
        One frame (s), science frames of a visit, gain of the register (1 to 1e4); broadcast with the rates.
    camera : FrameCamera
    background_pixels : array_like, optional
        Pixels ``a_s`` of the background region, above 0; those of the annulus around the planet by default.
    reference_ratio : float, optional
        Reference frames per science frame, above 0.
    programme : Programme
        Visits that are reduced together.

    Returns
    -------
    ndarray
        Expectation of ``snr_paper`` of `cpic_planner.validation.photometry.aperture_photometry`; 0 without signal.

    Raises
    ------
    InputError
        If an argument is out of range or not finite.

    Notes
    -----
    ``S0`` is the planet's charge in the aperture of the summed stack, as the projection leaves it (Eq. 3, whose
    background subtraction is unbiased); ``sigma_s`` the expected scatter of the pixels of the background, in electrons:
    white noise of the science frames and their share of the reference frames, and the speckles that are left, as one
    pixel shows them; ``a0`` the area of the aperture. Frames whose aperture a particle hits are left out of both.

    It is not the error of a measurement, in five ways: (1) the planet's own noise lacks the excess noise of the
    register, ``F^2``, up to a factor of 2 in variance; (2) printed, ``sigma_s`` is in units of the converter while
    ``S0`` is in electrons: here both are electrons; (3) speckles are as large as the aperture, and pixels that go up
    and down together do not average as ``sigma_s^2 a0`` has it: the variance is up to 20 times larger; (4) there is no
    throughput of the subtraction, nor a correction for the few apertures that the scatter is known from; (5) ``K``
    counts photo-electrons, not photons, and the errors of the calibrating star, of rounding and of the sum of frames
    are left open.
    """
    exposure = checked_array("exposure_s", exposure_s, low=0.0, unit="s")
    each = checked_array("n_frames", n_frames, low=0.0)
    ratio = programme.frame_ratio(checked_scalar("reference_ratio", reference_ratio, low=1e-6, high=1e6))
    area = rates.aperture_pixels
    if background_pixels is None:
        region = rates.background_apertures * area
    else:
        region = checked_array("background_pixels", background_pixels, low=1e-6, unit="px")
    gain = checked_array("em_gain", em_gain, low=1.0, high=GAIN_LIMIT)
    kept = each * programme.visits * clean_fraction(rates.loss_per_s, exposure)
    # Of the image itself, in which modes leave a part of the planet.
    left = programme.throughput
    own = left * rates.planet_e_s * exposure * kept
    frame = white_term(rates, camera, ratio)
    white = kept * programme.white * frame.variance_e2(exposure, light_factor2(camera, gain), gain) / area
    together = left**2 * residual_law(rates, programme).variance(each * (exposure + camera.readout_s)) / area**2
    pixel_variance = white + (kept * exposure) ** 2 * together / SPECKLE_COHERENCE
    variance = (own + pixel_variance * area * (1.0 + area / region)) * rates.variance_factor
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(np.where(own > 0, own / np.sqrt(variance), 0.0))


MODES_LIMITED, MODES_NOT_MODELLED, MODES_NOT_COUNTED = "modes_limited", "modes_not_modelled", "modes_not_counted"
_LOUD, _LONGEST_FRAMES = 1e3, 1e12


class Balance(NamedTuple):
    """Rms of white noise over that of speckles, in aperture sums of a mean rate without modes.

    Attributes
    ----------
    reference : ndarray
        Of one reference visit.
    programme : ndarray
        Of the whole programme.
    """

    reference: FloatArray
    programme: FloatArray


def balance_of(
    rates: ApertureRates,
    exposure_s: ArrayLike,
    n_frames: ArrayLike,
    em_gain: ArrayLike,
    camera: FrameCamera,
    strategy: Strategy,
    programme: Programme,
) -> Balance:
    """Return how white noise and speckles of frames compare; infinite without speckles.

    Parameters
    ----------
    rates, exposure_s, n_frames, em_gain, camera, strategy
        As of `stack_noise`; numbers of frames need not be whole.
    programme : Programme
        The visits; modes are left out.
    """
    exposure, each = np.asarray(exposure_s, float), np.asarray(n_frames, float)
    made = programme.of_mean()
    stack = stack_noise(rates, exposure, each, em_gain, camera, strategy, made)
    integrated = (each * made.visits * exposure) ** 2 * rates.variance_factor
    visit = each * (exposure + camera.readout_s)
    one = rates.speckle.reference.stretched(made.reference_length).variance(visit)
    with np.errstate(divide="ignore", invalid="ignore"):
        of_one = np.sqrt(stack.terms["reference"] / integrated * made.reference_visits / one)
        of_all = np.sqrt(stack.white / integrated / made.law(rates.speckle).variance(visit))
    return Balance(*(np.nan_to_num(part, nan=np.inf, posinf=np.inf) for part in (of_one, of_all)))


def modes_obstacle(model: EtcModel, band: str) -> str | None:
    """Return the flag of a prediction that cannot follow the modes that are asked for; None where it can, or need not.

    Parameters
    ----------
    model : EtcModel
    band : str
        Name of a band of the instrument, such as ``F520``.
    """
    return MODES_NOT_MODELLED if model.strategy.n_modes and model.of_table else None


def with_modes(
    model: EtcModel,
    band: str,
    separation_arcsec: FloatArray,
    rates: ApertureRates,
    programme: Programme,
    exposure_s: ArrayLike,
    n_frames: ArrayLike,
    em_gain: ArrayLike,
) -> Programme:
    """Return a programme with what the modes of its references change, for given frames.

    Parameters
    ----------
    model : EtcModel
        Its strategy says how many modes, or the most of them.
    band : str
        Name of a band of the instrument, such as ``F520``.
    separation_arcsec : ndarray
        Broadcasts with the rates.
    rates : ApertureRates
    programme : Programme
    exposure_s, n_frames, em_gain : array_like
        One frame (s), science frames of a visit, which need not be whole, gain of the register.

    Returns
    -------
    Programme
        The same where nothing can be projected out: no modes asked for, references that are all alike, no speckles, or
        no optical model of the band.
    """
    strategy = model.strategy
    plain = strategy.n_modes == 0 or strategy.reference_library.noise_free or modes_obstacle(model, band) is not None
    if plain:
        return programme.of_mean()
    frames = np.clip(np.asarray(n_frames, float), 1e-9, _LONGEST_FRAMES)
    balance = balance_of(rates, exposure_s, frames, em_gain, model.camera(band), strategy, programme)
    of_one, of_all = (np.minimum(part, _LOUD) for part in balance)
    where = separation_arcsec, programme.reference_visits, strategy.n_modes
    n_modes, *factors = model.modes(band).factors(*where, of_one, of_all if strategy.choose_modes else None)
    visits = programme.visits, programme.reference_visits, programme.reference_length, programme.gap_s
    return Programme(*visits, np.asarray(n_modes, float), *factors)
