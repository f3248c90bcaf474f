"""Design of the amplitude apodizer: a step mask found by linear programming.

The mask is a grid of square steps of constant transmission inside the pupil disc. Its focal-plane field is a
finite sum of cosines times the sinc envelope of one step, hence linear in the transmissions: maximising the
on-axis amplitude under ``|E| <= sqrt(contrast) E(0)`` at control points is a linear programme (Carlotti,
Vanderbei & Kasdin 2011; Vanderbei, Kasdin & Spergel 2003).

Run ``python -m tools.design_mask --out FILE`` to repeat the design of the shipped mask ``lpx43``; that of
``lpx25``, for one-sided holes, with ``--inner-lambda-d 2.5 --contrast 1e-6 --open-side-diameters 0.875``.
"""

import argparse
import math
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from cpic_core import FloatArray, InputError, NDArray, write_npz

DECIMALS = 9  # transmissions are rounded to this many decimals; the contrast changes by less than 1e-16


def design_step_mask(
    n_steps: int = 64,
    inner_lambda_d: float = 4.3,
    contrast: float = 1e-9,
    outer_half_side_lambda_d: float = 13.4,
    outer_leak: float = 1e-5,
    leak_extent_lambda_d: float = 30.0,
    spacing_lambda_d: float = 0.35,
    edge_spacing_lambda_d: float = 0.175,
    leak_spacing_lambda_d: float = 0.7,
    open_side_diameters: float = 1.0,
) -> FloatArray:
    """Return the step mask of largest throughput that is dark in four square quadrants.

    Parameters
    ----------
    n_steps : int
        Steps across the pupil diameter, even, 8 to 128. Only steps wholly inside the disc may be open.
    inner_lambda_d : float
        Diagonal separation of the inner corner of each quadrant; the quadrant starts at ``inner / sqrt2`` per axis.
    contrast : float
        Bound on the intensity in the quadrants relative to the on-axis peak, 0 to 1.
    outer_half_side_lambda_d : float
        Outer edge of the quadrants, per axis.
    outer_leak : float
        Bound on the intensity outside the quadrants and outside the arms of the cross between them, out to
        ``leak_extent_lambda_d`` per axis. Without it the optimum piles up light just outside the hole.
    leak_extent_lambda_d : float
        Extent of that outer bound, per axis.
    spacing_lambda_d, edge_spacing_lambda_d, leak_spacing_lambda_d : float
        Distances of control points inside the quadrants, on their edges, and outside.
    open_side_diameters : float
        Side of the centred square outside which every step is opaque, 0.25 to 1 pupil diameters: the part of the
        pupil that a deformable mirror covers.

    Returns
    -------
    ndarray of float64, shape (n_steps, n_steps)
        Amplitude transmission, 0 to 1, with the eight-fold symmetry of the square.

    Raises
    ------
    InputError
        If a parameter is out of range or no mask exists (at 1e-8 none exists inside about 3.1 lambda/D).
    """
    if n_steps % 2 or not 8 <= n_steps <= 128:
        raise InputError("n_steps", n_steps, allowed="an even number, 8 to 128")
    if not 0 < contrast < 1 or not 0 < outer_leak < 1:
        raise InputError("contrast, outer_leak", (contrast, outer_leak), allowed="between 0 and 1")
    if not 0.25 <= open_side_diameters <= 1:
        raise InputError("open_side_diameters", open_side_diameters, allowed="0.25 to 1")
    inner = inner_lambda_d / np.sqrt(2.0)
    if not 0 < inner < outer_half_side_lambda_d <= leak_extent_lambda_d:
        raise InputError(
            "inner_lambda_d",
            inner_lambda_d,
            unit="lambda/D",
            allowed="quadrants of positive size inside the extent of the outer bound",
        )
    from scipy.optimize import linprog

    selected, x, y = _open_octant(n_steps, open_side_diameters)
    peak = _orbit_fields(n_steps, x, y, np.zeros(1), np.zeros(1))[0]
    dark = _quadrant_points(inner, outer_half_side_lambda_d, spacing_lambda_d, edge_spacing_lambda_d)
    leak = _outer_points(inner, outer_half_side_lambda_d, leak_extent_lambda_d, leak_spacing_lambda_d)
    rows = []
    for (u, v), bound in ((dark, np.sqrt(contrast)), (leak, np.sqrt(outer_leak))):
        fields = _orbit_fields(n_steps, x, y, u, v)
        rows += [fields / bound - peak, -fields / bound - peak]
    scale = peak.max()
    matrix = np.vstack(rows) / scale
    answer = linprog(-peak / scale, A_ub=matrix, b_ub=np.zeros(len(matrix)), bounds=(0, 1), method="highs")
    if answer.x is None or not answer.x.sum() > 1e-6 * len(answer.x):
        raise InputError(
            "inner_lambda_d",
            inner_lambda_d,
            unit="lambda/D",
            allowed=f"no step mask reaches contrast {contrast:g} there",
            hint="move the inner edge outwards or relax the contrast",
        )
    octant = np.zeros((n_steps // 2, n_steps // 2))
    octant[selected] = np.round(np.clip(answer.x, 0.0, 1.0), DECIMALS)
    quarter = np.maximum(octant, octant.T)
    half = np.concatenate([quarter[::-1], quarter])
    return np.ascontiguousarray(np.concatenate([half[:, ::-1], half], axis=1))


def design_separable_mask(
    n_steps: int = 64,
    inner_lambda_d: float = 3.7,
    contrast: float = 1e-9,
    outer_half_side_lambda_d: float = 13.4,
    spacing_lambda_d: float = 0.1,
    open_side_diameters: float = math.sqrt(0.5),
) -> FloatArray:
    """Return the separable step mask ``A(x) A(y)`` of largest throughput that is dark on the diagonals.

    The contrast on a diagonal is the product of those of the two axes, so that a square root of it per axis is enough.
    The square must lie inside the disc (side ``sqrt(1/2)`` diameters at most): a rim that cuts a separable mask lifts
    the dark zone by orders of magnitude. No mask, stepped or not, goes inside the limit of Dolph (1946) for the
    inscribed square, ``2 acosh(contrast^(-1/4)) / pi`` lambda/D on the diagonal.

    Parameters
    ----------
    n_steps : int
        Steps across the pupil diameter, even, 8 to 512.
    inner_lambda_d : float
        Diagonal separation of the inner corner of the quadrants.
    contrast : float
        Bound on the intensity in the quadrants relative to the on-axis peak, 0 to 1.
    outer_half_side_lambda_d : float
        Outer edge of the quadrants, per axis.
    spacing_lambda_d : float
        Distance of control points.
    open_side_diameters : float
        Side of the open square, 0.25 to ``sqrt(1/2)`` pupil diameters.

    Returns
    -------
    ndarray of float64, shape (n_steps, n_steps)
        Amplitude transmission, 0 to 1.

    Raises
    ------
    InputError
        If a parameter is out of range or no mask exists.
    """
    if n_steps % 2 or not 8 <= n_steps <= 512:
        raise InputError("n_steps", n_steps, allowed="an even number, 8 to 512")
    if not 0 < contrast < 1:
        raise InputError("contrast", contrast, allowed="between 0 and 1")
    if not 0.25 <= open_side_diameters <= math.sqrt(0.5) + 1e-12:
        raise InputError("open_side_diameters", open_side_diameters, allowed="0.25 to sqrt(1/2)")
    inner = inner_lambda_d / math.sqrt(2.0)
    if not 0 < inner < outer_half_side_lambda_d:
        raise InputError("inner_lambda_d", inner_lambda_d, unit="lambda/D", allowed="quadrants of positive size")
    from scipy.optimize import linprog

    step = 1.0 / n_steps
    centre = (np.arange(n_steps // 2) + 0.5) * step
    centre = centre[centre + step / 2 <= open_side_diameters / 2 + 1e-12]
    u = _axis(inner, outer_half_side_lambda_d, spacing_lambda_d)
    fields = np.cos(2 * np.pi * np.outer(u, centre)) * np.sinc(u * step)[:, None] / contrast**0.25
    matrix = np.vstack([fields - 1.0, -fields - 1.0])
    answer = linprog(-np.ones(centre.size), A_ub=matrix, b_ub=np.zeros(len(matrix)), bounds=(0, 1), method="highs")
    if answer.x is None or not answer.x.sum() > 1e-6 * centre.size:
        raise InputError(
            "inner_lambda_d",
            inner_lambda_d,
            unit="lambda/D",
            allowed=f"no separable mask reaches contrast {contrast:g} there",
            hint="move the inner edge outwards or relax the contrast",
        )
    half = np.zeros(n_steps // 2)
    half[: centre.size] = np.round(np.clip(answer.x, 0.0, 1.0), DECIMALS)
    profile = np.concatenate([half[::-1], half])
    return np.outer(profile, profile)


def _open_octant(n_steps: int, side: float) -> tuple[NDArray[np.bool_], FloatArray, FloatArray]:
    """Return the steps of one octant (x <= y, both positive) wholly inside disc and square, in pupil diameters."""
    step = 1.0 / n_steps
    centre = (np.arange(n_steps // 2) + 0.5) * step
    x, y = np.meshgrid(centre, centre, indexing="ij")
    selected = (np.hypot(x + step / 2, y + step / 2) <= 0.5) & (x <= y) & (y + step / 2 <= side / 2 + 1e-12)
    return selected, x[selected], y[selected]


def _orbit_fields(n_steps: int, x: FloatArray, y: FloatArray, u: FloatArray, v: FloatArray) -> FloatArray:
    """Return the field at (u, v) in lambda/D of each step together with its seven mirror images, open at 1."""
    step = 1.0 / n_steps
    envelope = 4.0 * np.sinc(u * step) * np.sinc(v * step) * step**2
    straight = np.cos(2 * np.pi * np.outer(u, x)) * np.cos(2 * np.pi * np.outer(v, y))
    swapped = np.cos(2 * np.pi * np.outer(u, y)) * np.cos(2 * np.pi * np.outer(v, x))
    return np.asarray(envelope[:, None] * (straight + np.where(x != y, swapped, 0.0)))


def _axis(low: float, high: float, spacing: float) -> FloatArray:
    return np.linspace(low, high, int(np.ceil((high - low) / spacing)) + 1)


def _quadrant_points(inner: float, outer: float, spacing: float, edge: float) -> tuple[FloatArray, FloatArray]:
    u, v = (part.ravel() for part in np.meshgrid(*[_axis(inner, outer, spacing)] * 2, indexing="ij"))
    keep = u <= v
    rim = _axis(inner, outer, edge)
    return (
        np.concatenate([u[keep], np.full(rim.size, inner), rim]),
        np.concatenate([v[keep], rim, np.full(rim.size, outer)]),
    )


def _outer_points(inner: float, outer: float, extent: float, spacing: float) -> tuple[FloatArray, FloatArray]:
    u, v = (part.ravel() for part in np.meshgrid(*[_axis(inner, extent, spacing)] * 2, indexing="ij"))
    keep = (u <= v) & (v > outer)
    return u[keep], v[keep]


def mask_figures(mask: FloatArray) -> dict[str, float]:
    """Return the throughput figures of a mask, relative to the clear disc.

    Parameters
    ----------
    mask : ndarray, shape (n, n)
        Amplitude transmission, 0 to 1.

    Returns
    -------
    dict
        ``energy`` E, ``peak`` S = (sum A / area)^2, ``core`` = energy within 0.7 lambda/D of the peak.
    """
    n = len(mask)
    area = np.pi / 4
    centres = (np.arange(n) - n / 2 + 0.5) / n
    nodes, weights = np.polynomial.legendre.leggauss(48)
    radius, core = 0.7, 0.0
    for node, weight in zip(radius * nodes, weights, strict=True):  # chords of the circle, exactly
        chord = np.sqrt(radius**2 - node**2)
        along = chord * nodes
        rows = np.exp(-2j * np.pi * np.outer(along, centres)) * np.sinc(along / n)[:, None] / n
        field = rows @ mask @ np.exp(-2j * np.pi * node * centres) * np.sinc(node / n) / n
        core += weight * radius * float(weights @ np.abs(field) ** 2) * chord
    return {
        "energy": float((mask**2).sum() / n**2 / area),
        "peak": float((mask.sum() / n**2 / area) ** 2),
        "core": float(core / area),
    }


def main(argv: Sequence[str] | None = None) -> int:
    """Design the shipped mask and write it."""
    parser = argparse.ArgumentParser(prog="python -m tools.design_mask", description=__doc__)
    parser.add_argument("--out", required=True, type=Path, help="npz file to write")
    parser.add_argument("--separable", action="store_true", help="a product of two profiles on the inscribed square")
    parser.add_argument("--n-steps", type=int, default=64, help="steps across the pupil")
    parser.add_argument("--inner-lambda-d", type=float, default=4.3, help="inner corner of the quadrants, diagonal")
    parser.add_argument("--outer-half-side-lambda-d", type=float, default=13.4, help="outer edge, per axis")
    parser.add_argument("--contrast", type=float, default=1e-9, help="bound on the intensity over the peak")
    parser.add_argument("--outer-leak", type=float, help="bound outside quadrants and cross [1e-5]")
    parser.add_argument("--open-side-diameters", type=float, help="opaque outside this square [1, separable sqrt(1/2)]")
    options = parser.parse_args(argv)
    given: dict[str, Any] = {name: value for name, value in vars(options).items() if value is not None}
    target, separable = given.pop("out"), given.pop("separable")
    if separable and "outer_leak" in given:
        raise InputError("outer_leak", options.outer_leak, allowed="no such bound on a separable mask")
    if target.suffix != ".npz" or not target.parent.is_dir():
        raise InputError("out", str(target), allowed="an npz file in an existing folder")
    began = time.perf_counter()
    mask = design_separable_mask(**given) if separable else design_step_mask(**given)
    figures: dict[str, Any] = mask_figures(mask)
    write_npz(target, {"transmission": mask})
    print(
        ", ".join(f"{name} {value:.4f}" for name, value in figures.items()), f"in {time.perf_counter() - began:.0f} s"
    )
    return 0


if __name__ == "__main__":
    try:
        raise SystemExit(main())
    except InputError as refusal:
        print(refusal, file=sys.stderr)
        raise SystemExit(2) from None
