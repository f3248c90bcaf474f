import dataclasses
import mmap
import sys
import time

import numpy as np
import pytest

from cpic_planner.tradeoff import chosen, n_rows
from cpic_planner.tradeoff.measure import (
    NotApplicable,
    Places,
    aperture_flux_e,
    closed_form,
    drawn_frames,
    expected_flux_e,
    flux_of_programme,
    light_without,
    own_noise_e2,
    peak_memory_mb,
    ratio_of_programmes,
    reset_peak_memory,
    snr_of_programme,
    speckle_samples,
    timed,
    walk_samples,
    white_of_frames,
    white_of_sums,
    worked,
)
from cpic_planner.tradeoff.scenes import (
    SCENES,
    TOLERANCES_MEASURED,
    FixedScene,
    Setup,
    choice_of,
    chosen_by,
    points_of,
    reference_setup,
    this_machine,
    visit,
)
from simulator.detectors import excess_noise_factor2
from simulator.imaging import overlap_weights
from simulator.knobs import FIDELITIES, dial_of


@pytest.mark.parametrize("name", SCENES)
def test_knobs_and_effects_change_one_thing_of_the_reference(name):
    case = SCENES[name]
    best, points = reference_setup(case), points_of(case)
    assert len({point.name for point in points}) == len(points)
    for point in points:
        if not point.shares_process:
            continue
        changed = [
            item.name
            for item in dataclasses.fields(best)
            if getattr(point.setup, item.name) != getattr(best, item.name)
        ]
        assert len(changed) == 1, point.name
        if changed == ["knobs"]:
            ours, theirs = point.setup.knobs.model_dump(), best.knobs.model_dump()
            assert sum(ours[key] != theirs[key] for key in ours) == 1
        assert point.light_changes == (changed != ["switches"])


def test_every_way_of_the_dial_is_there():
    points = {point.name: point for point in points_of(SCENES["binary"])}
    assert [points[name].fidelity for name in ("quick", "standard")] == ["quick", "standard"]
    assert [points[f"tolerance_{value:g}"].tolerance for value in TOLERANCES_MEASURED] == list(TOLERANCES_MEASURED)
    assert set(
        """
        etc etc_many sums_quick sums_standard hole_quick hole_standard full_standard reference wavelengths_1
        pixel_nodes_4 single pupil_64 epochs_1 window paper_scene no_blooming no_sky no_drift no_other_stars
    """.split()
    ) <= set(points)
    assert "exact_scene" in {point.name for point in points_of(SCENES["paper"])}
    assert (
        "no_persistence" in {point.name for point in points_of(SCENES["infrared"])}
        or not SCENES["infrared"].instrument.near_infrared.detector.switches.persistence
    )


def test_what_is_asked_for():
    work = chosen(["faint", "edge"], ["etc"])
    assert [(case.name, [point.name for point in points]) for case, points in work] == [
        ("faint", ["etc"]),
        ("edge", ["etc"]),
    ]
    assert n_rows(work) == 2
    glance = chosen(["faint"], quick_look=True)
    assert glance[0][0].n_frames == 2
    assert not any(point.shares_process for point in glance[0][1])
    # A way that only some scenes have.
    assert [case.name for case, _ in chosen([], ["no_other_stars"])] == ["binary", "field"]


def test_refusals(refused):
    refused(r"--only = fast: not accepted; allowed: .*etc", chosen, [], ["fast"])
    refused(r"--only = no_other_stars", chosen, ["faint"], ["no_other_stars"])


QUICK = FIDELITIES["quick"]


@pytest.fixture(scope="module")
def window():
    return Setup("frames", "hole", QUICK, 1)


@pytest.fixture(scope="module")
def sums():
    return Setup("sums", "hole", QUICK, 1)


@pytest.fixture(scope="module")
def places(small_case):
    return Places.of(small_case)


def flux_of(case, setup):
    return expected_flux_e(case, setup, visit(case, setup), light_without(case, setup))


def test_the_flux_is_that_of_the_closed_form(small_case, window, sums):
    said = closed_form(small_case).answer()["flux_e"]
    # The closed form averages the core over the phase of the pixels.
    assert flux_of(small_case, window) == pytest.approx(said, rel=0.02)
    assert flux_of(small_case, sums) == pytest.approx(said, rel=0.02)
    # Transfer losses are the one effect of the mean that a reduction leaves.
    without = dataclasses.replace(window, switches={"parallel_cti": False, "serial_cti": False})
    assert flux_of(small_case, without) == pytest.approx(flux_of(small_case, sums), rel=1e-5)
    assert flux_of(small_case, window) < flux_of(small_case, sums)


