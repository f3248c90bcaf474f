""""""

import dataclasses

import numpy as np
import pytest

from simulator.config import ARCSEC_PER_RAD, load_instrument
from simulator.imaging import HoleZone
from simulator.imaging.build import bare_imager, dark_hole_of
from simulator.imaging.dark_hole import (
    Conjugation,
    ControlSettings,
    _NormalEquations,
    _step,
    conjugate,
    default_settings,
    score_hole,
    sensed,
    solve_dark_hole,
)
from simulator.imaging.deformable_mirror import DeformableMirror
from simulator.imaging.pupil import draw_aberrations, flat_aberrations
from simulator.knobs import Knobs

INSTRUMENT = load_instrument()
FLAT = {"wavefront": {"opd_rms_nm": 0, "amplitude_rms": 0, "jitter_mas": 0}, "dark_hole": {"control": "off"}}
SMALL = load_instrument(FLAT | {"coronagraph": {"outer_half_side_arcsec": 0.45}})
MIRROR = DeformableMirror(n_actuators=16)


@pytest.fixture(scope="module")
def small():
    return bare_imager(SMALL, "F662")


@pytest.fixture(scope="module")
def default_hole():
    """The state that comes with the package: what a search finds is another test's matter."""
    imager = bare_imager(INSTRUMENT, "F662", Knobs(wavelength_nodes=5))
    return imager, draw_aberrations(1, samples=128).pointed(imager.transmission), dark_hole_of(INSTRUMENT, "F662")


def test_default_hole_is_as_dark_as_stated(default_hole):
    _, _, hole = default_hole
    assert hole.reached
    assert hole.before.mean > 1e-5
    for score in (hole.wide, hole.own):
        assert score.mean <= 1e-9
        assert score.p95 <= 3e-9
        assert score.median < score.mean < score.p95 < score.max
        assert score.strehl >= 0.9
        assert score.core_throughput >= 0.12
    assert hole.before.mean / hole.wide.mean > 3e4
    assert np.abs(hole.commands_nm).max() <= DeformableMirror().stroke_nm / 2
    assert 1 < hole.commands_nm.std() < 50
    with pytest.raises(ValueError, match="read-only"):
        hole.commands_nm[0, 0] = 1.0


def test_score_is_what_hcipy_propagates(default_hole):
    imager, aberrations, hole = default_hole
    static = aberrations.plus_opd(DeformableMirror().opd_nm(hole.commands_nm, 128))
    behind = dataclasses.replace(imager, transmission=imager.transmission * static.amplitude)
    y, x = hole.zone.score_axes(0.25 * imager.lambda_d_arcsec)
    zero = np.zeros(1)
    peak = behind.intensity(zero, zero, opd_nm=static.opd_nm, engine="hcipy")[0, 0]
    contrast = behind.intensity(y, x, opd_nm=static.opd_nm, engine="hcipy") / peak
    assert hole.own.mean == pytest.approx(contrast.mean(), rel=1e-6)
    assert hole.own.max == pytest.approx(contrast.max(), rel=1e-6)
    assert hole.own.strehl == pytest.approx(peak / imager.intensity(zero, zero)[0, 0], rel=1e-12)


def test_hole_survives_on_a_finer_grid_only_with_its_own_samples(default_hole):
    _, aberrations, hole = default_hole
    fine = bare_imager(INSTRUMENT, "F662", Knobs(pupil_samples=256, wavelength_nodes=5))
    mirror, rest = DeformableMirror(), np.zeros((32, 32))
    repeated = aberrations.plus_opd(mirror.opd_nm(hole.commands_nm, 128)).upsampled(256)
    assert score_hole(fine, repeated, mirror, rest, hole.zone).mean == pytest.approx(hole.own.mean, rel=1e-9)
    anew = score_hole(fine, aberrations.upsampled(256), mirror, hole.commands_nm, hole.zone).mean
    assert anew > 2 * hole.own.mean


def test_converter_of_16_bits_is_fine_and_of_12_is_not(default_hole):
    imager, aberrations, hole = default_hole
    means = [
        score_hole(imager, aberrations, mirror, mirror.realise(hole.commands_nm), hole.zone).mean
        for mirror in (DeformableMirror(bits=16), DeformableMirror(bits=12))
    ]
    assert means[0] < 1.1 * hole.own.mean
    assert 3e-9 < means[1] < 6e-9


