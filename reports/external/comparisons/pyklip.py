"""Residuals of reference-star differential imaging: pyKLIP."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from reports.external.comparison import Reference, Row

TITLE = "Subtraction of reference frames: pyKLIP"
REFERENCE = Reference(
    "pyKLIP", "2.10.1", "package index, pyklip, `klip.klip_math`", ("pyklip==2.10.1", "mpmath==1.3.0")
)
TEXT = """
Three science frames and twelve references of 31 x 31 pixels, made of eight patterns of speckles and of noise by a
seed in both environments; the frames of either are projected off the leading modes of the references after their own
means are removed. This is one algebra (Soummer et al. 2012), written twice: as long as the modes are patterns, the
residuals are equal to rounding, and so is what is left of a planet, which ours predicts from its image alone
(`RdiResult.project`) and theirs shows as the difference of two subtractions. Modes of noise are 2e-4 of the first
here; pyKLIP takes them from the eigenvectors of the covariance alone, which are orthogonal to the square of that
only, and is off by 3e-9 of a pixel. The same subtraction in 40 digits is what ours gives. Where the references repeat
each other, pyKLIP divides by the root of an eigenvalue that is zero or below by rounding, and answers with numbers
that are not finite; ours finds the rank and uses as many modes as there are.
"""
SIDE, SCIENCE, REFERENCES, PATTERNS, MODES, PLANET = 31, 3, 12, 8, (1, 4, 11), (22, 9)
REPEATED, ASKED = 4, 8  # frames of a library that holds each of them three times, and modes asked of it
ROUNDING = "one algebra; rounding"
SQUARED = (
    "eigenvectors of a covariance lose the square of how much fainter a mode is than the first; see 40 digits below"
)
WIDE, NARROW = (
    1e-9,
    1e-10,
)  # tolerances of modes of noise and of patterns
NOT_FINITE = "not finite"


def stack() -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return science frames, references, the image of a planet, and signs to add pixels up with."""
    rng = np.random.default_rng(2025)
    axis = np.arange(SIDE) - SIDE // 2
    envelope = 1e3 * np.exp(-np.hypot(axis[:, None], axis) / 6.0)
    patterns = envelope * rng.standard_normal((PATTERNS, SIDE, SIDE)) ** 2
    strength = 1.0 + 0.3 * rng.standard_normal((SCIENCE + REFERENCES, PATTERNS))
    frames = np.tensordot(strength, patterns, axes=1) + rng.standard_normal((SCIENCE + REFERENCES, SIDE, SIDE))
    row, column = (np.arange(SIDE) - place for place in PLANET)
    planet = 50.0 * np.exp(-(row[:, None] ** 2 + column**2) / 4.0)
    signs = rng.choice([-1.0, 1.0], (SIDE, SIDE))
    return frames[:SCIENCE], frames[SCIENCE:], planet, signs


def measured(residuals: NDArray[np.float64], signs: NDArray[np.float64]) -> dict[str, float]:
    """Return the numbers of residuals (frame, y, x) that are compared."""
    place = (0, *PLANET)
    return {
        "rms of all pixels": float(np.sqrt(np.mean(residuals**2))),
        "one pixel": float(residuals[place]),
        "sum of all pixels with drawn signs": float(np.sum(residuals * signs)),
    }


def in_40_digits(frame: NDArray[np.float64], library: NDArray[np.float64], modes: int) -> float:
    """Return the residual at the planet's pixel by arithmetic of 40 digits."""
    import mpmath

    mpmath.mp.dps = 40
    centred = [[mpmath.mpf(float(value)) for value in image.ravel()] for image in (frame, *library)]
    centred = [[value - mpmath.fsum(row) / len(row) for value in row] for row in centred]
    target, rows = centred[0], centred[1:]
    values, vectors = mpmath.eigsy(mpmath.matrix([[mpmath.fdot(one, two) for two in rows] for one in rows]))
    pixel = PLANET[0] * SIDE + PLANET[1]
    left = target[pixel]
    for index in sorted(range(len(rows)), key=lambda index: -values[index])[:modes]:
        weights = [vectors[row, index] for row in range(len(rows))]
        along = mpmath.fsum(weight * mpmath.fdot(row, target) for weight, row in zip(weights, rows, strict=True))
        left -= along * mpmath.fdot(weights, [row[pixel] for row in rows]) / values[index]
    return float(left)


def peer() -> dict[str, Any]:
    """Ask pyKLIP."""
    from pyklip.klip import klip_math

    science, references, planet, signs = stack()

    def residuals(frames: NDArray[np.float64], library: NDArray[np.float64], modes: int) -> NDArray[np.float64]:
        rows = library.reshape(len(library), -1)
        left = [klip_math(frame.ravel(), rows, np.array([modes]))[:, 0] for frame in frames]
        return np.array(left).reshape(frames.shape)

    found: dict[str, Any] = {"input": float(np.sum(science * signs) + np.sum(references * signs)), "modes": []}
    for modes in MODES:
        plain = residuals(science, references, modes)
        left = residuals(science[:1] + planet, references, modes) - plain[:1]
        found["modes"].append({"modes": modes, **measured(plain, signs), "planet": float(np.sum(left * planet))})
    found["digits"] = in_40_digits(science[0], references, MODES[-1])
    with np.errstate(invalid="ignore", divide="ignore"):
        left = residuals(science, np.concatenate([references[:REPEATED]] * 3), ASKED)
    found["repeated"] = NOT_FINITE if not np.isfinite(left).all() else float(np.sqrt(np.mean(left**2)))
    return found


def rows(recorded: dict[str, Any]) -> list[Row]:
    """Return residuals of both."""
    from cpic_planner.validation import rdi_subtract

    science, references, planet, signs = stack()
    own = float(np.sum(science * signs) + np.sum(references * signs))
    found = [Row("input: sum of all pixels with drawn signs", recorded["input"], own, 1e-12, "the same draws")]
    for case in recorded["modes"]:
        result = rdi_subtract(science, references, case["modes"])
        ours = measured(result.residuals, signs) | {"planet": float(np.sum(result.project(planet) * planet))}
        for name, value in ours.items():
            what = "planet that is left, times its image" if name == "planet" else f"residuals, {name}"
            noise = case["modes"] > PATTERNS
            about = {"why": SQUARED, "expected": False} if noise else {"why": ROUNDING}
            found.append(Row(f"{what}, {case['modes']} modes", case[name], value, WIDE if noise else NARROW, **about))
    what = f"residuals, one pixel, {MODES[-1]} modes, theirs in 40 digits without pyKLIP"
    found.append(Row(what, recorded["digits"], ours["one pixel"], WIDE, ROUNDING))
    result = rdi_subtract(science, np.concatenate([references[:REPEATED]] * 3), ASKED)
    ours_repeated = float(np.sqrt(np.mean(result.residuals**2)))
    what = f"residuals, rms of all pixels, {ASKED} modes asked of {REPEATED} references thrice"
    why = f"ours uses the {result.modes_used} modes that exist; theirs divides by the root of a rounding error"
    found.append(Row(what, recorded["repeated"], ours_repeated, NARROW, why, expected=False))
    return found
