"""Contrast curve of a small stack: VIP."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from reports.external.comparison import Reference, Row

TITLE = "Contrast curve: VIP"
REFERENCE = Reference("VIP", "2.1.1", "package index, vip_hci, `contrast_curve` with `pca`", ("vip_hci==2.1.1",))
TEXT = """
Six science frames and twelve references of 63 x 63 pixels by a seed in both environments; six modes of the
references, not centred, as `pca` of VIP has it without scaling; the mean of the residual frames; apertures of a FWHM
of 4 pixels. VIP then measures the noise in apertures around each annulus, injects companions for the throughput, and
multiplies by the threshold for 5 sigma of few elements. Each part is compared by itself. Residuals and noise are
equal to rounding, and so is the throughput where VIP has one companion in an image. As it comes, its companions stand
three pixels apart in one image: their light overlaps, they share the modes, and the throughput is 3 to 4 % low. Its
two thresholds differ from each other: `significance` has n - 2 degrees of freedom as Mawet et al. (2014) and ours,
`contrast_curve` has n - 1, and takes the population scatter (n in the denominator) for the sample's. Together, its
curve is 8 % lower than ours where there are 12 elements and 2 % where there are 31.
"""
SIDE, SCIENCE, REFERENCES, MODES, FWHM, STAR, BRANCHES = 63, 6, 12, 6, 4.0, 1e7, 3
RADII = (8, 12, 20)  # pixels: 12, 18 and 31 elements
SIGMA = 5.0
FEW = "other apertures of the same annulus: three standard errors of a scatter from n values"
SHIFTED = "images of companions: a Gaussian, which VIP shifts to its place and cuts at 13 pixels"
CROWDED = "companions three pixels apart overlap and share the modes"
DEGREES = "n - 1 degrees of freedom and n others instead of n - 2 and n - 1: the tested element is not counted"
SCATTER = "threshold as above, and the scatter over n instead of n - 1 values"


def stack() -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return science frames and references: six patterns of speckles of varying strength, and noise."""
    rng = np.random.default_rng(7)
    axis = np.arange(SIDE) - SIDE // 2
    envelope = 1e3 * np.exp(-np.hypot(axis[:, None], axis) / 12.0)
    patterns = envelope * rng.standard_normal((6, SIDE, SIDE)) ** 2
    strength = 1.0 + 0.3 * rng.standard_normal((SCIENCE + REFERENCES, 6))
    frames = np.tensordot(strength, patterns, axes=1)
    frames += np.sqrt(envelope) * rng.standard_normal(frames.shape)
    return frames[:SCIENCE], frames[SCIENCE:]


def planet(x: float = 0.0, y: float = 0.0, side: int = SIDE) -> NDArray[np.float64]:
    """Return the image of a planet at a place from the centre: a Gaussian."""
    axis, sigma = np.arange(side) - side // 2, FWHM / math.sqrt(8.0 * math.log(2.0))
    return np.exp(-((axis[:, None] - y) ** 2 + (axis - x) ** 2) / (2.0 * sigma**2))


def peer() -> dict[str, Any]:
    """Ask VIP."""
    from vip_hci.metrics import contrast_curve, significance
    from vip_hci.psfsub import pca

    science, references = stack()
    about = {"cube_ref": references, "ncomp": MODES, "scaling": None, "collapse": "mean"}
    frame = pca(science, np.zeros(SCIENCE), verbose=False, **about)
    curves = [
        contrast_curve(
            science,
            np.zeros(SCIENCE),
            planet(side=13),
            FWHM,
            1.0,
            STAR,
            pca,
            sigma=SIGMA,
            nbranch=BRANCHES,
            noise_sep=separation,
            fc_rad_sep=apart,
            smooth=False,
            plot=False,
            verbose=False,
            **about,
        )
        for separation, apart in ((None, 5), (1, 3))  # one companion in an image, and as it comes
    ]
    found = {"rms": float(np.sqrt(np.mean(frame**2))), "pixel": float(frame[20, 40]), "radii": []}
    for radius in RADII:
        row, dense = (curve.iloc[int(np.argmin(np.abs(curve["distance"] - radius)))] for curve in curves)
        found["radii"].append(
            {
                "radius": float(row["distance"]),
                **{
                    name: float(row[name])
                    for name in ("noise", "throughput", "sensitivity_gaussian", "sensitivity_student")
                },
                "dense": float(dense["throughput"]),
                "student": float(significance(SIGMA, radius, FWHM, student_to_gauss=False, verbose=False)),
            }
        )
    return found


