"""Dark holes between measured states of the mirror."""

import numpy as np
import pytest

from simulator.config import load_instrument
from simulator.imaging import at_contrast, mean_contrast, psf_metrics, store
from simulator.imaging.store import LEVELS, SHARED, _states, measured_states, sensed_with

INSTRUMENT = load_instrument()


@pytest.mark.parametrize("band", INSTRUMENT.visible_bands())
def test_the_states_of_the_default_instrument_ship(tmp_path, monkeypatch, band):
    """From an empty cache nothing is dug or measured; the holes go from the darkest known to beyond the published."""

    def refuse(*_):
        raise AssertionError(f"a state of {band} dug or measured anew: run python -m tools.dig_holes --states-only")

    monkeypatch.setenv("CPIC_CACHE_DIR", str(tmp_path))
    monkeypatch.setattr(store, "measure", refuse)
    monkeypatch.setattr(store, "search", refuse)
    _states.cache_clear()
    states = measured_states(INSTRUMENT, band)
    contrasts = [mean_contrast(state) for state in states]
    assert len(states) == len(LEVELS) >= 6
    assert contrasts == sorted(contrasts)
    assert contrasts[0] == mean_contrast(psf_metrics(INSTRUMENT, band)) < 1.2e-9
    assert contrasts[-1] > 3e-8
    assert {state.hole_state for state in states} == {"reached"}
    assert not list(tmp_path.iterdir())


def test_the_published_instrument_is_one_of_the_states():
    published = psf_metrics(load_instrument("as_published"), "F720")
    (state,) = [state for state in measured_states(INSTRUMENT, "F720") if 9e-9 < mean_contrast(state) < 1.1e-8]
    np.testing.assert_array_equal(state.raw_contrast, published.raw_contrast)
    np.testing.assert_array_equal(state.floor_linear, published.floor_linear)


@pytest.mark.parametrize("contrast", [1.3e-9, 7e-9, 1.9e-8])
def test_a_mixture_has_the_mean_contrast_and_stays_between_its_states(contrast):
    states = measured_states(INSTRUMENT, "F520")
    found = at_contrast(states, contrast)
    assert mean_contrast(found) == pytest.approx(contrast, rel=1e-12)
    above = next(i for i, state in enumerate(states) if mean_contrast(state) > contrast)
    below, over = (mean_contrast(states[i]) for i in (above - 1, above))
    share = (contrast - below) / (over - below)
    for name in ("raw_contrast", "halo_map", "floor_linear", "column_light"):
        low, high = (getattr(states[i], name) for i in (above - 1, above))
        np.testing.assert_allclose(getattr(found, name), low + share * (high - low), rtol=1e-9)
    assert found.zone == states[0].zone
    assert found.geometry == states[0].geometry


def test_a_contrast_of_a_state_is_that_state_and_darker_than_the_darkest_is_the_darkest():
    states = measured_states(INSTRUMENT, "F850")
    found = at_contrast(states, mean_contrast(states[3]))
    np.testing.assert_allclose(found.raw_contrast, states[3].raw_contrast, rtol=1e-12)
    assert at_contrast(states, 1e-12) is states[0]


def test_files_of_states_leave_the_far_wings_to_the_own_state():
    states = measured_states(INSTRUMENT, "F662")
    own = psf_metrics(INSTRUMENT, "F662")
    for name in SHARED:
        np.testing.assert_array_equal(getattr(states[1], name), getattr(own, name))
    assert not np.array_equal(states[1].core_table, own.core_table)


def test_refusals(refused):
    states = measured_states(INSTRUMENT, "F520")
    refused("contrast", at_contrast, states, 1e-6)
    refused("contrast", at_contrast, states, 0.0)
    refused("contrast", sensed_with, INSTRUMENT, "F940", 1.0)
