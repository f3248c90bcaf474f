"""Named libraries: what the reference frames show."""

import math

import numpy as np
import pytest

from cpic_planner.etc import build_model, planet_offsets
from cpic_planner.queries import Strategy
from cpic_planner.targets import find_target
from cpic_planner.validation import LibraryPlan, library_plan, roll_photometry, roll_subtract
from simulator import load_instrument, load_scene, observe
from simulator.target import sky_to_detector

SCENE = load_scene(
    {
        "name": "a pair",
        "cstar": {"v_mag": 3.0, "teff_k": 5772, "log_g": 4.4, "metallicity": 0.0, "ra_deg": 10.0, "dec_deg": -20.0},
        "planet": {"v_mag": 13.0, "spectrum": "blackbody", "teff_k": 1500.0, "separation_arcsec": 0.6, "pa_deg": 315.0},
        "stars": [{"v_mag": 6.0, "spectral_type": "K1V", "separation_arcsec": 6.0, "pa_deg": 40.0}],
        "extended": [
            {"kind": "disc", "contrast": 1e-6, "inner_arcsec": 0.1, "outer_arcsec": 1.0},
            {"kind": "ring", "v_mag": 18.0, "radius_arcsec": 1.0, "fwhm_arcsec": 0.1},
        ],
    }
)
OTHER = {"v_mag": 1.0, "teff_k": 4500.0, "log_g": 4.5, "metallicity": -0.2}
STRATEGIES = {
    "same_star_planet_free": Strategy(reference_ratio=0.5),
    "reference_star": Strategy(library="reference_star", reference_star=OTHER, reference_ratio=2.0),
    "roll": Strategy(library="roll", roll_deg=40.0),
    "idealised": Strategy(library="idealised", reference_ratio=0.5),
}


def plan(name: str, n_frames: int = 10) -> LibraryPlan:
    return library_plan(STRATEGIES[name], SCENE, n_frames)


@pytest.mark.parametrize(
    ("name", "planets", "stars", "role", "frames"),
    [
        ("same_star_planet_free", 0, 1, "reference", 5),
        ("reference_star", 0, 0, "reference", 20),
        ("roll", 1, 1, "reference", 10),
        ("idealised", 0, 1, "science", 10),
    ],
)
def test_what_the_references_show(name: str, planets: int, stars: int, role: str, frames: int) -> None:
    made = plan(name)
    assert made.science_scene == SCENE
    assert (made.science["role"], made.science["n_frames"]) == ("science", 10)
    assert len(made.reference_scene.planets) == planets
    assert len(made.reference_scene.stars) == stars
    assert (made.reference["role"], made.reference["n_frames"]) == (role, frames)
    assert made.shows_planet == (planets == 1)
    assert made.noise_free == (name == "idealised")
    turned = 20.0 if name == "roll" else 0.0
    assert (made.science["roll_deg"], made.reference["roll_deg"]) == (-turned, turned)


def test_number_of_frames(refused) -> None:
    few = library_plan(Strategy(reference_ratio=0.1), SCENE, 1)
    assert few.reference["n_frames"] == 1
    assert library_plan(Strategy(reference_ratio=0.3), SCENE, 5).reference["n_frames"] == 2
    for wrong in (0, 2.5, True):
        refused("n_frames", library_plan, Strategy(), SCENE, wrong)


def test_the_reference_star_stands_in_the_same_sky_with_dust_like_the_stars_own() -> None:
    other = plan("reference_star").reference_scene
    assert other.name != SCENE.name
    assert (other.cstar.ra_deg, other.cstar.dec_deg) == (10.0, -20.0)
    assert {key: getattr(other.cstar, key) for key in OTHER} == OTHER
    for mine, its in zip(SCENE.extended, other.extended, strict=True):
        assert its.contrast_to(other.cstar.v_mag) == pytest.approx(mine.contrast_to(SCENE.cstar.v_mag), rel=1e-12)


