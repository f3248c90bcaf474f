"""Smear of the frame transfer in the closed forms, against expected whole frames."""

from dataclasses import replace

import numpy as np
import pytest

from cpic_planner.confirm import scene_target
from cpic_planner.etc import aperture_rates, build_model, stack_noise
from cpic_planner.queries import Strategy
from simulator import load_instrument, load_scene, observe
from simulator.imaging import aperture_sums, overlap_weights

DARK_SKY = {"sky": {"model": "uniform", "brightness_v_mag_arcsec2": 40.0}}
STILL = {"drift": {"visit_nm": 0.0, "walk_nm_per_sqrt_hour": 0.0}}
STAR = {"v_mag": 2.0, "teff_k": 5800, "log_g": 4.4, "metallicity": 0.0, "ra_deg": 100.0, "dec_deg": 20.0}
PLACES = np.array([-0.6, -0.45, -0.3, 0.3, 0.45, 0.6])


def companion(separation, pa):
    return {"name": "B", "v_mag": 4.0, "teff_k": 5200, "separation_arcsec": separation, "pa_deg": pa}


def rates_of(instrument, band, scene, strategy=None, x=PLACES):
    model = build_model(instrument, [band], strategy)
    target = scene_target(load_scene(scene))
    return aperture_rates(model, target, band, x[None, :], x[None, :], np.full((1, x.size), 1e-9)), model


def smear_map(instrument, band, scene, model):
    """Smear in apertures around the pixels of the stamp, on whole frames."""
    metrics = model.metrics[band]
    seen = observe(scene, band=band, exposure_s=1.0, instrument=instrument)
    rows, columns, _ = seen.area.stamp(len(metrics.raw_contrast))
    weights = overlap_weights(metrics.aperture_radius_arcsec / metrics.pixel_scale_arcsec)
    return aperture_sums(seen.smear_e[rows, columns], weights)


@pytest.mark.parametrize("band", ["F520", "F850"])
@pytest.mark.parametrize("sky_mag", [40.0, 14.0], ids=["star", "bright sky"])
def test_apertures_collect_what_whole_frames_do(band, sky_mag):
    instrument = load_instrument(STILL | {"sky": {"model": "uniform", "brightness_v_mag_arcsec2": sky_mag}}).switched(
        {"flat": False}
    )
    scene = {"name": "s", "cstar": STAR}
    _, model = rates_of(instrument, band, scene)
    pixel = np.rint(PLACES / model.metrics[band].pixel_scale_arcsec).astype(int)
    seen = smear_map(instrument, band, scene, model)
    rates, _ = rates_of(instrument, band, scene, x=pixel * model.metrics[band].pixel_scale_arcsec)
    middle = len(seen) // 2
    np.testing.assert_allclose(rates.smear_e[0], seen[pixel + middle, pixel + middle], rtol=0.01)


