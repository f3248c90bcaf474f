"""Figures of a planet's atmosphere from measured contrasts: the posterior, and the contrasts on the spectrum."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from cpic_core import ArrayLike, FloatArray, InputError
from cpic_planner.report.drawing import Look, Picture, band_style, new_figure, save, style
from cpic_planner.report.numbers import decimals, significant
from cpic_planner.validation import AlbedoFit, AlbedoModel

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_REGION, _INNER, _OUTER = "#0072B2", "#5B9FD0", "#C4DDEF"
_TRUTH, _BEST, _SPECTRUM = "#D55E00", "#000000", "#7A7A7A"
# Wavelengths shown beyond the outermost bands.
_MARGIN_NM = 40.0
_STATUS_TEXT = {
    "constrained": "both constrained",
    "not_constrained": "not constrained",
    "degenerate": "degenerate: fewer bands than parameters",
}
_BELOW: Look = {"loc": "upper center", "bbox_to_anchor": (0.5, 0.0), "borderaxespad": 4.4}
_PARAMETER_TEXT = {"log10_mh": "[M/H]", "log10_fsed": "f_sed"}


def albedo_figure(
    fit: AlbedoFit,
    model: AlbedoModel,
    *,
    truth: tuple[float, float] | None = None,
    spectrum: tuple[ArrayLike, ArrayLike] | None = None,
) -> Figure:
    """Draw the posterior of metallicity and clouds, and the measured contrasts.

    Parameters
    ----------
    fit : AlbedoFit
    model : AlbedoModel
        What was fitted.
    truth : (log10_mh, log10_fsed), optional
        Marked where it is known.
    spectrum : (wavelength_nm, contrast), optional
        The planet's true contrast against wavelength, shapes (n,).

    Raises
    ------
    InputError
        If the spectrum's columns do not fit each other.
    """
    line = None if spectrum is None else _columns(spectrum)
    with style():
        figure = new_figure(4.5)
        left, right = figure.subplots(1, 2, width_ratios=(1.0, 1.15))
        _posterior(left, fit, truth)
        _contrasts(right, fit, model, line)
        figure.draw_without_rendering()
    return figure


def albedo_picture(fit: AlbedoFit, model: AlbedoModel, **known: Any) -> Picture:
    """Return the same as a picture of a report; ``known`` are ``truth`` and ``spectrum``."""
    figure = albedo_figure(fit, model, **known)
    mh, fsed = fit.interval("log10_mh"), fit.interval("log10_fsed")
    ranges = (
        f"{decimals(mh[0], 2)} to {decimals(mh[1], 2)} and log10 f_sed {decimals(fsed[0], 2)} to {decimals(fsed[1], 2)}"
    )
    with style():
        return save(
            figure,
            alt="Regions of 68 % and 95 % probability in metallicity and f_sed, and measured contrasts: "
            f"{', '.join(fit.bands)}.",
            caption="Left: what the measured contrasts allow, with flat priors over the ranges of the model; 68 % of "
            f"the probability has log10 [M/H] {ranges} ({_STATUS_TEXT[fit.status]}). Right: measured contrasts with "
            "1-sigma errors and bandwidths, those of the best fit, and the input spectrum.",
        )


def _columns(spectrum: tuple[ArrayLike, ArrayLike]) -> tuple[FloatArray, FloatArray]:
    wavelength, contrast = (np.asarray(column, dtype=np.float64) for column in spectrum)
    if wavelength.ndim != 1 or wavelength.shape != contrast.shape or wavelength.size == 0:
        raise InputError("spectrum", f"{wavelength.shape}, {contrast.shape}", allowed="two columns of equal length")
    return wavelength, contrast


def _posterior(axes: Axes, fit: AlbedoFit, truth: tuple[float, float] | None) -> None:
    from matplotlib.patches import Patch

    inner, outer = fit.level(0.68), fit.level(0.95)
    x, y, density = fit.log10_mh_grid, fit.log10_fsed_grid, fit.posterior.T
    top = max(float(density.max()), inner) * 1.001
    axes.contourf(x, y, density, levels=[outer, inner, top], colors=[_OUTER, _INNER])
    axes.contour(x, y, density, levels=[outer, inner], colors=[_REGION], linewidths=[0.8, 1.3])
    axes.grid(visible=True)
    handles: list[Any] = [
        Patch(facecolor=_INNER, edgecolor=_REGION, label="68 %"),
        Patch(facecolor=_OUTER, edgecolor=_REGION, label="95 %"),
    ]
    bare: Look = {"ls": "none", "clip_on": False}
    if fit.status != "degenerate":
        look = bare | {"marker": "x", "ms": 8, "mew": 1.8, "color": _BEST, "zorder": 6}
        handles += axes.plot(fit.log10_mh, fit.log10_fsed, label="best fit", **look)
    if truth is not None:
        look = bare | {"marker": "*", "ms": 13, "mfc": _TRUTH, "mec": "white", "zorder": 5}
        handles += axes.plot(*truth, label="truth", **look)
    axes.set(xlim=(x[0], x[-1]), ylim=(y[0], y[-1]), xlabel="metallicity, log10 [M/H]", ylabel="clouds, log10 f_sed")
    axes.set_title(f"{_STATUS_TEXT[fit.status]}\n{_open_text(fit)}", fontsize=9.5)
    axes.legend(handles=handles, ncols=4, handletextpad=0.5, columnspacing=1.2, **_BELOW)


def _open_text(fit: AlbedoFit) -> str:
    """Return which ends of the ranges the 95 % region reaches."""
    ends = []
    for name, text in _PARAMETER_TEXT.items():
        sides = [side for side in ("low", "high") if f"{name}_{side}" in fit.open_edges]
        if sides:
            ends.append(f"{' and '.join(sides)} {text}")
    return f"open at {', '.join(ends)}" if ends else "within the ranges of the model"


def _contrasts(axes: Axes, fit: AlbedoFit, model: AlbedoModel, line: tuple[FloatArray, FloatArray] | None) -> None:
    from matplotlib.lines import Line2D

    rows = [model.bands.index(band) for band in fit.bands]
    middle, half = model.wavelength_nm[rows], 0.5 * model.width_nm[rows]
    low, high = float((middle - half).min()) - _MARGIN_NM, float((middle + half).max()) + _MARGIN_NM
    shown = [*(fit.contrasts - fit.errors), *(fit.contrasts + fit.errors), *fit.model_contrasts, 0.0]
    handles: list[Line2D] = []
    if line is not None:
        inside = (line[0] >= low) & (line[0] <= high) & np.isfinite(line[1])
        shown += line[1][inside].tolist()
    unit = 10.0 ** np.floor(np.log10(max(np.abs(shown))))
    if line is not None:
        handles += axes.plot(line[0][inside], line[1][inside] / unit, color=_SPECTRUM, lw=1.2, label="input spectrum")
    looks = band_style(model.bands)
    for number, band in enumerate(fit.bands):
        colour, marker = looks[band]
        value, error = fit.contrasts[number] / unit, fit.errors[number] / unit
        look: Look = {"color": colour, "marker": marker, "ms": 6.5, "mec": "white", "mew": 0.6, "lw": 1.6, "capsize": 3}
        axes.errorbar(middle[number], value, error, half[number], zorder=5, **look)
        handles.append(Line2D([], [], color=colour, marker=marker, ms=6.5, lw=1.6, label=band))
    looks_best: Look = {"ls": "none", "marker": "_", "ms": 17, "mew": 2.0, "color": _BEST}
    handles += axes.plot(middle, fit.model_contrasts / unit, label="best fit", zorder=4, **looks_best)
    axes.grid(visible=True)
    axes.axhline(0.0, color="#444444", lw=0.8)
    spread = (max(shown) - min(shown)) / unit
    axes.set(xlim=(low, high), ylim=(min(shown) / unit - 0.04 * spread, max(shown) / unit + 0.08 * spread))
    axes.set(xlabel="wavelength (nm)", ylabel=f"contrast ($10^{{{round(np.log10(unit))}}}$)")
    chance = "" if fit.p_value is None else f", p {significant(fit.p_value, 2)}"
    grey = "" if fit.grey == 1.0 else f", common factor {decimals(fit.grey, 2)}"
    count = len(fit.bands)
    axes.set_title(f"chi-square {decimals(fit.chi2, 1)} of {count} band{'s' * (count > 1)}{chance}{grey}", fontsize=9.5)
    axes.legend(handles=handles, ncols=3, handletextpad=0.6, columnspacing=1.4, **_BELOW)
