"""Every size against images with and without the effect."""

import math

import numpy as np
import pytest

from cpic_core import stream
from simulator import load_instrument, observe
from simulator.camera import aperture_loss_per_s
from simulator.config import Timing
from simulator.detectors import VISIBLE
from simulator.detectors.chains import switched
from simulator.effects import draw_cosmic_rays
from simulator.imaging import centred_axis, psf_metrics, single_band_psf
from simulator.imaging.drift import low_order_map
from simulator.ledger import forecast, light
from simulator.ledger.light import pixel_hits
from simulator.ledger.visit import Visit, largest_speckles
from simulator.signal import drift_halo

SETTINGS = {"band": "F662", "exposure_s": 2.0, "n_frames": 4, "em_gain": 20.0}
# Nothing overflows in the scene, and the clocks of the register make nothing by default.
ELSEWHERE = ("blooming", "register_full_well", "register_clock_charge")
FLUX = ("flat", "smear", "nonlinearity", "parallel_cti", "serial_cti")


@pytest.fixture(scope="module")
def bright(make, calm, report):
    """A scene, its observation and the predicted sizes."""
    scene = make(v_mag=3.0)
    whole = observe(scene, **SETTINGS, window="hole", instrument=calm)
    return scene, whole, forecast(scene, calm, **SETTINGS), report.truth


@pytest.mark.parametrize("key", [name for name in switched(VISIBLE) if name not in ELSEWHERE])
def test_size_of_a_switch_bounds_what_it_changes(key, bright, calm):
    scene, whole, said, truth = bright
    # Without the dark current its structure and the charge of hot pixels go too.
    more = ("dark_structure", "bad_pixels", "bad_columns") if key == "dark" else ()
    base = (
        whole
        if not more
        else observe(scene, **SETTINGS, window="hole", instrument=calm, switches=dict.fromkeys(more, False))
    )
    short = observe(scene, **SETTINGS, window="hole", instrument=calm, switches=dict.fromkeys((key, *more), False))
    true = truth.true_difference(base, short)
    for name in ("planet_flux", "snr", "pixel_map"):
        size, found = said.sizes[key][name], getattr(true, name)
        # Half a share of a variance is the first order of the change that follows.
        most = size if size < 0.2 or name == "planet_flux" else math.inf
        assert found <= 1.1 * most / max(1.0 - 2.0 * min(size, 0.3), 0.4) + 1e-5, name
        if found > 1e-3:
            assert size < 30 * found, name
    if key in FLUX:
        assert true.planet_flux > 1e-8


def test_saturation_is_seen_where_it_is(make, calm):
    faint, blooming = (forecast(make(v_mag=v), calm, **(SETTINGS | {"exposure_s": 300.0})) for v in (9.0, -2.0))
    for key in ("blooming", "register_full_well"):
        assert faint.sizes[key]["pixel_map"] < 1e-12
        assert faint.sizes[key]["planet_flux"] == 0.0
    assert blooming.sizes["register_full_well"]["pixel_map"] > 1.0
    assert blooming.sizes["register_full_well"]["planet_flux"] == 1.0
    # and with it everything that could tip the balance
    assert blooming.sizes["smear"]["planet_flux"] == 1.0
    assert blooming.sums.status.value == "saturated"
    assert faint.sums.status.value == "ok"


def test_reduced_sizes_leave_what_is_calibrated(make, calm):
    said = forecast(make(), calm, **SETTINGS, reduced=True).sizes
    for key in """
        flat dark_structure bad_pixels bad_columns stripes interference bias_drift nonlinearity
    """.split():
        assert said[key]["planet_flux"] == said[key]["snr"] == said[key]["pixel_map"] == 0.0
    assert said["parallel_cti"]["planet_flux"] > 0
    assert said["cosmic_rays"]["snr"] > 0


