"""Regenerate this report: ``python -m tools.reports imaging_speed``.

How long images take on one thread, beside the grid of 4 x 4 cells of the paper (Zhu et al. 2025) and HCIPy's
propagation, and how exact they are.
"""

from __future__ import annotations

import argparse
import csv
import io
import logging
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from cpic_core import write_text
from simulator import Psf, load_instrument, single_band_psf
from simulator.config import Instrument
from simulator.imaging import aperture_sums, build_imager, centred_axis, overlap_weights, pixel_axis
from simulator.imaging.build import aberrations_of, bare_imager, configured_mirror, dig
from simulator.imaging.dark_hole import Conjugation, default_settings
from simulator.imaging.imager import Imager
from simulator.imaging.psf import forget_stamps, wide_on_axis
from simulator.imaging.scene_image import CELLS, BandTransfer, PointSources, paper_scene_image, scene_image
from simulator.knobs import FIDELITIES, Knobs
from tools.report_parts import machine

HERE = Path(__file__).resolve().parent
BAND, HOLE_BAND = "F520", "F662"  # the finest image of the four, and the band of the Jacobian
SIDE, FRAME_SIDE, COUNTS = 1024, 1081, (1, 10, 100, 1000)
KERNEL_HALF = 256
ROUNDS = 5
ERRORS = ("peak", "aperture", "mean of the hole", "rms in the hole (contrast)")

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Timing:
    """Median seconds of one job."""

    name: str
    cpu_s: float
    wall_s: float
    rounds: int
    asked_s: float | None = None
    versus: str = ""


class Clock:
    """Collects timings."""

    def __init__(self) -> None:
        self.rows: dict[str, Timing] = {}

    def run(
        self,
        name: str,
        job: Callable[[], Any],
        *,
        rounds: int = ROUNDS,
        asked_s: float | None = None,
        versus: str = "",
        times: int = 1,
    ) -> Any:
        """Time a job, once before it counts unless it is run a single time; ``times`` multiplies the answer."""
        answer = job() if rounds > 1 else None
        cpu, wall = [], []
        for _ in range(rounds):
            began = time.process_time(), time.perf_counter()
            answer = job()
            cpu.append(time.process_time() - began[0])
            wall.append(time.perf_counter() - began[1])
        self.add(Timing(name, times * float(np.median(cpu)), times * float(np.median(wall)), rounds, asked_s, versus))
        return answer

    def add(self, timing: Timing) -> None:
        """Keep a timing."""
        self.rows[timing.name] = timing
        print(f"{timing.name}: {timing.cpu_s:.3f} s of processor, {timing.wall_s:.3f} s", flush=True)

    def table(self, names: list[str]) -> str:
        """Some of the timings."""
        lines = [
            "| job | processor time (s) | wall clock (s) | asked (s) | met | times longer than ours |",
            "|---|---|---|---|---|---|",
        ]
        for name in names:
            row = self.rows[name]
            ratio = f"{row.cpu_s / self.rows[row.versus].cpu_s:.1f}" if row.versus else ""
            met = "" if row.asked_s is None else "yes" if row.cpu_s <= row.asked_s else "**no**"
            asked = "" if row.asked_s is None else f"{row.asked_s:g}"
            lines.append(f"| {name} | {row.cpu_s:.3g} | {row.wall_s:.3g} | {asked} | {met} | {ratio} |")
        return "\n".join(lines)


