"""What is chosen: sums within tolerances, tiers, and what cannot be decided."""

import math

import pytest
from hypothesis import given, strategies as st

from simulator import load_instrument
from simulator.knobs import FIDELITIES, QUANTITIES, Knobs, dial_of
from simulator.ledger import budget_of, choose, error_of, forecast
from simulator.ledger.inventory import LEFT_OUT

SETTINGS = {"band": "F662", "exposure_s": 10.0, "n_frames": 30, "em_gain": 50.0}


@pytest.fixture(scope="module")
def said(make):
    """A forecast for sums of frames, and one of single frames."""
    star = {"name": "c", "v_mag": 7.0, "teff_k": 5000, "separation_arcsec": 3.0, "pa_deg": 60}
    scene = make(v_mag=6.0, stars=[star])
    return {reduced: forecast(scene, load_instrument(), **SETTINGS, reduced=reduced) for reduced in (True, False)}


def asked(dial, *quantities):
    return dial.of(*quantities)


def skipped_sum(choice):
    return sum(row.size for row in choice.rows if row.decision == "skipped" and row.size is not None)


@given(st.sampled_from(QUANTITIES), st.floats(1e-6, 0.5))
def test_budgets_bound_what_variances_do_together(quantity, tolerance):
    total = budget_of(quantity, tolerance)
    assert error_of(quantity, total) == pytest.approx(tolerance, rel=1e-9)
    assert total <= tolerance
    share = 2.0 * total  # of a variance that is left out
    if quantity == "pixel_map":
        assert 1.0 - math.sqrt(1.0 - share) <= tolerance * (1 + 1e-9)
    elif quantity == "snr":
        assert 1.0 / math.sqrt(1.0 - share) - 1.0 <= tolerance * (1 + 1e-9)


@pytest.mark.parametrize("quantities", [("planet_flux",), ("snr",), ("pixel_map",), QUANTITIES])
@pytest.mark.parametrize("tolerance", [0.003, 0.02, 0.1, 0.4])
def test_sizes_of_what_is_left_out_stay_within_the_tolerance(quantities, tolerance, said):
    for reduced in (True, False):
        choice = choose(said[reduced], asked(dial_of(tolerance=tolerance), *quantities))
        assert skipped_sum(choice) <= tolerance * (1 + 1e-9)
        assert set(choice.predicted_error) == set(quantities)
        assert all(0.0 <= choice.predicted_error[name] <= tolerance * (1 + 1e-9) for name in quantities)
        assert choice.outcome.value == max(choice.predicted_error.values())
        assert len({(row.key, row.effect) for row in choice.rows}) == len(choice.rows)
        assert all(row.reason and row.key for row in choice.rows)
        if reduced and tolerance >= 0.02 and "pixel_map" not in quantities:
            assert choice.draw == "sums"
        assert choice.knobs.pupil_samples == 64
    assert "b" not in choice.left_out or quantities == ("pixel_map",)


def test_tolerance_nought_leaves_nothing_out_that_exists(said):
    for dial in (dial_of("reference"), dial_of(tolerance=0.0)):
        choice = choose(said[False], dial)
        for row in choice.rows:
            assert row.decision == "kept" or not row.size or row.key in LEFT_OUT, row
        assert (choice.switches, choice.left_out, choice.sky) == ({}, (), True)
        assert (choice.draw, choice.region, choice.epochs) == ("frames", "full", 12)
        assert choice.knobs == FIDELITIES["reference"]
        assert choice.predicted_error == dict.fromkeys(QUANTITIES, 0.0)


def test_a_larger_tolerance_never_costs_more(said):
    from simulator.ledger.choice import stamp_s

    costs = []
    for tolerance in (0.003, 0.01, 0.03, 0.1, 0.3):
        choice = choose(said[False], asked(dial_of(tolerance=tolerance), "planet_flux", "snr"))
        costs.append(stamp_s(choice.knobs) * (choice.epochs + 2))
    assert costs == sorted(costs, reverse=True)
    assert costs[-1] < 0.02 * stamp_s(FIDELITIES["reference"]) * 14


