"""Regenerate this report: ``python reports/exposure_gain/make.py`` (about two minutes).

Exposure time and EM gain, as in the paper (Zhu et al. 2025, figure of exposure time and EM gain): the example star at
30 and 300 s, gain 1 and 20, with a bright source in the dark hole.
"""

from __future__ import annotations

import argparse
import csv
import functools
import io
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import AsinhNorm
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from matplotlib.ticker import FixedLocator, NullLocator
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from cpic_planner.report.drawing import style
from simulator import Observation, load_instrument, load_scene, observe
from simulator.camera import Frame, pixel_variance_e2, to_electrons
from simulator.config import Instrument
from simulator.files import write_bytes, write_text
from simulator.imaging.aperture import overlap_weights

HERE = Path(__file__).resolve().parent
BAND, EXPOSURES_S, GAINS = "F520", (30.0, 300.0), (1.0, 20.0)
PA_DEG, SEPARATION_ARCSEC = 135.0, 0.95
CONTRAST, OTHER_CONTRASTS = 1e-6, (1e-5, 1e-4)
FRAMES = 24
# The paper's text counts position angles counter-clockwise on the detector, its figures show them mirrored.
FIGURE_PARITY = 1
LINEAR_ADU = 10.0
TICKS_ADU = (0, 10, 30, 100, 300, 1000, 3000, 10000)
HALF_ARCSEC = 1.1

FloatArray = NDArray[np.float64]
BoolArray = NDArray[np.bool_]
Setting = tuple[float, float]
SETTINGS: tuple[Setting, ...] = tuple((exposure, gain) for exposure in EXPOSURES_S for gain in GAINS)


@functools.cache
def instrument() -> Instrument:
    """The default instrument, mirrored as in the paper's figures."""
    return load_instrument({"detector": {"parity": FIGURE_PARITY}})


def sequence(setting: Setting, contrast: float | None, *, gain: float | None = None) -> Observation:
    """Frames of the example with a source of that contrast, or without it; the wavefront is the same in all."""
    example = load_scene("paper_example")
    tree = example.model_dump(exclude_defaults=True)
    if contrast is not None:
        star = {"name": "source", "v_mag": example.cstar.v_mag - 2.5 * np.log10(contrast), "pa_deg": PA_DEG,
                "spectral_type": example.cstar.spectral_type, "separation_arcsec": SEPARATION_ARCSEC}  # fmt: skip
        tree |= {"stars": [star]}
    return observe(load_scene(tree), band=BAND, exposure_s=setting[0], em_gain=gain or setting[1], n_frames=FRAMES,
                   instrument=instrument())  # fmt: skip


@dataclass(frozen=True, eq=False)
class Seen:
    """The first frame of a setting."""

    seen: Observation
    frame: Frame
    bloomed: BoolArray

    @functools.cached_property
    def tails(self) -> BoolArray:
        """Pixels that the register cut off or spilled into."""
        return self.frame.lost & ~self.bloomed

    @functools.cached_property
    def hole(self) -> FloatArray:
        """ADU of the dark hole."""
        inside = self.seen.psf.metrics.hole
        rows, columns, part = self.seen.area.stamp(len(inside))
        return self.frame.adu[rows, columns][inside[part]].astype(np.float64)

    @functools.cached_property
    def tail_in_hole(self) -> float:
        """Fraction of the hole that tails run through."""
        inside = self.seen.psf.metrics.hole
        rows, columns, part = self.seen.area.stamp(len(inside))
        return float(self.tails[rows, columns][inside[part]].mean())


def first_frame(setting: Setting) -> Seen:
    """Simulate one frame; at gain 1 the same charge shows which pixels the pixel full well cut off."""
    seen = sequence(setting, CONTRAST)
    frame = seen.frame(0)
    plain = sequence(setting, CONTRAST, gain=1.0).frame(0)
    assert plain.n_saturated_pixels == frame.n_saturated_pixels
    return Seen(seen, frame, plain.lost)