def test_particles_cost_frames(make, calm):
    said = forecast(make(v_mag=9.0), calm, **(SETTINGS | {"exposure_s": 300.0})).sizes["cosmic_rays"]["snr"]
    lost = aperture_loss_per_s(calm, "F662")
    assert said == pytest.approx(1.0 - math.sqrt(math.exp(-lost * 300.0)), rel=1e-12)


def test_moments_of_tracks_are_those_of_other_tracks(calm):
    rays, pixel = calm.cosmic_rays, calm.detector.pixel_um
    said = pixel_hits(rays, pixel)
    area = (1000 * pixel * 1e-4) ** 2
    drawn = draw_cosmic_rays(rays, (1000, 1000), pixel, 1.0, 6000.0 / area, stream(9, "other"))
    charge = drawn.electrons.astype(float)
    assert said.mean_e == pytest.approx(charge.sum() / drawn.n_events, rel=0.05)
    assert said.square_e2 == pytest.approx((charge**2).sum() / drawn.n_events, rel=0.1)
    level = 1000.0
    assert said.share_above(level) == pytest.approx((charge[charge >= level] ** 2).sum() / (charge**2).sum(), abs=0.05)


def test_moments_of_tracks_are_drawn_once_but_for_those_of_a_file(calm, tmp_path, monkeypatch):
    monkeypatch.setenv("CPIC_CACHE_DIR", str(tmp_path))
    np.savez(tmp_path / "tracks.npz", templates=np.ones((1, 3, 3)), pixel_um=5.0)
    named = {"template": {"template_file": str(tmp_path / "tracks.npz")}, "model": "template"}
    own = calm.changed({"cosmic_rays": named}).cosmic_rays
    drawn = []
    monkeypatch.setattr(light, "draw_cosmic_rays", lambda *given: drawn.append(given) or draw_cosmic_rays(*given))
    for rays, times in ((calm.cosmic_rays, 1), (own, 2)):
        before, said = len(drawn), []
        for _ in range(2):
            pixel_hits.cache_clear()
            said.append(pixel_hits(rays, 13.0))
        assert said[0][:2] == said[1][:2]
        np.testing.assert_array_equal(said[0].charge_e, said[1].charge_e)
        assert len(drawn) - before == times


@pytest.mark.parametrize("place", [(0.9, 0.35), (2.0, 2.5), (6.0, -0.4)])
def test_size_of_a_star_left_out(place, make, calm, report):
    x, y = place
    star = {
        "name": "t",
        "v_mag": 9.0,
        "teff_k": 5000,
        "separation_arcsec": math.hypot(x, y),
        "pa_deg": math.degrees(math.atan2(-x, y)) % 360,
    }
    whole, short = (observe(make(stars=part), **SETTINGS, window="hole", instrument=calm) for part in ([star], []))
    true = report.truth.true_difference(whole, short)
    said = forecast(make(stars=[star]), calm, **SETTINGS).sizes["star:t"]
    for name in ("snr", "pixel_map"):
        assert getattr(true, name) <= 1.1 * said[name] + 1e-6, name
    assert said["planet_flux"] == 0.0


def test_settings_of_the_optics_for_a_scene(make, calm, report):
    from simulator.knobs import FIDELITIES

    best = FIDELITIES["reference"].model_copy(update={"pupil_samples": 64})
    scene = make(v_mag=3.0)
    settings = SETTINGS | {"window": "hole", "instrument": calm}
    whole, said = observe(scene, **settings, fidelity=best), forecast(scene, calm, **SETTINGS).knob_sizes
    for key, value in (("wavelength_nodes", 1), ("wavelength_nodes", 3), ("pixel_nodes", 2), ("precision", "single")):
        short = observe(scene, **settings, fidelity=best.model_copy(update={key: value}))
        true = report.truth.true_difference(whole, short)
        for name in ("planet_flux", "snr", "pixel_map"):
            assert getattr(true, name) <= 1.1 * said[key][value][name] + 1e-9, (key, value, name)
            if getattr(true, name) > 1e-4:
                assert said[key][value][name] < 50 * getattr(true, name), (key, value, name)


