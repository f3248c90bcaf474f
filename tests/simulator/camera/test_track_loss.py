"""Rates of hits against drawn tracks, and the mean track against samples and closed forms."""

import math

import mpmath
import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import norm

from simulator.camera import aperture_loss_per_s, noise
from simulator.camera.noise import mean_projection_um
from simulator.config import load_instrument
from simulator.detectors import clean_fraction
from simulator.effects import cosmic_ray_rate, draw_cosmic_rays, generated_projection_um
from simulator.effects.cosmic_rays import PaperModel, PhysicalModel, generated_templates
from simulator.imaging import overlap_weights

EXPOSURES = 2500
PHASES = 25


def clean_share(instrument, band, radius_pixel, exposure_s, flux):
    """Share of exposures whose aperture sum gains no electron; the aperture lies anywhere on its pixel."""
    rng = np.random.default_rng(7)
    steps = (np.arange(5) + 0.5) / 5 - 0.5
    weights = [overlap_weights(radius_pixel, y, x) for y in steps for x in steps]
    pixel_um = instrument.detector_of(band).pixel_um
    clean = 0
    for number in range(EXPOSURES):
        weight = weights[number % PHASES]
        rays = draw_cosmic_rays(instrument.cosmic_rays, weight.shape, pixel_um, exposure_s, flux, rng)
        clean += float(weight.ravel()[rays.pixels] @ rays.electrons) < 1.0
    return clean / EXPOSURES


def test_rate_is_that_of_sticks_thrown_on_a_disc():
    """Crofton: straight tracks of the mean length, any direction, on a disc widened by their charge's reach."""
    config = load_instrument()
    rays, pixel = config.cosmic_rays, config.detector.pixel_um
    length = mean_projection_um(rays.physical.depth_um, rays.physical.max_length_um)
    radius = 6.0
    rate = aperture_loss_per_s(config, "F662", aperture_radius_pixel=radius) / cosmic_ray_rate(
        rays, config.mission.start_utc
    )
    rng, n, side = np.random.default_rng(3), 400_000, 400.0
    reach = (radius + 0.25) * pixel + 3.1 * rays.physical.diffusion_um
    x, y = side * (rng.random((2, n)) - 0.5)
    along = np.clip(-x, -length / 2, length / 2)  # nearest point of a stick along x
    hits = np.hypot(x + along, y) < reach
    assert rate * 1e8 == pytest.approx(hits.mean() * side**2, rel=0.03)


@pytest.mark.parametrize(
    ("model", "band"),
    [
        ("physical", "F520"),
        pytest.param("physical", "F1265", marks=pytest.mark.long),
        pytest.param("paper", "F520", marks=pytest.mark.long),
        ("template", "F662"),
    ],
)
def test_clean_fraction_is_that_of_drawn_exposures(model, band):
    """Dense enough particles that half of the frames are lost; nothing depends on their number but the rate."""
    instrument = load_instrument({"cosmic_rays": {"model": model, "peak_rate_per_s_cm2": 50.0}})
    radius = instrument.aperture_radius_arcsec(band) / instrument.pixel_scale_arcsec(band)
    loss = aperture_loss_per_s(instrument, band, start_utc=2028.0)
    exposure = 0.7 / loss
    expected = float(clean_fraction(loss, exposure))
    seen = clean_share(instrument, band, radius, exposure, cosmic_ray_rate(instrument.cosmic_rays, 2028.0))
    error = math.sqrt(expected * (1 - expected) / EXPOSURES)
    assert abs(seen - expected) < 4.5 * error + 0.03 * expected


def test_default_loses_a_few_frames_in_a_hundred():
    """Area of the aperture alone is the least, half of it all: 2 % of frames of 300 s in F520."""
    instrument = load_instrument()
    loss = aperture_loss_per_s(instrument, "F520")
    bare = cosmic_ray_rate(instrument.cosmic_rays, instrument.mission.start_utc) * (13e-4) ** 2
    bare *= instrument.aperture_pixels("F520")
    assert 2 * bare < loss < 4 * bare
    assert float(clean_fraction(loss, 300.0)) == pytest.approx(0.977, abs=0.003)
    assert aperture_loss_per_s(instrument, "F850") > loss


