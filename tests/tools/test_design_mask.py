import subprocess
import sys

import numpy as np
import pytest
import scipy.optimize

from cpic_core import InputError
from simulator.imaging.pupil import load_apodizer
from tools.design_mask import design_separable_mask, design_step_mask, main, mask_figures


def contrast(mask, u, v):
    n = len(mask)
    centre = (np.arange(n) - n / 2 + 0.5) / n
    rows, columns = (np.exp(-2j * np.pi * np.outer(w, centre)) * np.sinc(w / n)[:, None] for w in (u, v))
    return np.abs(rows @ mask @ columns.T / mask.sum()) ** 2


def test_shipped_mask_has_the_stated_figures():
    mask = load_apodizer("lpx43")
    figures = mask_figures(mask)
    assert figures["energy"] == pytest.approx(0.328, abs=0.001)
    assert figures["peak"] == pytest.approx(0.152, abs=0.001)
    assert figures["core"] == pytest.approx(0.141, abs=0.001)
    inner = 4.3 / np.sqrt(2)
    grid = np.arange(inner, 13.4, 0.083)  # between the control points
    dark = contrast(mask, grid, grid)
    assert dark.mean() < 5e-10
    assert np.quantile(dark, 0.95) < 1.2e-9
    assert dark.max() < 4e-9
    outside = contrast(mask, np.arange(inner, 30, 0.2), np.arange(13.5, 30, 0.2))
    assert outside.max() < 3e-5


def test_clear_disc_figures_are_the_airy_ones():
    n = 512
    position = (np.arange(n) - n / 2 + 0.5) / n
    figures = mask_figures((np.hypot(position[:, None], position) <= 0.5).astype(float))
    from scipy.special import j0, j1

    x = np.pi * 0.7
    assert figures["core"] == pytest.approx(1 - j0(x) ** 2 - j1(x) ** 2, abs=2e-3)  # 0.678
    assert figures["energy"] == pytest.approx(1, abs=1e-3)


def test_small_design_obeys_its_bounds_and_symmetry():
    mask = design_step_mask(
        n_steps=24,
        inner_lambda_d=4.5,
        contrast=1e-6,
        outer_half_side_lambda_d=7,
        outer_leak=1e-3,
        leak_extent_lambda_d=11,
    )
    assert mask.min() >= 0
    assert mask.max() <= 1
    for image in (mask.T, mask[::-1], mask[:, ::-1]):
        np.testing.assert_array_equal(mask, image)
    corner = np.abs(np.arange(24) - 11.5) + 0.5
    assert not mask[np.hypot(corner[:, None], corner) > 12].any()
    grid = np.linspace(4.5 / np.sqrt(2), 7, 60)
    assert contrast(mask, grid, grid).max() < 3e-6
    assert mask_figures(mask)["energy"] > 0.2


def test_design_keeps_to_the_part_that_a_mirror_covers(refused):
    mask = design_step_mask(
        n_steps=24,
        inner_lambda_d=4.5,
        contrast=1e-5,
        outer_half_side_lambda_d=7,
        outer_leak=1e-3,
        leak_extent_lambda_d=11,
        open_side_diameters=0.75,
    )
    assert not mask[:3].any()
    assert mask[3].any()
    grid = np.linspace(4.5 / np.sqrt(2), 7, 60)
    assert contrast(mask, grid, grid).max() < 3e-5
    refused("open_side_diameters", design_step_mask, open_side_diameters=1.2)


@pytest.mark.parametrize(("goal", "inner", "energy", "peak"), [(1e-8, 3.39, 0.178, 0.054), (1e-9, 3.70, 0.140, 0.039)])
def test_separable_mask_reaches_its_contrast_on_the_diagonals(goal, inner, energy, peak):
    mask = design_separable_mask(n_steps=68, inner_lambda_d=inner + 0.05, contrast=goal)
    np.testing.assert_array_equal(mask, mask.T)
    np.testing.assert_allclose(mask * mask[33, 33], np.outer(mask[33], mask[33]), atol=1e-12)  # a product of profiles
    grid = np.arange((inner + 0.05) / np.sqrt(2), 13.4, 0.013)
    assert contrast(mask, grid, grid).diagonal().max() < 1.1 * goal
    corner = np.abs(np.arange(68) - 33.5) + 0.5
    assert not mask[np.hypot(corner[:, None], corner) > 34].any()
    figures = mask_figures(mask)
    assert figures["energy"] == pytest.approx(energy, rel=0.25)  # of a design of 22 to 24 steps a half
    assert figures["peak"] == pytest.approx(peak, rel=0.25)