def test_fewer_epochs_miss_the_variance_of_a_walk(make):
    """Variance of the mean of a walk sampled at the middle of e intervals, by its covariance min(s, s')."""
    exact = 1.0 / 3.0
    for epochs in (1, 2, 3, 6):
        middle = (np.arange(epochs) + 0.5) / epochs
        sampled = np.minimum(middle[:, None], middle).mean()
        assert sampled == pytest.approx(exact * (1.0 + 0.5 / epochs**2), rel=1e-12)
    walking = load_instrument({"drift": {"visit_nm": 0.0, "walk_nm_per_sqrt_hour": 0.5}})
    said = forecast(make(v_mag=0.0), walking, **(SETTINGS | {"n_frames": 1000}))
    few, more = (said.knob_sizes["drift_epochs"][n]["snr"] for n in (1, 6))
    assert few > 20 * more > 0
    assert said.knob_sizes["drift_epochs"][12]["snr"] == 0.0
    assert said.knob_sizes["drift_epochs"][1]["pixel_map"] > said.knob_sizes["drift_epochs"][6]["pixel_map"] > 0


@pytest.mark.parametrize(
    ("n_frames", "orders", "walk"), [(7, "low", 0.0), (7, "all", 0.05), (300, "low", 0.05), (300, "all", 0.0)]
)
def test_fewer_epochs_average_the_swing_with_the_orbit(n_frames, orders, walk, make, report):
    """Images of both, each frame of its own epoch, with the same map and walk."""
    drift = {"visit_nm": 0.02, "walk_nm_per_sqrt_hour": walk, "orbital_nm": 0.1, "orbital_orders": orders}
    swinging, scene = load_instrument({"drift": drift}), make(v_mag=3.0)
    settings = SETTINGS | {"n_frames": n_frames, "exposure_s": 40.0}
    said = forecast(scene, swinging, **settings, max_epochs=6).knob_sizes["drift_epochs"]
    settings |= {"window": "hole", "instrument": swinging, "seed": 3}
    whole = observe(scene, **settings, max_epochs=6)
    for epochs in (1, 2, 4):
        true = report.truth.true_difference(whole, observe(scene, **settings, max_epochs=epochs))
        assert 3e-3 < true.pixel_map < said[epochs]["pixel_map"] < 100 * true.pixel_map, epochs
        assert true.planet_flux < 1e-3
    assert said[6]["pixel_map"] == 0.0