def longest_run(flags: BoolArray) -> int:
    """Longest run of set pixels along a row."""
    padded = np.pad(flags, ((0, 0), (1, 1))).astype(np.int8)
    edges = np.diff(padded, axis=1).ravel()
    lengths = np.flatnonzero(edges == -1) - np.flatnonzero(edges == 1)
    return int(lengths.max(initial=0))


@dataclass(frozen=True, eq=False)
class Sums:
    """Electrons in the aperture around a source, one number a frame, and what they should be."""

    sums: FloatArray
    true_e: float
    expected_sigma_e: float

    @property
    def sigma_e(self) -> float:
        """Scatter, from the central 68 %: particles hit few frames."""
        low, high = np.percentile(self.sums, (15.865, 84.135))
        return float(high - low) / 2.0


def aperture(seen: Observation, index: int) -> Sums:
    """Sum the aperture around a source, level of the prescan taken off, in every frame."""
    detector, pixel = seen.instrument.detector, seen.pixel_scale_arcsec
    x, y = seen.truth.x_pixel[index], seen.truth.y_pixel[index]
    column, row = round(x), round(y)
    weights = overlap_weights(seen.psf.metrics.aperture_radius_arcsec / pixel, y - row, x - column)
    half = len(weights) // 2
    part = (slice(row - half, row + half + 1), slice(column - half, column + half + 1))
    sums = []
    for frame in seen.iter_full_frames():
        electrons = to_electrons(frame.adu, detector, seen.em_gain)
        sums.append(float((weights * (electrons[part] - electrons[seen.sections["prescan"]].mean())).sum()))
    source = seen.truth.sources[index]
    core = float(seen.psf.metrics.core_throughput(source.x_arcsec, source.y_arcsec))
    variance = pixel_variance_e2(seen.expected_e[part], detector.cic_e, seen.em_gain, detector)
    return Sums(np.array(sums), source.rate_e_s * core * seen.exposure_s, float(np.sqrt((weights**2 * variance).sum())))


def photometry() -> dict[tuple[str, Setting], tuple[float, Sums]]:
    """Electrons of each source in the aperture: mean with it less mean without, and the sums with it."""
    result: dict[tuple[str, Setting], tuple[float, Sums]] = {}
    for setting in SETTINGS:
        bare: Sums | None = None
        for contrast in (CONTRAST, *OTHER_CONTRASTS):
            seen = sequence(setting, contrast)
            found = aperture(seen, 2)
            if bare is None:
                empty = sequence(setting, 1e-14)  # a place to measure, no light
                bare = aperture(empty, 2)
            result[f"source, {contrast:.0e}", setting] = float(np.median(found.sums) - np.median(bare.sums)), found
    return result


def scaled() -> AsinhNorm:
    """Colour scale of all panels."""
    detector = instrument().detector
    return AsinhNorm(linear_width=LINEAR_ADU, vmin=-10.0, vmax=detector.adc_max_adu - detector.bias_adu)


def draw(panel: Axes, one: Seen, *, whole: bool) -> Any:
    """One panel: the whole frame in pixels, or the hole in arcsec, with mask and source."""
    seen, metrics, detector = one.seen, one.seen.psf.metrics, instrument().detector
    image = one.frame.adu - detector.bias_adu
    source = seen.truth.sources[2]
    pixel = seen.pixel_scale_arcsec
    if whole:
        shown = panel.imshow(image, origin="lower", cmap="viridis", norm=scaled(), interpolation="nearest")
        reach = 1.0 / pixel
        middle = np.array([detector.star_column, detector.star_row])
        panel.add_patch(Circle(tuple(middle), 1.6 * reach, fill=False, ec="white", lw=0.8, ls="--"))
        return shown
    half = round(HALF_ARCSEC / pixel)
    row, column = detector.star_row, detector.star_column
    edge = (half + 0.5) * pixel
    shown = panel.imshow(image[row - half : row + half + 1, column - half : column + half + 1], origin="lower",
                         cmap="viridis", norm=scaled(), interpolation="nearest",
                         extent=(-edge, edge, -edge, edge))  # fmt: skip
    w = metrics.mask_half_width_arcsec
    for x in (-w, w):
        for y in (-w, w):
            panel.plot([x, x, np.copysign(edge, x)], [np.copysign(edge, y), y, y], color="white", lw=0.7)
    panel.add_patch(Circle((source.x_arcsec, source.y_arcsec), 0.09, fill=False, ec="#D55E00", lw=1.4))
    panel.set(xlim=(-edge, edge), ylim=(-edge, edge), xticks=(-1, 0, 1), yticks=(-1, 0, 1))
    return shown


