"""

Dark holes between measured states of the mirror.
"""

import dataclasses
import logging

import numpy as np
import pytest

from simulator.config import load_instrument, preset_names
from simulator.imaging import (
    BandGeometry,
    PsfMetrics,
    at_contrast,
    build,
    build_imager,
    mean_contrast,
    measure,
    metrics_key,
    psf_metrics,
    single_band_psf,
    store,
)
from simulator.imaging.build import bare_imager, dark_hole_of, hole_arrays, hole_from_arrays, hole_key, hole_state_of
from simulator.imaging.dark_hole import DarkHole, HoleScore, Search
from simulator.imaging.measure import stamp_figures
from simulator.imaging.pupil import configured_apodizer, shipped_file
from simulator.imaging.store import LEVELS, SHARED, _states, measured_states, sensed_with
from simulator.knobs import Knobs

INSTRUMENT = load_instrument()


EVERY = [
    (preset, band)
    for preset in preset_names("instrument")
    for instrument in [load_instrument(preset)]
    if instrument.coronagraph.table is None
    for band in instrument.bands
]


@pytest.mark.parametrize(("preset", "band"), EVERY)
def test_every_band_of_every_preset_is_shipped(tmp_path, monkeypatch, preset, band):
    """From an empty cache nothing is dug or measured, and a preset that is changed without its files fails here."""

    def refuse(*_):
        raise AssertionError(f"{preset} {band} dug or measured anew: run python -m tools.dig_holes")

    monkeypatch.setenv("CPIC_CACHE_DIR", str(tmp_path))
    monkeypatch.setattr(store, "measure", refuse)
    monkeypatch.setattr(build, "search", refuse)
    instrument = load_instrument(preset)
    metrics, hole = psf_metrics(instrument, band), dark_hole_of(instrument, band)
    assert metrics.band == hole.band == band
    assert metrics.geometry == BandGeometry.of(instrument, band, len(metrics.raw_contrast))
    assert metrics.hole_state == hole_state_of(instrument, band, float(metrics.raw_contrast[metrics.hole].mean()))
    assert not list(tmp_path.iterdir())


def test_nothing_else_is_shipped():
    instruments = {(preset, band): load_instrument(preset) for preset, band in EVERY}
    metrics = {shipped_file("metrics", metrics_key(made, band), band).name for (_, band), made in instruments.items()}
    holes = {
        shipped_file("hole", hole_key(made, bare_imager(made, band, Knobs(wavelength_nodes=5))), band).name
        for (_, band), made in instruments.items()
    }
    folder = shipped_file("metrics", "", "").parent
    assert {path.name for path in folder.glob("metrics_*")} == metrics
    assert {path.name for path in folder.glob("hole_*")} == holes


def test_a_rounded_file_is_what_the_model_gives():
    """A rounded band measured anew, but for the speckle floor, which is stored exactly and takes most of the time."""
    instrument = load_instrument("cpic_2q")
    stored = psf_metrics(instrument, "F1542").to_arrays()
    psf = single_band_psf("F1542", instrument=instrument)
    now = stamp_figures(psf.imager, psf.on_axis, psf.off_axis)
    assert {"raw_contrast", "halo_map", "core_table"} < set(now)
    for name, value in now.items():
        np.testing.assert_allclose(stored[name], value, rtol=4e-6, atol=1e-30, err_msg=name)
    wide = build_imager(instrument, "F1542", Knobs(wavelength_nodes=store.WING_NODES))
    wings = measure._wings(wide)
    for name, tolerance in (("wing_profile", 4e-6), ("column_profile", 4e-6), ("wing_map", 1.3e-4)):
        np.testing.assert_allclose(stored[name], wings[name], rtol=tolerance, err_msg=name)
    np.testing.assert_allclose(stored["aperture_map"], wings["aperture_map"], rtol=0.0079)
    assert stored["aperture_map_step_arcsec"] == pytest.approx(wings["aperture_map_step_arcsec"], rel=1e-12)


