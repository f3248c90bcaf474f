"""Code that every figure shares: canvas, style, colours, and saving as a data URI with the same bytes every time."""

from __future__ import annotations

import base64
import contextlib
import functools
import io
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from importlib import resources
from typing import TYPE_CHECKING, Any, Literal, ParamSpec, TypeAlias, TypeVar

import numpy as np

from cpic_core import Record, visible
from cpic_planner.report import words

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from matplotlib.figure import Figure

    from cpic_planner.results import RankedTarget


P = ParamSpec("P")
D = TypeVar("D")

WIDTH_INCHES = 9.0


SCREEN_DPI = 100


IMAGE_DPI = 130


MOST_LABELLED = 12
"""Stars with their names in a figure of all."""


# Perceptually even or diverging with a light middle; both are told apart with any colour vision.
STACK_COLOURS = "viridis"


RESIDUAL_COLOURS = "RdBu_r"


_MAP_COLOURS = 112


_PNG_LEVEL = 6


# Okabe-Ito colours: told apart with any colour vision; markers differ as well.
VERDICT_STYLE: dict[str, tuple[str, str]] = {
    "detected": ("#0072B2", "o"),
    "measured_not_detected": ("#56B4E9", "v"),
    "unreachable": ("#8C8C8C", "o"),
    "saturated": ("#D55E00", "^"),
    "outside_field": ("#CC79A7", "s"),
    "invalid": ("#000000", "x"),
}


_COLOURS = ("#0072B2", "#E69F00", "#009E73", "#CC79A7", "#56B4E9", "#D55E00", "#000000", "#9A8700")


BAND_STYLE: tuple[tuple[str, str], ...] = tuple(zip(_COLOURS, "os^DvPX*", strict=True))


Look: TypeAlias = dict[str, Any]
"""Keywords of matplotlib that say how something is drawn."""


@functools.cache
def _settings() -> Any:
    from matplotlib import rc_params_from_file

    path = resources.files("cpic_planner.report").joinpath("templates/figures.mplstyle")
    with resources.as_file(path) as file:
        return rc_params_from_file(file, use_default_template=False)


class Picture(Record):
    """A finished figure: image as a data URI, text for those who cannot see it, caption, and natural width."""

    uri: str
    alt: str
    caption: str
    width_px: int = int(WIDTH_INCHES * SCREEN_DPI)


@contextlib.contextmanager
def style() -> Iterator[None]:
    """Draw with this report's settings, whatever the user's own are; theirs come back at the end."""
    import matplotlib as mpl

    with mpl.rc_context():
        mpl.rcdefaults()
        mpl.rcParams.update(_settings())
        yield


def new_figure(height_inches: float, *, layout: Literal["constrained"] | None = "constrained") -> Figure:
    """Return an empty figure of full width on its own canvas (nothing is registered anywhere).

    Parameters
    ----------
    height_inches : float
    layout : {"constrained"} or None
        Whether matplotlib looks for room for all words, which costs more than drawing them, or axes stay where they
        are put.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(WIDTH_INCHES, height_inches), dpi=SCREEN_DPI, layout=layout)
    FigureCanvasAgg(figure)
    return figure


def with_style(draw: Callable[P, D]) -> Callable[P, D]:
    """Let a function draw with this report's settings."""

    @functools.wraps(draw)
    def drawn(*given: P.args, **options: P.kwargs) -> D:
        with style():
            return draw(*given, **options)

    return drawn


def panels(
    height_inches: float, columns: int = 1, rows: int = 1, *, grid: Literal["x", "y", "both", ""] = "both", **look: Any
) -> tuple[Figure, Any]:
    """Return a new figure and its axes, with a grid: the axes alone where there is one, an array where there are more.

    Parameters
    ----------
    height_inches : float
    columns, rows : int
        Axes beside and below each other.
    grid : {"x", "y", "both", ""}
        Axis of the lines of the grid.
    **look
        Handed to ``Figure.subplots``.
    """
    figure = new_figure(height_inches)
    axes = figure.subplots(rows, columns, **look)
    for one in np.ravel(axes) if grid else ():
        one.grid(visible=True, axis=grid)
    return figure, axes


def name_rows(axes: Axes, names: Sequence[str], *, marks: bool = True, **look: Any) -> None:
    """Name the rows of axes, the first one on top; without ``marks`` no strokes stand at the names."""
    axes.set_yticks(range(len(names)), names, **look)
    axes.set_ylim(len(names) - 0.4, -0.6)
    if not marks:
        axes.tick_params(axis="y", length=0)