def figure_of(images: dict[Setting, Seen], *, whole: bool) -> Figure:
    """Four panels: a row an exposure, a column a gain."""
    figure = Figure(figsize=(10.4, 9.2), layout="constrained")
    panels = figure.subplots(len(EXPOSURES_S), len(GAINS), sharex=True, sharey=True)
    for row, exposure in zip(panels, EXPOSURES_S, strict=True):
        for panel, gain in zip(row, GAINS, strict=True):
            shown = draw(panel, images[exposure, gain], whole=whole)
            panel.set_title(f"{exposure:g} s, gain {gain:g}")
    unit = "px" if whole else "arcsec"
    for panel in panels[:, 0]:
        panel.set_ylabel(f"row ({unit})" if whole else f"y ({unit})")
    for panel in panels[-1]:
        panel.set_xlabel(f"column ({unit})" if whole else f"x ({unit})")
    label = f"ADU above the bias level of {instrument().detector.bias_adu:g} (asinh scale, linear below {LINEAR_ADU:g})"
    bar = figure.colorbar(shown, ax=panels, label=label, shrink=0.85, extend="both")
    bar.ax.yaxis.set_major_locator(FixedLocator(TICKS_ADU))
    bar.ax.yaxis.set_minor_locator(NullLocator())
    bar.ax.set_yticklabels([f"{tick:g}" for tick in TICKS_ADU])
    return figure


def frame_rows(images: dict[Setting, Seen]) -> list[list[str]]:
    """Numbers of the four frames."""
    rows = [["exposure (s)", "gain", "median of the hole (ADU)", "its noise (ADU)", "its noise (e-)",
             "pixels at the pixel full well", "columns that bloom", "pixels in register tails", "longest tail (px)",
             "tails in the hole", "clipped pixels", "brightest ADU", "particles"]]  # fmt: skip
    for (exposure, gain), one in images.items():
        low, middle, high = np.percentile(one.hole, (15.865, 50.0, 84.135))
        noise = float(high - low) / 2.0
        rows.append([f"{exposure:g}", f"{gain:g}", f"{middle:.0f}", f"{noise:.1f}",
                     f"{noise * instrument().detector.gain_e_adu / gain:.1f}", str(one.frame.n_saturated_pixels),
                     str(int(one.bloomed.any(axis=0).sum())), str(one.frame.n_register_saturated),
                     str(longest_run(one.tails)), f"{one.tail_in_hole:.0%}", str(one.frame.n_clipped),
                     str(int(one.frame.adu.max())), str(one.frame.n_cosmic_rays)])  # fmt: skip
    return rows


def source_rows(measured: dict[tuple[str, Setting], tuple[float, Sums]]) -> list[list[str]]:
    """Numbers of the sources."""
    rows = [["source, contrast", "exposure (s)", "gain", "electrons in the aperture", "of the true ones",
             "scatter (e-)", "expected scatter (e-)", "SNR of one frame"]]  # fmt: skip
    for (name, (exposure, gain)), (electrons, one) in measured.items():
        lost = one.sigma_e < 0.3 * one.expected_sigma_e or not 0.5 < electrons / one.true_e < 1.5
        rows.append([name, f"{exposure:g}", f"{gain:g}", f"{one.true_e:.0f}", f"{electrons / one.true_e:.3f}",
                     f"{one.sigma_e:.0f}", f"{one.expected_sigma_e:.0f}",
                     "none: cut off" if lost else f"{electrons / one.sigma_e:.1f}"])  # fmt: skip
    return rows