@pytest.mark.parametrize(
    ("band", "separation", "pa_deg"),
    [
        pytest.param("F520", 6.0, 4.0, id="companion in the columns"),
        pytest.param("F850", 4.0, 200.0, id="companion beside them"),
        pytest.param("F850", 6.0, 4.0, id="companion in the columns in the red", marks=pytest.mark.long),
        pytest.param("F520", 4.0, 200.0, id="companion beside them in the green", marks=pytest.mark.long),
    ],
)
def test_companions_smear_into_the_apertures_that_measure_the_noise(band, separation, pa_deg):
    """Mean over the whole apertures of the annulus that are not at the planet."""
    instrument = load_instrument(STILL | DARK_SKY).switched({"flat": False})
    alone = {"name": "s", "cstar": STAR}
    pair = alone | {"stars": [companion(separation, pa_deg)]}
    place = np.array([0.6 / 2**0.5])
    (both, model), (star, _) = (rates_of(instrument, band, scene, x=place) for scene in (pair, alone))
    seen = smear_map(instrument, band, pair, model) - smear_map(instrument, band, alone, model)
    metrics = model.metrics[band]
    radius, pixel = metrics.aperture_radius_arcsec, metrics.pixel_scale_arcsec
    offset = (np.arange(len(seen)) - len(seen) // 2) * pixel
    ring = metrics.annulus(0.6, 1.5) & (np.hypot(offset - place, (offset - place)[:, None]) > 1.5 * radius)
    used = (overlap_weights(radius / pixel) > 0).astype(float)
    whole = aperture_sums(ring.astype(float), used) > used.sum() - 0.5
    assert (both.smear_e - star.smear_e).item() == pytest.approx(seen[whole].mean(), rel=0.1)


def test_a_companion_beyond_the_frame_counts_with_its_wings():
    scene = {"name": "s", "cstar": STAR, "stars": [companion(12.0, 0.0)]}
    rates, model = rates_of(load_instrument(DARK_SKY), "F520", scene)
    alone, _ = rates_of(load_instrument(DARK_SKY), "F520", scene | {"stars": []})
    passed = 1024 * model.camera("F520").line_shift_s * rates.companion_e_s
    np.testing.assert_allclose(rates.smear_e - alone.smear_e, passed, rtol=1e-6)


@pytest.mark.parametrize("library", ["same_star_planet_free", "roll", "idealised", "reference_star"])
def test_noise_falls_to_that_without_smear_as_lines_shift_faster(library):
    other = {"reference_star": {"v_mag": 1.0}} if library == "reference_star" else {}
    strategy, scene = Strategy(library=library, **other), {"name": "s", "cstar": STAR}
    found = {}
    for shift in (1.5e-6, 1.5e-9, 0.0, "off"):
        change = {"switches": {"smear": False}} if shift == "off" else {"transfer": {"line_shift_s": shift}}
        rates, model = rates_of(load_instrument({"detector": change}), "F850", scene, strategy)
        found[shift] = stack_noise(rates, 0.3, 1000.0, 1000.0, model.camera("F850"))
    assert np.all(found["off"].terms["smear"] == 0)
    np.testing.assert_array_equal(found[0.0].snr, found["off"].snr)
    assert np.all(found[1.5e-6].snr < found["off"].snr)
    lost, less = (found["off"].snr ** -2 - found[shift].snr ** -2 for shift in (1.5e-6, 1.5e-9))
    np.testing.assert_allclose(less / lost, 1e-3, rtol=1e-6)


def test_a_brighter_reference_smears_less_once_it_is_scaled():
    """Star light by the ratio of rates, the sky by its square; the library without noise adds none."""
    scene, instrument = {"name": "s", "cstar": STAR}, load_instrument(DARK_SKY)
    same, _ = rates_of(instrument, "F520", scene)
    np.testing.assert_allclose(same.reference_smear_e, same.smear_e, rtol=1e-12)
    brighter = Strategy(
        library="reference_star",
        reference_star={name: STAR[name] for name in ("teff_k", "log_g", "metallicity")}
        | {"v_mag": STAR["v_mag"] - 2.5},
    )
    rates, _ = rates_of(instrument, "F520", scene, brighter)
    np.testing.assert_allclose(rates.reference_smear_e, same.smear_e / 10.0, rtol=1e-6)
    none, _ = rates_of(instrument, "F520", scene, Strategy(library="idealised"))
    assert not np.any(none.reference_smear_e)


def test_counted_photons_share_their_pixels_with_the_smear():
    """As much light a frame in the same pixels has the same noise, whether it smears in or falls on them."""
    scene = {"name": "s", "cstar": STAR}
    rates, model = rates_of(load_instrument(), "F850", scene, Strategy(mode="photon_counting"))
    zero, exposure = 0.0 * rates.smear_e, 0.5
    lit = replace(
        rates,
        smear_e=zero,
        reference_smear_e=zero,
        sky_e_s=rates.sky_e_s + rates.smear_e / exposure,
        reference_light_e_s=rates.reference_light_e_s + rates.reference_smear_e / exposure,
    )
    smeared, plain = (
        stack_noise(one, exposure, 100.0, 1000.0, model.camera("F850"), model.strategy) for one in (rates, lit)
    )
    np.testing.assert_allclose(smeared.snr, plain.snr, rtol=1e-12)
