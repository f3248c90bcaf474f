"""The images behind one measurement (science stack, reference stack, residual), with what is marked on them."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

import numpy as np

from cpic_core import FloatArray, InputError, NDArray
from cpic_planner.report import drawing
from cpic_planner.report.drawing import WIDTH_INCHES, Look, Picture, literal, new_figure, save, style
from cpic_planner.report.numbers import decimals, power_of_ten, pretty_name
from simulator.imaging import Zone
from simulator.target import sky_to_detector

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.colors import Colormap, Normalize
    from matplotlib.figure import Figure


_IMAGES = ("science", "reference", "residual")
MarkKind: TypeAlias = Literal["planet", "star", "candidate"]


def compass(parity: int, roll_deg: float = 0.0) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return the unit vectors (x, y) on the detector that point to north and to east.

    Parameters
    ----------
    parity : {-1, +1}
        Detector parity; -1 puts east at -x.
    roll_deg : float
        Rotation of the sky on the detector.
    """
    x, y = sky_to_detector([1.0, 1.0], [0.0, 90.0], roll_deg=roll_deg, parity=parity)
    return (float(x[0]), float(y[0])), (float(x[1]), float(y[1]))


@dataclass(frozen=True)
class Mark:
    """A place that is marked on the images: a planet, a star of the scene, or what a blind search names.

    Attributes
    ----------
    x_arcsec, y_arcsec : float
        Offset from the star on the detector.
    kind : {"planet", "star", "candidate"}
        What it is: candidates are marked on the residual alone.
    label : str
        Written beside it; empty for none.
    """

    x_arcsec: float
    y_arcsec: float
    kind: MarkKind = "planet"
    label: str = ""


@dataclass(frozen=True)
class Panels:
    """Images of one band: summed science stack, summed reference stack, residual after subtraction.

    Attributes
    ----------
    band : str
        Band name.
    science, reference, residual : ndarray
        Equal shapes (y, x), electrons of the summed stack; NaN where there is no value.
    pixel_scale_arcsec : float
        Size of a pixel.
    aperture_radius_arcsec : float
        Photometric aperture.
    zone : HoleZone or RingZone
        The dark quadrants, or the ring.
    parity : int
        Detector parity, -1 or +1.
    roll_deg : float
        Rotation of the sky on the detector.
    marks : tuple of Mark
        What is marked, planets included.
    """

    band: str
    science: FloatArray
    reference: FloatArray
    residual: FloatArray
    pixel_scale_arcsec: float
    aperture_radius_arcsec: float
    zone: Zone
    parity: int = -1
    roll_deg: float = 0.0
    marks: tuple[Mark, ...] = ()

    def __post_init__(self) -> None:
        for name in _IMAGES:
            image = np.asarray(getattr(self, name), dtype=np.float64)
            if image.ndim != 2 or image.shape != np.shape(self.science) or image.size == 0:
                raise InputError(f"panels.{name}", str(image.shape), allowed="2-D images of equal shape")
            object.__setattr__(self, name, image)
        for name in ("pixel_scale_arcsec", "aperture_radius_arcsec"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value > 0):
                raise InputError(f"panels.{name}", value, unit="arcsec", allowed="finite and above 0")
        compass(self.parity, self.roll_deg)

    @property
    def star_pixel(self) -> tuple[float, float]:
        """Column and row of the star: the middle of the array."""
        rows, columns = self.science.shape
        return (columns - 1) / 2.0, (rows - 1) / 2.0

    @property
    def extent_arcsec(self) -> tuple[float, float, float, float]:
        """Left, right, bottom and top edge of the array, arcsec from the star on the detector."""
        rows, columns = self.science.shape
        column, row = self.star_pixel
        edges = np.array([-0.5 - column, columns - 0.5 - column, -0.5 - row, rows - 0.5 - row])
        left, right, bottom, top = (edges * self.pixel_scale_arcsec).tolist()
        return left, right, bottom, top

    def inside_hole(self) -> NDArray[np.bool_]:
        """Return the pixels whose centres lie in one of the dark quadrants, (y, x)."""
        rows, columns = self.science.shape
        column, row = self.star_pixel
        x = np.asarray((np.arange(columns) - column) * self.pixel_scale_arcsec, dtype=np.float64)
        y = np.asarray((np.arange(rows) - row) * self.pixel_scale_arcsec, dtype=np.float64)
        return self.zone.covers(y, x)