def test_shipped_core_and_contrast_are_what_the_model_gives():
    stored = psf_metrics(INSTRUMENT, "F720")
    psf = single_band_psf("F720", instrument=INSTRUMENT)
    figures = stamp_figures(build_imager(INSTRUMENT, "F720"), psf.on_axis, psf.off_axis)
    now = PsfMetrics.from_arrays(stored.to_arrays() | {name: np.asarray(value) for name, value in figures.items()})
    x, y = np.array([0.0, 0.17, 0.25, 0.5, -0.3]), np.array([0.4, 0.17, 0.4, 0.5, 0.6])
    np.testing.assert_allclose(stored.core_throughput(x, y), now.core_throughput(x, y), rtol=1e-9, atol=1e-15)
    np.testing.assert_allclose(stored.halo_aperture(x, y), now.halo_aperture(x, y), rtol=1e-6)
    assert stored.iwa_arcsec == pytest.approx(now.iwa_arcsec, rel=1e-9)


@pytest.mark.parametrize(
    "change",
    [
        {"detector": {"read_noise_e": 160}},
        {"drift": {"visit_nm": 0.2, "walk_nm_per_sqrt_hour": 0.3}},
        {"drift": {"common_fraction": 0.4, "correlation_time_h": 9, "orbital_nm": 1, "orbital_orders": "all"}},
        {"bands": {"F662": {"t_opt": 0.3, "qe": 0.8}}},
        {"overhead_s": 100},
        {"bands": {"F720": {"width_nm": 30}}},
        {"coronagraph": {"inner_arcsec": {"F720": 0.3}}},
        {"near_infrared": {"mask_half_width_arcsec": 0.2}},
        {"sky": {"model": "uniform", "brightness_v_mag_arcsec2": 20}},
        {"dark_hole": {"sensing": "probes", "sensing_contrast": 3e-8, "sensing_contrast_by_band": {"F662": 0}}},
    ],
)
def test_key_ignores_what_does_not_matter(change):
    assert metrics_key(load_instrument(change), "F662") == metrics_key(INSTRUMENT, "F662")


@pytest.mark.parametrize(
    "change",
    [
        {"telescope": {"diameter_m": 2.1}},
        {"coronagraph": {"mask_half_width_arcsec": 0.134}},
        {"detector": {"pixel_scale_arcsec": 0.02}},
        {"drift": {"psd_slope": 3}},
        {"bands": {"F662": {"width_nm": 60}}},
        {"bands": {"F662": {"center_nm": 660}}},
        {"coronagraph": {"aperture_radius_lambda_d": 1}},
        {"wavefront": {"jitter_mas": 4}},
        {"wavefront": {"seed": 2}},
        {"wavefront": {"opd_rms_nm": 0}},
        {"mirror": {"bits": 14}},
        {"mirror": {"noise_nm": 0.01}},
        {"mirror": {"n_actuators": 34}},
        {"dark_hole": {"control": "off"}},
        {"dark_hole": {"control": "single_jacobian"}},
        {"dark_hole": {"sensing": "probes", "sensing_contrast": 3e-8}},
        {"dark_hole": {"mode": "2q"}},
        {"coronagraph": {"inner_arcsec": {"F662": 0.3}}},
        {"coronagraph": {"apodizer": "lpx25"}},
    ],
)
def test_key_sees_what_matters(change):
    assert metrics_key(load_instrument(change), "F662") != metrics_key(INSTRUMENT, "F662")


def test_other_instruments_are_measured_once_and_kept(tmp_path, monkeypatch):
    monkeypatch.setenv("CPIC_CACHE_DIR", str(tmp_path))
    calls = []

    def measure(instrument, band):
        calls.append(band)
        return psf_metrics(INSTRUMENT, band).to_arrays()

    monkeypatch.setattr(store, "measure", measure)
    other = load_instrument({"coronagraph": {"mask_half_width_arcsec": 0.134}})
    first, second = psf_metrics(other, "F850"), psf_metrics(other, "F850")
    assert calls == ["F850"]
    np.testing.assert_array_equal(first.raw_contrast, second.raw_contrast)


