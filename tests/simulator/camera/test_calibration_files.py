from __future__ import annotations

import warnings

import numpy as np
import pytest
from astropy.io import fits

from cpic_core import InputError
from simulator.camera import MaskBit, bias_level_adu, load_calibration_set, write_calibration_set
from simulator.config import Detector, load_instrument

UNITS = {"flat": None, "dark": "electron/s", "cic": "electron", "bad_columns": None, "bias": "adu"}
LEVELS = {"flat": 1.0, "dark": 0.5, "cic": 0.03, "bad_columns": 0.0, "bias": 300.0}


@pytest.fixture(scope="module")
def small(detector) -> Detector:
    """Frame of 70 x 60 around 44 x 34 active pixels, and fewer columns of flaws."""
    edge = {
        "prescan_columns": 4,
        "dark_columns_left": 3,
        "dark_columns_right": 3,
        "overscan_columns": 6,
        "dark_rows_bottom": 2,
        "dark_rows_top": 6,
        "overscan_rows": 18,
    }
    tree = detector.model_dump()
    flaws = {**tree["flaws"], "hot_fraction": 0.01, "dead_fraction": 0.005, "bad_columns": 1, "cic_rms": 0.2}
    return Detector(
        **{**tree, "n_rows": 60, "n_columns": 60, "star_row": 20, "star_column": 30, "layout": edge, "flaws": flaws}
    )


@pytest.fixture
def with_files(small):
    def build(**files):
        named = {**small.calibration_files.model_dump(), **{key: str(path) for key, path in files.items()}}
        return Detector(**{**small.model_dump(), "calibration_files": named})

    return build


@pytest.fixture
def save(tmp_path):
    def write(data, unit=None, name="map.fits", *, extension=False):
        hdu = fits.ImageHDU(data) if extension else fits.PrimaryHDU(data)
        if unit is not None:
            hdu.header["BUNIT"] = unit
        path = tmp_path / name
        (fits.HDUList([fits.PrimaryHDU(np.zeros(4)), hdu]) if extension else hdu).writeto(path, overwrite=True)
        return path

    return write


def a_map(kind, shape):
    data = np.full(shape, LEVELS[kind])
    if kind == "bad_columns":
        data = data.astype(np.int16)
        data[:, 20] = 1
    else:
        data[12, 15] *= 1.5
    return data


@pytest.mark.parametrize("kind", UNITS)
@pytest.mark.parametrize("whole", [True, False])
def test_a_map_replaces_its_part_of_the_set(kind, whole, small, with_files, save) -> None:
    frame = (small.n_rows, small.n_columns)
    data = a_map(kind, frame if whole else small.active_shape)
    path = save(data, UNITS[kind], extension=not whole)
    changed = load_calibration_set(with_files(**{kind: path}))
    base, parts = load_calibration_set(small), small.sections
    active, image = parts["active"], parts["image"]
    placed = np.zeros(frame)
    placed[active] = data[active] if whole else data
    assert dict(changed.files) == {kind: str(path)}
    same = {"response", "dark_e_s", "cic_e", "stripe_adu", "bad_column"}
    if kind == "flat":
        good = ~base.bad_column[active]
        assert np.array_equal(changed.response[active][good], placed[active][good])
        assert not changed.dead.any()
        same -= {"response"}
    elif kind == "dark":
        assert np.array_equal(changed.dark_e_s[active], placed[active])
        assert (changed.dark_uniform_e_s[image] == 0.5).all()
        assert (changed.dark_e_s[parts["dark_left"]] == 0.5).all()
        assert changed.dark_e_s[parts["prescan"]].sum() == 0
        same -= {"dark_e_s"}
    elif kind == "cic":
        assert changed.cic_varies
        assert np.array_equal(changed.cic_e[active], placed[active])
        assert (changed.cic_e[parts["overscan_rows"]] == 0.03).all()
        assert changed.cic_e[parts["overscan_columns"]].sum() == 0
        same -= {"cic_e"}
    elif kind == "bad_columns":
        assert np.array_equal(changed.bad_column[active], placed[active] > 0)
        assert (changed.response[changed.bad_column] == 0).all()
        raised = (changed.dark_e_s - base.dark_smooth_e_s)[changed.bad_column]
        assert raised.min() == pytest.approx(small.flaws.bad_column_e_s)
        same -= {"response", "dark_e_s", "bad_column"}
    else:
        assert np.array_equal(changed.bias_adu[active], placed[active])
        assert (changed.bias_adu[parts["prescan"]] == 300).all()
        assert (changed.stripe_adu == 0).all()
        assert changed.bias_level_adu == bias_level_adu(with_files(bias=path)) == 300
        assert base.bias_level_adu == bias_level_adu(small) == small.bias_adu == 200
        same -= {"stripe_adu"}
    for name in same:
        assert np.array_equal(getattr(changed, name), getattr(base, name)), name