def test_a_left_out_source_and_a_dark_sky_are_not_in_the_light(small_case, window):
    dark = light_without(small_case, dataclasses.replace(window, sky=False))
    assert dark.max() < 1e-6 * light_without(small_case, window).max()
    scene = dataclasses.replace(window, left_out=("planet",)).scene(small_case)
    assert scene.planets == ()


def test_read_noise_alone_gives_its_own_variance(small_case, window, places):
    switches = small_case.instrument.detector.switches.model_dump()
    only = {name: name == "read_noise" for name, on in switches.items() if on}
    setup = dataclasses.replace(window, switches=only)
    drawn = drawn_frames(visit(small_case, setup, n_frames=12))
    white = white_of_frames(dataclasses.replace(places, level=np.ones_like(places.level)), (drawn,))
    metrics = visit(small_case, setup, n_frames=1).psf.metrics
    weights = overlap_weights(metrics.aperture_radius_arcsec / metrics.pixel_scale_arcsec)
    detector = small_case.instrument.detector
    pixel = (detector.read_noise_e**2 + detector.gain_e_adu**2 / 12) / small_case.em_gain**2
    error = white.std(ddof=1) / np.sqrt(len(white))
    assert abs(white.mean() - pixel * (weights**2).sum()) < 4 * error
    assert error < 0.1 * white.mean()


def test_lost_frames_cost_noise(small_case, window, places):
    drawn = drawn_frames(visit(small_case, window, n_frames=12))
    every = white_of_frames(places, (drawn,)).mean()
    usable = drawn.usable.copy()
    usable[::2] = False
    half = dataclasses.replace(drawn, usable=usable)
    half = dataclasses.replace(half, electrons=np.where(usable, drawn.electrons, drawn.electrons[1::2].mean(axis=0)))
    kept = dataclasses.replace(drawn, usable=drawn.usable)
    assert white_of_frames(places, (half,)).mean() / every == pytest.approx(2.0, rel=0.25)
    assert white_of_frames(places, (kept,)).mean() == every


def test_sums_and_frames_have_the_same_noise(small_case, window, sums, places):
    case = FixedScene.of(small_case, n_frames=4)
    still = {"cosmic_rays": False, "bad_pixels": False, "bad_columns": False}
    calm = dataclasses.replace(window, switches=still)
    frames = white_of_frames(places, (drawn_frames(visit(case, calm, n_frames=24)),))
    stacked = white_of_sums(case, sums, places, 24)
    spread = [part.std(ddof=1) / np.sqrt(len(part)) for part in (frames, stacked)]
    assert abs(frames.mean() - stacked.mean()) < 4 * np.hypot(*spread)


def test_infrared_sums_and_frames_have_the_same_noise(window, sums):
    case = FixedScene.of(SCENES["infrared"], n_frames=4)
    places, calm = Places.of(case), dataclasses.replace(window, switches={"cosmic_rays": False, "bad_pixels": False})
    frames = white_of_frames(places, (drawn_frames(visit(case, calm, n_frames=24)),))
    stacked = white_of_sums(case, sums, places, 24)
    spread = [part.std(ddof=1) / np.sqrt(len(part)) for part in (frames, stacked)]
    assert abs(frames.mean() - stacked.mean()) < 4 * np.hypot(*spread) < 0.2 * frames.mean()


def test_own_noise_is_that_of_the_planets_light(small_case, window, places):
    metrics = visit(small_case, window, n_frames=1).psf.metrics
    factor2 = float(excess_noise_factor2(small_case.em_gain, 604))
    expected = factor2 * metrics.source_noise_fraction * 50.0
    assert own_noise_e2(small_case, window, places, 50.0) == pytest.approx(expected)
    without = dataclasses.replace(window, switches={"em_register": False})
    assert own_noise_e2(small_case, without, places, 50.0) == pytest.approx(metrics.source_noise_fraction * 50.0)
    silent = dataclasses.replace(window, switches={"photon_noise": False})
    assert own_noise_e2(small_case, silent, places, 50.0) == 0.0


def test_speckles_grow_with_the_star_and_vanish_without_drift(small_case, window, places):
    few = speckle_samples(small_case, window, places, 2)
    assert (few > 0).all()
    assert (speckle_samples(small_case, dataclasses.replace(window, drift=False), places, 2) == 0).all()
    bright = dict(small_case.tree) | {"cstar": dict(small_case.tree["cstar"]) | {"magnitude": 3.0}}
    brighter_case = FixedScene.of(small_case, tree=bright)
    brighter = speckle_samples(brighter_case, window, Places.of(brighter_case), 2)
    assert brighter == pytest.approx(few * 100.0, rel=1e-6)  # 2.5 mag, squared
    walk, one = walk_samples(small_case, dataclasses.replace(window, epochs=2), places, 2)
    assert not np.array_equal(walk, one)
    assert walk == pytest.approx(one, rel=0.5)


