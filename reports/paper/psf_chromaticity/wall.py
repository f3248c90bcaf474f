"""How bright the best pupil can be that is dark in four quadrants: bounds by linear programming."""

from __future__ import annotations

import math

import numpy as np
from scipy.optimize import linprog

from tools.report_parts import table

CORNERS_LAMBDA_D = (2.78, 2.9, 3.0, 3.1, 3.15, 3.2, 3.54, 4.3)
STEPS = (64, 96)
SPACING_LAMBDA_D, OUTER_LAMBDA_D = 0.4, 15.0 / math.sqrt(2.0)


def largest_peak(steps: int, corner_lambda_d: float, contrast: float, least: float) -> float:
    """Largest on-axis peak, over that of the clear disc, of square steps between ``least`` and 1, dark to ``contrast``.

    Dark in four quadrants; nothing is asked elsewhere. With ``least = -1`` it bounds every complex pupil of modulus
    up to 1: if E(u) is the field of A, dark at u and -u, the real part of A has the field (E(u) + E*(-u)) / 2 and, A
    turned so that its sum is real, the same peak. The eight-fold average of a real solution is one as well.
    """
    centre, inner = (np.arange(steps // 2) + 0.5) / steps, corner_lambda_d / math.sqrt(2.0)
    x, y = (part.ravel() for part in np.meshgrid(centre, centre))
    kept = (x <= y) & (np.hypot(x + 0.5 / steps, y + 0.5 / steps) <= 0.5)
    x, y = x[kept], y[kept]
    grid, rim = (
        np.linspace(inner, OUTER_LAMBDA_D, math.ceil((OUTER_LAMBDA_D - inner) / spacing) + 1)
        for spacing in (SPACING_LAMBDA_D, SPACING_LAMBDA_D / 2)
    )
    u, v = (part.ravel() for part in np.meshgrid(grid, grid))
    u, v = (
        np.concatenate([part[u <= v], edge])
        for part, edge in (
            (u, np.append(np.full(rim.size, rim[0]), rim)),
            (v, np.append(rim, np.full(rim.size, rim[-1]))),
        )
    )
    turns = [np.cos(2 * np.pi * np.outer(p, q)) for p, q in ((u, x), (v, y), (u, y), (v, x))]
    field = turns[0] * turns[1] + np.where(x < y, turns[2] * turns[3], 0.0)
    field *= (np.sinc(u / steps) * np.sinc(v / steps) / math.sqrt(contrast))[:, None]
    peak = np.where(x < y, 2.0, 1.0)
    answer = linprog(
        -peak,
        A_ub=np.vstack([field - peak, -field - peak]),
        b_ub=np.zeros(2 * len(field)),
        bounds=(least, 1.0),
        method="highs",
    )
    if not answer.success:
        raise RuntimeError(answer.message)
    return float((4.0 * peak @ answer.x / steps**2 / (math.pi / 4.0)) ** 2)


def wall_table(contrast: float) -> str:
    """Table of the largest peaks."""
    lines = []
    for corner in CORNERS_LAMBDA_D:
        peaks = [largest_peak(steps, corner, contrast, least) for least in (0.0, -1.0) for steps in STEPS]
        cells = ["none" if peak < 1e-9 else f"{peak:.2f}" if peak > 0.005 else f"{peak:.0e}" for peak in peaks]
        lines.append([f"{corner:.2f}", *cells])
    heads = [f"{what}, {steps} steps" for what in ("mask", "any pupil") for steps in STEPS]
    return table(["corner (lambda/D)", *heads], lines)