@pytest.mark.parametrize("parity", [-1, 1])
def test_rolls_stand_where_the_etc_puts_them(parity: int) -> None:
    """Half the roll to either side of the diagonal, in some order."""
    instrument = load_instrument({"detector": {"parity": parity}})
    model = build_model(instrument, ["F520"], STRATEGIES["roll"])
    x, y = planet_offsets(model, find_target("tau Cet")[0], "F520", 0.6)
    sign_x, sign_y = model.metrics["F520"].zone.diagonal
    pa = math.degrees(math.atan2(parity * sign_x, sign_y))
    made = plan("roll")
    found = [
        sky_to_detector(0.6, pa, roll_deg=visit["roll_deg"], parity=parity) for visit in (made.science, made.reference)
    ]
    assert any(np.allclose(place, (x, y), atol=1e-12) for place in found)
    # The two are mirror images in the diagonal.
    (x1, y1), (x2, y2) = found
    assert (x1 * sign_x, y1 * sign_y) == pytest.approx((y2 * sign_y, x2 * sign_x), abs=1e-12)
    assert math.hypot(x1 - x2, y1 - y2) == pytest.approx(2 * 0.6 * math.sin(math.radians(20.0)))


def visits(name: str, scene=SCENE, **more):
    made = library_plan(STRATEGIES[name], scene, 2)
    setup = {"band": "F520", "exposure_s": 10.0, "window": "hole", "fidelity": "quick", **more}
    return observe(made.science_scene, **setup, **made.science), observe(
        made.reference_scene, **setup, **made.reference
    )


def test_images_of_the_reference_star_have_the_rates_of_the_etc() -> None:
    science, reference = visits("reference_star")
    model = build_model(load_instrument(), ["F520"], STRATEGIES["reference_star"])
    star = np.array([science.truth.sources[0].rate_e_s])
    assert 1.0 / model.library_noise("F520", star).halo[0] == pytest.approx(
        reference.truth.sources[0].rate_e_s / star[0], rel=1e-9
    )
    assert len(reference.truth.sources) == 1


def test_two_rolls_of_one_scene() -> None:
    """The planet moves and keeps its flux, the speckles stay but for the drift between the visits."""
    scene = SCENE.model_copy(update={"companions": "off", "extended": ()})
    science, reference = visits("roll", scene)
    psf, pixel = science.psf, science.psf.metrics.pixel_scale_arcsec
    maps, places, templates = [], [], []
    for seen in (science, reference):
        without = observe(
            scene.without_planets(),
            band="F520",
            exposure_s=10.0,
            window="hole",
            fidelity="quick",
            role=seen.role,
            roll_deg=seen.roll_deg,
            n_frames=2,
        )
        planet = seen.mean_rate_map - without.mean_rate_map
        places.append((seen.truth.x_pixel[1], seen.truth.y_pixel[1]))
        templates.append(psf.at(seen.truth.sources[1].x_arcsec, seen.truth.sources[1].y_arcsec))
        assert planet == pytest.approx(seen.truth.sources[1].rate_e_s * templates[-1], abs=1e-3 * planet.max())
        maps.append(without.mean_rate_map)
    assert math.dist(*places) * pixel == pytest.approx(2 * 0.6 * math.sin(math.radians(20.0)), rel=1e-3)
    hole = psf.metrics.hole
    # Each visit has its own wavefront offset; without, the speckles are the same.
    assert np.corrcoef(maps[0][hole], maps[1][hole])[0, 1] < 0.99
    still = {"drift": {"visit_nm": 0.0, "walk_nm_per_sqrt_hour": 0.0}}
    one, two = (seen.mean_rate_map for seen in visits("roll", scene.without_planets(), instrument=still))
    assert one == pytest.approx(two, rel=1e-12)
    light = [seen.mean_rate_map[None] for seen in (science, reference)]
    cut = roll_subtract(*light, 1, region=hole)
    found = roll_photometry(
        cut, *templates, *places, psf.metrics.aperture_radius_arcsec / pixel, background_region=hole
    )
    core = np.mean(
        [
            psf.metrics.core_throughput(source.x_arcsec, source.y_arcsec)
            for source in (science.truth.sources[1], reference.truth.sources[1])
        ]
    )
    assert found.significance > 100
    assert found.flux == pytest.approx(core * science.truth.sources[1].rate_e_s, rel=4 / found.significance + 0.005)


def test_an_idealised_library_is_the_science_visit_without_planet_and_noise() -> None:
    made = plan("idealised")
    science, reference = visits("idealised")
    planet = science.expected_e - reference.expected_e
    hole = science.psf.metrics.hole
    weight = science.truth.sources[1].rate_e_s * 10.0
    # What is left is the planet alone: a hundredth of it elsewhere would be drift.
    assert 0.1 * weight < planet[hole].sum() < weight
    assert planet.min() > -1e-9 * reference.expected_e.max()
    assert made.noise_free