_VIEW_MARGIN = 1.06

PANEL_NOTE = (
    "Images: the first realisation, summed stacks in electrons per pixel. The circle is the photometric aperture at "
    "the planet, dashed squares bound the dark hole, N and E show the sky on the detector. Both stacks share one "
    "scale, linear at the noise and logarithmic above, set by the dark hole: brighter light outside it is clipped. The "
    "residual's scale is set by its noise: a bright planet is clipped. Grey: not drawn, or not used. "
    "A plus in the residual: a detection of the blind search; diamonds: other stars of the scene."
)
_SIGMA_OF_MAD = 1.4826
# Where things stand, in inches: three square panels in a row, a bar below each. Nothing in these pictures changes its
# size, so that nothing is to be laid out, which would cost more than the drawing.
_HEIGHT = 3.95
_LEFT, _PANEL, _GAP, _BOTTOM = 0.70, 2.67, 0.13, 1.055
_BAR_INSET, _BAR_BOTTOM, _BAR, _BAR_END = 0.06, 0.47, 0.09, 0.05
_LINE = 0.005  # half of the lines around a panel
_TITLES = ("science stack", "reference stack", "residual after subtraction")
_PLAIN_POWERS = range(-1, 4)  # numbers of this size are written out, others as multiples of a power of ten


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
    return PanelSheet().picture(panels, name)


def in_both_lights(png: bytes) -> bytes:
    """Return an SVG drawing of a picture of panels; in dark mode all around the images and their bars is turned dark.

    Parameters
    ----------
    png : bytes
        As `PanelSheet` draws it.
    """
    boxes = [(place, _LINE, _BOTTOM + _LINE, _PANEL - 2.0 * _LINE) for place in range(len(_TITLES))]
    boxes += [(place, _BAR_INSET, _BAR_BOTTOM, _BAR) for place in range(len(_TITLES))]
    kept = ""
    for left, bottom, wide, high in (_column_box(*box) for box in boxes):
        kept += f"M{left:.5f} {1.0 - bottom - high:.5f}h{wide:.5f}v{high:.5f}h{-wide:.5f}z"
    size = f'width="{WIDTH_INCHES:g}in" height="{_HEIGHT:g}in"'
    image = f'<image width="1" height="1" preserveAspectRatio="none" href="data:image/png;base64,{_base64(png)}"/>'
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" {size} viewBox="0 0 1 1" preserveAspectRatio="none">'
        "<style>path{display:none;fill:#ebe8e5;fill-rule:evenodd;mix-blend-mode:difference}"
        "@media (prefers-color-scheme:dark){path{display:inline}}</style>"
        f'{image}<path d="M0 0h1v1h-1z{kept}"/></svg>'
    ).encode()


def _base64(content: bytes) -> str:
    return base64.b64encode(content).decode("ascii")


def shown_in_both_lights(picture: Picture) -> Picture:
    """Return a picture of panels that is in the page itself as a drawing that follows dark mode; others as they are."""
    kind, _, content = picture.uri.partition(",")
    if kind != "data:image/png;base64" or not content:
        return picture
    return replace(picture, uri=f"data:image/svg+xml;base64,{_base64(in_both_lights(base64.b64decode(content)))}")


class PanelSheet:
    """The frame of such pictures, drawn on again and again: making it takes longer than filling it."""

    def __init__(self) -> None:
        with style():
            self._figure = new_figure(_HEIGHT, layout=None)
            self._columns = [_Column(self._figure, place) for place in range(len(_TITLES))]

    def picture(self, panels: Panels, name: str) -> Picture:
        """Draw one picture, see `panel_picture`; earlier ones leave nothing behind."""
        from matplotlib.colors import AsinhNorm, Normalize

        low, high, width = stack_scale(panels)
        limit = residual_limit(panels)
        residual = np.where(panels.inside_hole(), panels.residual, np.nan)
        stretch = AsinhNorm(width, low, high)
        filled: list[tuple[FloatArray, Normalize, list[float]]] = [
            (panels.science, stretch, _ticks(stretch)),
            (panels.reference, stretch, _ticks(stretch)),
            (residual, Normalize(-limit, limit), _even_ticks(limit)),
        ]
        with style():
            for column, content in zip(self._columns, filled, strict=True):
                column.fill(panels, *content)
            picture = save(
                self._figure,
                "png",
                alt=f"{pretty_name(name)} in {panels.band}: summed science frames, summed reference frames, and the "
                f"residual after subtraction{_planets_text(panels)}.",
                caption=f"{panels.band}; aperture radius {panels.aperture_radius_arcsec:.3f} arcsec.",
            )
        for column in self._columns:
            column.clear()
        return picture


