import numpy as np
import pytest
from astropy.io import fits

from cpic_core import write_npz
from simulator.imaging.deformable_mirror import DeformableMirror, load_dm_surface


def test_surface_is_the_sum_of_gaussians():
    mirror = DeformableMirror(n_actuators=6, span_diameters=0.9, coupling=0.2)
    commands = np.random.default_rng(1).normal(size=(6, 6))
    position = (np.arange(20) + 0.5) / 20 - 0.5
    pitch = 0.15
    sigma = pitch / np.sqrt(2 * np.log(1 / 0.2))
    expected = np.zeros((20, 20))
    for row in range(6):
        for column in range(6):
            y, x = (np.array([row, column]) - 2.5) * pitch
            squared = (position[:, None] - y) ** 2 + (position - x) ** 2
            expected += commands[row, column] * np.exp(-squared / (2 * sigma**2))
    np.testing.assert_allclose(mirror.surface_nm(commands, 20), expected, rtol=1e-12, atol=1e-14)
    np.testing.assert_allclose(mirror.opd_nm(commands, 20), 2 * expected, rtol=1e-12, atol=1e-14)


def test_coupling_is_the_influence_one_pitch_away():
    functions = DeformableMirror(n_actuators=8, span_diameters=1.0, coupling=0.15).influence(8)
    np.testing.assert_allclose(np.diagonal(functions), 1.0)
    np.testing.assert_allclose(np.diagonal(functions, 1), 0.15)
    np.testing.assert_allclose(np.diagonal(functions, 2), 0.15**4)


def test_rows_are_y():
    commands = np.zeros((32, 32))
    commands[3, 20] = 1.0
    surface = DeformableMirror(span_diameters=1.0).surface_nm(commands, 128)
    assert np.unravel_index(surface.argmax(), surface.shape)[0] // 4 == 3
    assert np.unravel_index(surface.argmax(), surface.shape)[1] // 4 == 20


def test_quantisation_error_is_uniform_over_a_step():
    mirror = DeformableMirror(bits=12, stroke_nm=1000.0)
    asked = np.random.default_rng(2).uniform(-400, 400, (32, 32))
    error = mirror.realise(asked) - asked
    step = 1000 / 4096
    assert np.abs(error).max() <= step / 2 * (1 + 1e-9)
    squares = error**2
    assert abs(squares.mean() - step**2 / 12) < 4 * squares.std() / 32
    np.testing.assert_array_equal(mirror.realise(mirror.realise(asked)), mirror.realise(asked))


def test_noise_stroke_and_dead_actuators():
    mirror = DeformableMirror(noise_nm=0.05, stroke_nm=100.0, dead=((2, 5), (31, 0)))
    asked = np.zeros((32, 32))
    asked[2, 5], asked[0, 0], asked[1, 1] = 7.0, 80.0, -80.0
    done = mirror.realise(asked, np.random.default_rng(3))
    assert done[2, 5] == 0 == done[31, 0]
    assert done[0, 0] == pytest.approx(50, abs=0.3)
    assert done[1, 1] == pytest.approx(-50, abs=0.3)
    rest = done[mirror.alive & (asked == 0)]
    assert abs((rest**2).mean() - 0.05**2) < 4 * (rest**2).std() / np.sqrt(rest.size)
    np.testing.assert_array_equal(done, mirror.realise(asked, np.random.default_rng(3)))
    perfect = DeformableMirror()
    np.testing.assert_array_equal(perfect.realise(asked), asked)


def test_quantised_range_never_passes_the_stroke():
    done = DeformableMirror(bits=8, stroke_nm=10.0).realise(np.full((32, 32), 5.0))
    assert done.max() <= 5.0
    assert DeformableMirror(bits=8, stroke_nm=10.0).realise(np.full((32, 32), -9.0)).min() == -5.0


def test_bad_commands_are_named(refused):
    mirror = DeformableMirror(noise_nm=1.0)
    refused("rng", mirror.realise, np.zeros((32, 32)))


def written(path, data, unit=None):
    hdu = fits.PrimaryHDU(data)
    if unit:
        hdu.header["BUNIT"] = unit
    hdu.writeto(path)
    return path


