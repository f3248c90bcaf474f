from __future__ import annotations

import numpy as np
import pytest

from catalogs.errors import InputError
from simulator.camera import aperture_noise_pixels, excess_noise_factor2, expose_frame, pixel_variance_e2, to_electrons


def test_terms_by_hand(bare) -> None:
    det = bare(read_noise_e=110, gain_e_adu=59)
    assert float(pixel_variance_e2(0.0, 0.0, 1.0, det)) == pytest.approx(110**2 + 59**2 / 12)
    assert float(pixel_variance_e2(3.0, 0.5, 1.0, det)) == pytest.approx(3.5 + 110**2 + 59**2 / 12)
    expected = float(excess_noise_factor2(300.0)) * 3.5 + (110 / 300) ** 2 + (59 / 300) ** 2 / 12
    assert float(pixel_variance_e2(3.0, 0.5, 300.0, det)) == pytest.approx(expected)


def test_broadcasts(bare_detector) -> None:
    out = pixel_variance_e2(np.ones((3, 1)), 0.02, np.array([1.0, 20.0]), bare_detector)
    assert out.shape == (3, 2)
    assert (out[:, 0] > out[:, 1]).all()


@pytest.mark.parametrize(
    ("arguments", "named"),
    [((-1.0, 0.0, 2.0), "photon_e"), ((1.0, np.nan, 2.0), "cic_e"), ((1.0, 0.0, 0.5), "gain")],
)
def test_refusals(arguments: tuple[float, float, float], named: str, bare_detector) -> None:
    with pytest.raises(InputError, match=named):
        pixel_variance_e2(*arguments, bare_detector)


def test_a_googol_is_the_most(bare_detector) -> None:
    """1e100 electrons and pixels are taken, and give finite figures; any number above is not."""
    most, more = 1e100, float(np.nextafter(1e100, 1e101))
    factor2 = float(excess_noise_factor2(20.0))
    assert float(pixel_variance_e2(most, 0.0, 20.0, bare_detector)) == pytest.approx(factor2 * most, rel=1e-14)
    assert float(pixel_variance_e2(0.0, most, 20.0, bare_detector)) == pytest.approx(factor2 * most, rel=1e-14)
    assert float(aperture_noise_pixels(most)) == pytest.approx(np.pi * 1e200, rel=1e-14)
    for call in (
        lambda: pixel_variance_e2(more, 0.0, 20.0, bare_detector),
        lambda: pixel_variance_e2(0.0, more, 20.0, bare_detector),
        lambda: aperture_noise_pixels(more),
    ):
        with pytest.raises(InputError, match="to 1e\\+100"):
            call()


@pytest.mark.parametrize("gain", [1.0, 1.1, 2.0, 20.0, 300.0, 1000.0])
def test_frames_have_this_mean_and_variance(gain: float, bare) -> None:
    det = bare(cic_e=0.3, dark_e_s=0.05, bias_adu=400)
    rate, exposure, side = 0.2, 10.0, 500
    frame = expose_frame(np.full((side, side), rate), exposure, gain, det, seed=5, path=("noise", int(gain * 10)))
    electrons = to_electrons(frame.adu, det, gain)
    mean = (rate + 0.05) * exposure + 0.3
    variance = float(pixel_variance_e2((rate + 0.05) * exposure, 0.3, gain, det))
    assert frame.n_clipped == frame.n_saturated_pixels == frame.n_register_saturated == 0
    assert abs(electrons.mean() - mean) < 4 * np.sqrt(variance / side**2)
    # Kurtosis of the compound gain law is at most 6/n + 6/lambda, plus 3 of a normal.
    assert electrons.var() == pytest.approx(variance, rel=4 * np.sqrt((2 + 9 / mean) / side**2))


@pytest.mark.parametrize("radius", [1.0, 1.5, 2.32, 3.8, 8.0])
def test_aperture_noise_pixels_against_exact_weights(radius: float) -> None:
    from photutils.aperture import CircularAperture

    rng = np.random.default_rng(1)
    sums = [
        np.sum(CircularAperture(centre, radius).to_mask(method="exact").data ** 2) for centre in rng.random((400, 2))
    ]
    error = np.std(sums) / np.sqrt(400)
    assert float(aperture_noise_pixels(radius)) == pytest.approx(np.mean(sums), rel=0.02 / radius**3, abs=4 * error)


def test_aperture_noise_pixels_needs_a_resolved_circle() -> None:
    with pytest.raises(InputError, match="radius_pixel"):
        aperture_noise_pixels([2.0, 0.9])
