"""Regenerate this report: ``python reports/dark_hole/make.py`` (four to five minutes).

Dark holes of the shipped instruments behind static aberrations, one per band and seed, dug anew: how dark, at what
loss, and how long a search takes on one thread.
"""

from __future__ import annotations

import argparse
import base64
import csv
import io
import logging
import time
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.colors import LogNorm
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from cpic_core import write_bytes, write_text
from cpic_planner.report import style
from cpic_planner.report.drawing import BAND_STYLE, save
from simulator.config import Instrument, load_instrument
from simulator.imaging import HoleZone
from simulator.imaging.build import aberrations_of, bare_imager, configured_mirror, dark_hole_of, dig
from simulator.imaging.dark_hole import DarkHole, HoleResult
from simulator.imaging.imager import Imager
from simulator.imaging.pupil import Aberrations

HERE = Path(__file__).resolve().parent
SHOWN_SEED = 1
ASKED_CORNERS = {"F520": 0.19, "F662": 0.19, "F720": 0.19, "F850": 0.24}
AS_ASKED: dict[str, Any] = {"base": "cpic_2q", "coronagraph": {"inner_arcsec": ASKED_CORNERS}}
CASES: dict[str, dict[str, Any]] = {
    "4q": {"base": "cpic_default"},
    "2q": {"base": "cpic_2q"},
    "2q as asked, star free": AS_ASKED | {"dark_hole": {"hold_star": False}},
    "2q as asked, star held": AS_ASKED,
    "4q, single Jacobian": {"base": "cpic_single_jacobian"},
}
SEEDS = dict.fromkeys(CASES, range(1, 6)) | {"2q as asked, star held": range(SHOWN_SEED, SHOWN_SEED + 1)}
FOUR = {"F520": (2e-9, 1e-8), "F662": (1e-9, 3e-9), "F720": (1e-9, 3e-9), "F850": (1e-9, 3e-9)}
"""Mean and 95th percentile asked over the 10 % band in four quadrants."""
TWO_MEAN, STREHL_ASKED, CORE_ASKED, TIME_ASKED_S = 8e-9, 0.9, 0.12, 70.0
LEAST_STREHL = 0.2  # below it the brightest point need not be the star
FIELD_ARCSEC = 1.1
POINTS = 161

FloatArray = NDArray[np.float64]
Row = dict[str, Any]


def row(case: str, instrument: Instrument, hole: HoleResult) -> Row:
    """Numbers of one hole."""
    return {
        "case": case,
        "band": hole.band,
        "seed": instrument.wavefront.seed,
        "corner_arcsec": f"{hole.zone.inner_corner_arcsec:.3f}",
        "reached": isinstance(hole, DarkHole),
        "before_mean": f"{hole.before.mean:.3e}",
        "mean": f"{hole.wide.mean:.3e}",
        "p95": f"{hole.wide.p95:.3e}",
        "max": f"{hole.wide.max:.3e}",
        "own_mean": f"{hole.own.mean:.3e}",
        "own_p95": f"{hole.own.p95:.3e}",
        "own_max": f"{hole.own.max:.3e}",
        "strehl": f"{hole.wide.strehl:.4f}",
        "core_throughput": f"{hole.wide.core_throughput:.4f}",
        "star_moved_mas": star_moved_mas(instrument, hole),
        "commands_rms_nm": f"{hole.commands_rms_nm:.1f}",
        "iterations": len(hole.search.strong),
        "ended": hole.search.ended,
    }


def screens(instrument: Instrument, band: str, commands_nm: FloatArray | None) -> tuple[Imager, Aberrations, Any]:
    """Bare optics, aberrations on their grid, and what the mirror adds to the wavefront in nm."""
    imager, aberrations = bare_imager(instrument, band), aberrations_of(instrument)
    assert aberrations is not None
    samples = len(imager.transmission)
    opd_nm = 0.0 if commands_nm is None else configured_mirror(instrument).opd_nm(commands_nm, samples)
    return imager, aberrations.upsampled(samples), opd_nm


