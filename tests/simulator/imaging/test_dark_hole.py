import dataclasses

import numpy as np
import pytest

from simulator.config import ARCSEC_PER_RAD, load_instrument
from simulator.imaging import HoleZone
from simulator.imaging.build import bare_imager, dark_hole_of
from simulator.imaging.dark_hole import (
    ControlSettings,
    DarkHole,
    UnreachedHole,
    default_settings,
    score_hole,
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
    assert type(hole) is DarkHole
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


def test_two_quadrants_go_inside_the_four(small):
    # The inner edge may differ from the imager's.
    hole = solve_dark_hole(
        small,
        draw_aberrations(3, samples=64),
        MIRROR,
        mode="2q",
        inner_arcsec=0.19,
        settings=ControlSettings(max_iterations=8),
    )
    assert hole.zone.inner_arcsec == 0.19
    assert hole.before.mean / hole.wide.mean > 100


def test_a_hole_not_reached_is_another_type(small):
    hole = solve_dark_hole(small, draw_aberrations(4, samples=64), MIRROR, settings=ControlSettings(max_iterations=1))
    assert type(hole) is UnreachedHole
    assert not isinstance(hole, DarkHole)
    assert "F662 4q" in hole.reason
    assert "asked 2e-09" in hole.reason
    assert "1 iterations (iterations)" in hole.reason
    lenient = solve_dark_hole(
        small, draw_aberrations(4, samples=64), MIRROR, settings=ControlSettings(max_iterations=1), limit_contrast=1e-4
    )
    assert type(lenient) is DarkHole
    np.testing.assert_array_equal(lenient.commands_nm, hole.commands_nm)


def test_single_jacobian_is_a_named_less_ideal_state(small):
    aberrations = draw_aberrations(1, samples=64)
    once = solve_dark_hole(small, aberrations, MIRROR, settings=default_settings("4q", "single_jacobian"))
    anew = solve_dark_hole(small, aberrations, MIRROR)
    assert once.method == "single_jacobian"
    assert type(once) is DarkHole
    assert once.limit_contrast == 5e-8
    assert once.wide.mean > 3 * anew.wide.mean


def test_what_is_asked_of_a_hole_allows_for_the_errors_of_sensing(small):
    aberrations = draw_aberrations(1, samples=64)
    hole = solve_dark_hole(small, aberrations, MIRROR, settings=default_settings("4q", sensing_contrast=1e-7))
    assert type(hole) is DarkHole
    assert hole.limit_contrast == pytest.approx(2e-9 + 5e-8)
    assert 1e-8 < hole.wide.mean <= hole.limit_contrast
    assert len(hole.search.strong) <= 10
    assert not any(hole.search.strong)
    assert default_settings("2q", sensing_contrast=1e-7).goal_contrast == default_settings("2q").goal_contrast
    assert default_settings("4q", "single_jacobian", 1e-7).sensing_contrast == 1e-7


def test_band_is_scored_in_its_own_width(refused, small):
    aberrations = draw_aberrations(1, samples=64)
    hole = solve_dark_hole(small, aberrations, MIRROR, settings=ControlSettings(max_iterations=4))
    own = score_hole(small, aberrations, MIRROR, hole.commands_nm, hole.zone, small.wavelengths_m, small.weights)
    assert hole.own == own
    assert hole.own != hole.wide
    refused("aberrations", solve_dark_hole, small, flat_aberrations(128), MIRROR)


@pytest.mark.long
def test_amplitude_errors_alone_do_not_stall_the_search():
    """A flat mirror is a saddle for them: the first step must come from elsewhere."""
    instrument = load_instrument({"wavefront": {"opd_rms_nm": 0, "amplitude_rms": 0.003}})
    imager = bare_imager(instrument, "F850", Knobs(wavelength_nodes=3))
    hole = solve_dark_hole(imager, draw_aberrations(1, samples=128, opd_rms_nm=0.0))
    assert type(hole) is DarkHole
    assert hole.before.mean > 5e-9
    assert hole.wide.mean < 1e-9
