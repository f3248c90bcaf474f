import dataclasses
import mmap
import sys
import time

import numpy as np
import pytest

from cpic_planner.tradeoff import chosen, n_rows
from cpic_planner.tradeoff.measure import (
    ClosedForm,
    Images,
    NotApplicable,
    compared,
    peak_memory_mb,
    reset_peak_memory,
    timed,
)
from cpic_planner.tradeoff.scenes import (
    SCENES,
    TOLERANCES_MEASURED,
    FixedScene,
    Point,
    Setup,
    points_of,
    reference_setup,
    this_machine,
)
from simulator.knobs import FIDELITIES


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


def way(draw="frames", **changes):
    return Point("way", "a way", "images", setup=Setup(draw, "hole", QUICK, 1, **changes))


def test_the_flux_is_that_of_the_closed_form(small_case):
    said, _ = ClosedForm.of(small_case, small_case.instrument).answer()
    frames, sums = (Images.of(small_case, way(draw)).flux_e() for draw in ("frames", "sums"))
    # The closed form averages the core over the phase of the pixels.
    assert frames == pytest.approx(said, rel=0.02)
    assert sums == pytest.approx(said, rel=0.02)
    # Transfer losses are the one effect of the mean that a reduction leaves.
    without = Images.of(small_case, way(switches={"parallel_cti": False, "serial_cti": False})).flux_e()
    assert without == pytest.approx(sums, rel=1e-5)
    assert frames < sums


def test_a_left_out_source_and_a_dark_sky_are_not_in_the_light(small_case):
    whole, dark, alone = (
        Images.of(small_case, way(**changes)).visits.science
        for changes in ({}, {"sky": False}, {"sky": False, "left_out": ("planet",)})
    )
    assert np.median(dark.light.static_e_s) < 1e-3 * np.median(whole.light.static_e_s)
    assert alone.scene.planets == ()
    assert alone.light.static_e_s.max() < 1e-6 * whole.light.static_e_s.max()


def test_sums_and_frames_have_the_noise_of_the_closed_form(small_case):
    case = FixedScene.of(small_case, n_frames=4)
    calm = {"cosmic_rays": False, "bad_pixels": False, "bad_columns": False}
    flux, snr = ClosedForm.of(case, case.instrument).answer()
    assert flux > 0
    for one in (way(switches=calm), way("sums")):
        images = Images.of(case, one)
        errors = np.array([images.contrast_error(number) for number in range(12)])
        assert images.contrast / np.sqrt((errors**2).mean()) == pytest.approx(snr, rel=0.15)


def test_a_way_that_does_not_apply_says_so(small_case):
    with pytest.raises(NotApplicable, match="reach"):
        Images.of(FixedScene.of(small_case, em_gain=1000.0, exposure_s=1e5), way("sums"))


def test_the_ledger_decides(small_case):
    coarse = Images.of(small_case, Point("tolerance_0.3", "coarse", "tolerance", tolerance=0.3))
    assert coarse.how.predicted_error["snr"] <= 0.3
    assert coarse.how.knobs.wavelength_nodes < reference_setup(small_case).knobs.wavelength_nodes


def test_the_closed_form_of_independent_visits_gains_as_their_root():
    one, many = (ClosedForm.of(SCENES[name], SCENES[name].instrument).answer()[1] for name in ("visits_1", "visits_16"))
    assert many / one == pytest.approx(4.0, rel=0.02)


def samples(errors):
    errors = np.asarray(errors)
    return {"samples": {"contrast_error": errors.tolist()}, "snr": float(1.0 / np.sqrt((errors**2).mean()))}


@pytest.fixture
def reference(make):
    return make.row("reference", group="tier", **samples(np.random.default_rng(1).gamma(50, 2, 16)))


def one(rows):
    return {row.point: row for row in compared(rows)}


def test_the_reference_is_its_own_measure(reference):
    row = one([reference])["reference"]
    assert row.snr == pytest.approx(reference.snr, rel=1e-12)
    assert row.variance_e2 == pytest.approx((100.0 / reference.snr) ** 2, rel=1e-12)
    assert (row.flux_error, row.snr_error, row.flux_uncertainty, row.snr_uncertainty) == (0.0, 0.0, 0.0, 0.0)


def test_common_random_numbers_leave_no_scatter(make, reference):
    scaled = samples(1.1 * np.array(reference.samples["contrast_error"][:4]))
    row = one([reference, make.row("changed", group="knob", flux_e=110.0, **scaled)])["changed"]
    assert row.flux_error == pytest.approx(0.1)
    assert row.snr_error == pytest.approx(1.0 / 1.1 - 1.0, abs=1e-12)
    assert row.snr == pytest.approx(reference.snr / 1.1, rel=1e-12)  # not that of its own few realisations
    assert row.snr_uncertainty == pytest.approx(0.0, abs=1e-12)


def test_the_stated_error_is_that_of_the_scatter(make):
    # Many trials of two independent ways with the same noise.
    rng, off, said = np.random.default_rng(3), [], []
    for _ in range(300):
        first = make.row("reference", group="tier", **samples(rng.normal(10, 1, 40)))
        second = make.row("sums", **samples(rng.normal(10, 1, 60)), settings={"draw": "sums", "region": "hole"})
        row = one([first, second])["sums"]
        off.append(row.snr_error)
        said.append(row.snr_uncertainty)
    assert np.std(off) / np.mean(said) == pytest.approx(1.0, abs=0.15)
    assert abs(np.mean(off)) < 4 * np.std(off) / np.sqrt(300)


def test_closed_forms_refusals_and_scenes_without_reference(make, reference):
    said = make.row("etc", group="closed_form", flux_e=101.0, settings={}, snr=0.5 * reference.snr)
    refused = make.row("sums", status="invalid", reason="register_full_well", message="no", flux_e=None, wall_s=None)
    found = one([reference, said, refused])
    assert found["etc"].snr == pytest.approx(0.5 * reference.snr)
    assert found["etc"].flux_error == pytest.approx(0.01)
    assert found["etc"].snr_error == pytest.approx(-0.5)
    assert found["etc"].snr_uncertainty > 0
    assert found["sums"] == refused
    assert one([said])["etc"].snr_error is None


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
