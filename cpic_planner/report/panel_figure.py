"""The images behind one measurement: science stack, reference stack, residual."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from cpic_planner.report.drawing import RESIDUAL_COLOURS, STACK_COLOURS, Picture, literal, new_figure, save, style
from cpic_planner.report.names import pretty_name
from cpic_planner.report.numbers import decimals
from cpic_planner.report.panels import Panels, compass

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["PANEL_NOTE", "panel_picture", "residual_limit", "stack_scale"]

FloatArray = NDArray[np.float64]
_VIEW_MARGIN = 1.06

PANEL_NOTE = (
    "Images: the first realisation, summed stacks in electrons per pixel. The circle is the photometric aperture at "
    "the planet, dashed squares bound the dark hole, N and E show the sky on the detector. Both stacks share one "
    "scale, linear at the noise and logarithmic above, set by the dark hole: brighter light outside it is clipped. The "
    "residual's scale is set by its noise: a bright planet is clipped. Grey: not drawn, or not used. "
    "A plus in the residual: a detection of the blind search; diamonds: other stars of the scene."
)
_SIGMA_OF_MAD = 1.4826


def robust_sigma(values: FloatArray) -> float:
    """Return the standard deviation that the median absolute deviation stands for; 0 for no finite values."""
    good = values[np.isfinite(values)]
    return float(_SIGMA_OF_MAD * np.median(np.abs(good - np.median(good)))) if good.size else 0.0


def stack_scale(panels: Panels) -> tuple[float, float, float]:
    """Return lowest and highest displayed value and the linear width of the stretch, one for both stacks (electrons).

    The dark hole alone decides; the linear width is the noise, so that faint light is shown linearly and the rest
    logarithmically.
    """
    hole = panels.inside_hole()
    both = np.concatenate([panels.science[hole], panels.reference[hole]])
    good = both[np.isfinite(both)]
    if good.size == 0:
        return 0.0, 1.0, 1.0
    low, high = (float(v) for v in np.percentile(good, [0.5, 99.8]))
    if not high > low:
        low, high = low - 0.5, low + 0.5
    width = robust_sigma((panels.science - panels.reference)[hole]) / np.sqrt(2.0)
    return low, high, float(max(width, 1e-3 * (high - low)))


def residual_limit(panels: Panels) -> float:
    """Return the half range of the residual panel, electrons: 5 robust sigma of the hole, 7 for a bright planet."""
    inside = panels.residual[panels.inside_hole()]
    good = inside[np.isfinite(inside)]
    peak = float(np.max(np.abs(good))) if good.size else 0.0
    sigma = robust_sigma(good)
    limit = float(np.clip(peak, 5.0 * sigma, 7.0 * sigma)) if sigma > 0 else peak
    return limit if limit > 0 else 1.0


def panel_picture(panels: Panels, name: str) -> Picture:
    """Draw science stack, reference stack and residual side by side.

    Parameters
    ----------
    panels : Panels
    name : str
        SIMBAD identifier of the star, for the alternative text.
    """
    from matplotlib.colors import AsinhNorm, Normalize

    low, high, width = stack_scale(panels)
    limit = residual_limit(panels)
    residual = np.where(panels.inside_hole(), panels.residual, np.nan)
    drawn: list[tuple[str, FloatArray, str, Normalize, str]] = [
        ("science stack", panels.science, STACK_COLOURS, AsinhNorm(width, low, high), "white"),
        ("reference stack", panels.reference, STACK_COLOURS, AsinhNorm(width, low, high), "white"),
        ("residual after subtraction", residual, RESIDUAL_COLOURS, Normalize(-limit, limit), "black"),
    ]
    with style():
        figure = new_figure(3.95)
        for axes, (title, image, colours, norm, ink) in zip(
            np.ravel(figure.subplots(1, 3, sharey=True)), drawn, strict=True
        ):
            _panel(axes, panels, image, colours, norm, ink)
            axes.set_title(title)
        figure.axes[0].set_ylabel("y offset (arcsec)")
        return save(
            figure,
            "png",
            alt=f"{pretty_name(name)} in {panels.band}: summed science frames, summed reference frames, and the "
            f"residual after subtraction{_places(panels)}.",
            caption=f"{panels.band}; aperture radius {panels.aperture_radius_arcsec:.3f} arcsec.",
        )


def _places(panels: Panels) -> str:
    """Where planets are, for those who cannot see it."""
    at = [
        f"{mark.label or 'the planet'} is at x {decimals(mark.x_arcsec, 2)}, y {decimals(mark.y_arcsec, 2)} arcsec"
        for mark in panels.every_mark
        if mark.kind == "planet"
    ]
    return f"; {', '.join(at)}" if at else "; there is no planet"


def _panel(axes: Axes, panels: Panels, image: FloatArray, colours: str, norm: Any, ink: str) -> None:
    import matplotlib as mpl
    from matplotlib.colors import AsinhNorm
    from matplotlib.ticker import MaxNLocator, ScalarFormatter

    palette = mpl.colormaps[colours].with_extremes(bad="#D8D8D8")
    drawn = axes.imshow(
        image, origin="lower", extent=panels.extent_arcsec, cmap=palette, norm=norm, interpolation="nearest"
    )
    view = _VIEW_MARGIN * panels.hole_outer_arcsec
    axes.set(xlim=(-view, view), ylim=(-view, view), xlabel="x offset (arcsec)")
    for axis in (axes.xaxis, axes.yaxis):
        axis.set_major_locator(MaxNLocator(5, symmetric=True))
    bar = axes.figure.colorbar(drawn, ax=axes, location="bottom", extend="both", shrink=0.95, aspect=28, pad=0.02)
    bar.set_label("electrons per pixel")
    ticks = (
        _ticks(norm)
        if isinstance(norm, AsinhNorm)
        else MaxNLocator(5, symmetric=True).tick_values(norm.vmin, norm.vmax)[1:-1]
    )
    formatter = ScalarFormatter(useMathText=True)
    formatter.set_powerlimits((-2, 4))
    bar.set_ticks(ticks)
    bar.minorticks_off()
    bar.ax.xaxis.set_major_formatter(formatter)
    _marks(axes, panels, ink, searched=colours == RESIDUAL_COLOURS)
    _hole(axes, panels, ink)
    _compass(axes, panels)


def _marks(axes: Axes, panels: Panels, ink: str, *, searched: bool) -> None:
    """Circles at planets, diamonds at stars, and crosses where a search names a place."""
    from matplotlib.patches import Circle

    radius, view = panels.aperture_radius_arcsec, _VIEW_MARGIN * panels.hole_outer_arcsec
    for mark in panels.every_mark:
        x, y = mark.x_arcsec, mark.y_arcsec
        if max(abs(x), abs(y)) > view or (mark.kind == "candidate" and not searched):
            continue
        if mark.kind == "planet":
            axes.add_patch(Circle((x, y), radius, fill=False, edgecolor=ink, linewidth=1.3, path_effects=_halo(ink)))
        else:
            shape, size = ("D", 13.0) if mark.kind == "star" else ("+", 11.0)
            axes.plot(x, y, marker=shape, ms=size, mfc="none", mec=ink, mew=1.3, ls="none", path_effects=_halo(ink))
        if mark.label:
            side = -1.0 if x > 0 else 1.0
            axes.text(
                x + side * 2.3 * radius, y, literal(mark.label), color=ink, fontsize=8.5, va="center",
                ha="right" if side < 0 else "left", path_effects=_halo(ink), clip_on=True,
            )  # fmt: skip


def _ticks(norm: Any) -> list[float]:
    """Five round values across the range, evenly spread after the stretch."""
    ends = float(norm.vmin), float(norm.vmax)
    values = [float(norm.inverse(fraction)) for fraction in (0.06, 0.35, 0.65, 0.94)]
    step = 10.0 ** np.floor(np.log10(max((ends[1] - ends[0]) / 20.0, 1e-300)))
    fine = [round(value / step) * step for value in values]
    return sorted({value for value in fine if ends[0] <= value <= ends[1]})


def _halo(ink: str) -> list[Any]:
    from matplotlib.patheffects import withStroke

    return [withStroke(linewidth=2.6, foreground="black" if ink == "white" else "white")]


def _hole(axes: Axes, panels: Panels, ink: str) -> None:
    from matplotlib.patches import Rectangle

    rows, columns = panels.zone.intervals()
    for bottom, top in rows:
        for left, right in columns:
            axes.add_patch(
                Rectangle(
                    (left, bottom),
                    right - left,
                    top - bottom,
                    fill=False,
                    edgecolor=ink,
                    linewidth=0.7,
                    linestyle=(0, (3, 2)),
                    alpha=0.9,
                )
            )


def _compass(axes: Axes, panels: Panels) -> None:
    """North and east arrows from the star, inside the part of the image that the mask's cross hides."""
    length = max(0.8 * panels.hole_inner_arcsec, 0.12 * panels.hole_outer_arcsec)
    ink = {
        "color": "white",
        "fontsize": 9,
        "fontweight": "bold",
        "ha": "center",
        "va": "center",
        "path_effects": _halo("white"),
    }
    for (dx, dy), letter in zip(compass(panels.parity, panels.roll_deg), "NE", strict=True):
        axes.annotate(
            "",
            xy=(length * dx, length * dy),
            xytext=(0, 0),
            arrowprops={
                "arrowstyle": "->",
                "color": "white",
                "linewidth": 1.4,
                "shrinkA": 0,
                "shrinkB": 0,
                "path_effects": _halo("white"),
            },
        )
        axes.text(1.5 * length * dx, 1.5 * length * dy, letter, **ink)  # type: ignore[arg-type]
