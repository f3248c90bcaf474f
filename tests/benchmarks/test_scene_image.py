"""Scenes on 1024 x 1024 pixels and on a stamp: ours, the grid of 4 x 4 cells a pixel, and HCIPy source by source."""

import numpy as np
import pytest

from simulator.config import load_instrument
from simulator.imaging import build_imager, centred_axis
from simulator.imaging.scene_image import BandTransfer, PointSources, paper_scene_image, scene_image

IMAGER = build_imager(load_instrument(), "F520")
PIXEL = IMAGER.pixel_scale_arcsec


def random_sources(side, count):
    rng = np.random.default_rng(count)
    half = side / 2 * PIXEL
    return PointSources(*rng.uniform(-half, half, (2, count)), rng.uniform(0.5, 1.5, count))


def ours(side, sources):
    axis = centred_axis(side, PIXEL)
    return scene_image(
        BandTransfer(IMAGER), axis, axis, PIXEL, sources, mask_half_width_arcsec=IMAGER.mask_half_width_arcsec
    )


@pytest.mark.parametrize("side", [137, 1024])
@pytest.mark.parametrize("count", [1, 10, 100, 1000])
def test_ours(timed, side, count):
    sources = random_sources(side, count)
    image = timed(f"scene of {count} sources, {side} px", lambda: ours(side, sources), rounds=5)
    assert image.sum() > 0


def test_grid_of_cells(timed):
    axis, sources = centred_axis(1024, PIXEL), random_sources(1024, 1000)
    image = timed(
        "scene of 1000 sources, 1024 px: 4 x 4 cells",
        lambda: paper_scene_image(IMAGER, axis, axis, sources, kernel_half_pixels=256),
        rounds=1,
    )
    assert image.sum() > 0


def test_hcipy_source_by_source(timed):
    axis, sources = IMAGER.axis(centred_axis(1024, PIXEL), masked=True), random_sources(1024, 1)
    (x,), (y,), (flux,) = sources.arrays
    image = timed(
        "scene of 1 source, 1024 px: peer HCIPy",
        lambda: flux * IMAGER.image(axis, axis, source_arcsec=(x, y), engine="hcipy"),
        rounds=1,
    )
    exact = ours(1024, sources)
    assert np.abs(image - exact).max() < 1e-4 * exact.max()  # its three nodes a pixel
