"""Changes of a prediction by the modes of its references.

Modes are found in the noise of the references: what they change depends on the frames, and the best frames depend on
it, weakly. Questions go from one to the other until both stand still.
"""

from typing import NamedTuple

import numpy as np

from cpic_core import ArrayLike, FloatArray
from cpic_planner.etc.camera import FrameCamera
from cpic_planner.etc.model import EtcModel, Programme
from cpic_planner.etc.noise import light_factor2, reference_term, white_term
from cpic_planner.etc.photon_counting import counted_terms, counting_probabilities
from cpic_planner.etc.rates import ApertureRates
from cpic_planner.queries import Strategy
from simulator.detectors import frames_per_clean

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
    exposure, each, gain = (np.asarray(item, float) for item in (exposure_s, n_frames, em_gain))
    made = programme.of_mean()
    ratio = made.frame_ratio(strategy.reference_ratio)
    share = frames_per_clean(rates.loss_per_s, exposure) * rates.noise_fraction / (each * made.visits * exposure**2)
    if strategy.mode == "photon_counting":
        law = counting_probabilities(camera, float(gain.flat[0]), strategy)
        counts, _ = counted_terms(rates, exposure, share / rates.noise_fraction, law, camera, ratio)
        reference, white = counts["reference"], counts["reference"] + counts["counting"]
    else:
        factor2 = light_factor2(camera, gain)
        reference, white = (
            share * term.variance_e2(exposure, factor2, gain)
            for term in (reference_term(rates, camera, ratio), white_term(rates, camera, ratio))
        )
    visit = each * (exposure + camera.readout_s)
    one = rates.speckle.reference.stretched(made.reference_length).variance(visit)
    with np.errstate(divide="ignore", invalid="ignore"):
        of_one = np.sqrt(reference * made.reference_visits / one)
        of_all = np.sqrt(white / made.law(rates.speckle).variance(visit))
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
