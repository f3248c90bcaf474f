"""Recovered contrasts on the spectrum that went into the images."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from cpic_planner.models import BandConfirmation
from cpic_planner.report.drawing import BAND_STYLE, Picture, literal, new_figure, save, style
from simulator.config import Instrument, Scene
from simulator.target.planet_light import LitPlanet
from simulator.target.sources import spectrum_generator

_MARGIN_NM = 40.0
_SHIFT_NM = 4.0
_LOG_SPAN = 5.0


def spectrum_figure(scene: Scene, instrument: Instrument, bands: Sequence[BandConfirmation]) -> Picture | None:
    """Draw what was measured of every planet on its contrast as a function of wavelength.

    Parameters
    ----------
    scene : Scene
    instrument : Instrument
        Its bands place the points.
    bands : sequence of BandConfirmation
        Those without a measurement are passed over.

    Returns
    -------
    Picture or None
        None where nothing was measured.
    """
    seen = [item for item in bands if item.recovered_contrast is not None]
    lights = {row.name: row.light for row in spectrum_generator(scene) if isinstance(row.light, LitPlanet)}
    names = [planet.name for planet in scene.planets if any(item.planet == planet.name for item in seen)]
    if not names:
        return None
    edges = [instrument.bands[item.band] for item in seen]
    low = min(band.center_nm - 0.5 * band.width_nm for band in edges) - _MARGIN_NM
    high = max(band.center_nm + 0.5 * band.width_nm for band in edges) + _MARGIN_NM
    with style():
        figure = new_figure(4.2)
        axes = figure.add_subplot()
        axes.grid(visible=True)
        axes.set(xlabel="wavelength (nm)", ylabel="contrast (planet over star)", xlim=(low, high))
        heights: list[float] = []
        for number, name in enumerate(names):
            light, (colour, marker) = lights[name], BAND_STYLE[number % len(BAND_STYLE)]
            inside = (light.wavelength_nm >= low) & (light.wavelength_nm <= high)
            axes.plot(
                light.wavelength_nm[inside],
                light.contrast[inside],
                color=colour,
                lw=1.0,
                alpha=0.55,
                label=literal(f"{name}: input"),
            )
            own = [item for item in seen if item.planet == name]
            centre = np.array([instrument.bands[item.band].center_nm for item in own])
            half = np.array([0.5 * instrument.bands[item.band].width_nm for item in own])
            true, value, error, mean = (
                np.array([getattr(item, key) or 0.0 for item in own])
                for key in ("true_contrast", "recovered_contrast", "contrast_error", "contrast_mean_error")
            )
            axes.hlines(
                true,
                centre - half,
                centre + half,
                color="#222222",
                lw=2.0,
                zorder=3,
                label="input in the band" if number == 0 else "",
            )
            place = centre + _SHIFT_NM * (number - 0.5 * (len(names) - 1))
            axes.errorbar(place, value, yerr=error, fmt="none", ecolor=colour, elinewidth=1.1, capsize=4.0, zorder=4)
            axes.errorbar(
                place,
                value,
                yerr=mean,
                fmt=marker,
                color=colour,
                ms=7,
                mec="white",
                mew=0.6,
                elinewidth=3.2,
                zorder=5,
                label=literal(f"{name}: recovered"),
            )
            heights += [*(value + error), *(value - error), *true]
        if min(heights) > 0 and max(heights) > _LOG_SPAN * min(heights):
            axes.set_yscale("log")
        figure.legend(loc="outside right upper", alignment="left")
        return save(
            figure,
            "svg",
            alt=f"Recovered contrasts of {', '.join(names)} in {len(seen)} measurements, on the spectrum of the scene.",
            caption="Points: mean contrast over the realisations, the thick bar its error, the thin bar that of one "
            "observation. Curve: the contrast of the scene; black dashes: its mean over each band, weighted with the "
            "star's detected light, which is what a measurement should give.",
        )
