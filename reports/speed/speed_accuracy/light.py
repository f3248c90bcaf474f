"""Light of visits by an expansion beside exact transforms of the same screens: time, memory, error.

Sums over apertures that lie wholly in the dark hole, every second pixel. At least a million of them for each band and
error, so that tails to 5 sigma are counted and not fitted.
"""

from __future__ import annotations

import json
import time
from pathlib import Path
from typing import Any

import numpy as np

from cpic_core import dump_json, write_text
from simulator import load_instrument, single_band_psf
from simulator.imaging import aperture_sums, centred_axis, overlap_weights, visit_light
from simulator.imaging.drift import screen_model
from simulator.imaging.light_expansion import waves_of

HERE = Path(__file__).resolve().parent
BANDS = ("F520", "F662", "F720", "F850")
RMS_NM = (0.005, 0.05, 0.2, 1.0)
ELEMENTS, BLOCK, SEED = 1_000_000, 50, 11
VISITS, PEERS = 1000, 5


def seconds(work: Any, least: int = 5) -> float:
    """Processor time of a work, the least of some runs."""
    taken = []
    for _ in range(least):
        began = time.process_time()
        work()
        taken.append(time.process_time() - began)
    return min(taken)


def measure_band(band: str) -> dict[str, Any]:
    """Every figure of one band."""
    instrument = load_instrument()
    psf = single_band_psf(band, instrument=instrument)
    imager, region = psf.imager, psf.geometry.hole
    rows, columns = (np.flatnonzero(region.any(axis=axis)) for axis in (1, 0))
    offset = centred_axis(len(region), imager.pixel_scale_arcsec)
    y, x = (imager.axis(offset[part], masked=True) for part in (rows, columns))
    slope = instrument.drift.psd_slope
    screens, grid = screen_model(len(imager.transmission), slope), imager.focal_grid(y, x)
    light = visit_light(imager, y, x, slope)
    began = time.process_time()
    waves = waves_of(imager, y, x, slope).reshape(-1, 128 * 128)
    set_up_s = time.process_time() - began
    weights = overlap_weights(imager.aperture_radius_arcsec / imager.pixel_scale_arcsec)
    whole = np.isclose(aperture_sums(region.astype(float), weights), weights.sum())
    whole[1::2] = whole[:, 1::2] = False
    half, places = len(weights) // 2, np.argwhere(whole)
    readers = np.zeros((len(places), *region.shape), np.float32)
    for reader, (row, column) in zip(readers, places, strict=True):
        reader[row - half : row + half + 1, column - half : column + half + 1] = weights
    readers = readers[:, rows[:, None], columns].reshape(len(places), -1).T
    rng = np.random.default_rng(SEED)
    drifts = {}
    for rms in RMS_NM:
        sums: tuple[list[Any], list[Any]] = ([], [])
        for _ in range(-(-ELEMENTS // (BLOCK * len(places)))):
            drawn = rng.standard_normal((BLOCK, 128, 128))
            numbers = np.zeros((BLOCK, 1, len(waves) + 1))
            numbers[:, 0, :-1] = rms * (drawn.reshape(BLOCK, -1) @ waves.T)
            images = [grid.image(screen) for screen in rms * screens.screens(drawn)]
            for kept, found in zip(sums, (np.array(images), light.images(numbers)), strict=True):
                kept.append(found.reshape(BLOCK, -1) @ readers)
        exact, fast = (np.concatenate(kept) for kept in sums)
        mean, spread = exact.mean(axis=0), exact.std(axis=0)
        ratio = fast.var(axis=0) / exact.var(axis=0) - 1.0
        drifts[f"{rms:g}"] = {
            "elements": exact.size,
            "mean": float(np.abs((fast - exact).mean(axis=0) / spread).max()),
            "variance": float(np.abs(ratio).max()),
            "variance_median": float(np.median(ratio)),
            "correlation": float(np.abs(np.corrcoef(fast.T) - np.corrcoef(exact.T)).max()),
            "tails": [[int(((part - mean) / spread > k).sum()) for part in (exact, fast)] for k in (3, 4, 5)],
        }
    one = 0.05 * screens.screens(rng.standard_normal((128, 128)))

    def visits() -> None:
        light.images(np.array([light.draw(rng, 0.05) for _ in range(VISITS)])[:, None])

    def transforms() -> None:
        for _ in range(20):
            grid.image(screens.draw(rng, 0.05))

    def peer() -> None:
        imager.image(y, x, opd_nm=one, engine="hcipy")

    return {
        "places": len(places),
        "numbers": len(waves),
        "megabytes": (light.linear.nbytes + light.field.nbytes) / 1e6,
        "set_up_s": set_up_s,
        "visit_s": seconds(visits) / VISITS,
        "transform_s": seconds(transforms) / 20,
        "hcipy_s": seconds(peer, PEERS),
        "drifts": drifts,
    }


def measure() -> None:
    """Measure all bands and keep the figures."""
    write_text(HERE / "light.json", dump_json({band: measure_band(band) for band in BANDS}))


HEAD = """
## Light of visits

Images of visits take the star's light from an expansion in the wavefront error (`simulator.imaging.visit_light`).
Processor time of a visit among 1000 of one star in one band, with its random numbers, beside a transform of one screen
by the program and by HCIPy on the same grid; what comes after the comma is the ratio.

| band | numbers a visit | memory | found once in | expansion | transform | HCIPy |
|---|---|---|---|---|---|---|
"""
ERRORS = """
Errors against transforms of the same screens, of sums over apertures: the largest of the hole. And how many sums lie
more than 3, 4 and 5 standard deviations above the mean, by transforms and by the expansion. Above 1 nm images take the
transform.

| band | rms, nm | sums, millions | mean, in standard deviations | variance | correlation of places | beyond 3; 4; 5 |
|---|---|---|---|---|---|---|
"""


def section() -> str:
    """The section of the report."""
    times, errors = [], []
    for band, part in json.loads((HERE / "light.json").read_text(encoding="utf-8")).items():
        ours_ms, others = part["visit_s"] * 1e3, [part[name] * 1e3 for name in ("transform_s", "hcipy_s")]
        beside = " | ".join(f"{other:.2g} ms, {other / ours_ms:.0f}" for other in others)
        size = f"{part['megabytes']:.0f} MB | {part['set_up_s']:.1f} s"
        times.append(f"| {band} | {part['numbers']} | {size} | {ours_ms:.2f} ms | {beside} |")
        for rms, one in part["drifts"].items():
            tails = "; ".join(f"{exact}, {fast}" for exact, fast in one["tails"])
            sizes = " | ".join(f"{one[name]:.1e}" for name in ("mean", "variance", "correlation"))
            errors.append(f"| {band} | {rms} | {one['elements'] / 1e6:.2f} | {sizes} | {tails} |")
    return HEAD + "\n".join(times) + "\n" + ERRORS + "\n".join(errors) + "\n"