def test_zeros_of_a_flat_are_dead_pixels(small, with_files, save) -> None:
    flat = a_map("flat", small.active_shape)
    flat[3, 4] = 0
    changed = load_calibration_set(with_files(flat=save(flat)))
    row, column = (part.start for part in small.sections["active"])
    assert changed.mask[row + 3, column + 4] & MaskBit.BAD
    switches = small.switched(off=("bad_pixels",)).switches
    assert changed.response_of(switches)[row + 3, column + 4] == 1


def test_hot_pixels_of_a_dark_follow_their_switch(small, with_files, save) -> None:
    dark = np.full(small.active_shape, 0.01)
    dark[5, 6], dark[7, 8] = 3.0, 0.2
    changed = load_calibration_set(with_files(dark=save(dark, "e-/s")))
    row, column = (part.start for part in small.sections["active"])
    assert changed.mask[row + 5, column + 6] & MaskBit.HOT
    assert changed.mask[row + 7, column + 8] & MaskBit.WARM
    smooth = changed.dark_of(small.switched(off=("bad_pixels",)).switches)
    assert smooth[row + 5, column + 6] == smooth[row + 7, column + 8] == 0.01


@pytest.mark.parametrize(
    "unit",
    [
        "electron/s",
        "electron s-1",
        "e-/s",
        "electron / s / pixel",
        "electrons/s",
        "e-/px/s",
        "electron s-1 pix-1",
        "electron / (s pix)",
    ],
)
def test_spellings_of_a_unit(unit, small, with_files, save) -> None:
    path = save(a_map("dark", small.active_shape), unit)
    assert load_calibration_set(with_files(dark=path)).dark_e_s.max() == 0.75


def test_units_are_converted(small, with_files, save) -> None:
    path = save(a_map("dark", small.active_shape), "electron/min")
    assert load_calibration_set(with_files(dark=path)).dark_e_s.max() == pytest.approx(0.75 / 60)


@pytest.mark.parametrize(
    ("kind", "unit", "expected"),
    [
        ("dark", None, "electron/s"),
        ("dark", "adu/s", "electron/s"),
        ("dark", "electron", "electron/s"),
        ("cic", None, "electron"),
        ("cic", "electron/s", "electron"),
        ("bias", None, "adu"),
        ("bias", "electron", "adu"),
        ("flat", "adu", "no unit"),
        ("bad_columns", "adu", "no unit"),
    ],
)
def test_units_are_checked(kind, unit, expected, small, with_files, save) -> None:
    path = save(a_map(kind, small.active_shape), unit)
    with pytest.raises(InputError, match=rf"calibration_files\.{kind} BUNIT = {unit or 'missing'}.*{expected}.*map"):
        load_calibration_set(with_files(**{kind: path}))


@pytest.mark.parametrize("kind", UNITS)
@pytest.mark.parametrize("value", [np.nan, np.inf, -0.5])
def test_bad_values_name_file_and_pixel(kind, value, small, with_files, save) -> None:
    data = a_map(kind, small.active_shape).astype(float)
    data[4, 9] = value
    path = save(data, UNITS[kind])
    with pytest.raises(InputError, match=rf"calibration_files\.{kind}\[y=4, x=9\] = {value}.*map\.fits"):
        load_calibration_set(with_files(**{kind: path}))


@pytest.mark.parametrize("shape", [(59, 60), (60, 61), (1050, 1080), (34, 45)])
def test_shapes_are_checked(shape, small, with_files, save) -> None:
    with pytest.raises(InputError, match=rf"calibration_files\.dark shape.*{shape[0]}.*\(60, 60\).*\(34, 44\).*map"):
        load_calibration_set(with_files(dark=save(np.ones(shape), "electron/s")))