def test_score_against_a_direct_sum_over_the_pupil(small):
    aberrations = draw_aberrations(2, samples=64)
    commands = np.random.default_rng(5).normal(0, 5, (16, 16))
    zone = HoleZone(0.25, 0.3)
    wavelength = 650e-9
    score = score_hole(small, aberrations, MIRROR, commands, zone, np.array([wavelength]), np.ones(1))
    y, x = zone.score_axes(0.25 * small.lambda_d_arcsec)
    pupil = small.transmission * aberrations.amplitude
    pupil = pupil * np.exp(2j * np.pi / 650 * (aberrations.opd_nm + 2 * MIRROR.surface_nm(commands, 64)))
    position = ((np.arange(64) + 0.5) / 64 - 0.5) * 2.0
    values = []
    for angle_y in y:
        for angle_x in x:
            u, v = (angle / ARCSEC_PER_RAD / wavelength for angle in (angle_x, angle_y))
            wave = np.exp(-2j * np.pi * (u * position + v * position[:, None]))
            values.append(abs((pupil * wave).sum() * np.sinc(u / 32) * np.sinc(v / 32)) ** 2)
    values = np.array(values) / abs(pupil.sum()) ** 2
    assert score.mean == pytest.approx(values.mean(), rel=1e-10)
    assert score.p95 == pytest.approx(np.percentile(values, 95), rel=1e-10)
    assert score.strehl == pytest.approx(abs(pupil.sum()) ** 2 / small.transmission.sum() ** 2, rel=1e-12)


def test_core_of_flat_optics_is_the_apodizers():
    imager = bare_imager(INSTRUMENT, "F720", Knobs(wavelength_nodes=1))
    zone = HoleZone(*imager.hole_arcsec)
    score = score_hole(imager, flat_aberrations(128), DeformableMirror(), np.zeros((32, 32)), zone)
    nodes, weights = np.polynomial.legendre.leggauss(12)
    radii, angles = 0.5 * (nodes + 1) * imager.aperture_radius_arcsec, np.arange(32) * 2 * np.pi / 32
    energy = 0.0
    for radius, weight in zip(radii, weights, strict=True):
        fields = [
            imager.field(0, np.array([radius * np.sin(t)]), np.array([radius * np.cos(t)]), engine="matrix")
            for t in angles
        ]
        energy += weight * radius * np.mean(np.abs(fields) ** 2)
    energy *= np.pi * imager.aperture_radius_arcsec / ARCSEC_PER_RAD**2
    assert score.core_throughput == pytest.approx(energy, rel=1e-9)
    assert score.strehl == pytest.approx(1.0, rel=1e-12)
    assert score.max < 1e-8  # the apodizer alone, designed at 1e-9


def test_two_quadrants_lie_on_the_named_side(small):
    aberrations = draw_aberrations(3, samples=64)
    settings = ControlSettings(max_iterations=8)
    angles = np.linspace(0.25, 0.42, 30)
    for side, sign, axis in (("right", 1, "x"), ("bottom", -1, "y")):
        hole = solve_dark_hole(small, aberrations, MIRROR, mode="2q", side=side, settings=settings)
        static = aberrations.plus_opd(MIRROR.opd_nm(hole.commands_nm, 64))
        behind = dataclasses.replace(small, transmission=small.transmission * static.amplitude)
        means = {}
        for direction in (sign, -sign):
            across, along = np.sort(direction * angles), np.concatenate([-angles[::-1], angles])
            y, x = (along, across) if axis == "x" else (across, along)
            means[direction] = behind.intensity(y, x, opd_nm=static.opd_nm, engine="matrix").mean()
        assert means[sign] < 1e-2 * means[-sign]


def test_a_hole_not_reached_is_another_type(small):
    hole = solve_dark_hole(small, draw_aberrations(4, samples=64), MIRROR, settings=ControlSettings(max_iterations=1))
    assert not hole.reached
    assert "F662 4q" in hole.reason
    assert "asked 2e-09" in hole.reason
    assert "1 iterations (iterations)" in hole.reason
    assert dataclasses.replace(hole, limit_contrast=1e-4).reached


def test_single_jacobian_is_a_named_less_ideal_state(small):
    aberrations = draw_aberrations(1, samples=64)
    once = solve_dark_hole(small, aberrations, MIRROR, settings=default_settings("4q", "single_jacobian"))
    anew = solve_dark_hole(small, aberrations, MIRROR)
    assert once.method == "single_jacobian"
    assert once.reached
    assert once.limit_contrast == 5e-8
    assert once.wide.mean > 3 * anew.wide.mean


