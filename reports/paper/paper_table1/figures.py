"""Pictures of the report."""

from __future__ import annotations

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.colors import AsinhNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from matplotlib.patheffects import withStroke
from numpy.typing import NDArray

from cpic_planner.report import new_figure
from cpic_planner.report.drawing import BAND_STYLE, RESIDUAL_COLOURS, STACK_COLOURS
from cpic_planner.report.image_figures import robust_sigma, stack_scale
from reports.external.comparison import recorded
from reports.paper.paper_table1.measure import (
    Case,
    Measured,
    Predicted,
    instrument,
    science_scene,
    true_contrast,
)
from simulator import planet_albedo, planet_contrast

# Zhu et al. 2025, Table 1: contrast and signal-to-noise ratio.
PAPER = {band: (row["contrast"], row["snr"]) for band, row in recorded("paper")["table1"].items()}
VIEW_ARCSEC = 0.86
RESIDUAL_SIGMA, TICKS_E = 4.0, (0, 100, 300, 1000, 3000)
MARKS = {"planet": "white", "calibration star": "#F0E442"}
FloatArray = NDArray[np.float64]


def _cross(axes: Axes, name: str, place: tuple[float, float], unit: float) -> None:
    """An open cross around a place, so that the place itself is seen; ``unit`` is an arcsec."""
    (x, y), gap, reach = place, 0.06 * unit, 0.13 * unit
    for dx, dy in ((1, 0), (-1, 0), (0, 1), (0, -1)):
        axes.plot(
            [x + gap * dx, x + reach * dx],
            [y + gap * dy, y + reach * dy],
            color=MARKS[name],
            lw=1.5,
            path_effects=[withStroke(linewidth=3.0, foreground="black")],
        )


def panels_figure(found: list[Measured]) -> Figure:
    """Science, star only and subtracted; a row a band."""
    figure = new_figure(2.72 * len(found) + 0.3)
    axes = figure.subplots(len(found), 3, sharex=True, sharey=True, squeeze=False)
    for row, one in zip(axes, found, strict=True):
        panels, case = one.panels, one.case
        low, high, width = stack_scale(panels)
        limit = RESIDUAL_SIGMA * robust_sigma(panels.residual[panels.inside_hole()])
        light, both = AsinhNorm(width, low, high), Normalize(-limit, limit)
        for axis, image, colours, norm, ink in (
            (row[0], panels.science, STACK_COLOURS, light, "white"),
            (row[1], panels.reference, STACK_COLOURS, light, "white"),
            (row[2], panels.residual, RESIDUAL_COLOURS, both, "black"),
        ):
            shown = axis.imshow(
                image,
                origin="lower",
                cmap=colormaps[colours].with_extremes(bad="#D8D8D8"),
                norm=norm,
                extent=panels.extent_arcsec,
                interpolation="nearest",
            )
            for bottom, top in panels.zone.intervals()[0]:
                for left, right in panels.zone.intervals()[1]:
                    axis.add_patch(
                        Rectangle(
                            (left, bottom), right - left, top - bottom, fill=False, ec=ink, lw=0.6, ls=(0, (3, 2))
                        )
                    )
            for name, place in one.places.items():
                _cross(axis, name, place, 1.0)
            axis.set(
                xlim=(-VIEW_ARCSEC, VIEW_ARCSEC),
                ylim=(-VIEW_ARCSEC, VIEW_ARCSEC),
                xticks=(-0.5, 0, 0.5),
                yticks=(-0.5, 0, 0.5),
            )
            if axis is not row[0]:
                bar = figure.colorbar(shown, ax=axis, extend="both", aspect=18, pad=0.02, fraction=0.05)
                bar.minorticks_off()
                if axis is row[1]:
                    ticks = [tick for tick in TICKS_E if low < tick < high]
                    bar.set_ticks(ticks, labels=[f"{tick:g}" for tick in ticks])
        row[0].set_ylabel(f"{case.band}, {case.exposure_s:g} s × {case.n_frames}\ny (arcsec)")
    for axis, title in zip(axes[0], ("star, planet, calibration star", "star only", "subtracted"), strict=True):
        axis.set_title(title)
    for axis in axes[-1]:
        axis.set_xlabel("x (arcsec)")
    return figure


def spectrum_figure(found: list[Measured], expected: dict[Case, Predicted]) -> Figure:
    """Recovered contrasts on the input spectrum, and signal-to-noise ratios over those of the paper."""
    figure = new_figure(4.2)
    left, right = figure.subplots(1, 2, width_ratios=(1.7, 1.0))
    _contrasts(left, found)
    place = np.arange(len(found))
    for shift, (values, label, (colour, marker)) in enumerate(
        (
            ([expected[one.case].snr for one in found], "predicted", BAND_STYLE[0]),
            ([expected[one.case].snr_paper for one in found], "predicted, Eq. 4", BAND_STYLE[1]),
            ([one.planet.snr for one in found], "recovered, one run", BAND_STYLE[2]),
        )
    ):
        ratio = [value / PAPER[one.case.band][1] for value, one in zip(values, found, strict=True)]
        right.plot(place + 0.14 * (shift - 1), ratio, marker=marker, color=colour, ls="", ms=7, label=label)
    right.axhline(1.0, color="#444444", lw=0.8)
    right.set(xticks=place, xlim=(-0.5, len(found) - 0.5), ylim=(0, None), ylabel="SNR over that of Table 1")
    right.set_xticklabels([one.case.band for one in found])
    right.grid(visible=True, axis="y")
    right.legend(loc="lower right")
    return figure


def _contrasts(axes: Axes, found: list[Measured]) -> None:
    planet, star = science_scene("off").planets[0], science_scene("off").cstar
    assert planet.separation_arcsec is not None
    assert star.distance_pc is not None
    albedo = planet.albedo
    wavelength = np.linspace(480.0, 900.0, 841)
    ag = planet_albedo(
        wavelength,
        log10_mh=albedo.log10_mh,
        log10_fsed=albedo.log10_fsed,  # type: ignore[union-attr]
        insolation_au=albedo.insolation_au,
    )  # type: ignore[union-attr]
    curve = planet_contrast(planet.radius_rjup, planet.separation_arcsec * star.distance_pc, 0.0, planet.phase_deg, ag)
    axes.plot(wavelength, np.asarray(curve) * 1e8, color="#8C8C8C", lw=1.0, label="input spectrum")
    for one, (colour, marker) in zip(found, BAND_STYLE, strict=False):
        band = instrument().band(one.case.band)
        edges = band.center_nm - band.width_nm / 2, band.center_nm + band.width_nm / 2
        axes.hlines(true_contrast(one.case.band) * 1e8, *edges, color="black", lw=2.0)
        axes.errorbar(
            band.center_nm,
            one.contrast.value * 1e8,
            yerr=one.contrast.error * 1e8,
            color=colour,
            fmt=marker,
            ms=6,
            capsize=3,
        )
        axes.plot(band.center_nm + 6, PAPER[one.case.band][0] * 1e8, marker="x", color="black", ls="", ms=6)
    axes.plot([], [], color="black", lw=2.0, label="its band contrasts")
    axes.errorbar([], [], yerr=[], color=BAND_STYLE[0][0], fmt="o", capsize=3, label="recovered, one run")
    axes.plot([], [], marker="x", color="black", ls="", label="Table 1 of the paper")
    axes.set(xlabel="wavelength (nm)", ylabel="contrast (10⁻⁸)", ylim=(0, None))
    axes.grid(visible=True)
    axes.legend(loc="lower left")