def picture(figure: Figure, name: str, image_format: Literal["svg", "png"] = "svg", /, **values: Any) -> Picture:
    """Return the figure as a picture with the words of its name in ``prose.yaml``, and values in their braces."""
    alt, caption = (words.text(f"pictures.{name}.{part}", **values) for part in ("alt", "caption"))
    return save(figure, image_format, alt=alt, caption=caption)


def save(figure: Figure, image_format: Literal["svg", "png"] = "svg", *, alt: str, caption: str) -> Picture:
    """Return the figure as a picture; no date, version or path goes into it.

    PNG files are reduced to a fixed palette that holds the two colour maps of the image panels and greys: a third of
    the size, no visible loss.
    """
    buffer = io.BytesIO()
    if image_format == "svg":
        from matplotlib.backends.backend_svg import FigureCanvasSVG

        # `savefig` draws a figure with a layout twice, of which the first time is for the layout
        FigureCanvasSVG(figure).print_svg(buffer, metadata={"Date": None, "Creator": None})
        return Picture(_uri("image/svg+xml", in_two_lights(buffer.getvalue())), alt, caption)
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from PIL import Image

    figure.set_dpi(IMAGE_DPI)
    canvas = FigureCanvasAgg(figure)
    canvas.draw()  # the pixels as they are: `savefig` would pack what would be unpacked here
    drawn = np.asarray(canvas.buffer_rgba())[..., :3]
    small = Image.fromarray(drawn).quantize(palette=_palette(), dither=Image.Dither.NONE)
    small.save(buffer, format="png", compress_level=_PNG_LEVEL)
    return Picture(_uri("image/png", buffer.getvalue()), alt, caption)


_COLOUR = re.compile(rb"(?<=: )#([0-9a-f]{6})(?![0-9a-f])")


_DARK_INK, _DARK_PAGE = (0xE4, 0xE7, 0xEA), (0x14, 0x17, 0x1A)
"""Ink and page of ``plan.css`` in dark mode."""


_MOST_TINT = 16
"""Largest difference between red, green and blue of what is a grey, of 255."""


def in_two_lights(drawing: bytes) -> bytes:
    """Return an SVG drawing whose greys, white and black follow dark mode: black becomes light and white dark.

    Parameters
    ----------
    drawing : bytes
        As matplotlib writes it: colours in styles, black where none is said.
    """
    greys = {"000000": 0.0}
    for colour in map(bytes.decode, _COLOUR.findall(drawing)):
        levels = bytes.fromhex(colour)
        if max(levels) - min(levels) <= _MOST_TINT:
            greys[colour] = sum(levels) / (3 * 255)
    named = sorted(greys.items())
    light = ";".join(f"--g{colour}:#{colour}" for colour, _ in named)
    dark = ";".join(f"--g{colour}:#{_in_the_dark(share)}" for colour, share in named)
    rules = f"svg{{fill:var(--g000000);{light}}}@media (prefers-color-scheme:dark){{svg{{{dark}}}}}"

    def looked(found: re.Match[bytes]) -> bytes:
        return b"var(--g" + found[1] + b")" if found[1].decode() in greys else found[0]

    return _COLOUR.sub(looked, drawing).replace(b"</style>", rules.encode() + b"</style>", 1)


def _in_the_dark(share: float) -> str:
    """Return a grey in dark mode, from its share of white."""
    pairs = zip(_DARK_INK, _DARK_PAGE, strict=True)
    return "".join(f"{round(ink + share * (page - ink)):02x}" for ink, page in pairs)


def _palette() -> Any:
    """Return the palette image of 256 colours: those that the image panels are drawn with."""
    import matplotlib as mpl
    from PIL import Image

    greys = np.repeat(np.linspace(0, 255, 256 - 2 * _MAP_COLOURS).round(), 3).reshape(-1, 3)
    shades = np.linspace(0.0, 1.0, _MAP_COLOURS)
    maps = [255.0 * mpl.colormaps[name](shades)[:, :3] for name in (STACK_COLOURS, RESIDUAL_COLOURS)]
    palette = Image.new("P", (1, 1))
    palette.putpalette(np.concatenate([*maps, greys]).round().astype(np.uint8).tobytes())
    return palette


def _uri(media_type: str, content: bytes) -> str:
    return f"data:{media_type};base64,{base64.b64encode(content).decode('ascii')}"


