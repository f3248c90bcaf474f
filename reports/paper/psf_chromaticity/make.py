"""Regenerate this report: ``python -m tools.reports psf_chromaticity``.

The masked star in every band, as in the paper (Zhu et al. 2025, section "PSF chromaticity"): maps and profiles along
the diagonals with the dark hole, with the mirror at rest, and with a flat wavefront; what the holes hold; and what the
apodizer alone could reach.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from matplotlib.ticker import MultipleLocator
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits
from wall import wall_table

from cpic_core import write_bytes, write_text
from cpic_planner.report import style
from cpic_planner.report.drawing import save
from simulator.config import load_instrument
from simulator.imaging import HoleZone, single_band_psf
from simulator.imaging.build import dark_hole_of
from simulator.imaging.dark_hole import HoleScore
from simulator.imaging.measure import stamp_figures, strehl
from tools import report_parts

HERE = Path(__file__).resolve().parent
REST: dict[str, Any] = {"dark_hole": {"control": "off"}}
IDEAL: dict[str, Any] = REST | {"wavefront": {"opd_rms_nm": 0, "amplitude_rms": 0}}
# Okabe-Ito colours; with and without the hole as in the paper's figure.
STYLES = {"hole": ("#E69F00", "-"), "rest": ("#0072B2", "-"), "ideal": ("#000000", "--")}
LABELS = {"hole": "dark hole", "rest": "mirror at rest", "ideal": "flat wavefront"}
CLAIM_ARCSEC, CLAIM = 0.19, 1e-8

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Star:
    """The masked star of one band in one state, and its figures."""

    preset: str
    case: str
    band: str
    zone: HoleZone
    pixel_arcsec: float
    mask_arcsec: float
    lambda_d_arcsec: float
    contrast: FloatArray
    iwa_arcsec: float
    strehl: float
    core: float
    wide: HoleScore | None

    @property
    def offsets(self) -> FloatArray:
        """Pixel centres in arcsec."""
        return np.asarray((np.arange(len(self.contrast)) - len(self.contrast) // 2) * self.pixel_arcsec)

    @property
    def hole(self) -> FloatArray:
        """Raw contrast of the pixels whose centres lie in the zone."""
        return self.contrast[self.zone.covers(self.offsets, self.offsets)]

    def diagonals(self) -> dict[tuple[int, int], FloatArray]:
        """Raw contrast along the four diagonals, pixel by pixel; NaN behind the mask. Keys: signs of x and y."""
        steps, middle = np.arange(len(self.contrast) // 2 + 1), len(self.contrast) // 2
        lines = {(x, y): self.contrast[middle + y * steps, middle + x * steps] for x in (1, -1) for y in (1, -1)}
        return {signs: np.where(line > 0, line, np.nan) for signs, line in lines.items()}

    @property
    def separations(self) -> FloatArray:
        """Separations along a diagonal, arcsec."""
        return np.asarray(np.arange(len(self.contrast) // 2 + 1) * self.pixel_arcsec * math.sqrt(2.0))


def star(preset: str, case: str, change: Mapping[str, Any], band: str) -> Star:
    """Image and figures of one band."""
    instrument = load_instrument({"base": preset, **change})
    psf = single_band_psf(band, instrument=instrument)
    figures = stamp_figures(psf.imager, psf.on_axis, psf.off_axis)
    return Star(
        preset=preset,
        case=case,
        band=band,
        zone=psf.imager.zone,
        pixel_arcsec=psf.pixel_scale_arcsec,
        mask_arcsec=psf.imager.mask_half_width_arcsec,
        lambda_d_arcsec=psf.imager.lambda_d_arcsec,
        contrast=np.asarray(figures["raw_contrast"]),
        iwa_arcsec=float(str(figures["iwa_arcsec"])),
        strehl=strehl(psf.imager),
        core=float(str(figures["core_open"])),
        wide=dark_hole_of(instrument, band).wide if case == "hole" else None,
    )


def draw_map(panel: Axes, one: Star, reach: float) -> Any:
    """One map: zone in white, cross in grey."""
    half = one.offsets[-1] + one.pixel_arcsec / 2
    image = np.ma.masked_less_equal(one.contrast, 0.0)
    panel.set_facecolor("#777777")
    shown = panel.imshow(
        image, origin="lower", cmap="viridis", norm=LogNorm(1e-10, 1e-3), extent=(-half, half, -half, half)
    )
    for low, high in one.zone.intervals()[1]:
        for bottom, top in one.zone.intervals()[0]:
            panel.add_patch(Rectangle((low, bottom), high - low, top - bottom, fill=False, ec="white", lw=1.0))
    w = one.mask_arcsec
    for x in (-w, w):
        for y in (-w, w):
            panel.plot([x, x, math.copysign(half, x)], [math.copysign(half, y), y, y], color="black", lw=0.8)
    ticks = (-math.floor(reach), 0, math.floor(reach))
    panel.set(xlim=(-reach, reach), ylim=(-reach, reach), xticks=ticks, yticks=ticks, xlabel="x (arcsec)")
    return shown


def maps_figure(lines: Mapping[str, list[Star]]) -> Figure:
    """Maps: a row a state, a column a band."""
    figure = Figure(figsize=(11.0, 8.6), layout="constrained")
    panels = figure.subplots(len(lines), len(next(iter(lines.values()))), sharex=True, sharey=True)
    for row, (what, stars) in zip(panels, lines.items(), strict=True):
        for panel, one in zip(row, stars, strict=True):
            shown = draw_map(panel, one, 1.1)
            panel.label_outer()
        row[0].set_ylabel(f"{what}\ny (arcsec)")
    for panel, one in zip(panels[0], stars, strict=True):
        panel.set_title(one.band)
    figure.colorbar(shown, ax=panels, label="raw contrast", shrink=0.6, extend="both")
    return figure


def profile_panel(panel: Axes, curves: list[tuple[Star, list[tuple[int, int]], str, str, str]]) -> None:
    """Mean over some diagonals and their range, per state; lambda/D on top."""
    for one, signs, label, colour, dash in curves:
        lines = np.array([one.diagonals()[which] for which in signs])
        seen = np.isfinite(lines).all(axis=0)
        x, lines = one.separations[seen], lines[:, seen]
        panel.plot(x, lines.mean(axis=0), color=colour, ls=dash, lw=1.3, label=label)
        panel.fill_between(x, lines.min(axis=0), lines.max(axis=0), color=colour, alpha=0.25, lw=0)
    one = curves[0][0]
    inner, outer = one.zone.inner_corner_arcsec, one.zone.outer_arcsec * math.sqrt(2.0)
    panel.axvspan(inner, outer, color="#999999", alpha=0.15, lw=0)
    panel.axhline(CLAIM, color="#444444", lw=0.8, ls=":")
    panel.set(yscale="log", xlim=(0, 1.05 * outer), ylim=(1e-11, 1e-2))
    panel.text(0.03, 0.04, f"{one.band}\nfrom {inner:.3f}″", transform=panel.transAxes)
    panel.grid(True)
    scale = one.lambda_d_arcsec
    top = panel.secondary_xaxis("top", functions=(lambda x: x / scale, lambda x: x * scale))
    top.xaxis.set_major_locator(MultipleLocator(5))
    top.xaxis.set_minor_locator(MultipleLocator(1))
    top.set_xlabel("separation (λ/D)")
    panel.set_xlabel("separation (arcsec)")


def profiles_figure(stars: Mapping[str, list[Star]]) -> Figure:
    """Four quadrants: mean of the four diagonals in each state."""
    figure = Figure(figsize=(9.5, 8.0), layout="constrained")
    panels = figure.subplots(2, 2, sharey=True)
    for index, panel in enumerate(panels.ravel()):
        profile_panel(
            panel,
            [
                (stars[case][index], list(stars[case][index].diagonals()), LABELS[case], *STYLES[case])
                for case in ("rest", "hole", "ideal")
            ],
        )
    for panel in panels[:, 0]:
        panel.set_ylabel("raw contrast")
    panels[0, 0].legend(loc="upper right")
    return figure


def holes_figure(stars: list[Star], reach: float) -> Figure:
    """Maps on top, profiles below: of the dark and of the other side of a one-sided hole."""
    figure = Figure(figsize=(11.0, 6.4), layout="constrained")
    panels = figure.subplots(2, len(stars), height_ratios=(1.0, 1.1), sharey="row")
    for (above, below), one in zip(panels.T, stars, strict=True):
        shown = draw_map(above, one, reach)
        above.set_title(one.band)
        sides = {"dark hole": (1, -1)} if one.zone.mode == "4q" else {"dark side": (1,), "other side": (-1,)}
        profile_panel(
            below,
            [
                (one, [(x, y) for x in signs for y in (1, -1)], label, *colour)
                for (label, signs), colour in zip(sides.items(), STYLES.values(), strict=False)
            ],
        )
    panels[0, 0].set_ylabel("y (arcsec)")
    panels[1, 0].set_ylabel("raw contrast")
    panels[1, 0].legend(loc="upper right")
    figure.colorbar(shown, ax=panels[0], label="raw contrast", extend="both")
    return figure


def table(stars: list[Star], *, geometry: bool = False) -> str:
    """Figures of the holes; with the pixel and the outer edge of the hole if asked."""
    heads = ["instrument", "state", "band", *(["pixel (arcsec)", "outer edge per axis (arcsec)"] if geometry else [])]
    heads += ["corner (arcsec)", "IWA (arcsec)", "own width: mean", "95 %", "max", "10 % band: mean", "95 %", "max"]
    rows = []
    for one in stars:
        row = [f"`{one.preset}`", LABELS[one.case], one.band]
        row += [f"{one.pixel_arcsec:.4f}", f"{one.zone.outer_arcsec:.3f}"] if geometry else []
        row += [f"{one.zone.inner_corner_arcsec:.3f}", f"{one.iwa_arcsec:.3f}"]
        row += [f"{value:.1e}" for value in (one.hole.mean(), np.percentile(one.hole, 95), one.hole.max())]
        row += ["-"] * 3 if one.wide is None else [f"{v:.1e}" for v in (one.wide.mean, one.wide.p95, one.wide.max)]
        rows.append([*row, f"{one.strehl:.3f}", f"{one.core:.3f}"])
    return report_parts.table([*heads, "Strehl", "core throughput"], rows)


def report(four: Mapping[str, list[Star]], two: list[Star], single: list[Star], infrared: list[Star]) -> str:
    """Text of the report."""
    default = load_instrument()
    claim = ", ".join(f"{CLAIM_ARCSEC / default.lambda_d_arcsec(b):.2f} in {b}" for b in default.visible_bands())
    means = [one.wide.mean for one in four["hole"] if one.wide is not None]
    per_band = ", ".join(f"{mean:.1e} in {one.band}" for mean, one in zip(means, four["hole"], strict=True))
    sided = [one.wide.mean for one in two if one.wide is not None]
    corners = ", ".join(f"{one.zone.inner_corner_arcsec:.2f} in {one.band}" for one in two)
    core = np.mean([one.core for one in two]) / np.mean([one.core for one in four["hole"]])
    return f"""# PSF chromaticity

