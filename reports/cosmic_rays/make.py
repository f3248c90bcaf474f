"""Regenerate this report: ``python reports/cosmic_rays/make.py`` (about a minute).

Cosmic rays as in the paper (Zhu et al. 2025, figure of cosmic rays): 3000 s at gain 1 and 300, by both models of
straight tracks, and how well their numbers, lengths and charges follow their laws.
"""

from __future__ import annotations

import argparse
import base64
import csv
import functools
import io
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.colors import AsinhNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from numpy.typing import NDArray
from scipy import integrate, stats
from threadpoolctl import threadpool_limits

from cpic_core import stream, write_bytes, write_text
from cpic_planner.report import new_figure, style
from cpic_planner.report.drawing import STACK_COLOURS, save
from simulator import load_instrument
from simulator.camera import Frame
from simulator.config import Instrument
from simulator.effects import CosmicRays, draw_cosmic_rays
from simulator.observing import calibrate
from simulator.observing.calibration import Calibration

HERE = Path(__file__).resolve().parent
EXPOSURE_S, GAINS, MODELS = 3000.0, (1.0, 300.0), ("paper", "physical")
RATE_PER_S_CM2 = 1.0
EXPOSURES = 40
# At this exposure they fill the register as particles do.
OFF = {"bad_pixels": False, "bad_columns": False}
TICKS_ADU = (0, 10, 30, 100, 300, 1000, 3000, 10000)
SIDE = 120
COLOURS = {"paper": "#D55E00", "physical": "#0072B2"}

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


@functools.cache
def instrument(model: str) -> Instrument:
    """The default instrument with one model of tracks, at the peak rate of the paper."""
    rays = {"model": model, "peak_rate_per_s_cm2": RATE_PER_S_CM2, "cycle_depth": 0.0}
    return load_instrument({"cosmic_rays": rays})


@functools.cache
def dark(model: str, gain: float) -> Calibration:
    """A closed exposure: nothing but dark current, particles and the camera."""
    return calibrate("DARK", exposure_s=EXPOSURE_S, em_gain=gain, instrument=instrument(model), switches=OFF)


@functools.cache
def image_shape(model: str) -> tuple[int, int]:
    """Rows and columns that particles can hit: active and shielded pixels."""
    rows, columns = dark(model, 1.0).sections["image"]
    return rows.stop - rows.start, columns.stop - columns.start


def rays_of(model: str, *path: str | int) -> CosmicRays:
    """Draw the particles of one exposure."""
    config = instrument(model)
    return draw_cosmic_rays(
        config.cosmic_rays,
        image_shape(model),
        config.detector.pixel_um,
        EXPOSURE_S,
        RATE_PER_S_CM2,
        stream(1, *path, "cosmic_rays"),
    )


