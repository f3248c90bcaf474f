"""The stellar grid's builder: band fluxes are met exactly, missing models stay missing."""

import numpy as np
import pytest

from cpic_core import InputError
from tools.build_catalogue.builders import spectra

NAMES = list(spectra._BANDS)
NM = np.geomspace(300.0, 2000.0, 8000)


def _filters() -> list[tuple[np.ndarray, np.ndarray, bool]]:
    """Nine triangles; every second one counts photons."""
    centres = np.geomspace(360.0, 1650.0, len(NAMES))
    return [(np.array([0.93 * c, c, 1.06 * c]), np.array([0.0, 1.0, 0.0]), bool(i % 2)) for i, c in enumerate(centres)]


def _mean_flux(flam: np.ndarray, curve: tuple[np.ndarray, np.ndarray, bool]) -> float:
    """Brute force on a fine grid: of flux per wavelength, or of photons."""
    wavelength, transmission, photons = curve
    x = np.linspace(wavelength[0], wavelength[-1], 200_001)
    weight = np.interp(x, wavelength, transmission) * (x if photons else 1.0)
    return float(np.trapezoid(np.interp(x, NM, flam) * weight, x) / np.trapezoid(weight, x))


def test_the_solution_has_the_band_fluxes_asked_for() -> None:
    filters = _filters()
    knots = np.array([spectra._mean_wavelength(*curve[:2]) for curve in filters])
    lines = 5.0 + 0.4 * np.sin(NM / 3.0)[None, None, :] + np.array([0.0, 0.3])[None, :, None]
    rng = np.random.default_rng(1)
    flux = 10.0 ** lines[0, 0].astype(np.float32).astype(float)
    target = np.array([_mean_flux(flux, curve) for curve in filters]) * rng.uniform(0.8, 1.2, (1, 3, 2, len(NAMES)))
    target[0, 0, :] = 0.0
    ratio = spectra._solve(NM, lines.astype(np.float32), knots, filters, target, np.array([0, 0, 1]))
    assert not ratio[0, 0].any()
    for gravity, line in ((1, 0), (2, 1)):
        flux = 10.0 ** lines[0, line].astype(np.float32).astype(float)
        for metal in range(2):
            factor = np.interp(np.log(NM), np.log(knots), ratio[0, gravity, metal])
            found = [_mean_flux(flux * factor, curve) for curve in filters]
            # The sum over samples and the fine grid differ by the sampling.
            np.testing.assert_allclose(found, target[0, gravity, metal], rtol=2e-5)


def test_a_negative_factor_is_refused() -> None:
    filters = _filters()
    knots = np.array([spectra._mean_wavelength(*curve[:2]) for curve in filters])
    target = np.ones((1, 1, 1, len(NAMES)))
    target[..., 4] = 100.0
    target[..., 3] = 1e-3
    with pytest.raises(InputError, match="above 0"):
        spectra._solve(NM, np.zeros((1, 1, NM.size), np.float32), knots, _wide(filters), target, np.array([0]))


def _wide(filters: list[tuple[np.ndarray, np.ndarray, bool]]) -> list[tuple[np.ndarray, np.ndarray, bool]]:
    """Neighbours that overlap, so that one bright band lights up the next."""
    return [(np.array([0.8 * c[1], c[1], 1.25 * c[1]]), t, p) for c, t, p in filters]


def _table(rows: dict[tuple[float, float, float], float]) -> spectra._Broadband:
    header = "# Teff logg [Fe/H] other " + " ".join(NAMES)
    lines = [f"{t} {g} {m} -1 " + " ".join(str(v + i) for i in range(len(NAMES))) for (t, g, m), v in rows.items()]
    return spectra._Broadband("\n".join([header, *lines]).encode())


def test_targets_are_level_times_trend() -> None:
    level = {(t, g, 0.0): t * g for t in (4000.0, 4100.0, 4250.0) for g in (3.5, 4.0)}
    trend = {
        (t, g, m): 100.0 * g + t + 300.0 * m for t in (4000.0, 4250.0) for g in (3.0, 3.5, 4.0) for m in (0.0, 0.5)
    }
    base = np.array([3.5, 3.5, 4.0])
    teff = np.array([4000.0, 4100.0, 4250.0])
    levels = spectra._solar(_table(level), teff, base, "level.dat")
    found = spectra._targets(teff, _table(trend), base, levels)
    assert found.shape == (3, 3, 2, len(NAMES))
    # First band, 4100 K, log g 3.0: level at 3.5; trend relative to solar at 3.5, linear between 4000 and 4250 K.
    for column, m in enumerate((0.0, 0.5)):
        ratio = [trend[t, 3.0, m] / trend[t, 3.5, 0.0] for t in (4000.0, 4250.0)]
        expected = 4100.0 * 3.5 * (0.6 * ratio[0] + 0.4 * ratio[1]) * 1e-4
        assert found[1, 0, column, 0] == pytest.approx(expected, rel=1e-12)
    np.testing.assert_allclose(found[2, 2, 0], (4250.0 * 4.0 + np.arange(len(NAMES))) * 1e-4, rtol=1e-12)
    # Without the model at 4250 K its neighbour at 4100 K has no trend either; 4000 K does not need it.
    holes = _table({key: value for key, value in trend.items() if key[:2] != (4250.0, 3.0)})
    found = spectra._targets(teff, holes, base, levels)
    assert found[0, 0].all()
    assert not found[1:, 0].any()
    assert found[:, 1:].all()


def test_a_hole_in_the_level_is_refused(refused) -> None:
    level = _table({(4000.0, 3.5, 0.0): 1.0})
    refused(
        "level.dat = a model is missing", spectra._solar, level, np.array([4000.0]), np.array([3.5, 4.0]), "level.dat"
    )


def test_red_bands_of_cool_dwarfs_lie_between_two_atlases() -> None:
    """Relative to y, by 45 % of the way at 4600 K, half of that at 4900 K; warm stars and giants stay."""
    teff, log_g = np.array([4000.0, 4600.0, 4900.0, 5200.0, 6000.0]), np.array([3.5, 4.0, 4.5])
    rng = np.random.default_rng(3)
    aces, other = rng.uniform(1.0, 2.0, (2, 5, 3, len(NAMES)))
    found = spectra._cool_dwarfs(teff, log_g, aces, other)
    y = NAMES.index("STROMGREN_y")
    for band, name in enumerate(NAMES):
        red = name in ("GROUND_COUSINS_R", "GROUND_COUSINS_I", "SDSS_z", "2MASS_J")
        for row, share in enumerate((0.45, 0.45, 0.225, 0.0, 0.0)):
            ratio = [flux[row, 1:, band] / flux[row, 1:, y] for flux in (aces, other)]
            mixed = (1 - share) * ratio[0] + share * ratio[1] if red else ratio[0]
            np.testing.assert_allclose(found[row, 1:, band], mixed * aces[row, 1:, y], rtol=1e-12)
    np.testing.assert_array_equal(found[:, 0], aces[:, 0])


def test_filters_say_whether_they_count_photons() -> None:
    text = "# DETECTOR       \t{}\n#\nWAVELENGTH,THROUGHPUT\n4000.0,0.0\n4100.0,0.5\n"
    for detector, photons in (("energy", False), ("photon", True)):
        wavelength, transmission, found = spectra._filter(text.format(detector).encode())
        np.testing.assert_allclose(wavelength, [400.0, 410.0])
        np.testing.assert_array_equal(transmission, [0.0, 0.5])
        assert found is photons
