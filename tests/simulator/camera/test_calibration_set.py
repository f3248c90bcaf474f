from __future__ import annotations

import numpy as np
import pytest

from simulator.camera import MaskBit, load_calibration_set


@pytest.fixture(scope="module")
def default_set(detector):
    return load_calibration_set(detector)


def test_shapes_and_read_only(default_set, detector) -> None:
    frame = (detector.n_rows, detector.n_columns)
    for name in ("response", "dark_e_s", "dark_uniform_e_s", "cic_e", "mask"):
        array = getattr(default_set, name)
        assert array.shape == frame
        with pytest.raises(ValueError, match="read-only"):
            array[0, 0] = 1
    assert default_set.mask.dtype == np.uint8
    assert default_set.stripe_adu.shape == (detector.n_columns,)
    assert default_set.bias_adu is None
    assert dict(default_set.files) == {}


def test_response(default_set, detector) -> None:
    active = detector.sections["active"]
    outside = default_set.response.copy()
    outside[active] = 0
    assert (outside == 0).all()
    seen = default_set.response[active]
    assert default_set.sensitivity[active].mean() == pytest.approx(1, abs=1e-12)
    bad = seen == 0
    n_bad = round(detector.flaws.dead_fraction * seen.size) + detector.flaws.bad_columns * seen.shape[0]
    assert n_bad - 3 <= bad.sum() <= n_bad
    assert seen[~bad].std() == pytest.approx(detector.flaws.prnu_rms, rel=0.01)
    assert np.array_equal(bad, (default_set.mask[active] & MaskBit.BAD) != 0)


def test_dark_current(default_set, detector) -> None:
    parts, level = detector.sections, detector.dark_rate_e_s
    image = parts["image"]
    for name in ("prescan", "overscan_columns", "overscan_rows"):
        assert (default_set.dark_e_s[parts[name]] == 0).all()
    assert (default_set.dark_e_s[image] > 0).all()
    assert (default_set.dark_uniform_e_s[image] == level).all()
    plain = default_set.dark_smooth_e_s[image]
    assert abs(plain.mean() - level) < 4.5 * level * detector.flaws.dsnu_rms / np.sqrt(plain.size)
    assert plain.std() == pytest.approx(detector.flaws.dsnu_rms * level, rel=0.01)
    columns = default_set.bad_column[image]
    assert columns.all(axis=0).sum() == columns.any(axis=0).sum() == detector.flaws.bad_columns
    excess = (default_set.dark_e_s - default_set.dark_smooth_e_s)[image]
    assert excess[columns].min() == pytest.approx(detector.flaws.bad_column_e_s)
    hot = default_set.hot[image] & ~columns
    assert hot.sum() == pytest.approx(detector.flaws.hot_fraction * hot.size, abs=4)
    mean = level * (detector.flaws.hot_factor - 1)
    assert abs(excess[hot].mean() - mean) < 4.5 * mean / np.sqrt(hot.sum())
    assert (excess[~hot & ~columns] == 0).all()


def test_clock_charge_and_stripes(default_set, detector) -> None:
    parts = detector.sections
    rows = default_set.cic_e[:, parts["image"][1]]
    assert (rows == detector.cic_e).all()
    assert default_set.cic_e.sum() == pytest.approx(rows.sum())
    assert not default_set.cic_varies
    assert default_set.stripe_adu.mean() == pytest.approx(0, abs=1e-12)
    assert default_set.stripe_adu.std() == pytest.approx(detector.bias_structure.stripe_rms_adu, rel=0.1)


def test_varying_clock_charge(changed, detector) -> None:
    flaws = {**detector.flaws.model_dump(), "cic_rms": 0.5}
    varied = load_calibration_set(changed(flaws=flaws))
    rows = varied.cic_e[:, detector.sections["image"][1]]
    assert varied.cic_varies
    assert rows.mean() == pytest.approx(detector.cic_e, rel=0.01)
    assert rows.std() == pytest.approx(0.5 * detector.cic_e, rel=0.02)


def test_made_once(detector) -> None:
    first = load_calibration_set(detector)
    assert load_calibration_set(detector.model_copy()) is first


def test_one_flaw_leaves_the_numbers_of_the_others(detector, changed) -> None:
    base = load_calibration_set(detector)
    flaws = detector.flaws.model_dump()
    same = {
        "prnu_rms": ("dark_e_s", "cic_e", "stripe_adu", "dead", "hot", "bad_column"),
        "dsnu_rms": ("response", "cic_e", "stripe_adu", "dead", "hot", "bad_column"),
        "hot_fraction": ("response", "dark_smooth_e_s", "stripe_adu", "dead", "bad_column"),
        "dead_fraction": ("sensitivity", "dark_e_s", "stripe_adu", "hot", "bad_column"),
        "bad_columns": ("sensitivity", "dark_smooth_e_s", "stripe_adu", "hot"),
        "cic_rms": ("response", "dark_e_s", "stripe_adu"),
    }
    for key, names in same.items():
        other = load_calibration_set(changed(flaws={**flaws, key: 0}))
        for name in names:
            assert np.array_equal(getattr(base, name), getattr(other, name)), (key, name)
    # The noise itself is the same, only its size changes.
    wide = load_calibration_set(changed(flaws={**flaws, "prnu_rms": 0.02}))
    active = detector.sections["active"]
    one, two = base.sensitivity[active] - 1, wide.sensitivity[active] - 1
    assert np.corrcoef(one.ravel(), two.ravel())[0, 1] > 0.9999
    reseeded = load_calibration_set(changed(flaws={**flaws, "seed": 2}))
    correlation = np.corrcoef(one.ravel(), reseeded.sensitivity[active].ravel() - 1)[0, 1]
    assert abs(correlation) < 4.5 / np.sqrt(one.size)


