"""Figures of images: the stacks behind a measurement, recovered SNR, spectra and atmospheres."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Literal, TypeAlias

import numpy as np

from cpic_core import ArrayLike, FloatArray, InputError, NDArray, Record
from cpic_planner import results
from cpic_planner.report import drawing, words
from cpic_planner.report.drawing import WIDTH_INCHES, Look, Picture, literal, new_figure, style, with_style
from cpic_planner.report.words import decimals, power_of_ten, significant

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.colors import Colormap, Normalize
    from matplotlib.figure import Figure

    from cpic_planner.validation import AlbedoFit, AlbedoModel
    from simulator.config import Instrument, Scene
    from simulator.imaging import Zone


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
    from simulator.target import sky_to_detector

    x, y = sky_to_detector([1.0, 1.0], [0.0, 90.0], roll_deg=roll_deg, parity=parity)
    return (float(x[0]), float(y[0])), (float(x[1]), float(y[1]))


class Mark(Record):
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


class Panels(Record):
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
        """Draw science stack, reference stack and residual side by side; earlier pictures leave nothing behind.

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
        stretch = AsinhNorm(width, low, high)
        filled: list[tuple[FloatArray, Normalize, list[float]]] = [
            (panels.science, stretch, _ticks(stretch)),
            (panels.reference, stretch, _ticks(stretch)),
            (residual, Normalize(-limit, limit), _even_ticks(limit)),
        ]
        with style():
            for column, content in zip(self._columns, filled, strict=True):
                column.fill(panels, *content)
            about = {"panels": panels, "name": name, "planets": _planets_text(panels)}
            picture = drawing.picture(self._figure, "image_panels", "png", **about)
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


_LOG_SPAN = 15.0
_ROOM = 1.4
"""Room around the points of a logarithmic figure, as a factor."""
_MARGIN_NM = 40.0
"""Wavelengths shown beyond the outermost bands."""
_SHIFT_NM = 4.0
_CONTRAST_SPAN = 5.0
_POINT: Look = {"ms": 7, "mec": "white", "mew": 0.6}


@with_style
def snr_figure(result: results.PlanResult | results.ConfirmResult) -> Picture:
    """Draw recovered against predicted SNR of every band that was measured, with the mean ratio and its error."""
    from cpic_planner.validation import PREDICTION_ERROR

    if isinstance(result, results.PlanResult):
        every = [band for target in result.targets for band in target.bands]
    else:
        every = list(result.bands)
    items = [item for item in every if item.predicted_snr is not None and item.recovered_snr is not None]
    names = ("predicted_snr", "recovered_snr", "recovered_snr_error")
    x, y, errors = (np.array([getattr(item, name) or 0.0 for item in items]) for name in names)
    figure, axes = drawing.panels(4.9)
    axes.set(xlabel="predicted SNR (analytic model)", ylabel="recovered SNR (simulated images)")
    # The points decide the frame, not their error bars: one long bar would push all points into a corner.
    top = x.max(initial=1.0)
    ends = np.array([[0.0, top], [y.min(initial=0.0), y.max(initial=0.2 * top)]]) * 1.2
    if items and top > _LOG_SPAN * x.min() and y.min() > 0:
        axes.set(xscale="log", yscale="log")
        ends = np.array([[x.min() / _ROOM, x.max() * _ROOM], [y.min() / _ROOM, y.max() * _ROOM]])
        for axis in (axes.xaxis, axes.yaxis):  # plain numbers, few enough not to touch
            drawing.plain_ticks(axis, 1.0, 2.0, 5.0)
    line = ends[0]
    axes.set(xlim=line, ylim=ends[1])
    axes.plot(line, line, color="#444444", lw=1.2, zorder=2, label="recovered = predicted")
    ratio, error = result.calibration.get("etc_ratio"), result.calibration.get("etc_ratio_error")
    if ratio is not None and error is not None:
        low, high = line / (ratio + error), line / max(ratio - error, 0.1 * ratio)
        axes.fill_between(line, low, high, color="#B03060", alpha=0.18, lw=0.0, zorder=1)
        label = f"predicted over recovered\n{ratio:.2f} ± {error:.2f}"
        axes.plot(line, line / ratio, color="#B03060", lw=1.2, ls="--", zorder=2, label=label)
    for band, (colour, marker) in drawing.band_style([item.band for item in every]).items():
        own = np.array([item.band == band for item in items], bool)
        if own.any():
            look = _POINT | {"fmt": marker, "color": colour, "lw": 1.2, "capsize": 2.5, "zorder": 4}
            axes.errorbar(x[own], y[own], yerr=errors[own], label=f"{band} ({own.sum()})", **look)
    if not items:
        axes.text(0.5, 0.5, "no band was measured", transform=axes.transAxes, ha="center")
    figure.legend(loc="outside right upper", alignment="left")
    accuracy = 100 * PREDICTION_ERROR
    return drawing.picture(figure, "snr", items=items, realisations=result.realisations, accuracy=accuracy)


