"""Scenes on 1024 x 1024 pixels and on a stamp: ours, the grid of 4 x 4 cells a pixel, and HCIPy source by source.

``make bench`` prints the times and their ratios. There is no limit on the clock here: machines differ.
"""

from collections.abc import Iterator

import numpy as np
import pytest

from simulator.config import load_instrument
from simulator.imaging.build import build_imager
from simulator.imaging.imager import centred_axis
from simulator.imaging.paper_scene import paper_scene_image
from simulator.imaging.scene_image import PointSources, scene_image
from simulator.imaging.transfer import band_transfer

IMAGER = build_imager(load_instrument(), "F520")
PIXEL = IMAGER.pixel_scale_arcsec
MEDIANS: dict[tuple[str, int, int], float] = {}


def random_sources(side, count):
    rng = np.random.default_rng(count)
    half = side / 2 * PIXEL
    return PointSources(*rng.uniform(-half, half, (2, count)), rng.uniform(0.5, 1.5, count))


@pytest.fixture(scope="module", autouse=True)
def ratios(printed) -> Iterator[None]:
    yield
    with printed() as line:
        line("\nscenes in F520, median seconds and how many times longer than ours")
        for (name, side, count), seconds in MEDIANS.items():
            ours = MEDIANS.get(("ours", side, count))
            ratio = f"{seconds / ours:8.1f} x" if ours else ""
            line(f"  {name:28s} {side:5d} px {count:5d} sources {seconds:9.4f} s {ratio}")


@pytest.mark.parametrize("side", [137, 1024])
@pytest.mark.parametrize("count", [1, 10, 100, 1000])
def test_ours(benchmark, side, count):
    axis, transfer, sources = centred_axis(side, PIXEL), band_transfer(IMAGER), random_sources(side, count)
    image = benchmark.pedantic(
        lambda: scene_image(transfer, axis, axis, PIXEL, sources, mask_half_width_arcsec=0.155),
        rounds=3, warmup_rounds=1,
    )  # fmt: skip
    MEDIANS["ours", side, count] = benchmark.stats.stats.median
    assert image.sum() > 0


@pytest.mark.parametrize("side", [137, 1024])
@pytest.mark.parametrize("count", [1, 1000])
def test_grid_of_cells(benchmark, side, count):
    axis, sources = centred_axis(side, PIXEL), random_sources(side, count)
    half = min(side // 2, 256)
    image = benchmark.pedantic(
        lambda: paper_scene_image(IMAGER, axis, axis, sources, kernel_half_pixels=half), rounds=1, warmup_rounds=0
    )
    MEDIANS["4 x 4 cells", side, count] = benchmark.stats.stats.median
    assert image.sum() > 0


@pytest.mark.parametrize(("side", "count"), [(137, 1), (137, 10), (1024, 1)])
def test_hcipy_source_by_source(benchmark, side, count):
    centres = centred_axis(side, PIXEL)
    axis, sources = IMAGER.axis(centres, masked=True), random_sources(side, count)

    def image():
        return sum(
            flux * IMAGER.image(axis, axis, source_arcsec=(x, y), engine="hcipy")
            for x, y, flux in zip(*sources.arrays, strict=True)
        )

    propagated = benchmark.pedantic(image, rounds=1, warmup_rounds=0)
    MEDIANS["HCIPy, each source", side, count] = benchmark.stats.stats.median
    ours = scene_image(
        band_transfer(IMAGER), centres, centres, PIXEL, sources, mask_half_width_arcsec=IMAGER.mask_half_width_arcsec
    )
    assert np.abs(propagated - ours).max() < 1e-4 * ours.max()  # its three nodes a pixel