def test_what_is_asked_of_a_hole_allows_for_the_errors_of_sensing(small):
    aberrations = draw_aberrations(1, samples=64)
    hole = solve_dark_hole(small, aberrations, MIRROR, settings=default_settings("4q", sensing_contrast=1e-7))
    assert hole.reached
    assert hole.limit_contrast == pytest.approx(2e-9 + 5e-8)
    assert 1e-8 < hole.wide.mean <= hole.limit_contrast
    assert len(hole.search.strong) <= 10
    assert not any(hole.search.strong)
    assert default_settings("2q", sensing_contrast=1e-7).goal_contrast == default_settings("2q").goal_contrast
    assert default_settings("4q", "single_jacobian", 1e-7).sensing_contrast == 1e-7


def test_band_is_scored_in_its_own_width(small):
    aberrations = draw_aberrations(1, samples=64)
    hole = solve_dark_hole(small, aberrations, MIRROR, settings=ControlSettings(max_iterations=4))
    own = score_hole(small, aberrations, MIRROR, hole.commands_nm, hole.zone, small.wavelengths_m, small.weights)
    assert hole.own == own
    assert hole.own != hole.wide


@pytest.mark.long
def test_amplitude_errors_alone_do_not_stall_the_search():
    """A flat mirror is a saddle for them: the first step must come from elsewhere."""
    instrument = load_instrument({"wavefront": {"opd_rms_nm": 0, "amplitude_rms": 0.003}})
    imager = bare_imager(instrument, "F850", Knobs(wavelength_nodes=3))
    hole = solve_dark_hole(imager, draw_aberrations(1, samples=128, opd_rms_nm=0.0))
    assert hole.reached
    assert hole.before.mean > 5e-9
    assert hole.wide.mean < 1e-9


IMAGER = bare_imager(load_instrument(FLAT), "F662")  # 64 samples: the steps of the apodizer
CENTER_M = 662e-9
ZONE = HoleZone(IMAGER.hole_arcsec[0], 0.42)
ABERRATIONS = draw_aberrations(1, samples=64)


def problem(mirror=MIRROR, zone=ZONE, aberrations=ABERRATIONS, **settings):
    settings = ControlSettings(**settings)
    return Conjugation(IMAGER, aberrations, mirror, zone, settings), settings


def test_jacobian_is_the_derivative_of_the_field():
    optics, _ = problem(DeformableMirror(n_actuators=6), n_wavelengths=2)
    state = np.random.default_rng(1).normal(0, 20, (6, 6))
    for index in range(2):
        jacobian = optics.jacobian(state, index)
        largest = np.abs(jacobian).max()
        for row, column in ((0, 0), (2, 3), (5, 1)):
            push = np.zeros((6, 6))
            push[row, column] = 1e-2
            change = (optics.fields(state + push)[index] - optics.fields(state - push)[index]) / 2e-2
            # Central differences leave (phase per nm x 0.01 nm)^2 / 6, some 1e-9 of the derivative.
            assert np.abs(jacobian[:, 6 * row + column] - change.ravel()).max() < 1e-8 * largest


def test_fields_are_those_of_the_psf():
    optics, settings = problem(n_wavelengths=3)
    commands = np.random.default_rng(2).normal(0, 10, (16, 16))
    opd_nm = ABERRATIONS.opd_nm + MIRROR.opd_nm(commands, 64)
    y, x = ZONE.control_axes(0.5 * IMAGER.lambda_d_arcsec, 0.1 * IMAGER.lambda_d_arcsec)
    behind = dataclasses.replace(
        IMAGER, transmission=IMAGER.transmission * ABERRATIONS.amplitude, wavelengths_m=optics.wavelengths_m
    )
    flat = dataclasses.replace(IMAGER, wavelengths_m=optics.wavelengths_m)
    origin, weights = np.zeros(1), np.array([5, 8, 5]) / 18
    peak = sum(w * abs(flat.field(i, origin, origin)[0, 0]) ** 2 for i, w in enumerate(weights))
    fields = optics.fields(commands)
    light = 0.0
    for index, weight in enumerate(weights):
        field = behind.field(index, y, x, opd_nm=opd_nm, engine="hcipy")
        assert np.abs(np.abs(fields[index]) ** 2 - weight * np.abs(field) ** 2 / peak).max() < 1e-12
        light += weight * abs(behind.field(index, origin, origin, opd_nm=opd_nm)[0, 0]) ** 2
    assert optics.strehl(commands) == pytest.approx(light / peak, rel=1e-12)
    assert optics.wavelengths_m[[0, 2]] == pytest.approx(CENTER_M * (1 + np.array([-1, 1]) * 0.05 * np.sqrt(0.6)))
    assert settings.bandwidth == 0.1


