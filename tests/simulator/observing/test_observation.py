"""Scenes to frames: absolute pictures, energy bookkeeping, streams."""

import numpy as np
import pytest

from cpic_core import InputError
from simulator import load_instrument, observe
from simulator.imaging import psf_metrics, single_band_psf, store
from simulator.imaging.pupil import configured_apodizer
from simulator.passbands import Passbands

STAR = {"name": "star", "v_mag": 5.0, "teff_k": 5800}
QUIET_CAMERA = {"cosmic_rays": False, "interference": False}
QUIET = {"drift": {"visit_nm": 0, "walk_nm_per_sqrt_hour": 0, "orbital_nm": 0.0}}


def planet(pa_deg, separation=0.5, distance=0.02):
    return {
        "name": "b",
        "radius_rjup": 10,
        "distance_au": distance,
        "phase_deg": 60,
        "separation_arcsec": separation,
        "pa_deg": pa_deg,
    }


def scene(*planets, **more):
    return {"name": "s", "cstar": STAR, "planets": list(planets)} | more


def difference(pa_deg, *, roll=0.0, parity=-1):
    """Expected light of the planet alone, on the star-centred stamp."""
    instrument = load_instrument(QUIET | {"detector": {"parity": parity}})
    settings = {"band": "F520", "exposure_s": 1.0, "window": "hole", "instrument": instrument, "roll_deg": roll}
    with_planet = observe(scene(planet(pa_deg)), **settings)
    return with_planet.mean_rate_map - observe(scene(), **settings).mean_rate_map