def test_metrics_of_two_instruments_that_were_swapped_answer_neither(tmp_path, monkeypatch, caplog):
    monkeypatch.setenv("CPIC_CACHE_DIR", str(tmp_path))

    def measure(instrument, band):
        share = instrument.coronagraph.mask_half_width_arcsec
        return psf_metrics(INSTRUMENT, band).to_arrays() | {"apodizer_energy": np.asarray(share)}

    monkeypatch.setattr(store, "measure", measure)
    widths = (0.134, 0.135)
    both = [load_instrument({"coronagraph": {"mask_half_width_arcsec": width}}) for width in widths]
    assert [psf_metrics(item, "F850").apodizer_energy for item in both] == list(widths)
    one, two = (tmp_path / f"metrics-{metrics_key(item, 'F850')}.bin" for item in both)
    kept = one.read_bytes()
    one.write_bytes(two.read_bytes())
    two.write_bytes(kept)
    assert [psf_metrics(item, "F850").apodizer_energy for item in both] == list(widths)
    assert len(caplog.records) == 2


def test_key_is_of_the_surface_and_not_of_its_file(tmp_path):
    def key(name, heights):
        path = tmp_path / name
        np.savez(path, surface_nm=heights)
        return metrics_key(
            load_instrument({"dark_hole": {"control": "surface", "surface_files": {"F662": str(path)}}}), "F662"
        )

    assert key("a.npz", np.eye(64)) == key("b.npz", np.eye(64)) != key("a.npz", 2 * np.eye(64))


@pytest.mark.long
def test_other_instrument_end_to_end(tmp_path, monkeypatch):
    default = psf_metrics(INSTRUMENT, "F850")
    monkeypatch.setenv("CPIC_CACHE_DIR", str(tmp_path))
    flat = {"wavefront": {"opd_rms_nm": 0, "amplitude_rms": 0, "jitter_mas": 0}, "dark_hole": {"control": "off"}}
    metrics = psf_metrics(load_instrument(flat | {"coronagraph": {"mask_half_width_arcsec": 0.134}}), "F850")
    assert metrics.iwa_arcsec < default.iwa_arcsec
    assert metrics.strehl == pytest.approx(1.0, rel=1e-9)
    assert metrics.raw_contrast[metrics.hole].mean() < 6e-10


PRESETS = ("cpic_default", "cpic_2q", "cpic_single_jacobian", "as_published")
BANDS = ("F520", "F662", "F720", "F850")
MODE_LIMIT = {"cpic_default": 2e-9, "cpic_2q": 8e-9, "cpic_single_jacobian": 5e-8, "as_published": 2e-9}


@pytest.fixture
def no_search(monkeypatch):
    def refuse(*_, **__):
        raise AssertionError("searched anew")

    monkeypatch.setattr(build, "search", refuse)


@pytest.mark.parametrize("band", BANDS)
def test_the_published_instrument_has_the_published_contrast(band):
    """And its speckles, which are coherent over the band, beat with the drift as coherent light does.

    Of drift dE on a static field E0, both coherent over an aperture, ``2 Re(E0* dE)`` has twice the variance
    ``<|E0|^2> <|dE|^2>``, and ``|dE|^2`` the variance ``<|dE|^2>^2``; in the difference of two visits both are twice
    that. What a perfect search leaves has another sign at other wavelengths, and beats less than it is bright.
    """
    default, published = (psf_metrics(load_instrument(preset), band) for preset in ("cpic_default", "as_published"))
    light = [metrics.raw_contrast[metrics.hole].mean() for metrics in (default, published)]
    assert light[1] == pytest.approx(1e-8, rel=0.1)
    (beat, own), (beat_published, own_published) = (
        (metrics.floor_linear[1:], metrics.floor_square[1:]) for metrics in (default, published)
    )
    np.testing.assert_allclose(own_published, own, rtol=0.15)
    static = np.array(light) * [m.peak_off_axis * m.aperture_pixels for m in (default, published)]
    coherent = 4 * static * np.sqrt(own / 2).mean()
    shares = np.array([beat.mean(), beat_published.mean()]) / coherent
    assert 0.4 < shares[1] < 1.0
    assert shares[0] < 0.5 * shares[1]


def solver(instrument, band="F662"):
    return bare_imager(instrument, band, Knobs(wavelength_nodes=5))