def band_style(bands: Sequence[str]) -> dict[str, tuple[str, str]]:
    """Return colour and marker of each band, in order of first appearance."""
    return {band: BAND_STYLE[i % len(BAND_STYLE)] for i, band in enumerate(dict.fromkeys(bands))}


RING: Look = {"facecolors": "none", "edgecolors": "#111111", "linewidths": 1.2, "zorder": 5}
"""A ring around a point that stands out."""


def by_verdict(rows: Iterable[RankedTarget]) -> dict[str, list[RankedTarget]]:
    """Return rows by the keys of `VERDICT_STYLE`: their verdicts, and for what is out of reach its status."""
    told = [(verdict_of(row), row) for row in rows]
    return {name: group for name in VERDICT_STYLE if (group := [row for verdict, row in told if verdict == name])}


def verdict_of(row: RankedTarget) -> str:
    """Return the verdict of a row, and for what is out of reach its status; older results have the status alone."""
    return row.verdict or "detected" if row.status == "ok" else row.status


def verdict_look(verdict: str, *, faint: float) -> Look:
    """Return how points of a verdict are scattered; unreachable ones lie below others, with opacity ``faint``."""
    colour, marker = VERDICT_STYLE[verdict]
    alpha, zorder = (faint, 2) if verdict == "unreachable" else (0.85, 4)
    return {"c": colour, "marker": marker, "alpha": alpha, "linewidths": 0 if marker != "x" else 1, "zorder": zorder}


def plain_ticks(axis: Axis, *steps: float, **limits: int) -> None:
    """Write few plain numbers at a logarithmic axis: ``steps`` of each decade, within ``limits`` of the locator."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    axis.set_major_locator(LogLocator(subs=steps, **limits))
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_formatter(NullFormatter())


def power_ticks(axis: Axis) -> None:
    """Write powers of ten at a logarithmic axis, and 2 and 5 times them where there are fewer than two of them."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    low, high = axis.get_view_interval()
    powers = np.floor(np.log10(high)) - np.ceil(np.log10(low))
    axis.set_major_locator(LogLocator(subs=(1.0,) if powers >= 1 else (1.0, 2.0, 5.0)))

    def written(value: float, _: float) -> str:
        power = int(np.floor(np.log10(value) + 1e-9))
        factor = round(value / 10.0**power)
        times = "" if factor == 1 else rf"{factor} \times "
        return f"${times}10^{{{power}}}$"

    axis.set_major_formatter(FuncFormatter(written))
    axis.set_minor_formatter(NullFormatter())


def plain_log_axis(axes: Axes) -> None:
    """Make the x axis logarithmic, with few ticks that are written as everyday numbers."""
    axes.set_xscale("log")
    low, high = axes.get_xlim()
    steps = (1.0,) if high > 40.0 * low else (1.0, 2.0, 5.0)
    plain_ticks(axes.xaxis, *steps, numticks=12)


def date_axis(axes: Axes, *, minticks: int = 4, maxticks: int | None = 13) -> None:
    """Write dates at the x axis, whose values are days since 1970."""
    from matplotlib.dates import AutoDateLocator, ConciseDateFormatter

    locator = AutoDateLocator(minticks=minticks, maxticks=maxticks)
    axes.xaxis.set_major_locator(locator)
    axes.xaxis.set_major_formatter(ConciseDateFormatter(locator))


def literal(text: str) -> str:
    """Return a text that matplotlib writes as it is: no formula of dollar signs, no control characters."""
    return visible(text, "\n").replace("$", r"\$")


_POINT_PX = 3.0
"""Radius of a small point on the screen."""


