"""Choice of band, separation, frame exposure, number of frames and EM gain for each target."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cpic_planner.etc.answer import EtcAnswer
from cpic_planner.etc.limits import largest_gain
from cpic_planner.etc.model import EtcModel
from cpic_planner.etc.noise import stack_noise
from cpic_planner.etc.place import check_range, diagonal, usable_range_arcsec
from cpic_planner.etc.planet import ReferencePlanet, reference_contrast
from cpic_planner.etc.rates import ApertureRates, aperture_rates
from cpic_planner.etc.settings import settings_for_time, visit_lengths
from cpic_planner.etc.significance import threshold_array
from cpic_planner.targets import Targets

__all__ = ["Best", "best_in_band", "best_separations", "optimise", "separation_grid"]

FloatArray = NDArray[np.float64]
N_SEPARATIONS = 40
N_COARSE = 4
STRIDE = 5
MIN_BACKGROUND_APERTURES = 25.0
"""Aperture areas that the background annulus must hold: about a third of them fit without overlap."""


@dataclass(frozen=True)
class Best:
    """Best setting of each target; arrays of ``n`` stars.

    ``margin`` is significance over the detection threshold at the chosen separation: 1 is a detection.
    ``floor_margin`` is what it would be with no other noise than the speckle residual of the shortest visit: a bound
    that no length of visit can pass.
    ``n_frames`` is 0 where every frame saturates or the time is too short.
    """

    band: NDArray[np.str_]
    separation_arcsec: FloatArray
    contrast: FloatArray
    exposure_s: FloatArray
    n_frames: FloatArray
    em_gain: FloatArray
    time_s: FloatArray
    snr: FloatArray
    significance: FloatArray
    threshold: FloatArray
    margin: FloatArray
    floor_margin: FloatArray
    longest_exposure_s: FloatArray
    peak_columns_e_s: FloatArray
    peak_hole_e_s: FloatArray
    tail_e_s: FloatArray
    core_throughput: FloatArray


def separation_grid(model: EtcModel, band: str) -> FloatArray:
    """Diagonal separations with the aperture inside a band's zone, a defined threshold and room to measure noise."""
    grid = np.geomspace(*usable_range_arcsec(model.instrument, band), N_SEPARATIONS)
    metrics = model.metrics[band]
    enough = [np.count_nonzero(metrics.annulus(s, model.strategy.annulus_lambda_d)) for s in grid]
    room = np.asarray(enough) >= MIN_BACKGROUND_APERTURES * metrics.aperture_pixels
    return grid[(metrics.resolution_elements(grid) >= 3.0) & room]


def optimise(
    model: EtcModel,
    targets: Targets,
    *,
    time_s: float,
    planet: ReferencePlanet | None = None,
    bands: Sequence[str] | None = None,
) -> Best:
    """Best band, separation and frame settings of each target in a given wall time.

    Parameters
    ----------
    model : EtcModel
    targets : Targets
        ``n`` stars.
    time_s : float
        Longest wall time per target and band, overheads and reference frames included.
    planet : ReferencePlanet, optional
    bands : sequence of str, optional
        All of the model by default.

    Returns
    -------
    Best

    Notes
    -----
    The separation maximises significance over the threshold that holds there, not bare significance: towards the
    corner of the zone the number of resolution elements falls below three and no detection could be claimed.
    Less than ``time_s`` is used where the wavefront's walk makes a longer visit worse.
    """
    check_range("time_s", time_s, 1e-3, 1e9, "s")
    planet = planet or ReferencePlanet()
    return _best_of([best_in_band(model, targets, band, time_s, planet) for band in bands or model.bands])


def best_separations(model: EtcModel, ask: Callable[[str, float], EtcAnswer], *, largest: bool) -> dict[str, float]:
    """Separation per band at which a question about one star has its best answer.

    Parameters
    ----------
    model : EtcModel
    ask : callable
        ``ask(band, separation_arcsec)`` gives the answer there.
    largest : bool
        Whether the best value is the largest significance over threshold, or the smallest value.

    Returns
    -------
    dict of str to float
        One per band; where no place has an answer, the middle of the range.
    """
    places = {}
    for band in model.bands:
        grid = separation_grid(model, band)[::STRIDE]
        answers = [ask(band, float(place)) for place in grid]
        cost = [
            np.inf
            if answer.value is None
            else -(answer.significance or 0.0) / (answer.threshold or np.inf)
            if largest
            else answer.value
            for answer in answers
        ]
        best = int(np.argmin(cost)) if np.isfinite(cost).any() else len(grid) // 2
        places[band] = float(grid[best])
    return places