class _Column:
    """One panel with the bar of its colours below."""

    def __init__(self, figure: Figure, place: int) -> None:
        import matplotlib as mpl
        from matplotlib.ticker import MaxNLocator

        self.searched = place == len(_TITLES) - 1
        self.ink = "black" if self.searched else "white"
        colours = drawing.RESIDUAL_COLOURS if self.searched else drawing.STACK_COLOURS
        palette = mpl.colormaps[colours].with_extremes(bad="#D8D8D8")
        self.axes = figure.add_axes(_column_box(place, 0.0, _BOTTOM, _PANEL))
        self.image = self.axes.imshow(np.zeros((1, 1)), origin="lower", cmap=palette, interpolation="nearest")
        for axis in (self.axes.xaxis, self.axes.yaxis):
            axis.set_major_locator(MaxNLocator(5, symmetric=True))
        self.axes.set(title=_TITLES[place], xlabel="x offset (arcsec)", ylabel="" if place else "y offset (arcsec)")
        self.axes.tick_params(labelleft=place == 0)
        self.bar = _bar(figure.add_axes(_column_box(place, _BAR_INSET, _BAR_BOTTOM, _BAR)), palette)
        self.kept = set(self.axes.get_children())

    def fill(self, panels: Panels, image: FloatArray, norm: Normalize, ticks: Sequence[float]) -> None:
        """Show an image and everything that is marked on it."""
        self.image.set_data(image)
        self.image.set_extent(panels.extent_arcsec)
        self.image.set_norm(norm)
        view = _VIEW_MARGIN * panels.zone.outer_arcsec
        self.axes.set(xlim=(-view, view), ylim=(-view, view))
        labels, power = tick_labels(ticks)
        self.bar.set_xticks([float(norm(tick)) for tick in ticks], labels)
        self.bar.set_xlabel(f"{power}electrons per pixel")
        _marks(self.axes, panels, self.ink, searched=self.searched)
        _hole(self.axes, panels, self.ink)
        _compass(self.axes, panels)

    def clear(self) -> None:
        """Take away what belongs to one picture."""
        for artist in set(self.axes.get_children()) - self.kept:
            artist.remove()


def _column_box(place: int, inset: float, bottom: float, height: float) -> tuple[float, float, float, float]:
    """Return the left, bottom, width and height of what stands in a column, as fractions of the figure."""
    left = _LEFT + place * (_PANEL + _GAP) + inset
    return left / WIDTH_INCHES, bottom / _HEIGHT, (_PANEL - 2.0 * inset) / WIDTH_INCHES, height / _HEIGHT


def _bar(axes: Axes, palette: Colormap) -> Axes:
    """Return the colours of a panel from 0 to 1, with pointed ends: both sides may be clipped."""
    from matplotlib.patches import Polygon

    outline = [(-_BAR_END, 0.5), (0.0, 0.0), (1.0, 0.0), (1.0 + _BAR_END, 0.5), (1.0, 1.0), (0.0, 1.0)]
    edge = Polygon(outline, closed=True, fill=False, edgecolor="#444444", linewidth=0.8, clip_on=False)
    ends = -_BAR_END, 1.0 + _BAR_END
    ramp = np.linspace(*ends, round((1.0 + 2.0 * _BAR_END) * palette.N))[np.newaxis].clip(0.0, 1.0)
    drawn = axes.imshow(ramp, cmap=palette, aspect="auto", extent=(*ends, 0.0, 1.0), vmin=0.0, vmax=1.0)
    axes.add_patch(edge)
    drawn.set_clip_path(edge)
    axes.set(xlim=ends, ylim=(0.0, 1.0), yticks=[])
    axes.spines[:].set_visible(False)
    return axes