def test_other_refusals(refused, small, with_files, save, tmp_path) -> None:
    shape = small.active_shape
    with pytest.raises(InputError, match=r"calibration_files\.flat mean = 30000.*divide it by its mean"):
        load_calibration_set(with_files(flat=save(np.full(shape, 3e4))))
    refused(r"calibration_files\.flat mean = 0", load_calibration_set, with_files(flat=save(np.zeros(shape))))
    with pytest.raises(InputError, match=r"calibration_files\.bad_columns\[y=0, x=0\] = 0\.5.*whole numbers"):
        load_calibration_set(with_files(bad_columns=save(np.full(shape, 0.5))))
    with pytest.raises(InputError, match=r"calibration_files\.bias\[y=0, x=0\] = 70000"):
        load_calibration_set(with_files(bias=save(np.full(shape, 7e4), "adu")))
    with pytest.raises(InputError, match=r"calibration_files\.bias median = 20000 ADU.*ADC maximum 16383.*map"):
        load_calibration_set(with_files(bias=save(np.full(shape, 2e4), "adu")))
    with pytest.raises(InputError, match=r"calibration_files\.dark.*two-dimensional"):
        load_calibration_set(with_files(dark=save(np.ones(44), "electron/s")))
    refused(r"calibration_files\.dark.*existing", load_calibration_set, with_files(dark=tmp_path / "absent.fits"))
    (tmp_path / "text.fits").write_text("no map")
    refused(r"calibration_files\.dark.*whole FITS", load_calibration_set, with_files(dark=tmp_path / "text.fits"))
    np.savez(tmp_path / "map.npz", dark=np.ones(shape))
    refused(r"calibration_files\.dark.*a FITS file", load_calibration_set, with_files(dark=tmp_path / "map.npz"))
    np.save(tmp_path / "object.npy", np.array([{}], dtype=object))
    refused(r"calibration_files\.dark", load_calibration_set, with_files(dark=tmp_path / "object.npy"))


def test_a_changed_file_is_read_again(small, with_files, save) -> None:
    path = save(np.full(small.active_shape, 0.5), "electron/s")
    detector = with_files(dark=path)
    assert load_calibration_set(detector).dark_e_s.max() == 0.5
    save(np.full(small.active_shape, 0.75), "electron/s")
    assert load_calibration_set(detector).dark_e_s.max() == 0.75


def test_round_trip(small, with_files, tmp_path) -> None:
    made = load_calibration_set(small)
    paths = write_calibration_set(made, tmp_path / "maps")
    assert sorted(path.name for path in (tmp_path / "maps").iterdir()) == sorted(f"{kind}.fits" for kind in UNITS)
    back = load_calibration_set(with_files(**paths))
    for name in ("response", "dark_e_s", "cic_e", "mask", "bad_column", "dead"):
        assert np.array_equal(getattr(made, name), getattr(back, name)), name
    assert back.bias_adu == pytest.approx(np.tile(small.bias_adu + made.stripe_adu, (small.n_rows, 1)))
    assert set(back.files) == set(UNITS)
    again = write_calibration_set(back, tmp_path / "again")
    for kind, path in paths.items():
        assert path.read_bytes() == again[kind].read_bytes()


def test_written_files_are_standard(small, tmp_path) -> None:
    paths = write_calibration_set(load_calibration_set(small), tmp_path)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for kind, path in paths.items():
            with fits.open(path, checksum=True) as hdus:
                hdus.verify("exception")
                assert hdus[0].header.get("BUNIT") == UNITS[kind]
                assert hdus[0].header["MAPKIND"] == kind


def test_files_are_not_overwritten_unasked(refused, small, tmp_path) -> None:
    made = load_calibration_set(small)
    (tmp_path / "cic.fits").write_text("mine")
    refused(r"cic\.fits", write_calibration_set, made, tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["cic.fits"]
    assert (tmp_path / "cic.fits").read_text() == "mine"
    write_calibration_set(made, tmp_path, overwrite=True)
    assert fits.getdata(tmp_path / "cic.fits").shape == (60, 60)


def test_nothing_is_left_of_a_failed_write(small, tmp_path, monkeypatch) -> None:
    from simulator.camera import calibration_set

    (tmp_path / "flat.fits").write_text("mine")
    real, calls = calibration_set.write_bytes, []

    def full_disk(path, data):
        calls.append(path)
        if len(calls) == 3:
            raise OSError("no space left")
        return real(path, data)

    monkeypatch.setattr(calibration_set, "write_bytes", full_disk)
    with pytest.raises(OSError, match="no space"):
        write_calibration_set(load_calibration_set(small), tmp_path, overwrite=True)
    assert [path.name for path in tmp_path.iterdir()] == ["flat.fits"]
    assert (tmp_path / "flat.fits").read_text() == "mine"


def test_files_beside_the_instrument_are_found(tmp_path, detector) -> None:
    hdu = fits.PrimaryHDU(np.full(detector.active_shape, 0.5, dtype=np.float32))
    hdu.header["BUNIT"] = "electron/s"
    hdu.writeto(tmp_path / "dark.fits")
    (tmp_path / "mine.yaml").write_text("kind: instrument\ndetector:\n  calibration_files: {dark: dark.fits}\n")
    changed = load_calibration_set(load_instrument(tmp_path / "mine.yaml").detector)
    assert changed.dark_e_s.max() == 0.5
    assert changed.files["dark"] == str(tmp_path / "dark.fits")
