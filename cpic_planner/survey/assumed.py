"""The model of a strategy: the instrument with what the strategy assumes of it."""

import functools
import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.optimize import brentq

from cpic_core import FloatArray, announce, compute_once
from cpic_planner.etc import EtcModel, build_model
from cpic_planner.queries import Change, Strategy, changed
from cpic_planner.survey.strategy import Assumptions, SurveyStrategy
from simulator.config import Instrument, content_hash
from simulator.imaging import PsfMetrics, build_imager, centred_axis, metrics_key, psf_metrics
from simulator.passbands import Passbands

_FIRST_NM, _MOST_NM, _RTOL, _ROUNDING = 0.01, 100.0, 1e-7, 1e-9


def assumed_model(instrument: Instrument, strategy: SurveyStrategy, bands: Sequence[str]) -> EtcModel:
    """Return the ETC's model under the assumptions of a strategy; observations have one visit unless it says more.

    Throughput and drift change the rates alone and dust the sky: optics are those of the instrument. A dark hole that
    is brighter than the instrument's is that of a less steady mirror, band by band (`mirror_noise_nm`); a darker one
    has less of the same light (`with_contrast`).

    Parameters
    ----------
    instrument : Instrument
    strategy : SurveyStrategy
    bands : sequence of str
        Names of bands of the instrument.

    Raises
    ------
    InputError
        If a band is unknown, or a number becomes impossible.
    """
    assumed = strategy.assumptions
    own = {"sigma": strategy.detection.sigma, "visits": strategy.reduction.visits or 1}
    reduction = Strategy.model_validate(strategy.reduction.model_dump() | own)
    nominal = build_model(instrument, bands, reduction)
    changes = _changes(assumed, nominal.bands)
    metrics, contrast = nominal.metrics, assumed.contrast
    if contrast is not None:
        metrics = {band: _assumed_metrics(instrument, band, item, contrast) for band, item in metrics.items()}
    if not changes and metrics is nominal.metrics:
        return nominal
    other = changed(instrument, changes)
    return EtcModel(other, Passbands.from_instrument(other), metrics, reduction)


def _changes(assumed: Assumptions, bands: Sequence[str]) -> list[Change]:
    """Return what a strategy takes of the instrument instead of what its file says."""
    changes = []
    if assumed.drift != 1.0:
        changes.append(Change.scaling("drift", assumed.drift))
    if assumed.throughput != 1.0:
        changes += [Change.scaling(f"bands.{band}.t_opt", assumed.throughput) for band in bands]
    zodis = assumed.exozodi if assumed.dust is None else assumed.dust.median
    if zodis is not None:
        changes.append(Change(key="sky.exozodi_zodis", value=zodis))
    return changes


def imaged_model(model: EtcModel, strategy: SurveyStrategy, band: str) -> EtcModel | None:
    """Return an assumed model whose instrument makes images of the same light; None where no instrument does.

    Parameters
    ----------
    model : EtcModel
    strategy : SurveyStrategy
    band : str
        Name of a band of the instrument, such as ``F520``.
    """
    contrast = strategy.assumptions.contrast
    if model.of_table:
        return None
    if contrast is None:
        return model
    noise = mirror_noise_nm(model.instrument, band, contrast)
    return None if noise is None else replace(model, instrument=_noisier(model.instrument, noise))


def _assumed_metrics(instrument: Instrument, band: str, nominal: PsfMetrics, contrast: float) -> PsfMetrics:
    noise = mirror_noise_nm(instrument, band, contrast)
    return with_contrast(nominal, contrast) if noise is None else psf_metrics(_noisier(instrument, noise), band)


def _noisier(instrument: Instrument, noise_nm: float) -> Instrument:
    return instrument.changed({"mirror": {"noise_nm": noise_nm}})


def mirror_noise_nm(instrument: Instrument, band: str, contrast: float) -> float | None:
    """Return the random error of the mirror's actuators at which the dark hole of a band has a median raw contrast.

    Parameters
    ----------
    instrument : Instrument
    band : str
    contrast : float
        At least 0.

    Returns
    -------
    float or None
        rms in nm of surface; None where the hole is as bright without, or no error of the mirror changes it, and where
        the coronagraph is a table.

    Notes
    -----
    Of what can brighten a dark hole this is the plainest: static and everywhere in it. It does more harm than as much
    light of the instrument's own hole (``reports/whatif``), whose field differs across the band, so that its products
    with the drift partly cancel; an error of the mirror leaves nearly the same field at all wavelengths of a band.
    """
    if instrument.coronagraph.table is not None:
        return None
    key = content_hash({"optics": metrics_key(instrument, band), "contrast": repr(contrast)})

    def computed() -> dict[str, FloatArray]:
        return {"noise_nm": np.asarray(_solved(instrument, band, contrast))}

    noise = compute_once(f"mirror-noise-{key}", computed, lambda found: float(found["noise_nm"]))
    return None if math.isnan(noise) else noise


def _solved(instrument: Instrument, band: str, contrast: float) -> float:
    """Return the noise of the mirror; nan without any."""
    announce(f"brightening the dark hole of {band} to {contrast:g}, once: about 10 s")
    least = instrument.mirror.noise_nm
    bright = functools.partial(_median_of, instrument, band)
    if contrast <= (1.0 + _ROUNDING) * bright(least):
        return math.nan
    high = max(least, _FIRST_NM)
    while bright(high) < contrast:
        high *= 2.0
        if high > _MOST_NM:
            return math.nan
    return float(brentq(lambda noise: bright(noise) - contrast, least, high, rtol=_RTOL, xtol=_RTOL * _FIRST_NM))


def _median_of(instrument: Instrument, band: str, noise_nm: float) -> float:
    """Return the same as `raw_contrast_median`, of the two images that it needs alone."""
    imager = build_imager(_noisier(instrument, noise_nm), band)
    masked, clear = (imager.stamp_axis(masked=state) for state in (True, False))
    light = imager.image(masked, masked)
    offset = centred_axis(len(light), imager.pixel_scale_arcsec)
    return float(np.median(light[imager.zone.covers(offset, offset)]) / imager.image(clear, clear).max())


def raw_contrast_median(metrics: PsfMetrics) -> float:
    """Return the median raw contrast of the pixels of the dark hole."""
    return metrics.median_contrast


@functools.lru_cache(maxsize=64)
def with_contrast(metrics: PsfMetrics, contrast: float) -> PsfMetrics:
    """Return the figures of a band whose dark hole has another median raw contrast: see `PsfMetrics.brightened`.

    Parameters
    ----------
    metrics : PsfMetrics
    contrast : float
        At least 0.
    """
    return metrics.brightened(contrast / raw_contrast_median(metrics))
