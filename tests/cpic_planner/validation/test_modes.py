"""Principal modes against a decomposition in extended precision."""

import numpy as np
import pytest

from cpic_planner.validation.modes import leading_modes, row_norm

M, P = 12, 300
SPECTRA = {
    "even": np.linspace(1.0, 0.5, M),
    "direct at its edge": np.geomspace(1.0, 0.031, M),
    "turned from its edge": np.geomspace(1.0, 0.029, M),
    "steep": np.geomspace(1.0, 1.1e-4, M),
    "below what the Gram matrix sees": np.geomspace(1.0, 1.2e-6, M),
    "one large, photon noise": np.r_[300.0, np.linspace(1.0, 0.5, M - 1)],
    "one large, hardly any noise": np.r_[1e5, np.linspace(1.0, 0.5, M - 1)],
    "wanted above 1e-4, the others below": np.r_[1.0, np.full(5, 1.1e-4) * np.linspace(1.2, 1.0, 5), np.full(6, 9e-7)],
    "rank 6": np.r_[np.linspace(1.0, 0.9, 6), np.full(6, 1e-9)],
}


def rows_with(spectrum: np.ndarray, seed: int = 3) -> np.ndarray:
    rng = np.random.default_rng(seed)
    left = np.linalg.qr(rng.normal(size=(M, M)))[0]
    right = np.linalg.qr(rng.normal(size=(P, M)))[0].T
    return 100.0 * (left * spectrum) @ right


def by_jacobi(rows: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """One-sided Jacobi rotations in extended precision: modes and singular values."""
    turned = rows.astype(np.longdouble)
    for _ in range(30):
        worst = 0.0
        for i in range(len(rows) - 1):
            for j in range(i + 1, len(rows)):
                a, b, c = turned[i] @ turned[i], turned[j] @ turned[j], turned[i] @ turned[j]
                if abs(c) < 1e-19 * np.sqrt(a * b):
                    continue
                worst = max(worst, float(abs(c) / np.sqrt(a * b)))
                zeta = (b - a) / (2 * c)
                tangent = (1 if zeta >= 0 else -1) / (abs(zeta) + np.sqrt(1 + zeta * zeta))
                cosine = 1 / np.sqrt(1 + tangent * tangent)
                turned[[i, j]] = (
                    cosine * (turned[i] - tangent * turned[j]),
                    cosine * (tangent * turned[i] + turned[j]),
                )
        if worst < 1e-18:
            break
    singular = np.sqrt((turned * turned).sum(axis=1))
    order = np.argsort(-singular)
    return turned[order] / singular[order][:, None], singular[order]


@pytest.mark.skipif(np.finfo(np.longdouble).eps > 1e-18, reason="no extended precision on this platform")
@pytest.mark.parametrize("name", SPECTRA)
def test_residuals_are_exact_down_to_the_rank(name: str) -> None:
    rows = rows_with(SPECTRA[name])
    frames = np.random.default_rng(5).normal(size=(3, P))
    modes, singular = by_jacobi(rows)
    for count in (1, 3, 6, M):
        used = min(count, int((singular > 1e-6 * singular[0]).sum()))
        found, values = leading_modes(rows, count)
        assert len(found) == len(values) == used
        assert values == pytest.approx(singular[:used].astype(float), rel=1e-9)
        assert np.abs(found @ found.T - np.eye(used)).max() < 1e-9
        exact = frames.astype(np.longdouble) @ modes[:used].T @ modes[:used]
        error = (frames @ found.T @ found - exact).astype(float)
        assert np.abs(error).max() < 1e-10, count


def test_the_eigenvectors_alone_would_not_do() -> None:
    """What the rotation and the QR factorisation are for."""
    rows = rows_with(SPECTRA["one large, hardly any noise"])
    values, vectors = np.linalg.eigh(rows @ rows.T)
    plain = (vectors[:, ::-1] / np.sqrt(values[::-1])).T @ rows
    assert np.abs(plain @ plain.T - np.eye(M)).max() > 1e-8
    modes, _ = leading_modes(rows, M)
    assert np.abs(modes @ modes.T - np.eye(M)).max() < 1e-14


@pytest.mark.parametrize("exponent", [-290, -160, 160, 290])
def test_squares_neither_overflow_nor_vanish(exponent: int) -> None:
    rows = rows_with(SPECTRA["turned from its edge"])
    plain, values = leading_modes(rows, 5)
    modes, singular = leading_modes(rows * 10.0**exponent, 5)
    assert np.abs(np.abs(modes @ plain.T) - np.eye(5)).max() < 1e-12
    assert singular / 10.0**exponent == pytest.approx(values, rel=1e-12)
    assert row_norm(rows * 10.0**exponent) / 10.0**exponent == pytest.approx(np.linalg.norm(rows), rel=1e-12)


def test_nothing_in_nothing_out() -> None:
    for rows in (np.zeros((3, 7)), np.full((3, 7), 1e-14)):
        modes, singular = leading_modes(rows, 3, floor=1e-13)
        assert modes.shape == (0, 7)
        assert singular.shape == (0,)
    assert row_norm(np.zeros((3, 7))) == 0.0
    assert leading_modes(np.eye(3), 0)[0].shape == (0, 3)