@with_style
def spectrum_figure(scene: Scene, instrument: Instrument, bands: Sequence[results.BandConfirmation]) -> Picture | None:
    """Draw what was measured of every planet on its contrast as a function of wavelength.

    Parameters
    ----------
    scene : Scene
    instrument : Instrument
        Its bands place the points.
    bands : sequence of BandConfirmation
        Those without a measurement are passed over.

    Returns
    -------
    Picture or None
        None where nothing was measured.
    """
    from simulator.target import LitPlanet, spectrum_generator

    measured = [item for item in bands if item.recovered_contrast is not None]
    lights = {row.name: row.light for row in spectrum_generator(scene) if isinstance(row.light, LitPlanet)}
    names = [planet.name for planet in scene.planets if any(item.planet == planet.name for item in measured)]
    if not names:
        return None
    edges = [instrument.bands[item.band] for item in measured]
    low = min(band.center_nm - 0.5 * band.width_nm for band in edges) - _MARGIN_NM
    high = max(band.center_nm + 0.5 * band.width_nm for band in edges) + _MARGIN_NM
    figure, axes = drawing.panels(4.2)
    axes.set(xlabel="wavelength (nm)", ylabel="contrast (planet over star)", xlim=(low, high))
    heights: list[float] = []
    for number, name in enumerate(names):
        light, (colour, marker) = lights[name], drawing.BAND_STYLE[number % len(drawing.BAND_STYLE)]
        inside = (light.wavelength_nm >= low) & (light.wavelength_nm <= high)
        x, y = light.wavelength_nm[inside], light.contrast[inside]
        axes.plot(x, y, color=colour, lw=1.0, alpha=0.55, label=literal(f"{name}: input"))
        own = [item for item in measured if item.planet == name]
        centre = np.array([instrument.bands[item.band].center_nm for item in own])
        half = np.array([0.5 * instrument.bands[item.band].width_nm for item in own])
        true, value, error, mean = (
            np.array([getattr(item, key) or 0.0 for item in own])
            for key in ("true_contrast", "recovered_contrast", "contrast_error", "contrast_mean_error")
        )
        label = "input in the band" if number == 0 else ""
        axes.hlines(true, centre - half, centre + half, color="#222222", lw=2.0, zorder=3, label=label)
        place = centre + _SHIFT_NM * (number - 0.5 * (len(names) - 1))
        axes.errorbar(place, value, yerr=error, fmt="none", ecolor=colour, elinewidth=1.1, capsize=4.0, zorder=4)
        look = _POINT | {"fmt": marker, "color": colour, "elinewidth": 3.2, "zorder": 5}
        axes.errorbar(place, value, yerr=mean, label=literal(f"{name}: recovered"), **look)
        heights += [*(value + error), *(value - error), *true]
    if min(heights) > 0 and max(heights) > _CONTRAST_SPAN * min(heights):
        axes.set_yscale("log")
    figure.legend(loc="outside right upper", alignment="left")
    return drawing.picture(figure, "spectrum", drawn=f"{', '.join(names)} in {len(measured)} measurements")


_REGION, _INNER, _OUTER = "#0072B2", "#5B9FD0", "#C4DDEF"
_TRUTH, _BEST, _SPECTRUM = "#D55E00", "#000000", "#7A7A7A"
_STATUS_TEXT = words.WORDS["albedo_short"]
_BELOW: Look = {"loc": "upper center", "bbox_to_anchor": (0.5, 0.0), "borderaxespad": 4.4}
_PARAMETER_TEXT = {"log10_mh": "[M/H]", "log10_fsed": "f_sed"}


@with_style
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
    figure, (left, right) = drawing.panels(4.5, 2, width_ratios=(1.0, 1.15))
    _posterior(left, fit, truth)
    _contrasts(right, fit, model, line)
    figure.draw_without_rendering()
    return figure


@with_style
def albedo_picture(fit: AlbedoFit, model: AlbedoModel, **known: Any) -> Picture:
    """Return the same as a picture of a report; ``known`` are ``truth`` and ``spectrum``."""
    about = {"bands": ", ".join(fit.bands), "mh": fit.interval("log10_mh"), "fsed": fit.interval("log10_fsed")}
    return drawing.picture(albedo_figure(fit, model, **known), "albedo", status=_STATUS_TEXT[fit.status], **about)


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
    shades = {"68 %": _INNER, "95 %": _OUTER}
    handles: list[Any] = [Patch(facecolor=face, edgecolor=_REGION, label=label) for label, face in shades.items()]
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
    looks = drawing.band_style(model.bands)
    for number, band in enumerate(fit.bands):
        colour, marker = looks[band]
        value, error = fit.contrasts[number] / unit, fit.errors[number] / unit
        look: Look = {"color": colour, "marker": marker, "ms": 6.5, "lw": 1.6}
        axes.errorbar(middle[number], value, error, half[number], zorder=5, mec="white", mew=0.6, capsize=3, **look)
        handles.append(Line2D([], [], label=band, **look))
    looks_best: Look = {"ls": "none", "marker": "_", "ms": 17, "mew": 2.0, "color": _BEST}
    handles += axes.plot(middle, fit.model_contrasts / unit, label="best fit", zorder=4, **looks_best)
    axes.axhline(0.0, color="#444444", lw=0.8)
    spread = (max(shown) - min(shown)) / unit
    axes.set(xlim=(low, high), ylim=(min(shown) / unit - 0.04 * spread, max(shown) / unit + 0.08 * spread))
    axes.set(xlabel="wavelength (nm)", ylabel=f"contrast ($10^{{{round(np.log10(unit))}}}$)")
    chance = "" if fit.p_value is None else f", p {significant(fit.p_value, 2)}"
    count = len(fit.bands)
    axes.set_title(f"chi-square {decimals(fit.chi2, 1)} of {count} band{'s' * (count > 1)}{chance}", fontsize=9.5)
    axes.legend(handles=handles, ncols=3, handletextpad=0.6, columnspacing=1.4, **_BELOW)