def axes(image):
    """Offsets y and x of every pixel from the star, arcsec."""
    return [(part - image.shape[0] // 2) * 0.016153 for part in np.indices(image.shape)]


def centroid(image):
    """Of the core: the wings are cut by cross and stamp."""
    y, x = axes(image)
    row, column = np.unravel_index(image.argmax(), image.shape)
    core = image * (np.hypot(y - y[row, column], x - x[row, column]) < 0.05)
    return np.sum(core * x) / core.sum(), np.sum(core * y) / core.sum()


@pytest.mark.parametrize(("pa", "signs"), [(45, (-1, 1)), (135, (-1, -1)), (225, (1, -1)), (315, (1, 1))])
def test_position_angle_grows_from_north_through_east_at_the_left(pa, signs):
    x, y = centroid(difference(pa))
    assert (np.sign(x), np.sign(y)) == signs
    assert abs(x) == pytest.approx(0.5 / 2**0.5, abs=0.004)
    assert abs(y) == pytest.approx(0.5 / 2**0.5, abs=0.004)


def test_parity_flips_x_only_and_roll_turns_the_sky():
    x, y = centroid(difference(45, parity=1))
    assert x > 0
    assert y > 0
    x, y = centroid(difference(45, roll=90.0))
    assert x > 0  # PA 45 at roll 90 is where PA -45 is at roll 0
    assert y > 0


def test_a_planet_behind_an_arm_of_the_cross_is_not_seen():
    sums = []
    for pa, place in ((0.0, (0.0, 0.5)), (45.0, (-(0.5**1.5), 0.5**1.5))):
        image = difference(pa)
        y, x = axes(image)
        sums.append(image[np.hypot(x - place[0], y - place[1]) < 0.0375].sum())
    assert sums[0] == 0  # wholly behind the bar of +-0.155 arcsec
    assert sums[1] > 0


@pytest.fixture
def figures_of_others(tmp_path, monkeypatch):
    """Metrics of the default optics for any other but for the state of the hole: measuring them takes long."""

    def measure(instrument, band):
        state = single_band_psf(band, instrument=instrument).hole_state
        return psf_metrics(load_instrument(), band).to_arrays() | {"hole_state": np.asarray(state)}

    monkeypatch.setenv("CPIC_CACHE_DIR", str(tmp_path))
    monkeypatch.setattr(store, "measure", measure)


def test_light_is_counted_once(figures_of_others):
    """An unmasked star's image holds F A t_opt QE E, within the field's loss."""
    instrument = load_instrument(
        QUIET
        | {"coronagraph": {"mask_half_width_arcsec": 0.0}, "sky": {"model": "uniform", "brightness_v_mag_arcsec2": 40}}
    )
    seen = observe(scene(), band="F662", exposure_s=1.0, instrument=instrument)
    passbands = Passbands.from_instrument(instrument)
    rate = passbands.star_rate_e_s(5.0, 5800, 4.5, 0.0, instrument.telescope.area_cm2)[passbands.index("F662")]
    disc = np.pi / 4.0  # of the square that the mask is given on
    expected = rate * float((configured_apodizer(instrument) ** 2).mean()) / disc
    assert seen.mean_rate_map.sum() == pytest.approx(expected, rel=0.01)
    assert seen.mean_rate_map.sum() < expected


def test_contrast_of_a_planet_is_the_ratio_of_detected_rates():
    seen = observe(scene(planet(45)), band="F520", exposure_s=1.0, window="hole")
    star, body = seen.truth.sources
    assert body.contrast == pytest.approx(body.rate_e_s / star.rate_e_s, rel=1e-14)
    assert difference(45).sum() == pytest.approx(body.rate_e_s * seen.psf.metrics.apodizer_energy, rel=0.06)


def test_frames_are_uint16_of_the_detector_and_independent():
    seen = observe(scene(), band="F520", exposure_s=0.1, n_frames=2, em_gain=5, seed=3, switches=QUIET_CAMERA)
    first, second = seen.frames
    assert first.shape == (1050, 1080)
    assert first.dtype == np.uint16
    assert not np.array_equal(first, second)
    dark = first[:200, :200].astype(float) - second[:200, :200]
    detector = seen.instrument.detector
    noise = np.sqrt(detector.read_noise_e**2 / detector.gain_e_adu**2 + 1 / 12)
    assert dark.std() / np.sqrt(2) == pytest.approx(noise, rel=0.1)


def test_any_frame_can_be_had_alone():
    seen = observe(scene(planet(45)), band="F520", exposure_s=10.0, n_frames=5, em_gain=50, seed=3, window="hole")
    again = observe(scene(planet(45)), band="F520", exposure_s=10.0, n_frames=5, em_gain=50, seed=3, window="hole")
    np.testing.assert_array_equal(seen.frames[3], again.frame(3).adu)
    other = observe(scene(planet(45)), band="F520", exposure_s=10.0, n_frames=5, em_gain=50, seed=4, window="hole")
    assert not np.array_equal(seen.frame(3).adu, other.frame(3).adu)


def test_roles_have_their_own_visit():
    settings = {"band": "F520", "exposure_s": 10.0, "n_frames": 1, "window": "hole"}
    science, reference = (observe(scene(), role=role, **settings) for role in ("science", "reference"))
    assert not np.array_equal(science.light.star.rate_e_s, reference.light.star.rate_e_s)
    calm = settings | {"instrument": load_instrument(QUIET)}
    science, reference = (observe(scene(), role=role, **calm) for role in ("science", "reference"))
    np.testing.assert_array_equal(science.light.star.rate_e_s, reference.light.star.rate_e_s)


@pytest.mark.parametrize("n_frames", [100, pytest.param(400, marks=pytest.mark.long)])
def test_mean_of_frames_is_the_expected_map(n_frames):
    seen = observe(
        scene(planet(45)),
        band="F520",
        exposure_s=5.0,
        n_frames=n_frames,
        em_gain=20,
        seed=1,
        window="hole",
        instrument=QUIET,
    )
    hole = seen.psf.metrics.hole
    frames = np.array([frame[hole] for frame in seen.iter_frames()])
    pull = (frames.mean(axis=0) - seen.expected[hole]) / (frames[:50].std() / np.sqrt(len(frames)))
    assert abs(pull.mean()) < 4 / np.sqrt(hole.sum())


def test_companions_can_be_switched_off_and_raise_the_halo():
    near = {"name": "c", "v_mag": 4.0, "teff_k": 5800, "separation_arcsec": 3.0, "pa_deg": 20}
    settings = {"band": "F520", "exposure_s": 1.0, "window": "hole", "instrument": QUIET}
    on, off, none = (
        observe(s, **settings).mean_rate_map.sum()
        for s in (scene(stars=[near]), scene(stars=[near], companions="off"), scene())
    )
    assert on > off
    assert off == none


def test_whole_frame_holds_a_companion_where_it_stands():
    near = {"name": "c", "v_mag": 6.0, "teff_k": 5800, "separation_arcsec": 5.0, "pa_deg": 315}
    frame = observe(scene(stars=[near]), band="F520", exposure_s=1.0, instrument=QUIET).mean_rate_map
    row, column = np.unravel_index(frame.argmax(), frame.shape)
    shift = 5.0 / 2**0.5 / 0.016153
    assert (column - 536, row - 514) == (pytest.approx(shift, abs=1), pytest.approx(shift, abs=1))


def test_ledger_says_what_is_kept_and_skipped():
    rows = {
        row.effect: row
        for row in observe(
            scene(), band="F520", exposure_s=1.0, window="hole", instrument=QUIET, switches={"smear": False}
        ).ledger
    }
    assert rows["wavefront drift"].decision == "skipped"
    assert rows["frame-transfer smear"].decision == "skipped"
    assert rows["cosmic rays"].decision == "kept"
    assert rows["noise of the EM register"].decision == "kept"
    assert all(row.reason for row in rows.values())


def test_stacks_that_do_not_fit_memory_are_refused():
    seen = observe(scene(), band="F520", exposure_s=1.0, n_frames=2000)
    with pytest.raises(InputError, match="iter_frames"):
        _ = seen.frames


def test_star_off_the_mask_is_seen_where_it_stands():
    for offset in ((0.2, 0.2), (-0.5, 0.3), (0.0, 1.0)):
        settings = {"band": "F520", "exposure_s": 0.01, "window": "hole", "instrument": load_instrument(QUIET)}
        moved = observe(scene(planet(45)), star_offset_arcsec=offset, **settings)
        expected = (offset[0] / 0.016153 + 68, offset[1] / 0.016153 + 68)
        assert (moved.truth.x_pixel[0], moved.truth.y_pixel[0]) == pytest.approx(expected)
        if offset[0]:  # else it is behind the bar
            row, column = np.unravel_index(moved.mean_rate_map.argmax(), moved.shape)
            assert abs(column - expected[0]) <= 1
            assert abs(row - expected[1]) <= 1
        assert moved.header["CRPIX1"] == pytest.approx(expected[0] + 1)
        # The planet keeps its distance from the star.
        assert moved.truth.x_pixel[1] - moved.truth.x_pixel[0] == pytest.approx(-0.5 / 2**0.5 / 0.016153)


def test_a_psf_from_a_file_is_used_as_it_is(refused, tmp_path):
    from simulator import load_psf, save_psf, single_band_psf

    save_psf(single_band_psf("F662"), tmp_path / "psf.fits")
    kernel = load_psf(tmp_path / "psf.fits")
    settings = {"band": "F662", "exposure_s": 1.0, "n_frames": 4, "window": "hole"}
    ours, theirs = (observe(scene(planet(45)), psf=psf, **settings) for psf in (None, kernel))
    assert theirs.light.epochs == 1
    assert theirs.header["FIDELITY"] == "external"
    assert theirs.estimated_error is None
    assert ours.estimated_error.tier == ours.header["FIDELITY"] == "standard"
    assert ours.estimated_error.aperture < 1e-4
    assert np.abs(ours.mean_rate_map - theirs.mean_rate_map).max() < 0.02 * ours.mean_rate_map.max()
    refused("psf", observe, scene(), band="F520", exposure_s=1.0, psf=kernel)
    refused("scene_model", observe, scene(), band="F520", exposure_s=1.0, scene_model="fast")


def test_header_says_how_dark_the_hole_is(figures_of_others):
    settings = {"band": "F850", "exposure_s": 1.0, "window": "hole"}
    header = observe(scene(), **settings).header
    assert header["HOLE"] == "reached"
    assert header["HOLEIN"] == pytest.approx(4.3 * 0.0876616, rel=1e-4)
    spoilt = observe(scene(), instrument={"mirror": {"bits": 10}}, **settings)
    assert spoilt.header["HOLE"] == "not_reached"
    assert any("brighter than asked" in row.reason for row in spoilt.ledger)


NO_EARTHSHINE = {"sky": {"earthshine": {"brightness_v_mag_arcsec2": None}}}


def test_light_given_on_the_detector_falls_into_a_window_as_on_the_frame(tmp_path):
    from astropy.io import fits

    glow = np.add.outer(np.arange(1050) / 100.0, np.arange(1080) / 1000.0)
    hdu = fits.PrimaryHDU(glow)
    hdu.header["BUNIT"] = "electron/(s pix)"
    hdu.writeto(tmp_path / "glow.fits")
    lit = {"sky": {"earthshine": {"rate_e_s": 0.25}, "stray_light": {"map_file": str(tmp_path / "glow.fits")}}}
    settings = {"band": "F662", "exposure_s": 1.0}
    part = {}
    for window in ("full", "hole"):
        bright = observe(scene(), instrument=QUIET | lit, window=window, **settings)
        dark = observe(scene(), instrument=QUIET | NO_EARTHSHINE, window=window, **settings)
        part[window] = bright.mean_rate_map - dark.mean_rate_map
    np.testing.assert_allclose(part["full"], glow + 0.25, rtol=1e-9, atol=1e-6)
    row, column = bright.first_pixel
    cut = (slice(row, row + 137), slice(column, column + 137))
    np.testing.assert_allclose(part["hole"], glow[cut] + 0.25, rtol=1e-9, atol=1e-6)
    rows = {item.effect: item for item in bright.ledger}
    assert rows["earthshine"].reason == "0.25 e-/s in every pixel"
    assert f"glow.fits, {glow[cut].mean():.3g} e-/s" in rows["stray light"].reason
    assert bright.calibration_files == ["glow.fits"]


def test_kinds_have_their_own_noise_and_settings_share_theirs():
    settings = {"band": "F662", "exposure_s": 1.0, "window": "hole", "instrument": QUIET}
    kinds = [observe(scene(), kind=kind, **settings).frame(0).adu for kind in ("SCI", "DSF", "CALS")]
    assert not any(np.array_equal(kinds[i], kinds[j]) for i, j in ((0, 1), (0, 2), (1, 2)))
    # Common random numbers: what the amplifier adds does not depend on exposure or gain.
    faint = {"cstar": STAR | {"v_mag": 20.0}}
    pair = [
        observe(scene() | faint, **(settings | more)).frame(0).adu.astype(int)
        for more in ({"exposure_s": 1e-3}, {"exposure_s": 2e-3})
    ]
    assert (pair[0] == pair[1]).mean() > 0.99
    other = observe(scene() | faint, **(settings | {"exposure_s": 1e-3, "realisation": 1})).frame(0).adu
    assert (pair[0] == other).mean() < 0.5


def test_a_psf_from_a_file_is_named_and_tells_observations_apart(tmp_path):
    from dataclasses import replace

    from simulator import load_psf, save_psf, single_band_psf
    from simulator.products.sequence import obsid_of

    ours = single_band_psf("F662")
    settings = {"band": "F662", "exposure_s": 1.0, "window": "hole"}
    (tmp_path / "other").mkdir()
    first = load_psf(save_psf(ours, tmp_path / "psf.fits"))
    again = load_psf(save_psf(ours, tmp_path / "other" / "psf.fits"))
    changed = first.off_axis.copy()
    changed[0, 0] += 1e-7
    second = load_psf(save_psf(replace(first, off_axis=changed), tmp_path / "mine.fits"))
    seen = [observe(scene(), psf=psf, **settings) for psf in (first, again, second)]
    assert [item.header["PSFFILE"] for item in seen] == ["psf.fits", "psf.fits", "mine.fits"]
    assert [item.calibration_files for item in seen] == [["psf.fits"], ["psf.fits"], ["mine.fits"]]
    assert seen[0].header["PSFHASH"] == seen[1].header["PSFHASH"] == first.content_hash != second.content_hash
    numbers = [obsid_of(item) for item in (*seen, observe(scene(), **settings))]
    assert numbers[0] == numbers[1]
    assert len(set(numbers)) == 3
    assert "PSFFILE" not in observe(scene(), **settings).header
    by_hand = observe(scene(), psf=replace(first, file=""), **settings)
    assert "PSFFILE" not in by_hand.header
    assert by_hand.calibration_files == []


def test_a_tolerance_leaves_out_what_it_may():
    bright = scene(
        planet(45, separation=0.6),
        stars=[{"name": "far", "v_mag": 9.0, "teff_k": 5000, "separation_arcsec": 6.0, "pa_deg": 70}],
    )
    settings = {"band": "F662", "exposure_s": 5.0, "n_frames": 20, "em_gain": 30, "window": "hole", "seed": 2}
    whole = observe(bright, **settings)
    short = observe(bright, **settings, tolerance=0.1, quantity=("planet_flux", "snr"))
    assert (whole.tolerance, whole.choice, whole.header["TOLERANC"]) == (0.0, None, 0.0)
    assert (short.tolerance, short.header["TOLERANC"], short.header["FIDELITY"]) == (0.1, 0.1, "custom")
    choice = short.choice
    assert "far" in choice.left_out
    assert choice.switches
    assert not any(choice.switches.values())
    assert short.psf.knobs.wavelength_nodes < whole.psf.knobs.wavelength_nodes
    assert short.light.epochs < whole.light.epochs == 12
    assert (choice.draw, choice.region) == ("frames", "hole")
    assert short.window == "hole"
    assert [source.name for source in short.truth.sources] == [source.name for source in whole.truth.sources]
    rows = {row.key: row for row in short.ledger}
    assert short.ledger == choice.rows
    for name in (*choice.switches, "star:far", "wavelength_nodes"):
        assert rows[name].decision == "skipped"
        assert rows[name].size is not None
    assert all(short.instrument.detector.switches.model_dump()[name] is False for name in choice.switches)
    total = sum(row.size for row in short.ledger if row.decision == "skipped" and row.size)
    assert 0 < total <= 0.1
    assert max(choice.predicted_error.values()) <= 0.1
    assert short.frame(3).adu.shape == whole.frame(3).adu.shape
    again = observe(bright, **settings, tolerance=0.1, quantity=("planet_flux", "snr"))
    np.testing.assert_array_equal(short.frame(1).adu, again.frame(1).adu)


def test_quantities_default_to_all_that_the_scene_has():
    settings = {"band": "F662", "exposure_s": 1.0, "window": "hole", "tolerance": 0.1}
    assert set(observe(scene(planet(45)), **settings).choice.predicted_error) == {"planet_flux", "snr", "pixel_map"}
    assert set(observe(scene(), **settings).choice.predicted_error) == {"pixel_map"}
    one = observe(scene(planet(45)), **settings, quantity="snr")
    assert set(one.choice.predicted_error) == {"snr"}


def test_a_tolerance_for_the_infrared_camera_but_no_psf_from_a_file(tmp_path):
    from simulator import load_psf, save_psf, single_band_psf

    near = observe(scene(planet(45)), band="F940", exposure_s=1.0, window="hole", tolerance=0.1, quantity="snr")
    assert near.choice.switches
    assert not {"photon_noise", "read_noise"} & set(near.choice.switches)  # which make all of its noise
    assert near.choice.predicted_error["snr"] <= 0.1
    assert near.psf.knobs.tier == "custom"
    save_psf(single_band_psf("F662"), tmp_path / "psf.fits")
    kernel = load_psf(tmp_path / "psf.fits")
    with pytest.raises(InputError, match="tolerance = 0.1.*PSF from a file"):
        observe(scene(planet(45)), band="F662", exposure_s=1.0, window="hole", psf=kernel, tolerance=0.1)


def test_another_visit_is_the_observation_of_that_visit():
    """The set-up of the first serves for all: the same light and frames as made anew."""
    settings = {
        "band": "F850",
        "exposure_s": 2.0,
        "n_frames": 3,
        "em_gain": 50.0,
        "fidelity": "quick",
        "window": "hole",
    }
    first, third = (observe("paper_example", visit=number, **settings) for number in (0, 2))
    again = first.at_visit(2)
    assert again.path == third.path
    np.testing.assert_array_equal(again.rate_map(1), third.rate_map(1))
    np.testing.assert_array_equal(again.frame(2).adu, third.frame(2).adu)
    assert np.any(again.rate_map(1) != first.rate_map(1))
    with pytest.raises(InputError, match="visit"):
        first.at_visit(-1)