def test_surface_from_fits_in_any_unit_and_from_npz(tmp_path):
    heights = np.random.default_rng(4).normal(size=(32, 32)) * 20
    um = load_dm_surface(written(tmp_path / "um.fits", heights / 1e3, "um"), 64)
    metre = load_dm_surface(written(tmp_path / "m.fits", heights * 1e-9), 64, unit="m")
    write_npz(tmp_path / "nm.npz", {"surface_nm": heights})
    nm = load_dm_surface(tmp_path / "nm.npz", 64)
    expected = np.kron(heights, np.ones((2, 2)))
    for surface in (um, metre, nm):
        np.testing.assert_allclose(surface, expected, rtol=1e-14)


def test_image_in_an_extension_is_found(tmp_path):
    image = fits.ImageHDU(np.ones((8, 8)))
    image.header["BUNIT"] = "nm"
    fits.HDUList([fits.PrimaryHDU(), image]).writeto(tmp_path / "x.fits")
    assert load_dm_surface(tmp_path / "x.fits", 64).shape == (64, 64)


def test_unusable_surfaces_are_refused_by_name(refused, tmp_path):
    good = np.ones((32, 32))
    holed = good.copy()
    holed[3, 4] = np.nan
    (tmp_path / "text.fits").write_text("not a FITS file")
    write_npz(tmp_path / "other.npz", {"height": good})
    fits.PrimaryHDU().writeto(tmp_path / "empty.fits")
    cases = [
        (written(tmp_path / "a.fits", holed, "nm"), {}, "finite values.*1 are not"),
        (written(tmp_path / "b.fits", good), {}, "missing.*BUNIT"),
        (written(tmp_path / "c.fits", good, "nm"), {"unit": "um"}, "as the file says"),
        (written(tmp_path / "d.fits", good, "Jy"), {}, "Jy"),
        (written(tmp_path / "e.fits", np.ones((32, 30)), "nm"), {}, "square"),
        (written(tmp_path / "f.fits", np.ones((40, 40)), "nm"), {}, "its side is 40"),
        (written(tmp_path / "g.fits", 20 * good, "um"), {}, "is the unit right"),
        (tmp_path / "text.fits", {"unit": "nm"}, "FITS"),
        (tmp_path / "empty.fits", {}, "with an image"),
        (tmp_path / "other.npz", {}, "surface_nm"),
        (tmp_path / "absent.fits", {}, "existing"),
    ]
    for path, options, words in cases:
        refused(words, load_dm_surface, path, 64, **options)


def test_without_samples_the_map_keeps_its_own_grid(tmp_path):
    heights = np.random.default_rng(6).normal(size=(33, 33)) * 20
    surface = load_dm_surface(written(tmp_path / "a.fits", heights.astype(">f8"), "nm"))
    np.testing.assert_array_equal(surface, heights)
    assert surface.dtype.isnative
    write_npz(tmp_path / "a.npz", {"surface_nm": heights})
    np.testing.assert_array_equal(load_dm_surface(tmp_path / "a.npz"), heights)


@pytest.mark.parametrize(
    ("unit", "nm"),
    [
        ("nm", 1),
        ("Nanometer", 1),
        ("um", 1e3),
        ("Micron", 1e3),
        ("\u00b5m", 1e3),
        ("mm", 1e6),
        ("m", 1e9),
        ("pm", 1e-3),
        ("Angstrom", 0.1),
    ],
)
def test_units_by_many_names(tmp_path, unit, nm):
    surface = load_dm_surface(written(tmp_path / "a.fits", np.full((4, 4), 2.0 / nm)), unit=unit)
    np.testing.assert_allclose(surface, 2.0, rtol=1e-14)


@pytest.mark.parametrize("unit", ["NM", "M", "Mm", "rad", "waves", "1"])
def test_other_units_are_refused(refused, tmp_path, unit):
    refused(f"unit = {unit}: .*nm, um", load_dm_surface, written(tmp_path / "a.fits", np.ones((4, 4))), unit=unit)


@pytest.mark.parametrize(
    ("data", "words"),
    [(np.ones((2, 8, 8)), "plane of the cube"), (np.ones((1, 1)), "2 to 4096"), (np.ones(9), "square")],
)
def test_other_shapes_are_refused(refused, tmp_path, data, words):
    refused(words, load_dm_surface, written(tmp_path / "a.fits", data, "nm"))
    write_npz(tmp_path / "a.npz", {"surface_nm": np.ones((8, 8), complex)})
    refused("complex128", load_dm_surface, tmp_path / "a.npz")
