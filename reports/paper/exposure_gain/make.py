"""Exposure time and EM gain: ``python -m tools.reports exposure_gain`` makes this report anew.

As in the paper (Zhu et al. 2025, figure of exposure time and EM gain): the example star at 30 and 300 s, gain 1 and 20,
with a bright source in the dark hole.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from astropy.stats import sigma_clip
from matplotlib import colormaps
from matplotlib.colors import AsinhNorm
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from numpy.typing import NDArray

from cpic_core import write_text
from cpic_planner.report import new_figure, style
from cpic_planner.report.drawing import RESIDUAL_COLOURS, STACK_COLOURS, save
from simulator import Observation, load_instrument, load_scene, observe
from simulator.camera import Frame
from simulator.config import Instrument, SceneStar
from tools.report_parts import Cells, columns, write_picture

HERE = Path(__file__).resolve().parent
BAND, EXPOSURES_S, GAINS = "F520", (30.0, 300.0), (1.0, 20.0)
PA_DEG, SEPARATION_ARCSEC = 135.0, 0.95
CONTRAST = 1e-6
# The paper's text counts position angles counter-clockwise on the detector, its figures show them mirrored.
FIGURE_PARITY = 1
LINEAR_ADU = 10.0
TICKS_ADU = (0, 10, 30, 100, 300, 1000, 3000, 10000)
MARK = colormaps[RESIDUAL_COLOURS](0.85)  # a red that the palette of the pictures holds

BoolArray = NDArray[np.bool_]
Setting = tuple[float, float]
SETTINGS: tuple[Setting, ...] = tuple((exposure, gain) for exposure in EXPOSURES_S for gain in GAINS)


@functools.cache
def instrument() -> Instrument:
    """The default instrument, mirrored as in the paper's figures."""
    return load_instrument({"detector": {"parity": FIGURE_PARITY}})


def sequence(setting: Setting, *, gain: float | None = None) -> Observation:
    """The example with a bright source beside its planet."""
    scene = load_scene("paper_example")
    star = SceneStar(
        name="source",
        v_mag=scene.cstar.v_mag - 2.5 * float(np.log10(CONTRAST)),
        spectral_type=scene.cstar.spectral_type,
        pa_deg=PA_DEG,
        separation_arcsec=SEPARATION_ARCSEC,
    )
    scene = scene.model_copy(update={"stars": (star,)})
    return observe(
        scene, band=BAND, exposure_s=setting[0], em_gain=gain or setting[1], n_frames=1, instrument=instrument()
    )


@dataclass(frozen=True, eq=False)
class Seen:
    """The first frame of a setting."""

    seen: Observation
    frame: Frame
    bloomed: BoolArray

    @functools.cached_property
    def tails(self) -> BoolArray:
        """Pixels that the register cut off or spilled into."""
        return self.frame.lost & ~self.bloomed

    def of_hole(self, image: NDArray[Any]) -> NDArray[Any]:
        """Pixels of the dark hole."""
        inside = self.seen.psf.metrics.hole
        rows, columns, part = self.seen.area.stamp(len(inside))
        return np.asarray(image[rows, columns][inside[part]])

    @functools.cached_property
    def noise_adu(self) -> float:
        """Scatter of the hole outside the tails, clipped at four sigma."""
        return float(sigma_clip(self.of_hole(self.frame.adu)[~self.of_hole(self.tails)], sigma=4.0, masked=False).std())

    @property
    def tail_in_hole(self) -> float:
        """Fraction of the hole that tails run through."""
        return float(self.of_hole(self.tails).mean())


def first_frame(setting: Setting) -> Seen:
    """Simulate one frame; at gain 1 the same charge shows which pixels the pixel full well cut off."""
    seen = sequence(setting)
    frame = seen.frame(0)
    plain = sequence(setting, gain=1.0).frame(0)
    assert plain.n_saturated_pixels == frame.n_saturated_pixels
    return Seen(seen, frame, plain.lost)


def longest_run(flags: BoolArray) -> int:
    """Longest run of set pixels along a row."""
    padded = np.pad(flags, ((0, 0), (1, 1))).astype(np.int8)
    edges = np.diff(padded, axis=1).ravel()
    lengths = np.flatnonzero(edges == -1) - np.flatnonzero(edges == 1)
    return int(lengths.max(initial=0))


def scaled() -> AsinhNorm:
    """Colour scale of all panels."""
    detector = instrument().detector
    return AsinhNorm(linear_width=LINEAR_ADU, vmin=-10.0, vmax=detector.adc_max_adu - detector.bias_adu)