@pytest.mark.parametrize("preset", PRESETS)
@pytest.mark.parametrize("band", BANDS)
def test_shipped_states_load_without_a_search(no_search, preset, band):
    instrument = load_instrument(preset)
    state = dark_hole_of(instrument, band)
    assert state.reached
    assert (state.band, state.zone.mode) == (band, instrument.dark_hole.mode)
    allowed = instrument.dark_hole.sensing_contrast_of(band) / 2
    assert state.limit_contrast == pytest.approx(MODE_LIMIT[preset] + allowed, rel=1e-12)
    assert state.wide.mean <= state.limit_contrast
    assert not state.commands_nm.flags.writeable
    assert np.abs(state.commands_nm).max() <= instrument.mirror.stroke_nm / 2


@pytest.mark.parametrize(("band", "ratio"), [("F520", 5e3), ("F662", 5e4), ("F720", 5e4), ("F850", 5e4)])
def test_the_default_mirror_darkens_by_the_stated_ratio(band, ratio):
    state = dark_hole_of(load_instrument(), band)
    assert state.before.mean / state.wide.mean >= ratio
    assert state.before.mean / state.own.mean >= ratio


@pytest.mark.parametrize("preset", PRESETS)
@pytest.mark.parametrize("band", BANDS)
def test_the_state_belongs_to_the_grid_that_builds_the_psf(preset, band):
    """Light of the built optics over the zone, finer grids included, against the score of the search."""
    exact = load_instrument({"base": preset, "mirror": {"bits": None}, "wavefront": {"jitter_mas": 0}})
    own = dark_hole_of(exact, band).own

    def mean(instrument, **knobs):
        imager = build_imager(instrument, band, Knobs(**knobs))
        y, x = imager.zone.score_axes(0.25 * imager.lambda_d_arcsec)
        peak = imager.intensity(np.zeros(1), np.zeros(1))[0, 0]
        return imager.intensity(y, x).mean() / peak

    same = mean(exact, wavelength_nodes=5)
    assert same == pytest.approx(own.mean, rel=1e-9)
    assert mean(exact, wavelength_nodes=5, pupil_samples=256) == pytest.approx(same, rel=1e-12)
    assert mean(exact) == pytest.approx(own.mean, rel=2e-3)  # one wavelength fewer
    assert mean(load_instrument(preset)) == pytest.approx(own.mean, rel=0.06)  # a converter of 16 bits


@pytest.mark.parametrize(
    "change",
    [
        {"telescope": {"diameter_m": 2.1}},
        {"coronagraph": {"inner_lambda_d": 4.5}},
        {"coronagraph": {"outer_half_side_arcsec": 0.65}},
        {"coronagraph": {"inner_arcsec": {"F662": 0.3}}},
        {"coronagraph": {"apodizer": "lpx25"}},
        {"bands": {"F662": {"center_nm": 660}}},
        {"bands": {"F662": {"width_nm": 60}}},
        {"wavefront": {"seed": 2}},
        {"wavefront": {"opd_rms_nm": 21}},
        {"wavefront": {"amplitude_rms": 0.002}},
        {"wavefront": {"psd_slope": 2.6}},
        {"wavefront": {"samples": 256}},
        {"mirror": {"n_actuators": 34}},
        {"mirror": {"span_diameters": 0.9}},
        {"mirror": {"coupling": 0.2}},
        {"mirror": {"stroke_nm": 900}},
        {"mirror": {"dead": [[3, 4]]}},
        {"dark_hole": {"mode": "2q"}},
        {"dark_hole": {"bandwidth": 0.05}},
        {"dark_hole": {"control": "single_jacobian"}},
        {"dark_hole": {"sensing": "probes", "sensing_contrast": 3e-8}},
    ],
)
def test_key_sees_what_the_search_sees(change):
    default, other = load_instrument(), load_instrument(change)
    assert hole_key(other, solver(other)) != hole_key(default, solver(default))