def place_labels(
    axes: Axes,
    x: Sequence[float],
    y: Sequence[float],
    texts: Sequence[str],
    *,
    reach_px: Sequence[float] | float = 4.0,
    avoid: Sequence[Artist] = (),
    others: Sequence[tuple[float, float]] = (),
    **text_style: Any,
) -> None:
    """Write a label near each point so that labels cover neither each other nor the labelled points.

    Parameters
    ----------
    axes : Axes
        Finished axes: limits, scales and layout must not change afterwards.
    x, y : sequence of float
        Data coordinates of the points, most important first.
    texts : sequence of str
        Labels. One that finds no free place within reach is left out: none is better than an unreadable one.
    reach_px : sequence of float
        Radius of each point's marker.
    avoid : sequence of Artist
        Texts that labels must not cover; those that lie on labelled points are hidden.
    others : sequence of (float, float)
        Data coordinates of points without a label that labels must not cover either.
    **text_style
        Handed to ``Axes.annotate``.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.patheffects import withStroke
    from matplotlib.transforms import Bbox

    figure = axes.figure
    canvas = figure.canvas
    assert isinstance(canvas, FigureCanvasAgg)
    if (layout := canvas.figure.get_layout_engine()) is not None:
        layout.execute(canvas.figure)
    renderer = canvas.get_renderer()
    points = axes.transData.transform(np.column_stack([x, y])) if len(texts) else np.empty((0, 2))
    frame = axes.get_window_extent(renderer)
    radii = np.broadcast_to(np.asarray(reach_px, float), len(texts))
    taken: list[tuple[float, ...]] = [(x - r, y - r, x + r, y + r) for (x, y), r in zip(points, radii, strict=True)]
    for artist in avoid:
        extent = artist.get_window_extent(renderer)
        if any(extent.overlaps(Bbox.from_extents(*box)) for box in taken[: len(texts)]):
            artist.set_visible(False)
        else:
            taken.append(tuple(extent.extents))
    beside = axes.transData.transform(np.array(others)) if others else np.empty((0, 2))
    taken += [(x - _POINT_PX, y - _POINT_PX, x + _POINT_PX, y + _POINT_PX) for x, y in beside]
    to_points = 72.0 / figure.dpi
    halo = [withStroke(linewidth=2.2, foreground="white")]
    for (px, py), radius, text in zip(points, radii, texts, strict=True):
        probe = axes.text(0, 0, text, **text_style)
        extent = probe.get_window_extent(renderer)
        probe.remove()
        place = _free_place(px, py, radius, extent.width, extent.height, frame, taken)
        if place is None:
            continue
        left, bottom, reach = place
        taken.append((left, bottom, left + extent.width, bottom + extent.height))
        offset = ((left + extent.width / 2 - px) * to_points, (bottom + extent.height / 2 - py) * to_points)
        arrow = {"arrowstyle": "-", "color": "#555555", "linewidth": 0.6, "shrinkA": 0, "shrinkB": 2}
        look = text_style | {"ha": "center", "va": "center", "zorder": 9, "arrowprops": arrow if reach > 0 else None}
        xy = tuple(axes.transData.inverted().transform((px, py)))
        label = axes.annotate(text, xy=xy, xytext=offset, textcoords="offset points", path_effects=halo, **look)
        label.set_in_layout(False)


def _free_place(
    px: float, py: float, radius: float, width: float, height: float, frame: Any, taken: Sequence[tuple[float, ...]]
) -> tuple[float, float, int] | None:
    """Return the lower left corner of a free place, nearest first, and on which ring it was found."""
    for ring, gap in enumerate((3.0, 11.0, 22.0, 36.0, 54.0, 76.0)):
        for angle in np.deg2rad((30, 330, 150, 210, 0, 180, 90, 270, 60, 120, 240, 300)):
            cx = px + np.cos(angle) * (radius + gap + width / 2)
            cy = py + np.sin(angle) * (radius + gap + height / 2)
            box = (cx - width / 2 - 1, cy - height / 2 - 1, cx + width / 2 + 1, cy + height / 2 + 1)
            if box[0] < frame.x0 + 2 or box[2] > frame.x1 - 2 or box[1] < frame.y0 + 2 or box[3] > frame.y1 - 2:
                continue
            if not any(box[0] < t[2] and t[0] < box[2] and box[1] < t[3] and t[1] < box[3] for t in taken):
                return box[0] + 1, box[1] + 1, ring
    return None


_TICKS_ARCSEC = (0.1, 0.15, 0.2, 0.25, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 1.0, 1.5, 2.0)


def contrast_axes(axes: Axes) -> None:
    """Make a plane of separation and contrast, both logarithmic."""
    axes.set(xscale="log", yscale="log")
    axes.grid(visible=True)
    axes.set_xlabel("projected separation (arcsec)")
    axes.set_ylabel("planet-to-star contrast (flux ratio)")


def separation_ticks(axes: Axes, low: float, high: float) -> None:
    """Set the limits of the axis of separations, arcsec, and write plain numbers at it."""
    axes.set_xlim(low, high)
    ticks = [tick for tick in _TICKS_ARCSEC if low <= tick <= high]
    axes.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
    axes.set_xticks([], minor=True)
