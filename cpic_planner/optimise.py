"""Choice of band, separation, frame exposure, number of frames and EM gain for each target."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cpic_planner.etc.model import EtcModel
from cpic_planner.etc.planet import ReferencePlanet, reference_contrast
from cpic_planner.etc.questions import check_range, diagonal
from cpic_planner.etc.rates import aperture_rates
from cpic_planner.etc.settings import settings_for_time
from cpic_planner.etc.significance import threshold_array
from cpic_planner.targets import Targets

__all__ = ["Best", "best_separations", "optimise", "separation_grid"]

FloatArray = NDArray[np.float64]
N_SEPARATIONS = 48


@dataclass(frozen=True)
class Best:
    """Best setting of each target; arrays of ``n`` stars.

    ``margin`` is significance over the detection threshold at the chosen separation: 1 is a detection.
    ``floor_margin`` is the same in unlimited time, where only the speckle residual is left.
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
    core_throughput: FloatArray


def separation_grid(model: EtcModel, band: str) -> FloatArray:
    """Separations on the diagonal of a band's zone at which the small-sample threshold is defined."""
    inner = model.instrument.hole_inner_arcsec(band) * np.sqrt(2.0)
    outer = model.instrument.coronagraph.outer_half_side_arcsec * np.sqrt(2.0)
    grid = np.geomspace(inner, outer, N_SEPARATIONS)
    return grid[model.metrics[band].resolution_elements(grid) >= 3.0]


def optimise(
    model: EtcModel, targets: Targets, *, time_s: float, planet: ReferencePlanet | None = None,
    bands: Sequence[str] | None = None,
) -> Best:  # fmt: skip
    """Best band, separation and frame settings of each target in a given wall time.

    Parameters
    ----------
    model : EtcModel
    targets : Targets
        ``n`` stars.
    time_s : float
        Wall time per target and band, overheads and reference frames included.
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
    """
    check_range("time_s", time_s, 1e-3, 1e9, "s")
    planet = planet or ReferencePlanet()
    found = [_best_in_band(model, targets, band, time_s, planet) for band in bands or model.bands]
    pick = np.argmax(np.stack([item.margin for item in found]), axis=0)
    rows = np.arange(len(targets))
    return Best(**{name: np.stack([getattr(item, name) for item in found])[pick, rows]
                   for name in Best.__dataclass_fields__})  # fmt: skip


def best_separations(
    model: EtcModel,
    target: Targets,
    separation_arcsec: float | None,
    *,
    time_s: float,
    planet: ReferencePlanet,
) -> dict[str, float]:
    """Separation per band for one star: the given one, or where the planet is detected most clearly."""
    if separation_arcsec is not None:
        return dict.fromkeys(model.bands, separation_arcsec)
    check_range("time_s", time_s, 1e-3, 1e9, "s")
    return {
        band: float(_best_in_band(model, target, band, time_s, planet).separation_arcsec[0])
        for band in model.bands
    }


def _best_in_band(
    model: EtcModel, targets: Targets, band: str, time_s: float, planet: ReferencePlanet
) -> Best:
    separation = separation_grid(model, band)
    x, y = diagonal(separation)
    contrast = np.reshape(
        reference_contrast(model, targets, band, separation, planet), (len(targets), len(separation))
    )
    rates = aperture_rates(model, targets, band, x[None, :], y[None, :], contrast)
    chosen = settings_for_time(model, rates, time_s)
    threshold = threshold_array(model.metrics[band].resolution_elements(separation), model.strategy.sigma)
    margin = chosen.noise.significance / threshold
    with np.errstate(divide="ignore"):
        floor = np.where(rates.speckle_e_s > 0, rates.planet_e_s / rates.speckle_e_s, np.inf) / threshold
    pick = np.argmax(margin, axis=1)
    rows = np.arange(len(targets))

    def at(array: Any) -> FloatArray:
        return np.broadcast_to(np.asarray(array, float), margin.shape)[rows, pick]

    core = model.metrics[band].core_throughput(x, y)
    return Best(
        band=np.full(len(targets), band), separation_arcsec=separation[pick], contrast=at(contrast),
        exposure_s=at(chosen.exposure_s), n_frames=at(chosen.n_frames), em_gain=at(chosen.em_gain),
        time_s=at(chosen.time_s), snr=at(chosen.noise.snr), significance=at(chosen.noise.significance),
        threshold=threshold[pick], margin=at(margin), floor_margin=at(floor),
        longest_exposure_s=at(chosen.longest_exposure_s), core_throughput=core[pick],
    )  # fmt: skip