@dataclass(frozen=True, eq=False)
class Shot:
    """A frame and the particles in it."""

    model: str
    gain: float
    frame: Frame
    rays: CosmicRays

    @functools.cached_property
    def tails(self) -> IntArray:
        """Lengths of the runs of pixels that the register cut off or spilled into, along the rows."""
        flags = np.pad(self.frame.lost, ((0, 0), (1, 1))).astype(np.int8)
        edges = np.diff(flags, axis=1).ravel()
        return np.asarray(np.flatnonzero(edges == -1) - np.flatnonzero(edges == 1))

    @property
    def corner(self) -> tuple[int, int]:
        """Lower left corner of the part of the frame with most saturated pixels."""
        rows, columns = (size // SIDE for size in self.frame.lost.shape)
        blocks = self.frame.lost[: rows * SIDE, : columns * SIDE].reshape(rows, SIDE, columns, SIDE).sum(axis=(1, 3))
        row, column = np.unravel_index(blocks.argmax(), blocks.shape)
        return int(row) * SIDE, int(column) * SIDE


def shot(model: str, gain: float) -> Shot:
    """Simulate one frame."""
    sequence = dark(model, gain)
    frame = sequence.frame(0)
    rays = rays_of(model, *sequence.path, 0)
    assert rays.n_events == frame.n_cosmic_rays
    assert float(rays.electrons.sum()) == frame.charge["cosmic_rays"]
    return Shot(model, gain, frame, rays)


@dataclass(frozen=True, eq=False)
class Sample:
    """Particles of many exposures whose middles lie on the pixels: a fair sample of all."""

    model: str
    counts: IntArray
    length_um: FloatArray
    azimuth_deg: FloatArray
    charge_e: FloatArray
    lost_charge_e: int


def sample(model: str) -> Sample:
    """Draw many exposures."""
    rows, columns = image_shape(model)
    counts, parts, lost = [], [], 0
    for index in range(EXPOSURES):
        rays = rays_of(model, "laws", index)
        inside = (rays.row >= -0.5) & (rays.row < rows - 0.5) & (rays.column >= -0.5) & (rays.column < columns - 0.5)
        counts.append(int(inside.sum()))
        parts.append((rays.length_um[inside], rays.azimuth_deg[inside], rays.charge_e[inside].astype(np.float64)))
        lost += int(rays.charge_e.sum()) - int(rays.electrons.sum()) - rays.lost_e
    length, azimuth, charge = (np.concatenate(part) for part in zip(*parts, strict=True))
    return Sample(model, np.array(counts), length, azimuth, charge, lost)


@dataclass(frozen=True)
class Law:
    """What a model states about its tracks, worked out anew: cosines, Landau's law by its density, tails."""

    model: str

    @property
    def depth_um(self) -> float:
        """Thickness of the layer."""
        return float(getattr(instrument(self.model).cosmic_rays, self.model).depth_um)

    @property
    def least(self) -> float:
        """Squared cosine of the longest chord."""
        return (self.depth_um / float(getattr(instrument(self.model).cosmic_rays, self.model).max_length_um)) ** 2

    def length_below(self, length_um: FloatArray) -> FloatArray:
        """Fraction of chords below a length: the squared cosine of an isotropic flux is uniform."""
        squared = np.clip((self.depth_um / np.maximum(length_um, 1e-9)) ** 2, self.least, 1.0)
        return np.asarray((1.0 - squared) / (1.0 - self.least))

    @property
    def median_length_um(self) -> float:
        """Median chord: depth times the root of 2, but for the cut."""
        return self.depth_um * math.sqrt(2.0 / (1.0 + self.least))

    @property
    def mean_length_um(self) -> float:
        """Mean chord: twice the depth, but for the cut."""
        return 2.0 * self.depth_um / (1.0 + math.sqrt(self.least))

    @property
    def mean_charge_e(self) -> float:
        """Mean charge of a track."""
        rays = instrument(self.model).cosmic_rays
        if self.model == "paper":
            return rays.paper.mean_charge_e
        return rays.physical.mean_loss_e_um * self.mean_length_um

    def charge_below(self, charge_e: FloatArray) -> FloatArray:
        """Fraction of tracks below a charge."""
        rays = instrument(self.model).cosmic_rays
        if self.model == "paper":
            knee, index = rays.paper.tail_start, rays.paper.tail_index

            def density(x: float) -> float:
                return math.exp(-x) if x < knee else math.exp(-knee) * (x / knee) ** -index

            def total(power: int, to: float) -> float:
                low = integrate.quad(lambda x: x**power * density(x), 0.0, min(knee, to))[0]
                return low + (integrate.quad(lambda x: x**power * density(x), knee, to)[0] if to > knee else 0.0)

            scale = rays.paper.mean_charge_e * total(0, math.inf) / total(1, math.inf)
            return np.array([total(0, charge / scale) / total(0, math.inf) for charge in charge_e])
        config = rays.physical
        # Landau's lambda in the parameters of scipy
        landau = stats.landau(loc=math.log(math.pi / 2.0), scale=math.pi / 2.0)
        cut, below = config.loss_cut, float(landau.cdf(config.loss_cut))
        mean = cut - integrate.quad(landau.cdf, -6.0, cut, limit=400)[0] / below
        edges = np.geomspace(config.depth_um, config.max_length_um, 1001)
        lengths, weights = np.sqrt(edges[1:] * edges[:-1]), np.diff(self.length_below(edges))
        losses = (charge_e[:, None] / lengths - config.mean_loss_e_um) / config.loss_width_e_um + mean
        return np.asarray(landau.cdf(np.minimum(losses, cut)) / below @ weights)


def check_rows(samples: dict[str, Sample]) -> list[list[str]]:
    """Numbers of the tracks beside their laws."""
    rows = [["model", "quantity", "law", "found", "standard errors off"]]
    for model, one in samples.items():
        law, n = Law(model), one.length_um.size
        pixel_cm = instrument(model).detector.pixel_um * 1e-4
        area = image_shape(model)[0] * image_shape(model)[1] * pixel_cm**2
        expected = RATE_PER_S_CM2 * area * EXPOSURE_S
        found = float(one.counts.mean())
        error = math.sqrt(expected / EXPOSURES)
        rows.append(
            [
                model,
                f"particles in {EXPOSURE_S:g} s on {area:.4f} cm²: R A t",
                f"{expected:.1f}",
                f"{found:.1f} ± {error:.1f}",
                f"{(found - expected) / error:+.1f}",
            ]
        )
        ratio, error = float(one.counts.var(ddof=1) / found), math.sqrt(2.0 / (EXPOSURES - 1))
        rows.append(
            [
                model,
                "their variance over their mean",
                "1",
                f"{ratio:.2f} ± {error:.2f}",
                f"{(ratio - 1.0) / error:+.1f}",
            ]
        )
        median, m = float(np.median(one.length_um)), law.median_length_um
        density = 2.0 * law.depth_um**2 / m**3 / (1.0 - law.least)
        error = 1.0 / (2.0 * density * math.sqrt(n))
        rows.append(
            [
                model,
                "median chord (µm): depth √2",
                f"{m:.2f}",
                f"{median:.2f} ± {error:.2f}",
                f"{(median - m) / error:+.1f}",
            ]
        )
        distance = float(stats.ks_1samp(one.length_um, law.length_below).statistic) * math.sqrt(n)
        rows.append(
            [model, "chords: largest distance of the distributions x √n", "below 1.63 in 99 %", f"{distance:.2f}", ""]
        )
        resultant = abs(np.exp(1j * np.deg2rad(one.azimuth_deg)).mean()) * math.sqrt(2.0 * n)
        rows.append([model, "azimuth: resultant x √(2 n)", "below 3.03 in 99 %", f"{resultant:.2f}", ""])
        charge, error = float(one.charge_e.mean()), float(one.charge_e.std(ddof=1)) / math.sqrt(n)
        rows.append(
            [
                model,
                "mean charge (e-)",
                f"{law.mean_charge_e:.1f}",
                f"{charge:.1f} ± {error:.1f}",
                f"{(charge - law.mean_charge_e) / error:+.1f}",
            ]
        )
        rows.append(
            [model, "electrons in pixels and outside less electrons of the tracks", "0", str(-one.lost_charge_e), ""]
        )
    return rows


def frame_rows(shots: list[Shot]) -> list[list[str]]:
    """Numbers of the frames."""
    rows = [
        [
            "model",
            "gain",
            "particles",
            "pixels hit",
            "above 5 e-",
            "above 50 e-",
            "at the register's full well",
            "tails",
            "median tail (px)",
            "longest tail (px)",
            "brightest ADU",
            "clipped pixels",
        ]
    ]
    for one in shots:
        size = one.rays.shape[0] * one.rays.shape[1]
        counts = [f"{np.count_nonzero(one.rays.electrons > level) / size:.1%}" for level in (0, 5, 50)]
        tails = one.tails if one.frame.n_register_saturated else np.zeros(0)
        rows.append(
            [
                one.model,
                f"{one.gain:g}",
                str(one.rays.n_events),
                *counts,
                f"{one.frame.n_register_saturated / size:.2%}",
                str(tails.size),
                f"{np.median(tails):g}" if tails.size else "",
                f"{tails.max():g}" if tails.size else "",
                str(int(one.frame.adu.max())),
                str(one.frame.n_clipped),
            ]
        )
    return rows


def figure_of(shots: list[Shot], *, whole: bool) -> Figure:
    """Four panels: a row a model, a column a gain."""
    detector = instrument(MODELS[0]).detector
    figure = new_figure(8.8)
    panels = figure.subplots(len(MODELS), len(GAINS), sharex=whole, sharey=whole)
    corners = {one.model: one.corner for one in shots if one.gain > 1}
    scales = {GAINS[0]: Normalize(-10.0, 40.0), GAINS[1]: AsinhNorm(10.0, -10.0, detector.adc_max_adu)}
    shown: dict[float, Any] = {}
    for panel, one in zip(panels.flat, shots, strict=True):
        image: Any = one.frame.adu - detector.bias_adu
        row, column = corners[one.model]
        options: dict[str, Any] = {"origin": "lower", "cmap": STACK_COLOURS, "norm": scales[one.gain]}
        if whole:
            shown[one.gain] = panel.imshow(image, **options)
            panel.add_patch(Rectangle((column, row), SIDE, SIDE, fill=False, ec="white", lw=1.0))
        else:
            part = image[row : row + SIDE, column : column + SIDE]
            extent = (column - 0.5, column + SIDE - 0.5, row - 0.5, row + SIDE - 0.5)
            shown[one.gain] = panel.imshow(part, extent=extent, interpolation="nearest", **options)
        panel.set_title(f"{one.model}, gain {one.gain:g}")
    for panel in panels[:, 0]:
        panel.set_ylabel("row (px)")
    for panel in panels[-1]:
        panel.set_xlabel("column (px)")
    for index, (gain, words) in enumerate(zip(GAINS, ("linear", "asinh, linear below 10"), strict=True)):
        label = f"ADU above the bias of {detector.bias_adu:g} ({words})"
        bar = figure.colorbar(
            shown[gain],
            ax=panels[:, index],
            label=label,
            location="bottom",
            shrink=0.9,
            extend="min" if index else "both",
            pad=0.02,
        )
        if index:
            bar.set_ticks(TICKS_ADU, labels=[f"{tick:g}" for tick in TICKS_ADU])
            bar.minorticks_off()
    return figure


def laws_figure(samples: dict[str, Sample]) -> Figure:
    """Histograms of charge and length over their laws."""
    figure = new_figure(4.0)
    left, right = figure.subplots(1, 2, sharey=True)
    for model, one in samples.items():
        law = Law(model)
        for panel, values, below, edges in (
            (left, one.charge_e, law.charge_below, np.geomspace(10.0, 1e5, 41)),
            (right, one.length_um, law.length_below, np.geomspace(10.0, 2e4, 45)),
        ):
            counts = np.histogram(values, edges)[0]
            width, n = np.diff(np.log10(edges)), values.size
            middle, seen = np.sqrt(edges[1:] * edges[:-1]), counts > 0
            panel.errorbar(
                middle[seen],
                (counts / width / n)[seen],
                (np.sqrt(counts) / width / n)[seen],
                fmt="o",
                ms=3.5,
                lw=1.0,
                color=COLOURS[model],
                label=f"{model}: drawn",
            )
            # Fractions in the same bins, so that points and law compare bin by bin.
            panel.stairs(np.diff(below(edges)) / width, edges, color=COLOURS[model], lw=1.2, label=f"{model}: law")
    left.set(
        xscale="log",
        yscale="log",
        xlabel="charge of a track (e-)",
        ylabel="fraction of tracks per decade",
        ylim=(3e-5, 10.0),
    )
    right.set(xscale="log", xlabel="length in the sensitive layer (µm)")
    for panel in (left, right):
        panel.grid(visible=True)
    right.legend(loc="upper right")
    return figure


def table(rows: list[list[str]]) -> str:
    """Rows as a table; the first is the head."""
    return "\n".join(f"| {' | '.join(row)} |" for row in [rows[0], ["---"] * len(rows[0]), *rows[1:]])


def report(shots: list[Shot], samples: dict[str, Sample]) -> str:
    """Text of the report."""
    paper, physical = Law("paper"), Law("physical")
    rows = frame_rows(shots)
    bright = {one.model: row for one, row in zip(shots, rows[1:], strict=True) if one.gain > 1}
    detector = instrument("paper").detector
    fills = detector.register_full_well_e / GAINS[1]
    return f"""# Cosmic rays

Regenerate with `python reports/cosmic_rays/make.py`; everything below is written by it.

The paper's figure of cosmic rays (Zhu et al. 2025): one exposure of {EXPOSURE_S:g} s at gain {GAINS[0]:g} and
{GAINS[1]:g}. It shows no scene, so these are closed exposures (`calibrate("DARK", ...)`) with every default effect of
the camera; hot pixels and bad columns alone are off, since in {EXPOSURE_S:g} s they fill the register as particles do.
The rate is the paper's peak of {RATE_PER_S_CM2:g} particle/s/cm², without the solar cycle. The same particles cross
the frames of both gains.

![four frames](frames.png)

*Whole frames. White square: the part shown below.*

![a part of the four frames](zoom.png)

*The {SIDE} x {SIDE} pixels of each model with most tails. The register is read from left to right.*

{table(rows)}

*Above 5 e-*, *above 50 e-*: of the charge before the register, of all pixels that particles can hit. *Tails*: runs of
pixels along a row that the register cut off or into which its excess spilled; at this gain it is full at
{fills:.0f} e- of a pixel.

The paper: "When EMCCD uses high electron multiplication, cosmic rays may cause saturated overflow, resulting in a
'tailing' phenomenon." So it is at gain {GAINS[1]:g}, and at gain {GAINS[0]:g} there is none. The tails are short, half
of them at most {bright["paper"][8]} pixels (`paper`) and {bright["physical"][8]} (`physical`): they grow by one pixel
for every {fills:.0f} e- that a pixel holds beyond what fills the register, and few hits leave more than that in one.
Tails by traps in the register are not modelled. Such an exposure is an illustration; science frames last
{detector.exposure_max_s:g} s at most.

## Two models, two laws

The paper's two numbers, a mean path of 200 µm and a mean charge of 2700 e-, are not those of one particle in silicon:
that would be {paper.mean_charge_e / paper.mean_length_um:.1f} e-/µm, where fast particles leave about
{instrument("physical").cosmic_rays.physical.mean_loss_e_um:g}.

- `paper` keeps both numbers: chords of a layer of {paper.depth_um:g} µm, and a charge that does not depend on them.
- `physical`, the default, keeps the particle: chords of the {physical.depth_um:g} µm of this detector, energy loss by
  Landau's law cut off where delta rays leave the layer. Its mean charge comes out at {physical.mean_charge_e:.0f} e-.

{EXPOSURES} exposures each, tracks whose middle lies on the pixels. The laws are worked out here from the configuration
by other means than those that draw the tracks.

{table(check_rows(samples))}

![charge and length of the tracks](laws.png)

*Fractions of the tracks in bins of charge and length. Points: drawn, with Poisson errors; steps: the law.*

Numbers are in `frames.csv` and `checks.csv`.
"""


def main() -> None:
    """Simulate, compare, draw."""
    argparse.ArgumentParser(description=__doc__).parse_args()
    with threadpool_limits(1):
        shots = [shot(model, gain) for model in MODELS for gain in GAINS]
        samples = {model: sample(model) for model in MODELS}
    with style():
        figures = {"frames": figure_of(shots, whole=True), "zoom": figure_of(shots, whole=False)}
        for name, figure in figures.items():
            picture = save(figure, "png", alt="", caption="")
            write_bytes(HERE / f"{name}.png", base64.b64decode(picture.uri.partition(",")[2]))
        laws = io.BytesIO()
        laws_figure(samples).savefig(laws, format="png", dpi=110, metadata={"Software": None})
        write_bytes(HERE / "laws.png", laws.getvalue())
    for name, rows in (("frames", frame_rows(shots)), ("checks", check_rows(samples))):
        text = io.StringIO()
        csv.writer(text, lineterminator="\n").writerows(rows)
        write_text(HERE / f"{name}.csv", text.getvalue())
    write_text(HERE / "report.md", report(shots, samples))
    print(HERE / "report.md")


if __name__ == "__main__":
    main()