def test_a_step_is_the_damped_least_squares_solution():
    rng = np.random.default_rng(3)
    matrix, field = rng.normal(size=(40, 7)), rng.normal(size=40)
    normal = matrix.T @ matrix
    damping = np.sqrt(1e-3 * normal.diagonal().max()) * np.eye(7)
    expected = np.linalg.lstsq(np.concatenate([matrix, damping]), np.concatenate([-field, np.zeros(7)]), rcond=None)[0]
    np.testing.assert_allclose(_step(normal, matrix.T @ field, -3.0), expected, rtol=1e-9)


def test_search_darkens_at_every_step_but_the_strong_ones():
    optics, settings = problem(max_iterations=16, tolerance=0.0)
    found = conjugate(optics, settings)
    assert len(found.history) == 1 + len(found.strong)
    assert [i for i, strong in enumerate(found.strong) if strong] == [4, 9]
    for before, after, strong in zip(found.history[:-1], found.history[1:], found.strong, strict=True):
        assert strong or after < before
    fields = optics.fields(found.commands_nm)
    assert (np.abs(fields) ** 2).sum(axis=0).mean() == pytest.approx(min(found.history), rel=1e-12)
    assert found.history[0] / min(found.history) > 5e3


def test_search_stops_at_the_goal_or_when_nothing_is_gained():
    optics, settings = problem(goal_contrast=1e-7)
    found = conjugate(optics, settings)
    assert found.ended == "goal"
    assert found.history[-1] <= 1e-7 * optics.strehl(found.commands_nm) < found.history[-2]
    optics, settings = problem(tolerance=0.5, max_iterations=60)
    found = conjugate(optics, settings)
    assert found.ended == "converged"
    assert len(found.strong) < 60


def test_search_from_the_solution_has_little_to_do():
    optics, settings = problem(max_iterations=12)
    first = conjugate(optics, settings)
    second = conjugate(optics, settings, first.commands_nm)
    assert second.history[0] == pytest.approx(min(first.history), rel=1e-12)
    assert min(second.history) <= second.history[0]


def test_dead_actuators_and_stroke_are_respected():
    mirror = DeformableMirror(n_actuators=16, stroke_nm=8.0, dead=((7, 7), (3, 12)))
    optics, settings = problem(mirror, max_iterations=6)
    found = conjugate(optics, settings)
    assert found.commands_nm[7, 7] == 0 == found.commands_nm[3, 12]
    assert np.abs(found.commands_nm).max() <= mirror.stroke_nm / 2
    free = conjugate(*problem(max_iterations=6))
    assert np.abs(free.commands_nm).max() > 4.0
    assert min(found.history) > min(free.history)


def test_actuator_noise_adds_what_the_jacobian_says():
    optics, settings = problem(max_iterations=8)
    state = conjugate(optics, settings).commands_nm
    sigma = 0.5
    expected = sigma**2 * sum((np.abs(optics.jacobian(state, i)) ** 2).sum(axis=1).mean() for i in range(3))
    nominal = (np.abs(optics.fields(state)) ** 2).sum(axis=0).mean()
    noisy = DeformableMirror(n_actuators=16, noise_nm=sigma)
    rng = np.random.default_rng(4)
    draws = [(np.abs(optics.fields(noisy.realise(state, rng))) ** 2).sum(axis=0).mean() - nominal for _ in range(200)]
    assert abs(np.mean(draws) - expected) < 4 * np.std(draws) / np.sqrt(200)


def test_single_jacobian_stalls_above_the_relinearised_search():
    once = conjugate(*problem(method="single_jacobian", strong_every=0, exponents=(-1.0, -2.0, -3.0)))
    anew = conjugate(*problem())
    assert min(once.history) > 2 * min(anew.history)
    assert min(once.history) < 0.02 * once.history[0]
    assert list(once.history) == sorted(once.history, reverse=True)


def test_perfect_optics_stay_as_good_as_the_apodizer():
    optics, settings = problem(aberrations=flat_aberrations(64), max_iterations=5)
    found = conjugate(optics, settings)
    assert found.history[0] < 1e-8
    assert min(found.history) <= found.history[0]