def best_in_band(model: EtcModel, targets: Targets, band: str, time_s: float, planet: ReferencePlanet) -> Best:
    """Best separation, length of visit and settings of each target in one band; see `optimise`."""
    lengths = visit_lengths(time_s)
    grid = separation_grid(model, band)
    return _best_of([_best_at(model, targets, band, grid, length, planet) for length in lengths])


def _best_of(found: Sequence[Best]) -> Best:
    """Row by row the one of largest margin, the first of equals."""
    pick = np.argmax(np.stack([item.margin for item in found]), axis=0)
    rows = np.arange(len(pick))
    return Best(
        **{name: np.stack([getattr(item, name) for item in found])[pick, rows] for name in Best.__dataclass_fields__}
    )


def _best_at(
    model: EtcModel, targets: Targets, band: str, fine: FloatArray, time_s: float, planet: ReferencePlanet
) -> Best:
    """Best in exactly ``time_s``: settings at a few separations first, then the separation at those settings."""
    metrics, detector, ratio = model.metrics[band], model.instrument.detector, model.strategy.reference_ratio
    coarse = fine[:: max(len(fine) // N_COARSE, 1)]
    rows = np.arange(len(targets))
    chosen = settings_for_time(model, _rates(model, targets, band, coarse, planet, time_s)[0], time_s)
    rough = chosen.noise.significance / threshold_array(metrics.resolution_elements(coarse), model.strategy.sigma)
    pick = np.argmax(rough, axis=1)
    setting = {name: getattr(chosen, name)[rows, pick] for name in ("exposure_s", "n_frames", "em_gain", "time_s")}

    rates, contrast = _rates(model, targets, band, fine, planet, setting["time_s"][:, None])
    exposure, frames, gain = (setting[name][:, None] for name in ("exposure_s", "n_frames", "em_gain"))
    noise = stack_noise(rates, exposure, frames, gain, detector, reference_ratio=ratio)
    threshold = threshold_array(metrics.resolution_elements(fine), model.strategy.sigma)
    feasible = gain <= largest_gain(rates.peak_hole_e_s, rates.tail_e_s, exposure, detector) * (1.0 + 1e-12)
    margin = np.where(feasible, noise.significance / threshold, 0.0)
    instant = _rates(model, targets, band, fine, planet, 0.0)[0].speckle_e_s
    with np.errstate(divide="ignore"):
        floor = np.where(instant > 0, rates.planet_e_s / instant, np.inf) / threshold
    best = np.argmax(margin, axis=1)

    def at(array: ArrayLike) -> FloatArray:
        return np.broadcast_to(np.asarray(array, float), margin.shape)[rows, best]

    return Best(
        band=np.full(len(targets), band),
        separation_arcsec=fine[best],
        contrast=at(contrast),
        exposure_s=setting["exposure_s"],
        n_frames=setting["n_frames"],
        em_gain=setting["em_gain"],
        time_s=setting["time_s"],
        snr=at(noise.snr),
        significance=at(noise.significance),
        threshold=threshold[best],
        margin=at(margin),
        floor_margin=floor.max(axis=1),
        longest_exposure_s=chosen.longest_exposure_s[rows, pick],
        peak_columns_e_s=at(rates.peak_columns_e_s),
        peak_hole_e_s=at(rates.peak_hole_e_s),
        tail_e_s=at(rates.tail_e_s),
        core_throughput=metrics.core_throughput(*diagonal(metrics.zone, fine))[best],
    )


def _rates(
    model: EtcModel, targets: Targets, band: str, separation: FloatArray, planet: ReferencePlanet, time_s: ArrayLike
) -> tuple[ApertureRates, FloatArray]:
    """Rates and contrasts of the reference planet, shape ``(n_star, n_separation)``."""
    x, y = diagonal(model.metrics[band].zone, separation)
    contrast = np.reshape(reference_contrast(model, targets, band, separation, planet), (len(targets), len(separation)))
    rates = aperture_rates(model, targets, band, x[None, :], y[None, :], contrast, visit_s=model.visit_s(time_s))
    return rates, contrast