def star_moved_mas(instrument: Instrument, hole: HoleResult) -> str:
    """How far the mirror moves the peak of the unmasked image, at band centre, to 1 mas; a dash if little is left."""
    if hole.wide.strehl < LEAST_STREHL:
        return "-"
    imager, aberrations, opd_nm = screens(instrument, hole.band, hole.commands_nm)
    wavelength = instrument.band(hole.band).center_nm * 1e-9
    near = np.arange(-80, 81) * 1e-3
    matrix = imager.transform(near, wavelength)
    places = []
    for added in (0.0, opd_nm):
        light = np.abs(matrix @ aberrations.pupil(imager.transmission, wavelength, opd_nm=added) @ matrix.T)
        places.append(np.array(np.unravel_index(light.argmax(), light.shape)))
    return f"{np.hypot(*(places[1] - places[0])):.1f}"


def contrast_map(instrument: Instrument, band: str, commands_nm: FloatArray | None) -> FloatArray:
    """Intensity over the unmasked peak in the band's own width, without the focal-plane mask."""
    imager, aberrations, opd_nm = screens(instrument, band, commands_nm)
    places = np.linspace(-FIELD_ARCSEC, FIELD_ARCSEC, POINTS)
    light, peak = np.zeros((POINTS, POINTS)), 0.0
    for wavelength, weight in zip(imager.wavelengths_m, imager.weights, strict=True):
        pupil = aberrations.pupil(imager.transmission, float(wavelength), opd_nm=opd_nm)
        matrix = imager.transform(places, wavelength)
        origin = imager.transform(np.zeros(1), wavelength)[0]
        light += weight * np.abs(matrix @ pupil @ matrix.T) ** 2
        peak += weight * abs(origin @ pupil @ origin) ** 2
    return np.asarray(light / peak)


def picture(maps: list[tuple[str, dict[str, tuple[FloatArray, HoleZone]]]]) -> Figure:
    """Contrast in every band, a row a state, the controlled squares outlined."""
    figure = Figure(figsize=(11.0, 8.6), layout="constrained")
    panels = figure.subplots(len(maps), len(maps[0][1]), sharex=True, sharey=True, squeeze=False)
    extent = (-FIELD_ARCSEC, FIELD_ARCSEC, -FIELD_ARCSEC, FIELD_ARCSEC)
    for line, (what, images) in zip(panels, maps, strict=True):
        for panel, (band, (image, zone)) in zip(line, images.items(), strict=True):
            shown = panel.imshow(image, origin="lower", cmap="viridis", norm=LogNorm(1e-10, 1e-3), extent=extent)
            for low, high in zone.intervals()[1]:
                for bottom, top in zone.intervals()[0]:
                    panel.add_patch(Rectangle((low, bottom), high - low, top - bottom, fill=False, ec="white", lw=0.9))
            panel.set(title=band if what == maps[0][0] else "", xticks=(-1, 0, 1), yticks=(-1, 0, 1))
        line[0].set_ylabel(f"{what}\ny (arcsec)")
    for panel in panels[-1]:
        panel.set_xlabel("x (arcsec)")
    figure.colorbar(shown, ax=panels, label="raw contrast, focal-plane mask out", shrink=0.7, extend="both")
    return figure


def search_figure(holes: dict[tuple[str, str], HoleResult]) -> Figure:
    """Mean contrast at the control points after every iteration."""
    figure = Figure(figsize=(9.0, 3.8), layout="constrained")
    shown = ("4q", "2q", "4q, single Jacobian")
    for panel, case in zip(figure.subplots(1, len(shown), sharey=True), shown, strict=True):
        bands = [band for name, band in holes if name == case]
        for band, (colour, marker) in zip(bands, BAND_STYLE, strict=False):
            panel.plot(holes[case, band].search.history, color=colour, marker=marker, ms=3.5, lw=1.1, label=band)
        panel.set(title=case, yscale="log", xlabel="iteration", ylim=(3e-10, 1e-3))
        panel.grid(True)
    figure.axes[0].set_ylabel("mean at control points / flat peak")
    figure.axes[0].legend(loc="upper right")
    return figure


def spread(rows: list[Row], name: str, form: str) -> str:
    """Median and range over the seeds."""
    values = [float(entry[name]) for entry in rows if entry[name] != "-"]
    if not values:
        return "-"
    if len(values) == 1:
        return f"{values[0]:{form}}"
    return f"{np.median(values):{form}} [{min(values):{form}}, {max(values):{form}}]"