def test_loss_follows_radius_rate_and_date():
    instrument = load_instrument()
    radii = (1.0, 2.0, 4.0, 100.0, 200.0)
    by_radius = [aperture_loss_per_s(instrument, "F662", aperture_radius_pixel=radius) for radius in radii]
    assert np.all(np.diff(by_radius) > 0)
    assert by_radius[-1] / by_radius[-2] == pytest.approx(4.0, rel=0.03)
    # area plus perimeter: the second difference of a parabola in the radius is 2 pi times the flux per pixel
    second = np.diff([aperture_loss_per_s(instrument, "F662", aperture_radius_pixel=r) for r in (1.0, 2.0, 3.0)], 2)
    flux = cosmic_ray_rate(instrument.cosmic_rays, instrument.mission.start_utc)
    assert second[0] == pytest.approx(2 * math.pi * flux * (13e-4) ** 2, rel=1e-9)
    minimum, maximum = (aperture_loss_per_s(instrument, "F662", start_utc=t) for t in (2019.96, 2025.46))
    assert maximum / minimum == pytest.approx(0.7, rel=1e-6)
    double = load_instrument({"cosmic_rays": {"orbit_factor": 2.0}})
    assert aperture_loss_per_s(double, "F662") == pytest.approx(2 * aperture_loss_per_s(instrument, "F662"))


def test_no_particles_no_loss():
    off = {"switches": {"cosmic_rays": False}}
    instrument = load_instrument({"detector": off})
    assert aperture_loss_per_s(instrument, "F520") == 0.0
    assert aperture_loss_per_s(instrument, "F1265") > 0.0
    assert aperture_loss_per_s(load_instrument({"near_infrared": {"detector": off}}), "F1265") == 0.0
    assert aperture_loss_per_s(load_instrument({"cosmic_rays": {"peak_rate_per_s_cm2": 0}}), "F520") == 0.0


@pytest.mark.parametrize("longest", [15.0, 100.0, 1000.0, 1e6])
def test_mean_projection_is_the_integral(longest):
    least = (14.0 / longest) ** 2
    # with mu = cos(angle), the element 2 mu d(mu) keeps the integrand smooth
    expected, _ = quad(lambda mu: 2 * mu * 14.0 * math.sqrt(1 / mu**2 - 1), math.sqrt(least), 1.0)
    assert mean_projection_um(14.0, longest) == pytest.approx(expected / (1 - least), rel=1e-8)
    assert mean_projection_um(14.0, 1e9) == pytest.approx(7 * math.pi, rel=1e-7)


def test_mean_projection_is_that_of_the_models():
    rays = load_instrument().cosmic_rays
    for model in (PhysicalModel(rays.physical, 13.0), PaperModel(rays.paper, 13.0)):
        drawn = model.tracks(200_000, np.random.default_rng(3)).projected_um
        expected = mean_projection_um(model.config.depth_um, model.config.max_length_um)
        assert abs(drawn.mean() - expected) < 4 * drawn.std() / math.sqrt(drawn.size)


