"""The model of a strategy: the instrument with what the strategy assumes of it."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from cpic_planner.etc.model import EtcModel, Strategy, build_model
from cpic_planner.etc.speckles import floor_law
from cpic_planner.survey.strategy import Assumptions, SurveyStrategy
from simulator.config import Instrument
from simulator.imaging.metrics import PsfMetrics
from simulator.passbands import Passbands

__all__ = ["assumed_model", "raw_contrast_median", "with_contrast"]

_LEAST = 1e-30  # a floor of 0 has no law


def assumed_model(instrument: Instrument, strategy: SurveyStrategy, bands: Sequence[str]) -> EtcModel:
    """Model of the ETC under the assumptions of a strategy.

    Light and drift change the rates alone and dust the sky: optics are those of the instrument. A given raw contrast
    scales the static light of the hole (`with_contrast`).

    Raises
    ------
    InputError
        If a band is unknown, or a number becomes impossible.
    """
    assumed = strategy.assumptions
    reduction = Strategy.model_validate(strategy.reduction.model_dump() | {"sigma": strategy.detection.sigma})
    nominal = build_model(instrument, bands, reduction)
    own = _changes(instrument, assumed, nominal.bands)
    metrics = nominal.metrics
    if assumed.contrast is not None:
        metrics = {band: with_contrast(item, assumed.contrast) for band, item in metrics.items()}
    if not own and metrics is nominal.metrics:
        return nominal
    changed = instrument.changed(own) if own else instrument
    return EtcModel(changed, Passbands.from_instrument(changed), metrics, reduction)


def _changes(instrument: Instrument, assumed: Assumptions, bands: Sequence[str]) -> dict[str, Any]:
    own: dict[str, Any] = {}
    if assumed.drift != 1.0:
        drift = instrument.drift
        own["drift"] = {"visit_nm": drift.visit_nm * assumed.drift,
                        "walk_nm_per_sqrt_hour": drift.walk_nm_per_sqrt_hour * assumed.drift}  # fmt: skip
    if assumed.throughput != 1.0:
        own["bands"] = {band: {"t_opt": instrument.bands[band].t_opt * assumed.throughput} for band in bands}
    if assumed.exozodi is not None:
        own["sky"] = {"exozodi_zodis": assumed.exozodi}
    return own


def raw_contrast_median(metrics: PsfMetrics) -> float:
    """Median raw contrast of the pixels of the dark hole."""
    return float(np.median(metrics.raw_contrast[metrics.hole]))


@functools.lru_cache(maxsize=64)
def with_contrast(metrics: PsfMetrics, contrast: float) -> PsfMetrics:
    """Figures of a band whose dark hole has another median raw contrast.

    Parameters
    ----------
    metrics : PsfMetrics
    contrast : float
        At least 0.

    Notes
    -----
    The static intensity ``|E0|^2`` in the hole is multiplied with one factor f. The residual of two visits with
    independent errors dE of the wavefront has the variance ``f a o^2 + b o^4`` for offsets of ``o`` nm: the cross term
    ``2 Re(E0* dE)`` grows with ``|E0|^2``, the light of the errors does not change. Peaks in the columns and tails of
    the register, which lie mostly outside the hole, are kept; so are all throughputs.
    """
    factor = contrast / raw_contrast_median(metrics)
    linear, square = (part[:, None] for part in floor_law(metrics))
    offset2 = metrics.floor_visit_nm**2
    inside = metrics.zone.covers(*_axes(metrics))
    # The measured table times the ratio of the two laws: a difference would be left with the errors of the fit.
    floor = metrics.floor_sigma.copy()
    ratio = (factor * linear + square * offset2) / (linear + square * offset2)
    floor[1:] *= np.sqrt(np.maximum(ratio, _LEAST))
    whole = metrics.floor_sigma[0] ** 2 / np.mean(metrics.floor_sigma[1:] ** 2, axis=0)
    floor[0] = np.sqrt(whole * np.mean(floor[1:] ** 2, axis=0))
    scaled = {name: np.where(inside, factor * getattr(metrics, name), getattr(metrics, name))
              for name in ("halo_map", "raw_contrast")}  # fmt: skip
    return replace(metrics, **scaled, floor_sigma=floor, peak_on_axis_hole=factor * metrics.peak_on_axis_hole)


def _axes(metrics: PsfMetrics) -> tuple[Any, Any]:
    n = len(metrics.raw_contrast)
    axis = (np.arange(n) - n // 2) * metrics.pixel_scale_arcsec
    return axis, axis