def test_the_mirror_does_not_point():
    """The slope of the commanded surface, weighted with the light, is zero; left free it is not."""
    slopes = {}
    for hold in (True, False):
        optics, settings = problem(max_iterations=3, hold_star=hold, n_wavelengths=1)
        surface = MIRROR.surface_nm(conjugate(optics, settings).commands_nm, 64)
        position = (np.arange(len(surface)) + 0.5) / len(surface) - 0.5
        slopes[hold] = [abs((IMAGER.transmission * surface * plane).sum()) for plane in (position, position[:, None])]
    assert max(slopes[True]) < 1e-6 * max(slopes[False])


def test_the_error_of_sensing_is_that_of_probes():
    """Two pairs of probes, images with Poisson noise: ``1 / (4 N)`` over one square lambda/D and the whole band."""
    photons, step, shares = 1e7, 0.5, np.array([5, 8, 5]) / 18
    rng = np.random.default_rng(5)
    field = 1e-5 * np.exp(2j * np.pi * rng.random((3, 200, 200)))
    light = photons * step**2 * shares[:, None, None]  # at the peak, in a pixel of half a lambda/D, at one wavelength
    parts = []
    for probe in (1e-3, 1e-3j):
        bright, faint = (rng.poisson(light * np.abs(field + sign * probe) ** 2) for sign in (1, -1))
        parts.append((bright - faint) / (4 * light * abs(probe)))
    probed = (parts[0] + 1j * parts[1] - field) * np.sqrt(shares)[:, None, None]
    settings = ControlSettings(sensing_contrast=1 / (4 * photons), step_lambda_d=step)
    drawn = sensed(field, settings, np.random.default_rng(6)) - field
    for parts_of in (np.real, np.imag):
        for index in range(3):  # each a mean of 40,000 squares, good to 0.7 %
            one, other = ((parts_of(errors[index]) ** 2).mean() for errors in (probed, drawn))
            assert one == pytest.approx(other, rel=0.04)
    cells = (np.sqrt(shares)[:, None, None] * drawn).sum(axis=0).reshape(100, 2, 100, 2).mean(axis=(1, 3))
    assert (np.abs(cells) ** 2).mean() == pytest.approx(1 / (4 * photons), rel=0.05)


def test_a_step_brings_the_errors_of_sensing_into_the_hole():
    """As many of them as the singular values of the Jacobian let through, by the field behind the moved mirror."""
    optics, settings = problem(n_wavelengths=1, sensing_contrast=1e-8, hold_star=False)
    dark = conjugate(optics, dataclasses.replace(settings, sensing_contrast=0.0)).commands_nm
    fields, equations, rng = optics.fields(dark), _NormalEquations(optics, settings), np.random.default_rng(7)
    stacked = optics.jacobian(dark, 0)
    values = np.linalg.svd(np.concatenate([stacked.real, stacked.imag]), compute_uv=False)
    damping = 1e-2 * (np.abs(stacked) ** 2).sum(axis=0).max()
    passed = ((values**2 / (values**2 + damping)) ** 2).sum()
    expected = passed * settings.sensing_contrast / 2 / settings.step_lambda_d**2 / fields[0].size
    quiet = dark + _step(*equations.at(dark, fields), -2.0).reshape(16, 16)
    draws = []
    for _ in range(60):
        moved = dark + _step(*equations.at(dark, sensed(fields, settings, rng)), -2.0).reshape(16, 16)
        draws.append((np.abs(optics.fields(moved) - optics.fields(quiet)) ** 2).sum(axis=0).mean())
    assert abs(np.mean(draws) - expected) < 4 * np.std(draws) / np.sqrt(60)


def test_the_hole_is_as_dark_as_the_field_is_known():
    few = {"max_iterations": 10, "strong_every": 0, "tolerance": 0.0, "exponents": (1.0, 0.0, -1.0, -2.0, -3.0, -4.0)}

    def darkest(sensing, seed=1):
        found = conjugate(*problem(sensing_contrast=sensing, sensing_seed=seed, **few))
        assert list(found.history) == sorted(found.history, reverse=True)
        return min(found.history)

    perfect = darkest(0)
    assert darkest(1e-14) == pytest.approx(perfect, rel=0.01)
    errors = (3e-8, 3e-7, 3e-6)
    ends = [darkest(error) for error in errors]
    assert perfect < ends[0] < ends[1] < ends[2]
    for error, end in zip(errors, ends, strict=True):
        assert 0.1 * error < end - perfect < 0.8 * error
    assert darkest(3e-7) == ends[1] != darkest(3e-7, seed=2)
    assert darkest(3e-7, seed=2) == pytest.approx(ends[1], rel=0.3)
