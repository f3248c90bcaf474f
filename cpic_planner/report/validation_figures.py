"""Figures of the blind validator: measured contrast curve, detections against false alarms, recovered injections."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from cpic_core import FloatArray
from cpic_planner.report.drawing import BAND_STYLE, STACK_COLOURS, Look, Picture, literal, new_figure, save, style
from cpic_planner.validation import CompletenessMap, ContrastCurve, RocCurve

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_LINES = ("-", "--", "-.", ":")
_MARKED_SIGMA = (3.0, 4.0, 5.0)


def contrast_curve_figure(
    measured: ContrastCurve, *, title: str, predicted: tuple[FloatArray, FloatArray] | None = None
) -> Picture:
    """Draw the contrast limit that a residual allows, over the one that the ETC predicts.

    Parameters
    ----------
    measured : ContrastCurve
    title : str
        Star and band.
    predicted : tuple of ndarray, optional
        Separations (arcsec) and contrast limits of the ETC, equal shapes.
    """
    with style():
        figure = new_figure(4.4)
        axes = figure.add_subplot()
        defined = np.isfinite(measured.contrast)
        colour, marker = BAND_STYLE[0]
        label = f"measured, {measured.sigma:g}-sigma equivalent"
        x, y = measured.separation_arcsec[defined], measured.contrast[defined]
        axes.plot(x, y, color=colour, marker=marker, ms=4, label=label)
        if predicted is not None:
            axes.plot(*predicted, color=BAND_STYLE[5][0], ls="--", lw=2.0, label="predicted by the ETC")
        axes.set(yscale="log", xlabel="separation (arcsec)", ylabel="contrast limit (planet-to-star flux ratio)")
        axes.set_title(literal(title))
        axes.grid(visible=True, which="both")
        axes.legend()
        return save(
            figure,
            alt=f"Contrast limit against separation, {int(defined.sum())} separations.",
            caption="Faintest planet of known place that the residual would show: scatter of apertures in an annulus, "
            "threshold of few samples, losses of mask, aperture and subtraction divided out.",
        )


def roc_figure(curves: Mapping[str, RocCurve], *, title: str) -> Picture:
    """Draw detection probability against the false-alarm rate, with binomial and Poisson errors.

    Parameters
    ----------
    curves : mapping of str to RocCurve
        One curve for each filter, by name.
    title : str
        Star, band and planet.
    """
    with style():
        figure = new_figure(4.4)
        axes = figure.add_subplot()
        floor = min(0.5 / curve.n_elements for curve in curves.values())
        for index, (name, curve) in enumerate(curves.items()):
            colour, marker = BAND_STYLE[index % len(BAND_STYLE)]
            rate, odds = np.maximum(curve.false_alarm_rate, floor), curve.detection_probability
            axes.plot(rate, odds, color=colour, ls=_LINES[index % len(_LINES)], label=literal(name))
            some = np.flatnonzero(curve.n_false > 0)[::6]
            look: Look = {"xerr": curve.false_alarm_error[some], "yerr": curve.detection_error[some]}
            axes.errorbar(rate[some], odds[some], **look, color=colour, marker=marker, ms=4, ls="none", lw=0.8)
        _mark_levels(axes, floor)
        axes.set(xscale="log", ylim=(-0.03, 1.03))
        axes.set(xlabel="false alarms per resolution element", ylabel="detection probability")
        axes.set_title(literal(title))
        axes.grid(visible=True)
        axes.legend(loc="lower right")
        return save(
            figure,
            alt=f"Detection probability against false alarms for {', '.join(curves)}.",
            caption="Planets found by the blind detector against peaks of noise that pass for one, as the threshold "
            "moves. Left edge: no false alarm in these residuals. Dotted: levels of a normal law.",
        )


def completeness_figure(
    found: CompletenessMap, *, title: str, predicted: tuple[FloatArray, FloatArray] | None = None
) -> Picture:
    """Draw the fraction of injected planets that were recovered, with the contour of one half.

    Parameters
    ----------
    found : CompletenessMap
        At least 2 separations and 2 contrasts.
    title : str
        Star and band.
    predicted : tuple of ndarray, optional
        Separations (arcsec) and contrast limits of the ETC.
    """
    with style():
        figure = new_figure(4.6)
        axes = figure.add_subplot()
        look: Look = {"cmap": STACK_COLOURS, "vmin": 0.0, "vmax": 1.0, "shading": "nearest"}
        mesh = axes.pcolormesh(found.separation_arcsec, found.contrast, found.fraction.T, **look)
        figure.colorbar(mesh, ax=axes, label=f"recovered at {found.sigma:g} sigma ({found.n_injected} a cell)")
        sides = axes.get_xlim()
        half = found.contrast_at(0.5)
        there = np.isfinite(half)
        look = {"color": "white", "lw": 2.6, "marker": "o", "ms": 5, "markeredgecolor": "black"}
        axes.plot(found.separation_arcsec[there], half[there], label="half recovered", **look)
        if predicted is not None:
            axes.plot(*predicted, color="#D55E00", ls="--", lw=2.2, label="limit of the ETC")
        axes.set(yscale="log", xlabel="separation (arcsec)", ylabel="contrast (planet-to-star flux ratio)")
        axes.set_xlim(sides)
        axes.set_ylim(found.contrast[0] / _half_step(found.contrast), found.contrast[-1] * _half_step(found.contrast))
        axes.set_title(literal(title))
        legend = axes.legend(loc="upper right", frameon=True, facecolor="#555555", labelcolor="white", framealpha=0.9)
        legend.get_frame().set_edgecolor("none")
        return save(
            figure,
            alt=f"Fraction of recovered planets for {found.separation_arcsec.size} separations and "
            f"{found.contrast.size} contrasts.",
            caption="Planets added one at a time to planet-free residuals, searched for blind anywhere in the hole.",
        )


def _mark_levels(axes: Axes, floor: float) -> None:
    from scipy.special import ndtr

    for sigma in _MARKED_SIGMA:
        rate = float(ndtr(-sigma))
        if rate >= floor:
            axes.axvline(rate, color="#444444", lw=0.9, ls=":")
            axes.annotate(f"{sigma:g} sigma", (rate, 0.02), xytext=(3, 0), textcoords="offset points", fontsize=9)


def _half_step(values: FloatArray) -> float:
    return float((values[-1] / values[0]) ** (0.5 / max(values.size - 1, 1)))