def test_switches_take_their_flaw_away(default_set, detector) -> None:
    parts, level = detector.sections, detector.dark_rate_e_s
    active, image = parts["active"], parts["image"]

    def off(*names):
        return detector.switched(off=names).switches

    every = off()
    assert default_set.response_of(every) is default_set.response
    assert default_set.dark_of(every) is default_set.dark_e_s
    assert default_set.mask_of(every) is default_set.mask

    ideal = default_set.response_of(off("all"))
    assert (ideal[active] == 1).all()
    assert ideal.sum() == np.prod(detector.active_shape)
    no_dead = default_set.response_of(off("bad_pixels"))
    assert (no_dead[default_set.dead] > 0.5).all()
    assert (no_dead[default_set.bad_column & (default_set.sensitivity > 0)] == 0).all()
    no_columns = default_set.response_of(off("bad_columns"))
    assert (no_columns[default_set.dead] == 0).all()
    assert np.count_nonzero(no_columns[active] == 0) == default_set.dead.sum()
    assert set(np.unique(default_set.response_of(off("flat")))) == {0.0, 1.0}

    assert (default_set.dark_of(off("dark")) == 0).all()
    flat_dark = default_set.dark_of(off("dark_structure", "bad_pixels", "bad_columns"))
    assert np.array_equal(flat_dark, default_set.dark_uniform_e_s)
    smooth = default_set.dark_of(off("bad_pixels", "bad_columns"))
    assert np.array_equal(smooth, default_set.dark_smooth_e_s)
    columns_only = default_set.dark_of(off("dark_structure", "bad_pixels"))
    raised = columns_only > 1.01 * level
    assert np.array_equal(raised, default_set.bad_column)
    hot_only = default_set.dark_of(off("dark_structure", "bad_columns"))
    assert set(zip(*np.nonzero(hot_only[image] > 1.01 * level), strict=True)) <= set(
        zip(*np.nonzero(default_set.hot[image]), strict=True)
    )

    mask = default_set.mask_of(off("bad_columns"))
    assert (mask[default_set.bad_column] == MaskBit.GOOD).all()
    assert ((mask & MaskBit.BAD) != 0).sum() == default_set.dead.sum()
    mask = default_set.mask_of(off("dark"))
    assert set(np.unique(mask)) == {MaskBit.GOOD, MaskBit.BAD}
    mask = default_set.mask_of(off("bad_pixels"))
    assert not (mask[default_set.hot & ~default_set.bad_column]).any()
    assert (default_set.mask_of(off("all")) == 0).all()


def test_window(default_set) -> None:
    rows, columns = slice(500, 530), slice(520, 560)
    cut = default_set.window(rows, columns)
    assert cut.shape == (30, 40)
    assert np.array_equal(cut.response, default_set.response[rows, columns])
    assert np.array_equal(cut.stripe_adu, default_set.stripe_adu[columns])
    assert np.shares_memory(cut.dark_e_s, default_set.dark_e_s)
    assert not cut.mask.flags.writeable
    assert cut.window(slice(0, 30), slice(None)).shape == (30, 40)


@pytest.mark.parametrize(
    ("rows", "columns", "key"),
    [
        (slice(0, 1051), slice(0, 5), "window rows"),
        (slice(5, 5), slice(0, 5), "window rows"),
        (slice(-3, 5), slice(0, 5), "window rows"),
        (slice(0, 5), slice(0, 6, 2), "window columns"),
    ],
)
def test_window_refusals(refused, default_set, rows, columns, key) -> None:
    refused(key, default_set.window, rows, columns)


def test_more_bad_columns_than_columns(refused, changed, detector) -> None:
    small = changed(n_columns=80, star_column=40, flaws={**detector.flaws.model_dump(), "bad_columns": 100})
    refused(r"detector\.flaws\.bad_columns = 100.*at most the 24 active columns", load_calibration_set, small)


def test_what_is_switched_off_is_in_the_set_too(detector) -> None:
    """The same set serves all switches: a minute of tests, and 0.1 s of an image, went into making it again."""
    off = dict.fromkeys(type(detector.switches).model_fields, False)
    assert load_calibration_set(detector.with_switches(off)) is load_calibration_set(detector)