def rows(recorded: dict[str, Any]) -> list[Row]:
    """Return the curve of both and its parts."""
    from cpic_planner.validation import detection_threshold, rdi_subtract
    from cpic_planner.validation.photometry import aperture_weights, sample_scatter

    science, references = stack()
    reduced = rdi_subtract(science, references, MODES, centering="none")
    frame, middle = reduced.residuals.mean(axis=0), SIDE // 2
    axis = np.arange(SIDE) - middle
    distance = np.hypot(axis[:, None], axis)
    found = [
        Row("residual frame, rms", recorded["rms"], float(np.sqrt(np.mean(frame**2))), 1e-9, "one algebra"),
        Row("residual frame, one pixel", recorded["pixel"], float(frame[20, 40]), 1e-9, "one algebra"),
    ]
    for case in recorded["radii"]:
        radius = case["radius"]
        elements = 2.0 * math.pi * radius / FWHM
        where = f"{radius:g} pixels, {int(elements)} elements"
        angles = 2.0 * math.pi * np.arange(int(elements)) / elements
        circles = [
            aperture_weights(frame.shape, middle + radius * np.cos(angle), middle + radius * np.sin(angle), FWHM / 2.0)
            for angle in angles
        ]
        sums = [np.sum(frame * weights) for weights in circles]
        found.append(
            Row(
                f"noise in the same apertures, {where}",
                case["noise"],
                float(np.std(sums)),
                1e-9,
                "the same circles and pixels",
            )
        )
        annulus = np.abs(distance - radius) <= FWHM
        scatter, _ = sample_scatter(frame, annulus, FWHM / 2.0)
        noise = case["noise"] * math.sqrt(int(elements) / (int(elements) - 1.0))
        found.append(
            Row(f"noise in apertures of our own grids, {where}", noise, scatter, 3.0 / math.sqrt(2.0 * elements), FEW)
        )
        kept = []
        for branch in 2.0 * math.pi * np.arange(BRANCHES) / BRANCHES:
            x, y = radius * math.cos(branch), radius * math.sin(branch)
            aperture = aperture_weights((SIDE, SIDE), middle + x, middle + y, FWHM / 2.0)
            kept.append(reduced.throughput(planet(x, y), aperture))
        found.append(Row(f"throughput, {where}", case["throughput"], float(np.mean(kept)), 1e-4, SHIFTED))
        what = f"throughput, {where}, three pixels between companions"
        found.append(Row(what, case["dense"], float(np.mean(kept)), 1e-3, CROWDED, expected=False))
        threshold = detection_threshold(elements).unwrap()
        theirs = case["sensitivity_student"] * STAR * case["throughput"] / case["noise"]
        found.append(Row(f"threshold, {where}, of `contrast_curve`", theirs, threshold, 1e-6, DEGREES, expected=False))
        theirs = case["student"] * math.sqrt(1.0 + 1.0 / (elements - 1.0))
        found.append(Row(f"threshold, {where}, of `significance`", theirs, threshold, 1e-6, "the same law"))
        ours = threshold * float(np.std(sums, ddof=1)) / np.mean(kept) / STAR
        found.append(Row(f"limit, {where}", case["sensitivity_student"], ours, 1e-3, SCATTER, expected=False))
    return found
