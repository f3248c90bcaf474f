import numpy as np
import pytest

from cpic_planner.tradeoff.compare import compared, speed_ups


def samples(white, speckle=(1.0, 3.0), walk=(1.1, 3.2), own=20.0, one=(1.0, 3.0)):
    return {
        "white_e2": list(white),
        "speckle_e2_s2": list(speckle),
        "walk_e2_s2": list(walk),
        "one_epoch_e2_s2": list(one),
        "own_e2": [own],
    }


@pytest.fixture
def reference(make):
    rng = np.random.default_rng(1)
    return make.row("reference", group="tier", samples=samples(rng.gamma(50, 2, 16)))


def one(rows):
    return {row.point: row for row in compared(rows, exposure_s=2.0)}


def test_the_reference_is_its_own_measure(reference):
    row = one([reference])["reference"]
    white, speckle = np.mean(reference.samples["white_e2"]), 2.0 * (4.3 / 2) / 2.0
    variance = 2 * 4 * white + 20.0 + speckle * (4 * 2.0) ** 2
    assert row.variance_e2 == pytest.approx(variance, rel=1e-12)
    assert row.snr == pytest.approx(100.0 / np.sqrt(variance), rel=1e-12)
    assert (row.flux_error, row.snr_error, row.flux_uncertainty, row.snr_uncertainty) == (0.0, 0.0, 0.0, 0.0)


def test_common_random_numbers_leave_no_scatter(make, reference):
    scaled = samples(1.21 * np.array(reference.samples["white_e2"]), own=24.2, speckle=(1.21, 3.63))
    row = one([reference, make.row("changed", group="knob", flux_e=110.0, samples=scaled)])["changed"]
    assert row.flux_error == pytest.approx(0.1)
    assert row.snr_error == pytest.approx(1.1 / 1.1 - 1.0, abs=1e-12)
    assert row.snr_uncertainty == pytest.approx(0.0, abs=1e-12)


def test_other_random_numbers_carry_the_scatter_of_both(make, reference):
    other = make.row(
        "window",
        samples=samples(np.random.default_rng(2).gamma(50, 2, 60)),
        settings={"draw": "frames", "region": "hole"},
    )
    row = one([reference, other])["window"]
    share = 8 * np.mean(other.samples["white_e2"]) / row.variance_e2
    relative = [
        np.std(item.samples["white_e2"], ddof=1)
        / np.mean(item.samples["white_e2"])
        / np.sqrt(len(item.samples["white_e2"]))
        for item in (reference, other)
    ]
    assert row.snr_uncertainty == pytest.approx((1 + row.snr_error) * 0.5 * share * np.hypot(*relative), rel=1e-9)


def test_the_stated_error_is_that_of_the_scatter(make):
    # Many trials of two independent ways with the same noise.
    rng, off, said = np.random.default_rng(3), [], []
    for _ in range(300):
        first = make.row("reference", group="tier", samples=samples(rng.gamma(8, 2, 40)))
        second = make.row("sums", samples=samples(rng.gamma(8, 2, 60)), settings={"draw": "sums", "region": "hole"})
        row = one([first, second])["sums"]
        off.append(row.snr_error)
        said.append(row.snr_uncertainty)
    assert np.std(off) / np.mean(said) == pytest.approx(1.0, abs=0.15)
    assert abs(np.mean(off)) < 4 * np.std(off) / np.sqrt(300)


def test_closed_forms_refusals_and_scenes_without_reference(make, reference):
    said = make.row(
        "etc",
        group="closed_form",
        flux_e=101.0,
        settings={},
        samples={"whole_e2": [1000.0], "fixed_speckle_e2": [25.0]},
    )
    refused = make.row("sums", status="invalid", reason="register_full_well", message="no", flux_e=None, wall_s=None)
    found = one([reference, said, refused])
    assert found["etc"].snr == pytest.approx(101.0 / np.sqrt(1025.0))
    assert found["etc"].flux_error == pytest.approx(0.01)
    assert found["etc"].snr_uncertainty > 0
    assert found["sums"] == refused
    assert one([said])["etc"].snr_error is None


def test_without_drift_there_is_no_speckle(make, reference):
    still = make.row("no_drift", group="effect", samples=samples(reference.samples["white_e2"], speckle=(0.0, 0.0)))
    row = one([reference, still])["no_drift"]
    assert row.variance_e2 == pytest.approx(8 * np.mean(reference.samples["white_e2"]) + 20.0)
    assert row.snr_error > 0


def test_speed_ups(make):
    rows = [
        make.row("reference", group="tier", wall_s=12.0),
        make.row("etc", group="closed_form", wall_s=0.003),
        make.row("reference", group="tier", wall_s=5.0, scene="edge"),
        make.row("etc", group="closed_form", wall_s=0.001, scene="edge", machine="elsewhere"),
        make.row("etc", group="closed_form", wall_s=0.001, scene="field"),
    ]
    assert speed_ups(rows) == {"faint": pytest.approx(4000.0)}