def test_standard_only_draws_sums(said):
    choice = choose(said[True], dial_of("standard").of("planet_flux", "snr"))
    assert (choice.draw, choice.region, choice.epochs) == ("sums", "hole", 6)
    assert choice.knobs == Knobs()
    assert choice.left_out == ()
    assert set(choice.switches) == set(
        """
        flat dark_structure bad_pixels bad_columns cosmic_rays nonlinearity parallel_cti serial_cti stripes
        interference bias_drift
    """.split()
    )
    assert choice.outcome.status.value == "ok"
    single = choose(said[True], dial_of("standard").of("planet_flux", "snr"), fixed=("summed_frames",))
    assert (single.draw, single.switches) == ("frames", {})


def test_quick_is_refused_where_it_is_too_coarse(make):
    """Two wavelengths do not know the light of a bright star beyond the dark hole."""
    calm = load_instrument({"drift": {"visit_nm": 0.5, "walk_nm_per_sqrt_hour": 0.0, "orbital_nm": 0.0}})
    speckled = forecast(
        make(0.8, 0.2, v_mag=4.0), calm, **(SETTINGS | {"band": "F520", "exposure_s": 1.0}), reduced=True
    )
    for name, status in (("quick", "invalid"), ("standard", "ok"), ("reference", "ok")):
        choice = choose(speckled, dial_of(name).of("planet_flux", "snr"))
        assert choice.outcome.status.value == status, name
    quick = choose(speckled, dial_of("quick").of("planet_flux", "snr"))
    assert quick.outcome.reason.value == "tier_too_coarse"
    assert "quick misses its tolerance here: SNR" in quick.outcome.message
    assert quick.switches == {}


def test_what_is_fixed_is_not_decided(said):
    dial = asked(dial_of(tolerance=0.3), "planet_flux", "snr")
    keys = ("summed_frames", "hole_region", "photon_noise", "read_noise", "wavelength_nodes", "drift_epochs", "sky")
    choice = choose(said[False], dial, fixed=keys)
    assert choice.draw == "frames"
    assert not {"photon_noise", "read_noise"} & set(choice.switches)
    assert choice.knobs.wavelength_nodes == 7
    assert choice.epochs == 12
    assert choice.sky


def test_settings_start_from_the_finest_allowed(said):
    dial = asked(dial_of(tolerance=0.02), "pixel_map")
    finest = Knobs(wavelength_nodes=2, pixel_nodes=3, precision="single")
    choice = choose(said[False], dial, finest=finest)
    assert choice.knobs.wavelength_nodes <= 2
    assert choice.knobs.pixel_nodes <= 3
    assert choice.knobs.precision == "single"


def test_sums_are_not_offered_to_what_does_not_add_up(make):
    star = {"exposure_s": 60.0, "em_gain": 300.0}
    for scene, more, word in (
        (make(v_mag=0.0), star, "limit"),
        (make(), {"star_offset_arcsec": (0.5, 0.5)}, "off the mask"),
    ):
        found = forecast(scene, load_instrument(), **(SETTINGS | more), reduced=True)
        choice = choose(found, dial_of("standard").of("planet_flux", "snr"))
        assert choice.draw == "frames"
        row = next(row for row in choice.rows if row.key == "summed_frames")
        assert row.decision == "kept"
        assert word in row.reason or "full well" in row.reason or "enter" in row.reason
    infrared = forecast(make(), load_instrument(), **(SETTINGS | {"band": "F940", "em_gain": 1.0}), reduced=True)
    assert choose(infrared, dial_of("standard").of("planet_flux", "snr")).draw == "sums"
    # Two reads of 25 electrons make nearly all the noise of a frame of a second.
    assert infrared.sizes["read_noise"]["snr"] == pytest.approx(0.5, abs=0.05)
    assert infrared.sizes["flat"] == infrared.sizes["nonlinearity"] == dict.fromkeys(infrared.sizes["flat"], 0.0)


def test_dark_current_goes_with_its_flaws(said):
    choice = choose(said[False], asked(dial_of(tolerance=0.05), "planet_flux", "snr"))
    if "dark" in choice.switches:
        assert {"dark_structure", "bad_pixels", "bad_columns"} <= set(choice.switches)


def test_planets_are_named_from_the_scene(refused, make):
    refused(r"planets = c.*\bb\b", forecast, make(), load_instrument(), **SETTINGS, planets=("c",))
    alone = forecast(make(), load_instrument(), **SETTINGS, planets=())
    assert alone.measured == ()
    assert alone.sizes["planet:b"]["planet_flux"] == 0.0
    both = forecast(make(), load_instrument(), **SETTINGS)
    assert both.sizes["planet:b"]["planet_flux"] == 1.0
    assert both.measured == ("b",)
