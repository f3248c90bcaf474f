"""Regenerate this report: ``python -m tools.reports imaging_speed``.

How long images take on one thread, and how exact they are beside the grid of 4 x 4 cells of the paper (Zhu et al. 2025)
and beside every source propagated by itself.
"""

from __future__ import annotations

import logging
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from cpic_core import write_text
from simulator import Psf, load_instrument, single_band_psf
from simulator.config import Instrument
from simulator.imaging import aperture_sums, build_imager, centred_axis, overlap_weights, pixel_axis
from simulator.imaging.imager import Imager
from simulator.imaging.psf import forget_stamps
from simulator.imaging.scene_image import BandTransfer, PointSources, paper_scene_image, scene_image
from simulator.knobs import FIDELITIES, Knobs
from tools.report_parts import Timing, columns, machine, table, timed

HERE = Path(__file__).resolve().parent
BAND = "F520"  # the finest image of the four
SIDE, COUNTS, ROUNDS = 1024, (1, 10, 100, 1000), 5
ERRORS = ("peak", "aperture", "mean of the hole", "rms in the hole (contrast)")

FloatArray = NDArray[np.float64]


def stamps(instrument: Instrument, fidelity: str) -> list[Psf]:
    """Stamps of four bands, made anew."""
    forget_stamps()
    return [single_band_psf(band, fidelity=fidelity, instrument=instrument) for band in instrument.visible_bands()]


def random_sources(count: int, pixel: float) -> PointSources:
    """Sources anywhere on the frame, over three decades of flux."""
    rng = np.random.default_rng(count)
    half = SIDE / 2 * pixel
    return PointSources(*rng.uniform(-half, half, (2, count)), 10.0 ** rng.uniform(-3.0, 0.0, count))


def times(instrument: Instrument, imager: Imager) -> list[Timing]:
    """Stamps of the tiers, and scenes on 1024 x 1024 pixels."""
    found = [
        timed(f"four bands, 137 px, `{tier}`", partial(stamps, instrument, tier), ROUNDS)
        for tier in ("standard", "quick", "reference")
    ]
    pixel = imager.pixel_scale_arcsec
    axis = centred_axis(SIDE, pixel)
    for count in COUNTS:
        sources = random_sources(count, pixel)
        name = f"ours, {count} sources" if count > 1 else "ours, 1 source"
        found.append(timed(name, partial(ours_of, imager, axis, axis, sources), ROUNDS))
    return found


def ours_of(imager: Imager, y: FloatArray, x: FloatArray, sources: PointSources) -> FloatArray:
    """The exact scene behind the mask."""
    half = imager.mask_half_width_arcsec
    return scene_image(BandTransfer(imager), y, x, imager.pixel_scale_arcsec, sources, mask_half_width_arcsec=half)


def near(centre: float) -> NDArray[np.intp]:
    """Indices of the frame within eight pixels of a position."""
    return np.arange(max(round(centre) - 8, 0), min(round(centre) + 9, SIDE))


def propagated(imager: Imager, y: FloatArray, x: FloatArray, sources: PointSources) -> FloatArray:
    """Each source by its own propagation, eight nodes a pixel."""
    rows, columns_ = (
        pixel_axis(centres, imager.pixel_scale_arcsec, 8, imager.mask_half_width_arcsec, imager.jitter_arcsec)
        for centres in (y, x)
    )
    images = (
        flux * imager.image(rows, columns_, source_arcsec=(at_x, at_y))
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
        rows, columns_ = near(y[index] / pixel + SIDE // 2), near(x[index] / pixel + SIDE // 2)
        exact = propagated(imager, axis[rows], axis[columns_], sources)
        crowd = max(crowd, float(np.abs(image[np.ix_(rows, columns_)] - exact).max() / (flux[index] * peak)))
    rng, worst, cells = np.random.default_rng(12), [], []
    stamp = centred_axis(137, pixel)
    for place in rng.uniform(0.4, 0.8, (12, 2)):
        one = PointSources(place[:1], place[1:], [1.0])
        rows, columns_ = (np.abs(stamp - value) < 0.2 for value in (place[1], place[0]))
        exact = propagated(imager, stamp[rows], stamp[columns_], one)
        worst.append(np.abs(ours_of(imager, stamp[rows], stamp[columns_], one) - exact).max() / peak)
        paper = paper_scene_image(imager, stamp[rows], stamp[columns_], one, kernel_half_pixels=24)
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
    lines = []
    for tier in FIDELITIES:
        for band in instrument.visible_bands():
            psf = single_band_psf(band, fidelity=tier, instrument=instrument)
            if tier == "reference":
                finer = Knobs(pupil_samples=512, wavelength_nodes=11, pixel_nodes=8)
                values = compare(psf, single_band_psf(band, fidelity=finer, instrument=instrument))
            else:
                error = psf.estimated_error
                values = [error.peak, error.aperture, error.hole_mean, error.hole_rms]
            lines.append([f"`{tier}`", band, *(f"{value:.0e}" for value in values)])
    return table(["tier", "band", *ERRORS], lines)


def report(rows: list[Timing], errors: dict[str, float], tiers: str) -> str:
    """Text of the report."""
    cells = {"job": "{0.job}", "processor time (s)": "{0.cpu_s:.3g}", "wall clock (s)": "{0.wall_s:.3g}"}
    return f"""# Speed and exactness of images

Regenerate with `python -m tools.reports imaging_speed`; everything below is written by it.

## Times

{machine("numpy")}, one thread, medians of {ROUNDS} warm runs, the default instrument.

A stamp pair is the star behind the mask and a source off the axis, mirror, aberrations and jitter included. Scenes have
{SIDE} x {SIDE} pixels of {BAND}, behind the mask, and sources anywhere on the frame over three decades of flux.
`make bench` times the same and more, beside HCIPy.

{columns(rows, cells)}

## Errors of scenes

*Ours* integrates every pixel in closed form and reaches over the whole frame. *4 x 4 cells*: the method that the paper
describes, as we read it (`scene_model="paper"`, laid down source by source; its own code was not run). Errors in units
of the source's own peak, against every source propagated by itself with eight nodes a pixel:

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
"""


def main() -> None:
    """Time, compare, write."""
    logging.getLogger("simulator").setLevel(logging.ERROR)
    with threadpool_limits(1):
        instrument = load_instrument()
        imager = build_imager(instrument, BAND)
        text = report(times(instrument, imager), scene_errors(imager), tier_table(instrument))
    write_text(HERE / "report.md", text)


if __name__ == "__main__":
    main()
