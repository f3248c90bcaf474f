"""Regenerate this report: ``python reports/star_shift/make.py`` (about a minute).

The star moved off the focal-plane mask for calibration, as in the paper (Zhu et al. 2025, figure of the shifted star):
images, saturation, and how well the flux of the star comes back from them.
"""

from __future__ import annotations

import argparse
import csv
import io
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from cpic_core import write_bytes, write_text
from cpic_planner.report import style
from cpic_planner.validation import images_of
from simulator import Observation, load_instrument, observe, single_band_psf
from simulator.camera import to_electrons
from simulator.imaging import Psf, overlap_weights

HERE = Path(__file__).resolve().parent
SCENE, BAND, EXPOSURE_S, FRAMES = "paper_example", "F520", 0.01, 50
SHIFTS_ARCSEC = (0.0, 0.2, 0.5, 1.0)
DIRECTIONS = {"diagonal": (math.sqrt(0.5), math.sqrt(0.5)), "axis": (1.0, 0.0)}
CALIBRATION_ARCSEC = (0.5, 1.0)
REALISATIONS = 10
PLACES = 5  # per pixel and axis
CURVE_ARCSEC = (0.0, 0.1, 0.15, 0.19, 0.2, 0.22, 0.25, 0.27, 0.3, 0.35, 0.4, 0.5, 0.7, 1.0)

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Shifted:
    """Co-added frames of one shift."""

    direction: str
    shift_arcsec: float
    seen: Observation
    electrons: FloatArray
    lost_pixels: int
    brightest_adu: int

    @property
    def mean_peak_e(self) -> float:
        """Electrons of the brightest pixel in one frame, on average."""
        return float(self.seen.mean_rate_map.max()) * self.seen.exposure_s

    @property
    def aperture(self) -> tuple[float, float, float]:
        """Electrons in the aperture at the known place of the star: measured, expected without noise, and variance."""
        seen, detector = self.seen, self.seen.instrument.detector
        pixel = detector.pixel_scale_arcsec
        x, y = (offset / pixel for offset in seen.star_offset_arcsec)
        column, row = (round(value) for value in (x, y))
        weights = overlap_weights(seen.psf.metrics.aperture_radius_arcsec / pixel, y - row, x - column)
        half = len(weights) // 2
        top, left = seen.area.centre[0] + row - half, seen.area.centre[1] + column - half
        part = (slice(top, top + len(weights)), slice(left, left + len(weights)))
        total_s = seen.exposure_s * seen.n_frames
        mean = seen.mean_rate_map[part] * total_s
        pixels = (
            detector.read_noise_e**2 * seen.n_frames + detector.dark_rate_e_s * total_s + detector.cic_e * seen.n_frames
        )
        variance = float((weights**2 * (mean + pixels)).sum())
        return float((weights * self.electrons[part]).sum()), float((weights * mean).sum()), variance


def shifted(band: str, direction: str, shift_arcsec: float, realisation: int = 0) -> Shifted:
    """Simulate one set of frames and add them up, bias, mean dark and clock-induced charge taken off."""
    x, y = (part * shift_arcsec for part in DIRECTIONS[direction])
    seen = observe(
        SCENE,
        band=band,
        exposure_s=EXPOSURE_S,
        n_frames=FRAMES,
        role="calibration",
        window="hole",
        realisation=realisation,
        star_offset_arcsec=(x, y),
        # Calibration undoes the smear, a thousandth of the star in so short frames.
        instrument=images_of(load_instrument()).switched({"smear": False}),
    )
    detector, total, lost, brightest = seen.instrument.detector, np.zeros(seen.shape), 0, 0
    for index in range(FRAMES):
        frame = seen.frame(index)
        total += to_electrons(frame.adu, detector, seen.em_gain)
        lost, brightest = max(lost, int(frame.lost.sum())), max(brightest, int(frame.adu.max()))
    total -= FRAMES * (detector.cic_e + detector.dark_rate_e_s * EXPOSURE_S)
    return Shifted(direction, shift_arcsec, seen, total, lost, brightest)


