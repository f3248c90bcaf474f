import dataclasses

import numpy as np
import pytest

from catalogs import load_reference_spectrum
from simulator.config import load_instrument
from simulator.imaging import build, build_imager, single_band_psf
from simulator.imaging.build import (
    aberrations_of,
    bare_imager,
    configured_mirror,
    dark_hole_of,
    dig,
    hole_key,
    static_wavefront,
)
from simulator.imaging.deformable_mirror import DeformableMirror
from simulator.imaging.pupil import draw_aberrations
from simulator.knobs import Knobs
from simulator.passbands import Passbands

INSTRUMENT = load_instrument()
OFF = {"dark_hole": {"control": "off"}}
FLAT = OFF | {"wavefront": {"opd_rms_nm": 0, "amplitude_rms": 0, "jitter_mas": 0}}
SMALL = Knobs(wavelength_nodes=1, stamp_pixels=121)


def hole_contrast(psf):
    offset = (np.arange(len(psf.on_axis)) - len(psf.on_axis) // 2) * psf.pixel_scale_arcsec
    return (psf.on_axis / psf.off_axis.max())[psf.imager.zone.covers(offset, offset)].mean()


@pytest.fixture
def own_cache(tmp_path, monkeypatch):
    monkeypatch.setenv("CPIC_CACHE_DIR", str(tmp_path / "cache"))


def test_static_wavefront_is_aberrations_and_what_the_mirror_does():
    static = static_wavefront(INSTRUMENT, "F662")
    drawn = draw_aberrations(1, samples=128, opd_rms_nm=20, amplitude_rms=0.003)
    maps = drawn.pointed(bare_imager(INSTRUMENT, "F662").transmission)
    np.testing.assert_array_equal(static.amplitude, maps.amplitude)
    commands = dark_hole_of(INSTRUMENT, "F662").commands_nm
    done = np.clip(np.rint(commands / (1000 / 2**16)), -(2**15), 2**15 - 1) * (1000 / 2**16)
    np.testing.assert_allclose(static.opd_nm, maps.opd_nm + DeformableMirror().opd_nm(done, 128), atol=1e-9)
    imager = build_imager(INSTRUMENT, "F662")
    np.testing.assert_array_equal(imager.static.opd_nm, static.opd_nm)
    assert imager.jitter_arcsec == 0.005
    assert configured_mirror(INSTRUMENT) == DeformableMirror(bits=16)


def test_bare_optics_have_apodizer_and_jitter_only():
    bare = bare_imager(INSTRUMENT, "F720")
    built = build_imager(INSTRUMENT, "F720")
    assert bare.static is None
    assert dataclasses.replace(built, static=None).pupil(0).dtype == bare.pupil(0).dtype == np.float64
    for name in ("wavelengths_m", "weights", "transmission"):
        np.testing.assert_array_equal(getattr(bare, name), getattr(built, name))
    assert (bare.zone, bare.jitter_arcsec) == (built.zone, built.jitter_arcsec)


def test_mirror_off_leaves_the_aberrations(refused):
    off = load_instrument(OFF)
    np.testing.assert_array_equal(static_wavefront(off, "F662").opd_nm, aberrations_of(off).opd_nm)
    psf = single_band_psf("F662", fidelity=SMALL, instrument=off)
    assert psf.flags == ()
    assert 1e-5 < hole_contrast(psf) < 1e-4
    refused(r"dark_hole.control = off", dark_hole_of, off, "F662")


def test_perfect_optics_need_no_mirror():
    flat = load_instrument(FLAT)
    assert aberrations_of(flat) is None
    imager = build_imager(flat, "F662")
    assert imager.static is None
    assert imager.transmission.shape == (64, 64)
    assert hole_contrast(single_band_psf("F662", fidelity=SMALL, instrument=flat)) < 6e-10
    # With the mirror in use, there is nothing for it to do.
    controlled = load_instrument({"wavefront": {"opd_rms_nm": 0, "amplitude_rms": 0}})
    assert build_imager(controlled, "F662", SMALL).transmission.shape == (128, 128)


def test_perfect_optics_under_control_keep_their_mirror_still():
    state = dark_hole_of(load_instrument({"wavefront": {"opd_rms_nm": 0, "amplitude_rms": 0}}), "F662")
    assert np.abs(state.commands_nm).max() < 1e-9
    assert state.wide.strehl == pytest.approx(1.0, rel=1e-12)
    assert state.wide.mean == pytest.approx(state.before.mean, rel=1e-9)


def test_single_jacobian_is_thirty_times_brighter():
    psfs = [
        single_band_psf("F662", fidelity=SMALL, instrument=load_instrument(name))
        for name in ("cpic_default", "cpic_single_jacobian")
    ]
    contrast = [hole_contrast(psf) for psf in psfs]
    assert contrast[0] < 1e-9
    assert 10 * contrast[0] < contrast[1] < 5e-8
    assert psfs[1].flags == ()


@pytest.mark.parametrize("kind", ["npz", "fits"])
def test_a_saved_surface_gives_the_same_psf(refused, tmp_path, kind):
    plain = load_instrument({"mirror": {"bits": None}})
    surface = DeformableMirror().surface_nm(dark_hole_of(plain, "F662").commands_nm, 128)
    path = tmp_path / f"mirror.{kind}"
    if kind == "npz":
        np.savez(path, surface_nm=surface)
    else:
        from astropy.io import fits

        fits.PrimaryHDU(surface * 1e-3, fits.Header({"BUNIT": "um"})).writeto(path)
    loaded = load_instrument({"dark_hole": {"control": "surface", "surface_files": {"F662": str(path)}}})
    ours, theirs = (single_band_psf("F662", fidelity=SMALL, instrument=item) for item in (plain, loaded))
    assert np.abs(ours.on_axis - theirs.on_axis).max() < 1e-14 * ours.off_axis.max()
    assert np.abs(ours.off_axis - theirs.off_axis).max() < 1e-14 * ours.off_axis.max()
    assert theirs.flags == ()
    refused(r"dark_hole.surface_files = F720", build_imager, loaded, "F720")
    refused(r"dark_hole.control = surface", dark_hole_of, loaded, "F662")


def test_surfaces_on_another_grid(refused, tmp_path):
    path = tmp_path / "coarse.npz"
    surface = np.random.default_rng(1).normal(0, 5, (64, 64))
    np.savez(path, surface_nm=surface)
    flat = {"wavefront": {"opd_rms_nm": 0, "amplitude_rms": 0}}
    instrument = load_instrument(flat | {"dark_hole": {"control": "surface", "surface_files": {"F662": str(path)}}})
    static = static_wavefront(instrument, "F662")
    np.testing.assert_allclose(static.opd_nm, 2 * np.kron(surface, np.ones((2, 2))))
    np.savez(path, surface_nm=np.zeros((1021, 1021)))
    refused("1021 samples", build_imager, instrument, "F662")


def test_noise_of_the_electronics_changes_the_psf_and_not_the_hole(monkeypatch):
    def refuse(*_, **__):
        raise AssertionError("searched anew")

    monkeypatch.setattr(build, "search", refuse)
    contrast = {}
    for name, mirror in (("none", {"bits": None}), ("12 bits", {"bits": 12}), ("noise", {"noise_nm": 0.05})):
        instrument = load_instrument({"mirror": mirror})
        contrast[name] = hole_contrast(single_band_psf("F662", fidelity=SMALL, instrument=instrument))
    # The reference study: 4.1e-9 at 12 bits, 3.7e-9 at 50 pm of actuator noise.
    assert contrast["none"] < 1e-9
    assert 3e-9 < contrast["12 bits"] < 6e-9
    assert 2e-9 < contrast["noise"] < 6e-9


def test_a_hole_not_reached_is_flagged(own_cache):
    psf = single_band_psf("F850", fidelity=SMALL, instrument=load_instrument({"mirror": {"n_actuators": 12}}))
    assert psf.flags == ("hole_not_reached",)
    assert hole_contrast(psf) > 1e-7


@pytest.mark.long
def test_digging_anew_finds_what_is_shipped():
    state, key = dig(INSTRUMENT, "F850")
    shipped = dark_hole_of(INSTRUMENT, "F850")
    assert key == hole_key(INSTRUMENT, bare_imager(INSTRUMENT, "F850", Knobs(wavelength_nodes=5)))
    assert type(state) is type(shipped)
    assert state.wide.mean == pytest.approx(shipped.wide.mean, rel=0.1)
    assert state.before.mean == pytest.approx(shipped.before.mean, rel=1e-9)
    np.testing.assert_allclose(state.commands_nm, shipped.commands_nm, atol=1.0)


@pytest.mark.parametrize("band", ["F940", "F1265", "F1425", "F1542"])
def test_near_infrared_bands_have_their_own_pixel_mask_and_hole(band):
    imager = build_imager(load_instrument(OFF), band, SMALL)
    lambda_d = INSTRUMENT.bands[band].center_nm * 1e-9 / 2.0 * 180 * 3600 / np.pi
    assert imager.pixel_scale_arcsec == 0.0323
    assert imager.mask_half_width_arcsec == 0.28
    assert imager.zone.outer_arcsec == 1.2
    assert imager.zone.inner_arcsec == pytest.approx(4.3 * lambda_d / np.sqrt(2))
    assert imager.zone.inner_arcsec > imager.mask_half_width_arcsec
    assert imager.lambda_d_arcsec == pytest.approx(lambda_d)


def test_a_near_infrared_hole(own_cache):
    psf = single_band_psf("F1425", fidelity=SMALL, instrument=INSTRUMENT)
    assert psf.flags == ()
    assert psf.pixel_scale_arcsec == 0.0323
    assert hole_contrast(psf) < 1e-9
    row, column = np.unravel_index(psf.off_axis.argmax(), psf.off_axis.shape)
    assert abs(row - 60) <= 1 >= abs(column - 60)


def test_user_bands(tmp_path):
    wavelength = np.arange(580.0, 620.1, 0.5)
    curves = {
        "file": np.where(np.abs(wavelength - 600) <= 10.0, 0.9, 0.0),
        "skew": np.clip((wavelength - 590) / 20, 0, 1) * (wavelength <= 610),
    }
    for name, curve in curves.items():
        np.savetxt(tmp_path / f"{name}.txt", np.stack([wavelength, curve], axis=1), header="nm")
    band = {"camera": "VIS", "center_nm": 600, "width_nm": 20, "t_opt": 0.2, "qe": 0.9}
    filters = {name: band | {"transmission_file": str(tmp_path / f"{name}.txt")} for name in curves}
    filters["skew"] |= {"center_nm": 603, "width_nm": 10}
    instrument = load_instrument(OFF | {"bands": {"mine": band} | filters})
    knobs = Knobs(stamp_pixels=65)
    mine, file, skewed = (
        single_band_psf(name, fidelity=knobs, instrument=instrument) for name in ("mine", "file", "skew")
    )
    for psf in (mine, file, skewed):
        imager = psf.imager
        assert imager.weights.sum() == pytest.approx(1.0, rel=1e-12)
        center_nm = instrument.bands[psf.band].center_nm
        assert imager.lambda_d_arcsec == pytest.approx(center_nm * 1e-9 / 2 * 206264.806, rel=1e-8)
        assert psf.band in ("mine", "file", "skew")
    assert mine.off_axis.sum() == pytest.approx(file.off_axis.sum(), rel=1e-3)
    assert mine.off_axis.max() == pytest.approx(file.off_axis.max(), rel=2e-3)
    # A filter that opens to the red makes the image wider.
    means = [psf.imager.weights @ psf.imager.wavelengths_m * 1e9 for psf in (mine, file, skewed)]
    assert means[0] == pytest.approx(600, abs=0.5)
    assert means[1] == pytest.approx(600, abs=0.5)
    assert means[2] == pytest.approx(590 + 20 * 2 / 3, abs=0.7)
    assert skewed.off_axis.max() < mine.off_axis.max()


def test_wavelengths_are_those_of_the_passbands():
    imager = build_imager(INSTRUMENT, "F520", Knobs(wavelength_nodes=6))
    sun = load_reference_spectrum("sun")
    wavelength, weights = Passbands.from_instrument(INSTRUMENT).wavelength_nodes("F520", 6, spectrum=sun)
    np.testing.assert_allclose(imager.wavelengths_m * 1e9, wavelength)
    np.testing.assert_allclose(imager.weights, weights)


@pytest.mark.parametrize(("asked", "given"), [(64, 128), (128, 128), (129, 256), (200, 256), (1000, 1024)])
def test_pupil_grid_is_the_next_common_multiple(asked, given):
    imager = build_imager(load_instrument(OFF), "F662", Knobs(pupil_samples=asked, wavelength_nodes=1))
    assert imager.transmission.shape == imager.static.opd_nm.shape == (given, given)
    flat = build_imager(load_instrument(FLAT), "F662", Knobs(pupil_samples=asked, wavelength_nodes=1))
    assert len(flat.transmission) == 64 * -(-asked // 64)


def test_grids_that_do_not_fit_are_refused(refused, tmp_path):
    path = tmp_path / "odd.npz"
    np.savez(path, transmission=np.ones((134, 134)))
    other = load_instrument(OFF | {"coronagraph": {"apodizer": str(path)}})
    refused(r"wavefront.samples = 128.*2048 samples with the 134 steps", build_imager, other, "F662")
    fits = load_instrument(OFF | {"coronagraph": {"apodizer": str(path), "apodizer_samples": 128}})
    assert build_imager(fits, "F662").transmission.shape == (128, 128)


@pytest.mark.parametrize(("words", "arguments"), [("band = F999", ("F999",)), ("fidelity", ("F662", "best"))])
@pytest.mark.parametrize("build", [build_imager, bare_imager])
def test_unknown_names_are_refused(refused, build, words, arguments):
    refused(words, build, INSTRUMENT, *arguments)


def test_a_finer_surface_makes_the_pupil_grid_finer(tmp_path):
    plain = load_instrument({"mirror": {"bits": None}})
    coarse = DeformableMirror().surface_nm(dark_hole_of(plain, "F662").commands_nm, 128)
    path = tmp_path / "fine.npz"
    np.savez(path, surface_nm=np.kron(coarse, np.ones((2, 2))))
    loaded = load_instrument({"dark_hole": {"control": "surface", "surface_files": {"F662": str(path)}}})
    imager = build_imager(loaded, "F662", SMALL)
    assert len(imager.transmission) == 256
    np.testing.assert_allclose(imager.static.opd_nm[::2, ::2], build_imager(plain, "F662", SMALL).static.opd_nm)
