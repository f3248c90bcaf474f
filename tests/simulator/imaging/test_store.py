import numpy as np
import pytest

from simulator.config import load_instrument
from simulator.config.presets import preset_names
from simulator.imaging import hole_store, measure, store
from simulator.imaging.build import bare_imager, build_imager, dark_hole_of, hole_state_of
from simulator.imaging.floor import measure_floor
from simulator.imaging.geometry import BandGeometry
from simulator.imaging.hole_store import hole_key, shipped_hole
from simulator.imaging.measure import stamp_figures
from simulator.imaging.metrics import PsfMetrics
from simulator.imaging.psf import single_band_psf
from simulator.imaging.store import metrics_key, psf_metrics, shipped_metrics
from simulator.knobs import Knobs

INSTRUMENT = load_instrument()


EVERY = [(preset, band) for preset in preset_names("instrument") for band in load_instrument(preset).bands]


@pytest.mark.parametrize(("preset", "band"), EVERY)
def test_every_band_of_every_preset_is_shipped(tmp_path, monkeypatch, preset, band):
    """From an empty cache nothing is dug or measured, and a preset that is changed without its files fails here."""

    def refuse(*_):
        raise AssertionError(f"{preset} {band} dug or measured anew: run python -m tools.dig_holes")

    monkeypatch.setenv("CPIC_CACHE_DIR", str(tmp_path))
    monkeypatch.setattr(store, "measure", refuse)
    monkeypatch.setattr(hole_store, "search", refuse)
    instrument = load_instrument(preset)
    metrics, hole = psf_metrics(instrument, band), dark_hole_of(instrument, band)
    assert metrics.band == hole.band == band
    assert metrics.geometry == BandGeometry.of(instrument, band, len(metrics.raw_contrast))
    assert metrics.hole_state == hole_state_of(instrument, band, float(metrics.raw_contrast[metrics.hole].mean()))
    assert not list(tmp_path.iterdir())


def test_nothing_else_is_shipped():
    instruments = {(preset, band): load_instrument(preset) for preset, band in EVERY}
    metrics = {shipped_metrics(metrics_key(made, band), band).name for (_, band), made in instruments.items()}
    holes = {
        shipped_hole(hole_key(made, bare_imager(made, band, Knobs(wavelength_nodes=5))), band).name
        for (_, band), made in instruments.items()
    }
    folder = shipped_metrics("", "").parent
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
    profile, wing_map, columns = measure._wings(wide)
    np.testing.assert_allclose(stored["wing_profile"], profile, rtol=4e-6)
    np.testing.assert_allclose(stored["column_profile"], columns, rtol=4e-6)
    np.testing.assert_allclose(stored["wing_map"], wing_map, rtol=1.3e-4)


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
        {"bands": {"F662": {"t_opt": 0.3, "qe": 0.8}}},
        {"overhead_s": 100},
        {"bands": {"F720": {"width_nm": 30}}},
        {"coronagraph": {"inner_arcsec": {"F720": 0.3}}},
        {"near_infrared": {"mask_half_width_arcsec": 0.2}},
        {"sky": {"brightness_v_mag_arcsec2": 20}},
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


def test_key_is_of_the_surface_and_not_of_its_file(tmp_path):
    def key(name, heights):
        path = tmp_path / name
        np.savez(path, surface_nm=heights)
        return metrics_key(
            load_instrument({"dark_hole": {"control": "surface", "surface_files": {"F662": str(path)}}}), "F662"
        )

    assert key("a.npz", np.eye(64)) == key("b.npz", np.eye(64)) != key("a.npz", 2 * np.eye(64))


def test_other_instrument_end_to_end(tmp_path, monkeypatch):
    monkeypatch.setenv("CPIC_CACHE_DIR", str(tmp_path))
    monkeypatch.setattr(measure, "measure_floor", lambda imager, slope: measure_floor(imager, slope, n_visits=8))
    flat = {"wavefront": {"opd_rms_nm": 0, "amplitude_rms": 0, "jitter_mas": 0}, "dark_hole": {"control": "off"}}
    metrics = psf_metrics(load_instrument(flat | {"coronagraph": {"mask_half_width_arcsec": 0.134}}), "F850")
    assert metrics.iwa_arcsec < psf_metrics(INSTRUMENT, "F850").iwa_arcsec
    assert metrics.strehl == pytest.approx(1.0, rel=1e-9)
    assert metrics.raw_contrast[metrics.hole].mean() < 6e-10