def time_psfs(clock: Clock, instrument: Instrument) -> list[str]:
    """Stamps of four bands, and one band over the whole frame."""
    bands, names = instrument.visible_bands(), []

    def run(name: str, job: Callable[[], Any], **options: Any) -> None:
        names.append(name)
        clock.run(name, job, **options)

    def stamps(fidelity: str, engine: Any = "matrix") -> list[Psf]:
        forget_stamps()
        return [single_band_psf(band, fidelity=fidelity, instrument=instrument, engine=engine) for band in bands]

    ours = "four bands, 137 px, `standard`"
    run(ours, lambda: stamps("standard"), asked_s=0.5)
    run("four bands, 137 px, `quick`", lambda: stamps("quick"))
    run("four bands, 137 px, `reference`", lambda: stamps("reference"))
    run(f"{ours}, HCIPy", lambda: stamps("standard", "hcipy"), versus=ours)
    imager = build_imager(instrument, BAND)
    axis = imager.stamp_axis(masked=True, n_pixels=FRAME_SIDE)
    wide = f"{BAND}, star behind the mask, {FRAME_SIDE} px, `standard` nodes"
    run(wide, lambda: imager.image(axis, axis), rounds=3)
    run(f"{wide}, HCIPy", lambda: imager.image(axis, axis, engine="hcipy"), rounds=1, versus=wide)
    centres, star = centred_axis(FRAME_SIDE, imager.pixel_scale_arcsec), PointSources([0.0], [0.0], [1.0])
    exact = f"{BAND}, star behind the mask, {FRAME_SIDE} px, closed-form pixels"
    run(
        exact,
        lambda: scene_image(
            BandTransfer(imager),
            centres,
            centres,
            imager.pixel_scale_arcsec,
            star,
            mask_half_width_arcsec=imager.mask_half_width_arcsec,
        ),
    )
    middle = (FRAME_SIDE // 2, FRAME_SIDE // 2)
    run(
        f"{BAND}, star behind the mask, {FRAME_SIDE} px, one node a pixel (whole frames)",
        lambda: wide_on_axis(BAND, instrument, (FRAME_SIDE, FRAME_SIDE), middle),
    )
    large = Knobs(stamp_pixels=FRAME_SIDE)
    run(
        f"{BAND}, `single_band_psf`, both stamps of {FRAME_SIDE} px, `standard`",
        lambda: single_band_psf(BAND, fidelity=large, instrument=instrument),
        rounds=3,
        asked_s=2.0,
    )
    return names


def time_holes(clock: Clock, instrument: Instrument) -> list[str]:
    """Searches, and one Jacobian beside HCIPy's propagation of every actuator."""
    names = []
    for preset, label in (("cpic_default", "4q"), ("cpic_2q", "2q")):
        chosen = load_instrument(preset)
        for band in chosen.visible_bands():
            names.append(f"dark hole {label}, {band}")
            clock.run(names[-1], lambda chosen=chosen, band=band: dig(chosen, band), rounds=1, asked_s=70.0)
    imager, mirror = bare_imager(instrument, HOLE_BAND), configured_mirror(instrument)
    aberrations = aberrations_of(instrument)
    assert aberrations is not None
    aberrations = aberrations.upsampled(len(imager.transmission))
    settings = default_settings("4q")
    problem = Conjugation(imager, aberrations, mirror, imager.zone, settings)
    rest = np.zeros(mirror.alive.shape)
    ours = f"Jacobian, {HOLE_BAND}, one wavelength, {rest.size} actuators"
    clock.run(ours, lambda: problem.jacobian(rest, 0))
    points = imager.zone.control_axes(
        settings.step_lambda_d * imager.lambda_d_arcsec, settings.margin_lambda_d * imager.lambda_d_arcsec
    )
    theirs = f"one HCIPy propagation to the same points x {rest.size} (finite differences)"
    seen = build_imager(instrument, HOLE_BAND)
    clock.run(theirs, lambda: seen.field(0, *points, engine="hcipy"), versus=ours, times=rest.size)
    return [*names, ours, theirs]


def random_sources(count: int, pixel: float) -> PointSources:
    """Sources anywhere on the frame, over three decades of flux."""
    rng = np.random.default_rng(count)
    half = SIDE / 2 * pixel
    return PointSources(*rng.uniform(-half, half, (2, count)), 10.0 ** rng.uniform(-3.0, 0.0, count))


def time_scenes(clock: Clock, imager: Imager) -> list[str]:
    """Scenes on 1024 x 1024 pixels."""
    pixel, names = imager.pixel_scale_arcsec, []
    axis = centred_axis(SIDE, pixel)
    for count in COUNTS:
        sources = random_sources(count, pixel)
        names.append(f"ours, {count} sources" if count > 1 else "ours, 1 source")
        clock.run(
            names[-1],
            lambda sources=sources: ours_of(imager, axis, axis, sources),
            asked_s=1.0 if count == 1000 else None,
        )
    first, last = names[0], names[-1]
    names.append(f"4 x 4 cells, 1000 sources, kernels of {2 * KERNEL_HALF + 1} px made anew")
    many = random_sources(1000, pixel)
    clock.run(
        names[-1],
        lambda: paper_scene_image(imager, axis, axis, many, kernel_half_pixels=KERNEL_HALF),
        rounds=1,
        versus=last,
    )
    names.append("4 x 4 cells, any number of sources, as one convolution by FFT, kernel not counted")
    clock.run(
        names[-1], convolution(CELLS * (SIDE + 2 * KERNEL_HALF), 2 * CELLS * KERNEL_HALF + 1), rounds=3, versus=last
    )
    point, nodes = imager.axis(axis, masked=True, pixel_nodes=1), imager.axis(axis, masked=True)
    names.append("HCIPy, 1 source, one node a pixel")
    clock.run(
        names[-1], lambda: imager.image(point, point, source_arcsec=(1.0, 1.0), engine="hcipy"), rounds=1, versus=first
    )
    names.append("HCIPy, 1 source")
    clock.run(
        names[-1], lambda: imager.image(nodes, nodes, source_arcsec=(1.0, 1.0), engine="hcipy"), rounds=1, versus=first
    )
    one = clock.rows[names[-1]]
    for count in COUNTS[1:]:
        name = f"HCIPy, {count} sources ({count} x one)"
        clock.add(Timing(name, count * one.cpu_s, count * one.wall_s, 1, versus=f"ours, {count} sources"))
        names.append(name)
    return names


def convolution(side: int, kernel_side: int) -> Callable[[], Any]:
    """A job that convolves a grid of that side."""
    from scipy.signal import oaconvolve

    grid, kernel = np.ones((side, side)), np.ones((kernel_side, kernel_side))
    return lambda: oaconvolve(grid, kernel, mode="valid")


def ours_of(imager: Imager, y: FloatArray, x: FloatArray, sources: PointSources) -> FloatArray:
    """The exact scene behind the mask."""
    return scene_image(
        BandTransfer(imager),
        y,
        x,
        imager.pixel_scale_arcsec,
        sources,
        mask_half_width_arcsec=imager.mask_half_width_arcsec,
    )


def near(centre: float) -> NDArray[np.intp]:
    """Indices of the frame within eight pixels of a position."""
    return np.arange(max(round(centre) - 8, 0), min(round(centre) + 9, SIDE))


def propagated(imager: Imager, y: FloatArray, x: FloatArray, sources: PointSources) -> FloatArray:
    """Each source by its own propagation, eight nodes a pixel."""
    rows, columns = (
        pixel_axis(centres, imager.pixel_scale_arcsec, 8, imager.mask_half_width_arcsec, imager.jitter_arcsec)
        for centres in (y, x)
    )
    images = (
        flux * imager.image(rows, columns, source_arcsec=(at_x, at_y))
        for at_x, at_y, flux in zip(*sources.arrays, strict=True)
    )
    return np.asarray(sum(images))


def scene_errors(imager: Imager) -> dict[str, float]:
    """Largest errors in units of a source's own peak: in the scene of 1000, and of one source at twelve places."""
    pixel = imager.pixel_scale_arcsec
    axis, sources = centred_axis(SIDE, pixel), random_sources(1000, pixel)
    x, y, flux = sources.arrays
    image = ours_of(imager, axis, axis, sources)
    peak = float(imager.intensity(np.zeros(1), np.zeros(1))[0, 0])
    crowd = 0.0
    for index in (int(flux.argmin()), int(flux.argmax())):
        rows, columns = near(y[index] / pixel + SIDE // 2), near(x[index] / pixel + SIDE // 2)
        exact = propagated(imager, axis[rows], axis[columns], sources)
        crowd = max(crowd, float(np.abs(image[np.ix_(rows, columns)] - exact).max() / (flux[index] * peak)))
    rng, worst, cells = np.random.default_rng(12), [], []
    stamp = centred_axis(137, pixel)
    for place in rng.uniform(0.4, 0.8, (12, 2)):
        one = PointSources(place[:1], place[1:], [1.0])
        rows, columns = (np.abs(stamp - value) < 0.2 for value in (place[1], place[0]))
        exact = propagated(imager, stamp[rows], stamp[columns], one)
        worst.append(np.abs(ours_of(imager, stamp[rows], stamp[columns], one) - exact).max() / peak)
        paper = paper_scene_image(imager, stamp[rows], stamp[columns], one, kernel_half_pixels=24)
        cells.append(np.abs(paper - exact).max() / peak)
    return {"crowd": crowd, "ours": float(max(worst)), "paper": float(max(cells)), "paper_mean": float(np.mean(cells))}


def compare(psf: Psf, best: Psf) -> list[float]:
    """Relative errors of peak, aperture and mean of the hole, and rms error of its pixels in raw contrast."""
    weights = overlap_weights(psf.imager.aperture_radius_arcsec / psf.pixel_scale_arcsec)
    middle, peak = len(psf.off_axis) // 2, float(best.off_axis.max())
    cores = [float(aperture_sums(one.off_axis, weights)[middle, middle]) for one in (psf, best)]
    offset = centred_axis(len(psf.off_axis), psf.pixel_scale_arcsec)
    hole = psf.imager.zone.covers(offset, offset)
    rms = float(np.sqrt(((psf.on_axis - best.on_axis)[hole] ** 2).mean())) / peak
    mean = float(psf.on_axis[hole].mean() / best.on_axis[hole].mean())
    return [abs(float(psf.off_axis.max()) / peak - 1), abs(cores[0] / cores[1] - 1), abs(mean - 1), rms]


def tier_table(instrument: Instrument) -> str:
    """Errors of the tiers in every band, as the PSFs state them."""
    heads = ["tier", "band", *ERRORS]
    lines = [f"| {' | '.join(heads)} |", "|" + "---|" * len(heads)]
    for tier in FIDELITIES:
        for band in instrument.visible_bands():
            psf = single_band_psf(band, fidelity=tier, instrument=instrument)
            if tier == "reference":
                finer = Knobs(pupil_samples=512, wavelength_nodes=11, pixel_nodes=8)
                values = compare(psf, single_band_psf(band, fidelity=finer, instrument=instrument))
            else:
                error = psf.estimated_error
                values = [error.peak, error.aperture, error.hole_mean, error.hole_rms]
            lines.append(f"| `{tier}` | {band} | {' | '.join(f'{value:.0e}' for value in values)} |")
    return "\n".join(lines)


def report(clock: Clock, groups: list[list[str]], errors: dict[str, float], tiers: str) -> str:
    """Text of the report."""
    return f"""# Speed and exactness of images

Regenerate with `python -m tools.reports imaging_speed`; everything below is written by it.

{machine("numpy")}, one thread.
Medians of {ROUNDS} warm runs of our own code (three of the largest images), single runs of searches and other methods.
The verdict is by processor time: on one thread it is the wall clock of an idle machine.
The default instrument.

## Point-spread functions

A stamp pair is the star behind the mask and a source off the axis, mirror, aberrations and jitter included. HCIPy
propagates to the same points of the focal plane, at the same wavelengths.

{clock.table(groups[0])}

## Dark holes

Dug once and kept; those of the shipped instruments come with the package. The time of a Jacobian by HCIPy is that of
one propagation times the number of actuators, without making the pupils.

{clock.table(groups[1])}

## Scenes on {SIDE} x {SIDE} pixels

{BAND}, behind the mask, sources anywhere on the frame over three decades of flux. *Ours* integrates every pixel in
closed form and reaches over the whole frame. *4 x 4 cells*: the method that the paper describes, as we read it
(`scene_model="paper"`, laid down source by source; its own code was not run); its kernel ends at {KERNEL_HALF} px, and
it does not honour the mask.
*HCIPy*: the `standard` nodes; with one node a pixel the error is some 5 % on the steepest pixels.

{clock.table(groups[2])}

Errors in units of the source's own peak, against every source propagated by itself with eight nodes a pixel:

| | asked | largest error |
|---|---|---|
| ours, the faintest and the brightest of 1000 sources | 1e-06 | {errors["crowd"]:.0e} |
| ours, one source at 12 places | 1e-06 | {errors["ours"]:.0e} |
| 4 x 4 cells, one source at the same places | | {errors["paper"]:.1e} (mean {errors["paper_mean"]:.1e}) |

## Numerical errors of the tiers

`Psf.estimated_error`: differences from the `reference` settings; those of `reference` itself from 11 wavelengths, 8
nodes a pixel and 512 samples. Peak, aperture and mean are relative. These are errors of the numerics, not of the
assumptions.

{tiers}

Medians are in `times.csv`.
"""


def main() -> None:
    """Time, compare, write."""
    argparse.ArgumentParser(description=__doc__).parse_args()
    logging.getLogger("simulator.imaging").setLevel(logging.ERROR)
    instrument, clock = load_instrument(), Clock()
    with threadpool_limits(1):
        imager = build_imager(instrument, BAND)
        groups = [time_psfs(clock, instrument), time_holes(clock, instrument), time_scenes(clock, imager)]
        text = report(clock, groups, scene_errors(imager), tier_table(instrument))
    rows = io.StringIO()
    writer = csv.writer(rows, lineterminator="\n")
    writer.writerow(["job", "cpu_s", "wall_s", "rounds", "asked_s"])
    for row in clock.rows.values():
        asked = "" if row.asked_s is None else f"{row.asked_s:g}"
        writer.writerow([row.name.replace("`", ""), f"{row.cpu_s:.4g}", f"{row.wall_s:.4g}", row.rounds, asked])
    write_text(HERE / "times.csv", rows.getvalue())
    write_text(HERE / "report.md", text)
    print(HERE / "report.md")


if __name__ == "__main__":
    main()