Regenerate with `python -m tools.reports psf_chromaticity`; everything below is written by it.

The star behind apodizer, mirror and cross mask (Zhu et al. 2025, section "PSF chromaticity"), pixel by pixel over the
peak pixel of the unmasked star: 20 nm rms of wavefront error and 0.3 % of amplitude error (seed 1), 5 mas of jitter
per axis, the band's own width under the Sun's spectrum. Of the optics only the aperture, the pixel and the band
centres are published; the rest is assumed.

## Four quadrants (`cpic_default`)

![maps of the masked star in four bands](maps_4q.png)

*White: the squares that the mirror darkens. Grey: the cross mask. Top to bottom: dark hole; same aberrations, mirror
at rest; flat wavefront, that is the apodizer's own darkness.*

![profiles along the diagonals in four bands](profiles_4q.png)

*Lines: mean of the four diagonals; coloured areas: their range. Grey: the hole, inner to outer corner. Dotted:
{CLAIM:.0e}. The curves begin where the mask ends.*

## Two quadrants (`cpic_2q`)

![maps and profiles of the one-sided hole](one_sided_2q.png)

*The mirror darkens the right-hand side. Mean and range of the two diagonals on either side.*

## Figures

*Corner*: inner corner of the hole. *IWA*: diagonal separation where the core throughput is half its maximum, far from
the mask; the mask sets it, and the hole may begin farther out. *Own width*: the pixels of the image in the hole,
jitter and the mirror's 16 bits included. *10 % band*: flat spectrum, points 0.25 lambda/D apart, without jitter and
bits. Strehl and core throughput include the jitter.