@pytest.mark.parametrize("scheme", ["interleaved", "half"])
@pytest.mark.parametrize(("n_frames", "epochs"), [(6, 1), (7, 4), (50, 2), (50, 4)])
def test_the_swing_of_a_frame_is_the_mean_over_its_epoch(n_frames, epochs, scheme, make):
    """Frame by frame and at every phase, on a fine grid of times in the windows of the orbits."""
    timing, period_s, each_s = Timing(scheme), 5000.0, 300.0
    drift = {"visit_nm": 0.0, "walk_nm_per_sqrt_hour": 0.0, "orbital_nm": 0.1, "orbital_period_s": period_s}
    instrument = load_instrument({"drift": drift})
    exposure_s = each_s - instrument.detector.readout_s
    found = Visit(
        make(), instrument, **(SETTINGS | {"n_frames": n_frames, "exposure_s": exposure_s}), max_epochs=6, timing=timing
    )
    window = timing.window_turns / (2.0 if scheme == "half" else 1.0)
    on_source = (np.arange(120_000) + 0.5) / 120_000 * n_frames * each_s / period_s
    turns = on_source // window + on_source % window
    swings = np.sin(2.0 * np.pi * (turns + np.linspace(0.0, 1.0, 60, endpoint=False)[:, None]))
    frames, largest = np.arange(n_frames), []
    for count in (6, epochs):
        means = swings.reshape(60, count, -1).mean(axis=2)
        largest.append(means[:, frames * count // n_frames])
    expected = 0.1 * math.sqrt(2.0) * np.abs(largest[0] - largest[1]).max()
    assert found._swing_nm(epochs) == pytest.approx(expected, rel=3e-3)
    assert found._swing_nm(6) == 0.0


def test_what_visits_have_in_common_grows_with_their_number(make):
    """Half the share that it has in the variance of the programme, by the law; what averages counts less and less."""
    drift = {"visit_nm": 0.1, "walk_nm_per_sqrt_hour": 0.0, "common_fraction": 0.3, "orbital_nm": 0.05}
    drifting = load_instrument({"drift": drift | {"orbital_orders": "all"}})
    settings = SETTINGS | {"n_frames": 1000}
    found = [
        forecast(make(v_mag=0.0), drifting, **settings, visits=visits, timing=Timing("other_star")).sizes
        for visits in (1, 4, 64)
    ]
    for key in ("drift_common", "orbital_drift"):
        few, more, many = (sizes[key]["snr"] for sizes in found)
        assert 0 < few < more < many < 0.5, key
        assert found[0][key]["pixel_map"] == found[2][key]["pixel_map"] > 0
    for key in ("photon_noise", "read_noise", "clock_charge"):
        few, more, many = (sizes[key]["snr"] for sizes in found)
        assert few > more > many > 0, key
    # More than half of the variance of so many visits.
    assert found[2]["drift_common"]["snr"] + found[2]["orbital_drift"]["snr"] > 0.25


def test_a_small_orbit_is_not_drawn(make):
    """Low orders of 0.1 nm change nothing that was asked for; a screen of that size in another part of orbits does."""
    low = load_instrument()
    high = low.changed({"drift": {"orbital_orders": "all"}})
    settings = SETTINGS | {"n_frames": 1000, "window": "hole", "max_epochs": 1, "timing": Timing("other_star")}
    settings |= {"quantity": "snr", "tolerance": 0.02}
    kept = {
        name: observe(make(v_mag=1.0), **settings, instrument=instrument, visits=16)
        for name, instrument in (("low", low), ("high", high))
    }
    rows = {name: {row.key: row for row in seen.ledger} for name, seen in kept.items()}
    assert rows["low"]["orbital_drift"].decision == "skipped"
    assert "SNR" in rows["low"]["orbital_drift"].reason
    assert rows["high"]["orbital_drift"].decision == rows["low"]["drift_common"].decision == "kept"
    assert kept["low"].instrument.drift.orbital_nm == 0.0 < kept["high"].instrument.drift.orbital_nm
    assert kept["low"].choice.still == ("orbital_nm",)


@pytest.mark.parametrize("band", ["F520", "F850"])
def test_an_orbit_of_low_orders_changes_no_pixel_by_more_than_it_says(band):
    """Full propagation at the largest swing, either sign, on the whole stamp; the light of a screen of that rms."""
    instrument, largest_nm = load_instrument(), 0.1 * math.sqrt(2.0)
    psf, figures = single_band_psf(band), psf_metrics(instrument, band)
    axis, shape = psf.imager.stamp_axis(masked=True), low_order_map(len(psf.imager.transmission))
    grid = psf.imager.focal_grid(axis, axis)
    still, swung = grid.image(), [grid.image(sign * largest_nm * shape) for sign in (1, -1)]
    place = centred_axis(len(still), psf.imager.pixel_scale_arcsec)
    radius = np.hypot(place[:, None], place)
    halo = drift_halo(figures, radius, largest_nm, 2.5, instrument.band(band).center_nm) * figures.peak_off_axis
    change = np.max([np.abs(image - still) for image in swung], axis=0)
    assert 0.05 < np.max(change / largest_speckles(still, halo)) < 0.5