def figure_of(images: dict[tuple[str, float], Shifted]) -> Figure:
    """Images: a row a direction, a column a shift."""
    figure = Figure(figsize=(11.0, 5.7), layout="constrained")
    panels = figure.subplots(len(DIRECTIONS), len(SHIFTS_ARCSEC), sharex=True, sharey=True)
    for row, direction in zip(panels, DIRECTIONS, strict=True):
        for panel, shift in zip(row, SHIFTS_ARCSEC, strict=True):
            one = images[direction, shift]
            metrics = one.seen.psf.metrics
            half = one.seen.area.columns[-1] + metrics.pixel_scale_arcsec / 2
            shown = panel.imshow(
                np.maximum(one.electrons, 1.0),
                origin="lower",
                cmap="viridis",
                norm=LogNorm(1e3, 4e6),
                extent=(-half, half, -half, half),
            )
            w = metrics.mask_half_width_arcsec
            for x in (-w, w):
                for y in (-w, w):
                    panel.plot([x, x, math.copysign(half, x)], [math.copysign(half, y), y, y], color="white", lw=0.7)
            panel.plot(*one.seen.star_offset_arcsec, marker="+", ms=9, mew=1.0, color="#D55E00")
            panel.set(xlim=(-half, half), ylim=(-half, half), xticks=(-1, 0, 1), yticks=(-1, 0, 1))
            if direction == "diagonal":
                panel.set_title(f"shift {shift:g}″" if shift else "no shift")
    for panel, name in zip(panels[:, 0], DIRECTIONS, strict=True):
        panel.set_ylabel(f"along the {name}\ny (arcsec)")
    for panel in panels[-1]:
        panel.set_xlabel("x (arcsec)")
    label = f"electrons per pixel, {FRAMES} frames of {EXPOSURE_S:g} s"
    figure.colorbar(shown, ax=panels, label=label, shrink=0.9, extend="both")
    return figure


def image_rows(images: dict[tuple[str, float], Shifted]) -> list[list[str]]:
    """Numbers of the images."""
    rows = [
        [
            "direction",
            "shift (arcsec)",
            "x, y (arcsec)",
            "core throughput",
            "share of an open core",
            "peak (e- / frame)",
            "of the full well",
            "brightest ADU",
            "pixels cut off",
        ]
    ]
    for (direction, shift), one in images.items():
        x, y = one.seen.star_offset_arcsec
        metrics, detector = one.seen.psf.metrics, one.seen.instrument.detector
        core = float(metrics.core_throughput(x, y))
        rows.append(
            [
                direction,
                f"{shift:g}",
                f"{x:.3f}, {y:.3f}",
                f"{core:.4f}",
                f"{core / metrics.core_open:.3f}",
                f"{one.mean_peak_e:.0f}",
                f"{one.mean_peak_e / detector.full_well_e:.1%}",
                f"{one.brightest_adu} of {detector.adc_max_adu}",
                str(one.lost_pixels),
            ]
        )
    return rows


def calibration_rows() -> list[list[str]]:
    """Flux of the star from aperture photometry, over the truth, in every band."""
    rows = [
        [
            "band",
            "shift (arcsec)",
            "peak (e- / frame)",
            "of the full well",
            "core throughput",
            "noise-free / true - 1",
            "measured / true - 1",
            "error of one set",
            "scatter / error",
            "places in a pixel: mean",
            "rms",
        ]
    ]
    for band in load_instrument().visible_bands():
        for shift in CALIBRATION_ARCSEC:
            sets = [shifted(band, "diagonal", shift, number) for number in range(REALISATIONS)]
            first = sets[0].seen
            core = float(first.psf.metrics.core_throughput(*first.star_offset_arcsec))
            true = first.truth.sources[0].rate_e_s * EXPOSURE_S * FRAMES * core
            sums = np.array([one.aperture for one in sets])
            ratio, error = sums[:, 0] / true - 1.0, float(np.sqrt(sums[:, 2].mean())) / true
            rows.append(
                [
                    band,
                    f"{shift:g}",
                    f"{sets[0].mean_peak_e:.0f}",
                    f"{sets[0].mean_peak_e / first.instrument.detector.full_well_e:.1%}",
                    f"{core:.4f}",
                    f"{sums[:, 1].mean() / true - 1.0:+.2%}",
                    f"{ratio.mean():+.3%} ± {ratio.std(ddof=1) / math.sqrt(REALISATIONS):.3%}",
                    f"{error:.3%}",
                    f"{(sums[:, 0] - sums[:, 1]).std(ddof=1) / true / error:.2f}",
                    f"{(places := within_a_pixel(first.psf, shift))[0]:+.3%}",
                    f"{places[1]:.3%}",
                ]
            )
    return rows