def limits(case: str, band: str) -> dict[str, float]:
    """What is asked: upper limits, and lower ones of Strehl and throughput."""
    if case == "4q":
        mean, p95 = FOUR[band]
        return {"mean": mean, "p95": p95, "strehl": STREHL_ASKED, "core_throughput": CORE_ASKED}
    return {"mean": TWO_MEAN} if case.startswith("2q as asked") else {}


def table(rows: list[Row], seconds: dict[tuple[str, str], list[float]], case: str) -> str:
    """Asked and got of one case."""
    heads = ["band", "corner (arcsec)", "mean asked", "mean", "95 % asked", "95 %", "max", "mean, own width"]
    heads += ["95 %, own width", "Strehl", "core throughput", "rest / hole", "star moved (mas)"]
    lines = [[*heads, "seeds that meet all", "time (s)"], ["---"] * (len(heads) + 2)]
    for band in dict.fromkeys(entry["band"] for entry in rows):
        own = [entry for entry in rows if (entry["case"], entry["band"]) == (case, band)]
        asked = limits(case, band)
        met = sum(
            all(
                float(entry[name]) >= limit if limit > 0.01 else float(entry[name]) <= limit
                for name, limit in asked.items()
            )
            for entry in own
        )
        gain = np.median([float(entry["before_mean"]) / float(entry["mean"]) for entry in own])
        cells = [band, own[0]["corner_arcsec"]]
        for name in ("mean", "p95"):
            cells += [f"{asked[name]:.0e}" if name in asked else "-", spread(own, name, ".1e")]
        cells += [spread(own, name, ".1e") for name in ("max", "own_mean", "own_p95")]
        cells += [spread(own, name, ".3f") for name in ("strehl", "core_throughput")]
        cells += [f"{gain:.0e}", spread(own, "star_moved_mas", ".0f"), f"{met} of {len(own)}" if asked else "-"]
        lines.append([*cells, f"{np.median(seconds[case, band]):.1f}"])
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def main() -> None:
    """Dig, tabulate, draw."""
    argparse.ArgumentParser(description=__doc__).parse_args()
    logging.getLogger("simulator.imaging").setLevel(logging.ERROR)
    with threadpool_limits(1):
        rows, seconds, shown = searches()
    text = io.StringIO()
    writer = csv.DictWriter(text, rows[0], lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    write_text(HERE / "holes.csv", text.getvalue())
    draw(shown)
    write_text(HERE / "report.md", report(rows, seconds, shipped_difference(shown)))
    print(HERE / "report.md")


def searches() -> tuple[list[Row], dict[tuple[str, str], list[float]], dict[tuple[str, str], HoleResult]]:
    """Numbers of every hole, seconds of every search, and the holes of the shown seed."""
    rows: list[Row] = []
    seconds: dict[tuple[str, str], list[float]] = {}
    shown: dict[tuple[str, str], HoleResult] = {}
    for case, change in CASES.items():
        for band in load_instrument(change).visible_bands():
            for seed in SEEDS[case]:
                instrument = load_instrument(change | {"wavefront": {"seed": seed}})
                began = time.process_time()
                hole, _ = dig(instrument, band)
                seconds.setdefault((case, band), []).append(time.process_time() - began)
                rows.append(row(case, instrument, hole))
                print(case, band, seed, f"mean {hole.wide.mean:.2e}", flush=True)
                if seed == SHOWN_SEED:
                    shown[case, band] = hole
    return rows, seconds, shown


def draw(shown: dict[tuple[str, str], HoleResult]) -> None:
    """Both figures."""
    default, two = load_instrument(), load_instrument("cpic_2q")
    bands = default.visible_bands()
    maps = [("mirror at rest", {b: (contrast_map(default, b, None), shown["4q", b].zone) for b in bands})]
    for case, own in (("4q", default), ("2q", two)):
        held = {band: shown[case, band] for band in bands}
        maps.append((case, {b: (contrast_map(own, b, hole.commands_nm), hole.zone) for b, hole in held.items()}))
    with style():
        # The palette of the report's image panels: a third of the size.
        uri = save(picture(maps), "png", alt="", caption="").uri
        write_bytes(HERE / "holes.png", base64.b64decode(uri.partition(",")[2]))
        image = io.BytesIO()
        search_figure(shown).savefig(image, format="png", dpi=130, metadata={"Software": None})
        write_bytes(HERE / "search.png", image.getvalue())


def shipped_difference(shown: dict[tuple[str, str], HoleResult]) -> float:
    """Largest relative difference of the mean contrast from the states that the package ships."""
    return max(
        abs(dark_hole_of(load_instrument(CASES[case]), band).wide.mean / hole.wide.mean - 1.0)
        for (case, band), hole in shown.items()
        if "asked" not in case
    )


def report(rows: list[Row], seconds: dict[tuple[str, str], list[float]], difference: float) -> str:
    """Text of the report."""
    tables = {case: table(rows, seconds, case) for case in CASES}
    longest = max(max(times) for times in seconds.values())
    brightest = {
        band: max(float(entry["max"]) for entry in rows if (entry["case"], entry["band"]) == ("4q", band))
        for band in FOUR
    }
    same = "are the same" if difference < 1e-3 else f"differ by up to {difference:.0e} in mean contrast"
    return f"""# Dark holes

Regenerate with `python reports/dark_hole/make.py`; everything below is written by it.

Electric-field conjugation behind 20 nm rms of f^-2.5 wavefront error and 0.3 % of amplitude error, with 32 x 32
actuators over 0.875 diameters of the pupil (all assumed). Contrast over the dark squares (from the diagonal corner
given to 0.707 arcsec per axis) on a 0.25 lambda/D grid that the search does not use: over a 10 % band with a flat
spectrum at eight wavelengths that the search does not use either, and in the band's own width with the Sun's photon
spectrum. Median [lowest, highest] of five seeds of the aberrations; *rest / hole*: how much darker than with the mirror
at rest.

Images and exposure times use the state of seed {SHOWN_SEED} of each band, which the package ships; the ones dug here
{same}.
The search sees neither pointing jitter nor the converter of the mirror; images and their metrics hold both
(`reports/psf_chromaticity`). It knows the field perfectly, which is optimistic.

## Four quadrants (`cpic_default`)

Also asked: Strehl >= {STREHL_ASKED}, core throughput >= {CORE_ASKED}.

{tables["4q"]}

## Two quadrants (`cpic_2q`)

One side of the star only, behind a milder apodizer, from 3.1 lambda/D (3.5 in F520).

{tables["2q"]}

Asked was a mean of at most {TWO_MEAN:.0e} from 0.19 arcsec in F520, F662 and F720 and from 0.24 arcsec in F850. It is
reached if the mirror may tip and tilt (`dark_hole.hold_star: false`). But then it pushes the star away from the dark
side, and the hole, which is fixed to the mask, begins farther from the star than the corner says.

{tables["2q as asked, star free"]}

With the star held on the mask, as a tip-tilt loop does and as the shipped states have it, F520 reaches it and the other
bands do not: they would also lose most of their light. Hence the corners of `cpic_2q`. Seed {SHOWN_SEED}:

{tables["2q as asked, star held"]}

## One Jacobian, of the design (`cpic_single_jacobian`)

The less ideal state of the four quadrants: the Jacobian is that of the mirror at rest in the design without
aberrations, and stays so. Nothing is asked of it.

{tables["4q, single Jacobian"]}

## Time

Median processor time of a search on one thread, asked at most {TIME_ASKED_S:.0f} s; the longest of all {len(rows)}
took {longest:.0f} s.

![raw contrast with the mirror at rest and in the holes, seed {SHOWN_SEED}](holes.png)

*Raw contrast without the focal-plane mask, seed {SHOWN_SEED}, own width; squares: controlled zone. Mirror at rest:
behind the apodizer of the four quadrants.*

![mean contrast against iteration](search.png)

*The searches of seed {SHOWN_SEED}. Every fifth step is a strong one and may brighten the hole; the darkest state met is
kept.*

An inner edge of 0.19 arcsec at 1e-8 in four quadrants is not physical for this aperture: the squares begin at
4.3 lambda/D on the diagonal (`reports/psf_chromaticity` has the wall). Single points on the edge of the zone stay
brighter than 1e-8: the brightest of all seeds in four quadrants have
{", ".join(f"{value:.1e} in {band}" for band, value in brightest.items())}.

Every hole is in `holes.csv`.
"""


if __name__ == "__main__":
    main()