def figure_of(images: dict[Setting, Seen]) -> Figure:
    """Four panels: a row an exposure, a column a gain."""
    figure, detector = new_figure(8.0), instrument().detector
    panels = figure.subplots(len(EXPOSURES_S), len(GAINS), sharex=True, sharey=True)
    for row, exposure in zip(panels, EXPOSURES_S, strict=True):
        for panel, gain in zip(row, GAINS, strict=True):
            one = images[exposure, gain]
            image = one.frame.adu - detector.bias_adu
            shown = panel.imshow(image, origin="lower", cmap=STACK_COLOURS, norm=scaled())
            place = one.seen.truth.x_pixel[2], one.seen.truth.y_pixel[2]
            panel.add_patch(Circle(place, 8, fill=False, ec=MARK, lw=1.0))
            panel.set_title(f"{exposure:g} s, gain {gain:g}")
    for panel in panels[:, 0]:
        panel.set_ylabel("row (px)")
    for panel in panels[-1]:
        panel.set_xlabel("column (px)")
    label = f"ADU above the bias level of {detector.bias_adu:g} (asinh scale, linear below {LINEAR_ADU:g})"
    bar = figure.colorbar(shown, ax=panels, label=label, shrink=0.85, aspect=30, extend="min")
    bar.set_ticks(TICKS_ADU, labels=[f"{tick:g}" for tick in TICKS_ADU])
    bar.minorticks_off()
    return figure


FRAMES: Cells = {
    "exposure (s)": "{0.seen.exposure_s:g}",
    "gain": "{0.seen.em_gain:g}",
    "median of the hole (ADU)": lambda one: f"{np.median(one.of_hole(one.frame.adu)):.0f}",
    "its noise (ADU)": "{0.noise_adu:.2f}",
    "its noise (e-)": lambda one: f"{one.noise_adu * instrument().detector.gain_e_adu / one.seen.em_gain:.1f}",
    "pixels at the pixel full well": "{0.frame.n_saturated_pixels}",
    "columns that bloom": lambda one: int(one.bloomed.any(axis=0).sum()),
    "pixels in register tails": "{0.frame.n_register_saturated}",
    "longest tail (px)": lambda one: longest_run(one.tails),
    "tails in the hole": "{0.tail_in_hole:.0%}",
    "clipped pixels": "{0.frame.n_clipped}",
    "brightest ADU": lambda one: int(one.frame.adu.max()),
    "particles": "{0.frame.n_cosmic_rays}",
}


def report(images: dict[Setting, Seen]) -> str:
    """Text of the report."""
    one = images[30.0, 1.0]
    star, detector = one.seen.truth.sources[0], one.seen.instrument.detector
    magnitude = load_scene("paper_example").cstar.v_mag - 2.5 * np.log10(CONTRAST)
    bright = images[300.0, 20.0]
    return f"""# Exposure time and EM gain

Regenerate with `python -m tools.reports exposure_gain`; everything below is written by it.

The paper's figure of exposure time and EM gain (Zhu et al. 2025): {star.name} in {BAND} with its planet at 30 and
300 s, gain 1 and 20, and a bright source added in the dark hole at position angle {PA_DEG:g} deg and
{SEPARATION_ARCSEC:g} arcsec. The paper does not give its brightness; here it has a contrast of {CONTRAST:.0e}
(V = {magnitude:.2f}, the spectrum of the star), twenty times that of the planet. Whole frames with every default effect
of the camera, particles included. `detector.parity` is +1, the orientation of the paper's figures: north up, this
source on the lower right.

![four whole frames](frames.png)

*Whole frames; red: the source.*

{columns(images.values(), FRAMES)}

*Noise of the hole*: standard deviation of its pixels outside tails, clipped at four sigma; fixed stripes are in it.
*Tails*: pixels that the register cut off, or into which its excess spilled.

## What is seen

The paper's words, and these frames:

- **30 s, gain 1: "dominated by detector noise", "only the brightest targets barely detectable".** So it is. The noise
  of the hole is {images[30.0, 1.0].noise_adu:.1f} ADU: stripes of {detector.bias_structure.stripe_rms_adu:g}, read
  noise of {detector.read_noise_e / detector.gain_e_adu:.1f}, interference of
  {detector.bias_structure.interference_adu / np.sqrt(2.0):.1f}. The eye does not find the source, and
  the planet is lost.
- **300 s, gain 1: "saturation and blooming in the brightest regions", "vertical streak artifacts".** So it is; but the
  streaks are short and come from the star's own light outside the hole, {images[300.0, 1.0].frame.n_saturated_pixels}
  pixels in {int(images[300.0, 1.0].bloomed.any(axis=0).sum())} columns. They end in the arms of the mask and do not
  reach the hole.
- **30 s, gain 20: "improving sensitivity to faint sources", "bright-source saturation artifacts become pronounced".**
  The first is so. The second is about to be: the brightest pixel has {images[30.0, 20.0].frame.adu.max()} ADU, and the
  register is full at {bright.frame.adu.max()}.
- **300 s, gain 20: "severe saturation and blooming effects dominate the image".** Around the hole they do:
  {bright.frame.n_register_saturated} pixels lie in tails, which run along the rows in the order of reading, up to
  {longest_run(bright.tails)} pixels far, and cover {bright.tail_in_hole:.0%} of the hole, on the side that is read
  first. The rest of the hole is usable.
"""


def main() -> None:
    """Simulate, draw, write."""
    images = {setting: first_frame(setting) for setting in SETTINGS}
    with style():
        write_picture(HERE, "frames", save(figure_of(images), "png", alt="", caption=""))
    write_text(HERE / "report.md", report(images))


if __name__ == "__main__":
    main()