{table([*four["hole"], *four["rest"], *four["ideal"], *two, *single])}

## What the paper says, and what can be had

**{CLAIM:.0e} from {CLAIM_ARCSEC} arcsec in four quadrants, in all four bands, is not physical for this aperture.**
{CLAIM_ARCSEC} arcsec, in lambda/D of the clear 2 m disc, are {claim}.
The table gives the largest on-axis peak, relative to the clear disc, of any step mask that is {CLAIM:.0e} dark in four
quadrants from a corner on (linear programme; nothing is asked outside the quadrants, which end at 15 lambda/D on the
diagonal), and of any pupil whatever, that is for masks, mirrors and both together, at one wavelength:

{wall_table(CLAIM)}

The wall for an amplitude apodizer stands at 3.1 lambda/D, that for a pupil with phase at 2.9: {CLAIM_ARCSEC} arcsec in
F662, F720 and F850 lie inside both. In F520 alone the claim is possible, behind a mask of less throughput than ours.
What is offered instead:

- `cpic_default`: four quadrants from 4.3 lambda/D, at most {max(means):.1e} in the mean;
- `cpic_2q`: two quadrants from closer in, at most {max(sided):.1e} in the mean, for half the azimuths and {core:.0%}
  of the core throughput; corners, in arcsec: {corners};