def test_the_work_measures_what_is_there(small_case, sums):
    case = FixedScene.of(small_case, em_gain=1.0)
    work = worked(case, sums)
    assert work.drawn == ()
    ones = np.ones(work.science.psf.on_axis.shape)
    assert aperture_flux_e(work.science, ones) == pytest.approx(case.instrument.aperture_pixels(case.band), rel=1e-3)
    with pytest.raises(NotApplicable, match="reach"):
        worked(FixedScene.of(case, em_gain=1000.0, exposure_s=1e5), sums)


def test_the_ledger_decides(small_case):
    choice = choice_of(small_case, dial_of("reference"))
    setup = chosen_by(small_case, choice)
    best = reference_setup(small_case)
    assert (setup.draw, setup.region, setup.knobs) == (best.draw, best.region, best.knobs)
    assert not setup.switches
    coarse = chosen_by(small_case, choice_of(small_case, dial_of(None, 0.3)))
    assert coarse.n_epochs(small_case) <= best.n_epochs(small_case)
    assert coarse.knobs.wavelength_nodes < best.knobs.wavelength_nodes


def test_a_brighter_place_counts_for_what_the_planet_has(places):
    # The halo falls outwards: the planet's place is darker than the inner edge and brighter than the corners.
    assert 0.3 < places.level[places.white].min() < 1.0 < places.level[places.white].max() < 3.0
    assert not (places.near & ~places.white).any()
    assert (places.near.sum(), places.white.sum()) > (0, places.near.sum())


def test_the_closed_form_of_independent_visits_gains_as_their_root():
    answers = [closed_form(SCENES[name]).answer() for name in ("visits_1", "visits_16")]
    one, many = (answer["flux_e"] / answer["white_e2"] ** 0.5 for answer in answers)
    assert many / one == pytest.approx(4.0, rel=0.02)


def test_what_is_common_to_realisations_drops_out_of_their_ratio():
    rng = np.random.default_rng(5)
    contrast, error = rng.normal(1.0, 0.1, 20), rng.normal(0.1, 0.01, 20)
    ours = {"contrast": list(1.1 * contrast), "contrast_error": list(error)}
    theirs = {"contrast": list(contrast), "contrast_error": list(error)}
    for what in (flux_of_programme, snr_of_programme):
        assert ratio_of_programmes(ours, theirs, what, paired=True) == pytest.approx((1.1, 0.0), abs=1e-12)
    # Apart, each mean carries its scatter over the root of its number.
    _, spread = ratio_of_programmes(ours, theirs, flux_of_programme, paired=False)
    relative = contrast.std(ddof=1) / contrast.mean() / 20**0.5
    assert spread == pytest.approx(1.1 * 2**0.5 * relative, rel=1e-9)


def test_a_sleep_is_long_and_costs_no_processor_time():
    found = timed(lambda: time.sleep(0.05), budget_s=0.0)
    assert 0.05 <= found["wall_s"] < 1.0
    assert found["cpu_s"] < 0.02
    assert found["repeats"] == 1


def test_short_calls_are_timed_in_blocks():
    calls = []
    found = timed(lambda: calls.append(0), budget_s=0.05)
    assert found["wall_s"] < 1e-4
    assert len(calls) > 100
    assert 1 <= found["repeats"] <= 5


def _touch_mb(size):
    """Pages of the system's own: an array may reuse what earlier tests left on the heap, and cost none."""
    with mmap.mmap(-1, size * 1_000_000) as pages:
        for start in range(0, len(pages), mmap.PAGESIZE):
            pages[start] = 1


@pytest.mark.skipif(sys.platform != "linux", reason="the peak cannot be reset elsewhere")
def test_peak_memory_is_of_the_job_alone():
    _touch_mb(160)
    reset_peak_memory()
    before = peak_memory_mb()
    found = timed(lambda: _touch_mb(80), budget_s=0.0)
    assert found["peak_memory_mb"] - before == pytest.approx(80.0, abs=15.0)


def test_the_machine_is_described_without_a_name():
    import platform

    machine = this_machine()
    assert machine == this_machine()
    assert machine.cores >= 1
    assert machine.memory_gb > 0
    assert machine.blas != ""
    assert len(platform.node()) < 4 or platform.node() not in machine.model_dump_json()
