"""Closed forms of the validator: apertures, sums of frames, albedos."""

from __future__ import annotations

import itertools

import numpy as np
from mpmath import mp, mpf
from oracle import ClosedForm

from cpic_planner.validation import AlbedoModel, aperture_weights, combine, filled

MODEL = AlbedoModel(
    bands=("F520",),
    wavelength_nm=np.array([520.0]),
    width_nm=np.array([40.0]),
    log10_mh=np.array([0.0, 1.0, 2.0]),
    log10_fsed=np.array([-2.0, 0.0, 0.7]),
    albedo=np.array([[0.1, 0.2, 0.45], [0.3, 0.35, 0.01], [0.7, 0.5, 0.6]])[..., None],
    phase=np.array([[0.3, 0.31, 0.29], [0.25, 0.3, 0.33], [0.2, 0.22, 0.4]]),
    full_contrast=1e-15,
    insolation_au=1.0,
)


def bilinear(metal: mpf, cloud: mpf) -> mpf:
    def shares(nodes: np.ndarray, value: mpf) -> list[tuple[int, mpf]]:
        k = min(max(int(np.searchsorted(nodes, float(value), side="right")) - 1, 0), nodes.size - 2)
        share = (value - mpf(float(nodes[k]))) / (mpf(float(nodes[k + 1])) - mpf(float(nodes[k])))
        return [(k, 1 - share), (k + 1, share)]

    pairs = list(itertools.product(shares(MODEL.log10_mh, metal), shares(MODEL.log10_fsed, cloud)))
    albedo, phase = (
        mp.fsum(a * b * mpf(float(table[i, j])) for (i, a), (j, b) in pairs)
        for table in (MODEL.albedo[..., 0], MODEL.phase)
    )
    return mpf(MODEL.full_contrast) * albedo * phase


FRAMES = [(a, b, c) for a in (0.0, 1e-6, 3.7, 1e12, 1e100) for b in (1e-12, 2.0) for c in (1e6, 1.0)]
USABLE = np.array([True, False, True])[:, None, None]
SUMS = [(x, r) for x in (20.0, 20.25, 19.7) for r in (1e-3, 0.3, 1.0, 3.3, 15.0)]

FORMS = [
    ClosedForm(
        "cpic_planner.validation.combine",
        "one frame of three unusable, 1e-12 to 1e100 e-",
        FRAMES,
        lambda *x: combine(np.array(x)[:, None, None], USABLE).image_e[0, 0],
        lambda a, b, c: (a + c) / 2 * 3,
    ),
    ClosedForm(
        "cpic_planner.validation.filled",
        "one frame of three unusable, 1e-12 to 1e100 e-",
        FRAMES,
        lambda *x: filled(np.array(x)[:, None, None], USABLE)[0][1, 0, 0],
        lambda a, b, c: (a + c) / 2,
    ),
    ClosedForm(
        "cpic_planner.validation.aperture_weights, sum",
        "radius 1e-3 to 15 px, any place in a pixel",
        SUMS,
        lambda x, r: aperture_weights((41, 41), x, 20.1, r).sum(),
        lambda x, r: mp.pi * r**2,
    ),
    ClosedForm(
        "cpic_planner.validation.AlbedoModel.contrast",
        "nodes, ends and places between",
        list(itertools.product((0.0, 1e-9, 0.4, 1.0, 2.0), (-2.0, -1e-9, 0.3, 0.7))),
        lambda m, c: MODEL.contrast(m, c)[0],
        bilinear,
    ),
]