def within_a_pixel(psf: Psf, shift_arcsec: float) -> tuple[float, float]:
    """Aperture sum over core throughput, less one, on the places of a grid in a pixel: mean and rms about it."""
    pixel, middle = psf.pixel_scale_arcsec, len(psf.on_axis) // 2
    nearest = round(shift_arcsec * math.sqrt(0.5) / pixel)
    fractions = (np.arange(PLACES) - PLACES // 2) / PLACES
    ratios = []
    for dx in fractions:
        for dy in fractions:
            x, y = ((nearest + part) * pixel for part in (dx, dy))
            weights = overlap_weights(psf.metrics.aperture_radius_arcsec / pixel, dy, dx)
            low = middle + nearest - len(weights) // 2
            part = psf.at(x, y)[low : low + len(weights), low : low + len(weights)]
            ratios.append(float((weights * part).sum() / psf.metrics.core_throughput(x, y)) - 1.0)
    return float(np.mean(ratios)), float(np.std(ratios))


def curve_rows() -> list[list[str]]:
    """What the mask leaves of the core, by shift."""
    default, two = load_instrument(), load_instrument("cpic_2q")
    metrics = {band: single_band_psf(band, instrument=default).metrics for band in default.visible_bands()}
    columns: dict[str, tuple[Any, str]] = {f"diagonal, {band}": (own, "diagonal") for band, own in metrics.items()}
    columns["axis, every band"] = (metrics[BAND], "axis")
    columns[f"diagonal, {BAND}, `cpic_2q`"] = (single_band_psf(BAND, instrument=two).metrics, "diagonal")
    rows = [["shift_arcsec", *columns]]
    for shift in CURVE_ARCSEC:
        cells = [f"{shift:g}"]
        for own, direction in columns.values():
            x, y = (part * shift for part in DIRECTIONS[direction])
            cells.append(f"{float(own.core_throughput(x, y)) / own.core_open:.3f}")
        rows.append(cells)
    return rows


def table(rows: list[list[str]]) -> str:
    """Rows as a table; the first is the head."""
    return "\n".join(f"| {' | '.join(row)} |" for row in [rows[0], ["---"] * len(rows[0]), *rows[1:]])


def report(images: dict[tuple[str, float], Shifted], calibration: list[list[str]], curve: list[list[str]]) -> str:
    """Text of the report."""
    one = images["diagonal", 1.0]
    star, instrument = one.seen.truth.sources[0], one.seen.instrument
    mask = instrument.mask_half_width_arcsec(BAND)
    return f"""# The star moved off the mask

Regenerate with `python reports/star_shift/make.py`; everything below is written by it.

The paper's calibration without a coronagraph (Zhu et al. 2025, figure of the shifted star): its example star
({star.name}, {star.rate_e_s:.3g} e-/s on the clear 2 m disc) in {BAND}, {EXPOSURE_S:g} s x {FRAMES} frames, gain 1,
moved by {", ".join(f"{shift:g}" for shift in SHIFTS_ARCSEC)} arcsec: `observe(..., star_offset_arcsec=(x, y))`.
The paper does not say in which direction; the cross mask makes it matter. Its arms have a half width of
{mask:g} arcsec.

![co-added images of the shifted star](shifts.png)

*Bias, mean dark and clock-induced charge taken off. White: edges of the cross mask; plus: the star.*

{table(image_rows(images))}

- Along a diagonal 0.2 arcsec put the star at {0.2 * math.sqrt(0.5):.3f} arcsec per axis, still behind the mask: its
  skirt shows, its core does not. From 0.3 arcsec on the mask takes nothing from the aperture in {BAND}.
- Along an axis the star stays behind an arm of the cross at every shift; what is seen are its outermost wings. So a
  calibration needs a shift along a diagonal.
- No frame saturates: the full well of {instrument.detector.full_well_e:g} e- leaves a tenth to spare. That is by
  choice: the optical transmission (0.19) is the largest with which the paper's {EXPOSURE_S:g} s frame stays below it.

## Flux of the star

Aperture of 0.7 lambda/D at the known place of the star, divided by `core_throughput` there, over the true electrons on
the clear disc; mean of {REALISATIONS} sets of {FRAMES} frames. *Noise-free*: the same on the expected image. What is
left there is the place of the star within its pixel, over which `core_throughput` is a mean: the last columns give it
for {PLACES} x {PLACES} places. *Scatter / error*: of the measured sums about the noise-free ones, over photon and read
noise as predicted (its own uncertainty is {1 / math.sqrt(2 * REALISATIONS - 2):.0%}).

{table(calibration)}

## What the mask leaves of the core

Core throughput over its value far from the mask.

{table([["shift (arcsec)", *curve[0][1:]], *curve[1:]])}

The companion of the example star is left out, as in the paper.
"""


def main() -> None:
    """Simulate, measure, draw."""
    argparse.ArgumentParser(description=__doc__).parse_args()
    with threadpool_limits(1):
        images = {
            (direction, shift): shifted(BAND, direction, shift) for direction in DIRECTIONS for shift in SHIFTS_ARCSEC
        }
        calibration, curve = calibration_rows(), curve_rows()
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows([[head.replace("`", "") for head in curve[0]], *curve[1:]])
    write_text(HERE / "core.csv", text.getvalue())
    with style():
        image = io.BytesIO()
        figure_of(images).savefig(image, format="png", dpi=110, metadata={"Software": None})
        write_bytes(HERE / "shifts.png", image.getvalue())
    write_text(HERE / "report.md", report(images, calibration, curve))
    print(HERE / "report.md")


if __name__ == "__main__":
    main()