- `cpic_single_jacobian`: four quadrants at about 2e-8. The other two assume that the field in the hole is known
  perfectly at every step, which is optimistic; this one uses the Jacobian of the design throughout.

**"Most effective near 662 nm".** With one state of the mirror a band, the depth is about the same in every band:
{per_band}.
In F520 the outer edge lies 13 lambda/D from the star per axis, where the mirror's reach ends. Set once, for F662, the
mirror is best in F662: the paper's statement fits a mirror that is set once.

## Near-infrared (assumed)

The near-infrared camera is not public: pixel scale, cross (0.28 arcsec half width) and edges of the holes are
assumed. The holes are dug like the visible ones; no camera reads them yet.

{table(infrared, geometry=True)}

![maps and profiles in the near-infrared](near_infrared.png)
"""


def main() -> None:
    """Compute, draw, write."""
    logging.getLogger("simulator.imaging").setLevel(logging.ERROR)
    with threadpool_limits(1):
        default = load_instrument()
        bands = default.visible_bands()
        longer = sorted(set(default.bands) - set(bands), key=lambda band: default.band(band).center_nm)
        changes = {"hole": {}, "rest": REST, "ideal": IDEAL}
        four = {case: [star("cpic_default", case, change, band) for band in bands] for case, change in changes.items()}
        two, single = (
            [star(preset, "hole", {}, band) for band in bands] for preset in ("cpic_2q", "cpic_single_jacobian")
        )
        infrared = [star("cpic_default", "hole", {}, band) for band in longer]
        write_text(HERE / "report.md", report(four, two, single, infrared))
    with style():
        maps = maps_figure({LABELS[case]: stars for case, stars in four.items()})
        report_parts.write_picture(HERE, "maps_4q", save(maps, "png", alt="", caption=""))
        write_bytes(HERE / "profiles_4q.png", report_parts.png(profiles_figure(four)))
        write_bytes(HERE / "one_sided_2q.png", report_parts.png(holes_figure(two, 1.1)))
        write_bytes(HERE / "near_infrared.png", report_parts.png(holes_figure(infrared, 2.0)))
    print(HERE / "report.md")


if __name__ == "__main__":
    main()