@pytest.mark.parametrize(
    "change",
    [
        {"mirror": {"bits": None}},
        {"mirror": {"bits": 12, "noise_nm": 0.1}},
        {"wavefront": {"jitter_mas": 10}},
        {"drift": {"visit_nm": 1.0, "psd_slope": 3}},
        {"detector": {"read_noise_e": 10}},
        {"overhead_s": 5},
        {"coronagraph": {"mask_half_width_arcsec": 0.12}},
        {"bands": {"F720": {"width_nm": 30}}},
        {"name": "mine"},
        {"near_infrared": {"pixel_scale_arcsec": 0.03}},
        {"bands": {"F662": {"t_opt": 0.3, "qe": 0.5}}},
        {"dark_hole": {"sensing": "probes", "sensing_contrast": 3e-8, "sensing_contrast_by_band": {"F662": 0}}},
    ],
)
def test_key_ignores_what_the_search_does_not_see(no_search, change):
    default, other = load_instrument(), load_instrument(change)
    assert hole_key(other, solver(other)) == hole_key(default, solver(default))
    np.testing.assert_array_equal(dark_hole_of(other, "F662").commands_nm, dark_hole_of(default, "F662").commands_nm)


def test_side_is_part_of_the_key_where_it_matters():
    keys = [
        hole_key(item, solver(item))
        for item in (
            load_instrument({"base": "cpic_2q", "dark_hole": {"side": side}}) for side in ("right", "left", "top")
        )
    ]
    assert len(set(keys)) == 3


def test_arrays_there_and_back():
    instrument = load_instrument()
    state = dark_hole_of(instrument, "F720")
    again = hole_from_arrays(hole_arrays(state), solver(instrument, "F720"))
    assert type(again) is type(state)
    np.testing.assert_array_equal(again.commands_nm, state.commands_nm)
    for name in ("band", "zone", "method", "before", "wide", "own", "limit_contrast"):
        assert getattr(again, name) == getattr(state, name)
    for name in ("history", "strong", "ended"):
        assert getattr(again.search, name) == getattr(state.search, name)
    brighter = hole_arrays(state) | {"limit_contrast": np.asarray(1e-11)}
    assert not hole_from_arrays(brighter, solver(instrument, "F720")).reached


def test_any_other_hole_is_searched_once_and_kept(tmp_path, monkeypatch, caplog):
    monkeypatch.setenv("CPIC_CACHE_DIR", str(tmp_path))
    calls = []

    def search(instrument, imager, aberrations, mirror):
        calls.append(imager.band)
        commands = np.full((32, 32), 1.5)
        score = HoleScore(3e-9, 1e-9, 4e-9, 5e-9, 0.9, 0.13)
        found = Search(commands, (1e-5, 3e-9), (False,), "iterations")
        return DarkHole(imager.band, imager.zone, "relinearised", commands, found, score, score, score, 2e-9)

    monkeypatch.setattr(build, "search", search)
    other = load_instrument({"wavefront": {"seed": 77}})
    with caplog.at_level(logging.WARNING):
        first, second = dark_hole_of(other, "F850"), dark_hole_of(other, "F850")
    assert calls == ["F850"]
    assert not first.reached
    assert not second.reached
    np.testing.assert_array_equal(second.commands_nm, np.full((32, 32), 1.5))
    assert [record.getMessage() for record in caplog.records] == [
        "dark hole not reached: F850 4q: mean contrast 3e-09 after 1 iterations (iterations), asked 2e-09"
    ]


def test_configured_apodizer_is_the_map_as_it_is_named(tmp_path):
    instrument = load_instrument()
    steps = configured_apodizer(instrument)
    assert steps.shape == (64, 64)
    path = tmp_path / "lab.npz"
    np.savez(path, intensity=np.repeat(np.repeat(steps**2, 2, 0), 2, 1))
    lab = load_instrument(
        {"coronagraph": {"apodizer": str(path), "apodizer_kind": "intensity", "apodizer_samples": 64}}
    )
    np.testing.assert_allclose(configured_apodizer(lab), steps, atol=1e-12)
    assert dataclasses.is_dataclass(build_imager(load_instrument({"dark_hole": {"control": "off"}}), "F662"))


@pytest.mark.parametrize("band", INSTRUMENT.visible_bands())
def test_the_states_of_the_default_instrument_ship(tmp_path, monkeypatch, band):
    """From an empty cache nothing is dug or measured; the holes go from the darkest known to beyond the published."""

    def refuse(*_):
        raise AssertionError(f"a state of {band} dug or measured anew: run python -m tools.dig_holes --states-only")

    monkeypatch.setenv("CPIC_CACHE_DIR", str(tmp_path))
    monkeypatch.setattr(store, "measure", refuse)
    monkeypatch.setattr(build, "search", refuse)
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