def test_templates_count_as_they_are(tmp_path):
    """A set from a file, by its hulls, loses what the same set made here loses, by the tracks that it was made from."""
    rays = load_instrument().cosmic_rays
    made = generated_templates(rays.template, rays.physical)
    # the longest side of a bar, blurred by the charge cloud
    bar = math.sqrt(float(np.mean(made.extent_um**2)) - 12 * rays.physical.diffusion_um**2)
    assert generated_projection_um(rays.template, rays.physical) < bar
    images = []
    side = 2 * int(np.abs(np.concatenate([made.row_um, made.column_um])).max() / made.pixel_um) + 5
    for first, last in zip(made.start[:-1], made.start[1:], strict=True):
        image = np.zeros((side, side))
        row, column = (
            np.rint(part[first:last] / made.pixel_um).astype(int) + side // 2 for part in (made.row_um, made.column_um)
        )
        image[row, column] = made.weight[first:last]
        images.append(image)
    np.savez(tmp_path / "set.npz", templates=np.array(images), pixel_um=made.pixel_um)
    from_file = {"model": "template", "template": {"template_file": str(tmp_path / "set.npz")}}
    losses = [
        aperture_loss_per_s(load_instrument({"cosmic_rays": tree}), "F520")
        for tree in (from_file, {"model": "template"})
    ]
    assert losses[0] == pytest.approx(losses[1], rel=0.03)


def test_one_sample_is_a_point(tmp_path):
    np.savez(tmp_path / "dot.npz", templates=np.ones((1, 1, 1)), pixel_um=1.0)
    np.savez(tmp_path / "line.npz", templates=np.ones((1, 1, 14)), pixel_um=10.0)
    dot, line = (
        aperture_loss_per_s(
            load_instrument(
                {
                    "cosmic_rays": {
                        "model": "template",
                        "peak_rate_per_s_cm2": 1.0,
                        "cycle_depth": 0.0,
                        "template": {"template_file": str(tmp_path / name)},
                    }
                }
            ),
            "F520",
            aperture_radius_pixel=10.0,
        )
        for name in ("dot.npz", "line.npz")
    )
    assert dot == pytest.approx(1e-8 * math.pi * (10.25 * 13 + 0.5) ** 2)
    assert line == pytest.approx(1e-8 * (math.pi * (10.25 * 13 + 5) ** 2 + 2 * 130 * (10.25 * 13 + 5)))


def test_bad_input_is_refused(refused):
    instrument = load_instrument()
    refused("band", aperture_loss_per_s, instrument, "F999")
    refused("aperture_radius_pixel", aperture_loss_per_s, instrument, "F520", aperture_radius_pixel=0.0)
    refused("when", aperture_loss_per_s, instrument, "F520", start_utc="yesterday")
    refused("max_length_um", mean_projection_um, 14.0, 14.0)


@pytest.mark.parametrize("angle", [1e-9, 1e-4, 0.3, 0.999, 1.001, 2.5, 6.0])
def test_an_angle_less_its_sine(angle):
    with mpmath.workdps(60):
        exact = float(mpmath.mpf(angle) - mpmath.sin(mpmath.mpf(angle)))
    assert noise._less_sine(angle) == pytest.approx(exact, rel=1e-14, abs=0.0)


@pytest.mark.parametrize("model", ["physical", "paper", "template"])
def test_the_hull_of_a_mean_track_ends_where_its_charge_is_one_electron(model):
    """A straight track has no area and two sides; the Gaussian beyond its end or side holds one electron."""
    rays = load_instrument({"cosmic_rays": {"model": model}}).cosmic_rays
    area, perimeter, reach = noise._mean_shape_um(rays)
    tracks, streaks = rays.physical, rays.paper
    if model == "paper":
        length, sigma = mean_projection_um(streaks.depth_um, streaks.max_length_um), streaks.width_um
    elif model == "template":
        length, sigma = generated_projection_um(rays.template, tracks), tracks.diffusion_um
    else:
        length, sigma = mean_projection_um(tracks.depth_um, tracks.max_length_um), tracks.diffusion_um
    near_e = streaks.mean_charge_e * min(1.0, noise._STRETCH_SIGMA * sigma / length)
    if model == "physical":
        near_e = tracks.mean_loss_e_um * tracks.depth_um
    assert (area, perimeter) == (0.0, pytest.approx(2.0 * length, rel=1e-12))
    assert near_e * norm.sf(reach / sigma) == pytest.approx(1.0, rel=1e-9)