def test_no_separable_mask_goes_inside_the_limit_of_dolph():
    """Oracle: 2 acosh(R) / pi lambda/D on the diagonal of the inscribed square, R = contrast^(-1/4)."""
    limit = 2 * np.arccosh(1e-8**-0.25) / np.pi
    assert limit == pytest.approx(3.37, abs=0.01)
    with pytest.raises(InputError, match="no separable mask"):
        design_separable_mask(n_steps=256, inner_lambda_d=limit - 0.05, contrast=1e-8, outer_half_side_lambda_d=25)
    assert design_separable_mask(n_steps=256, inner_lambda_d=limit + 0.03, contrast=1e-8).any()


def test_impossible_and_bad_requests_are_refused(refused):
    with pytest.raises(InputError, match="no step mask"):
        design_step_mask(
            n_steps=16, inner_lambda_d=1.6, contrast=1e-9, outer_half_side_lambda_d=5, leak_extent_lambda_d=7
        )
    refused("n_steps", design_step_mask, n_steps=63)
    refused("inner_lambda_d", design_step_mask, inner_lambda_d=40)


@pytest.mark.long
def test_command_repeats_the_shipped_mask(tmp_path, capsys, monkeypatch, record_property):
    # By interior points the same problem takes a third of the time that the default takes, to the same optimum.
    solve = scipy.optimize.linprog
    monkeypatch.setattr("scipy.optimize.linprog", lambda *args, **more: solve(*args, **more | {"method": "highs-ipm"}))
    assert main(["--out", str(tmp_path / "mask.npz")]) == 0
    assert "energy 0.328" in capsys.readouterr().out
    # The optimum is degenerate at the level of single steps; what it achieves is not.
    again = mask_figures(load_apodizer(tmp_path / "mask.npz"))
    shipped = mask_figures(load_apodizer("lpx43"))["peak"]
    record_property("peak over that of the shipped mask, less 1", f"{again['peak'] / shipped - 1:.0e}")
    assert again["peak"] == pytest.approx(shipped, rel=1e-6)


def test_command_takes_every_requirement(refused, tmp_path, capsys):
    small = ["--n-steps", "24", "--inner-lambda-d", "4.5", "--contrast", "1e-5", "--outer-half-side-lambda-d", "7"]
    assert main(["--out", str(tmp_path / "a.npz"), *small, "--outer-leak", "1e-3"]) == 0
    assert main(["--out", str(tmp_path / "b.npz"), *small, "--separable"]) == 0
    energies = [mask_figures(load_apodizer(tmp_path / f"{name}.npz"))["energy"] for name in "ab"]
    assert energies[0] > energies[1]  # the inscribed square wastes a third of the aperture
    assert capsys.readouterr().out.count("energy") == 2
    refused("outer_leak", main, ["--out", str(tmp_path / "c.npz"), "--separable", "--outer-leak", "1e-4"])


@pytest.mark.parametrize("words", [["--n-steps", "7"], ["--contrast", "2"], ["--inner-lambda-d", "-1"]])
def test_nonsense_on_the_command_line_is_one_line(refused, tmp_path, words):
    done = subprocess.run(
        [sys.executable, "-m", "tools.design_mask", "--out", str(tmp_path / "m.npz"), *words],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 2
    assert len(done.stderr.strip().splitlines()) == 1
    assert list(tmp_path.iterdir()) == []
    refused("out", main, ["--out", str(tmp_path / "none" / "m.npz")])