def _planets_text(panels: Panels) -> str:
    """Return where planets are, for those who cannot see it."""
    at = [
        f"{mark.label or 'the planet'} is at x {decimals(mark.x_arcsec, 2)}, y {decimals(mark.y_arcsec, 2)} arcsec"
        for mark in panels.marks
        if mark.kind == "planet"
    ]
    return f"; {', '.join(at)}" if at else "; there is no planet"


def _marks(axes: Axes, panels: Panels, ink: str, *, searched: bool) -> None:
    """Draw circles at planets, diamonds at stars, and crosses where a search names a place."""
    from matplotlib.patches import Circle

    radius, view = panels.aperture_radius_arcsec, _VIEW_MARGIN * panels.zone.outer_arcsec
    for mark in panels.marks:
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
            look: Look = {"color": ink, "fontsize": 8.5, "va": "center", "ha": "right" if side < 0 else "left"}
            place = x + side * 2.3 * radius
            axes.text(place, y, literal(mark.label), path_effects=_halo(ink), clip_on=True, **look)


def _ticks(norm: Any) -> list[float]:
    """Return the five round values across the range, evenly spread after the stretch."""
    ends = float(norm.vmin), float(norm.vmax)
    values = [float(norm.inverse(fraction)) for fraction in (0.06, 0.35, 0.65, 0.94)]
    step = 10.0 ** np.floor(np.log10(max((ends[1] - ends[0]) / 20.0, 1e-300)))
    fine = [round(value / step) * step for value in values]
    return sorted({value for value in fine if ends[0] <= value <= ends[1]})


def _even_ticks(limit: float) -> list[float]:
    """Return round values on both sides of zero."""
    from matplotlib.ticker import MaxNLocator

    return [float(value) for value in MaxNLocator(5, symmetric=True).tick_values(-limit, limit)[1:-1]]


def tick_labels(ticks: Sequence[float]) -> tuple[list[str], str]:
    """Return the shortest texts that tell the ticks apart, and the power of ten to multiply by (empty for 1)."""
    largest = max((abs(tick) for tick in ticks), default=0.0)
    power = int(np.floor(np.log10(largest))) if largest > 0 else 0
    power = 0 if power in _PLAIN_POWERS else power
    scaled = np.asarray(ticks, dtype=np.float64) / 10.0**power
    allowed = 1e-3 * float(np.ptp(scaled)) if scaled.size > 1 else 1e-3 * largest / 10.0**power
    places = next((n for n in range(7) if np.all(np.abs(scaled - scaled.round(n)) <= allowed)), 7)
    return [decimals(value, places) for value in scaled.tolist()], f"{power_of_ten(power)} " if power else ""


def _halo(ink: str) -> list[Any]:
    from matplotlib.patheffects import withStroke

    return [withStroke(linewidth=2.6, foreground="black" if ink == "white" else "white")]


def _hole(axes: Axes, panels: Panels, ink: str) -> None:
    from matplotlib.patches import Circle, Rectangle

    look: Look = {"edgecolor": ink, "linewidth": 0.7, "linestyle": (0, (3, 2)), "alpha": 0.9}
    zone = panels.zone
    if zone.mode == "ring":
        for radius in (zone.inner_arcsec, zone.outer_arcsec):
            axes.add_patch(Circle((0.0, 0.0), radius, fill=False, **look))
        return
    rows, columns = zone.intervals()
    for bottom, top in rows:
        for left, right in columns:
            axes.add_patch(Rectangle((left, bottom), right - left, top - bottom, fill=False, **look))


def _compass(axes: Axes, panels: Panels) -> None:
    """Draw north and east arrows from the star, inside the part of the image that the mask's cross hides."""
    length = max(0.8 * panels.zone.inner_arcsec, 0.12 * panels.zone.outer_arcsec)
    halo = _halo("white")
    ink: Look = {"fontsize": 9, "fontweight": "bold", "ha": "center", "va": "center", "path_effects": halo}
    arrow = {"arrowstyle": "->", "color": "white", "linewidth": 1.4, "shrinkA": 0, "shrinkB": 0, "path_effects": halo}
    for (dx, dy), letter in zip(compass(panels.parity, panels.roll_deg), "NE", strict=True):
        axes.annotate("", xy=(length * dx, length * dy), xytext=(0, 0), arrowprops=arrow)
        axes.text(1.5 * length * dx, 1.5 * length * dy, letter, color="white", **ink)
