"""What several bands of a scene say together: positions and albedos of its planets."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from catalogs.errors import InputError
from cpic_planner.models import AlbedoRecord, BandConfirmation, CandidateRecord, PositionRecord, SearchRecord
from cpic_planner.validation.albedo_fit import AlbedoFit, fit_albedo
from cpic_planner.validation.albedo_model import AlbedoModel, planet_albedo_model
from cpic_planner.validation.detection import BlindSearch
from cpic_planner.validation.task import ConfirmTask
from simulator.config import Instrument, Scene
from simulator.config.geometry import place
from simulator.passbands import Passbands
from simulator.target.planet_light import LitPlanet
from simulator.target.positions import detector_to_sky
from simulator.target.sources import spectrum_generator

__all__ = ["FittedAlbedo", "albedo_fits", "albedo_records", "position_records", "search_record"]


def search_record(
    blind: BlindSearch,
    task: ConfirmTask,
    planets: Mapping[str, tuple[float, float]],
    *,
    reach_arcsec: float,
    roll_deg: float,
    parity: int,
) -> SearchRecord:
    """A blind search for the record.

    Parameters
    ----------
    blind : BlindSearch
        Of the first realisation.
    task : ConfirmTask
    planets : mapping of str to (x_arcsec, y_arcsec)
        Where planets really are; the nearest candidate within ``reach_arcsec`` bears the name.
    reach_arcsec : float
    roll_deg, parity
        Of the detector.
    """
    names = [""] * len(blind.candidates)
    for name, (x, y) in planets.items():
        distance = [math.hypot(item.x_arcsec - x, item.y_arcsec - y) for item in blind.candidates]
        if distance and min(distance) <= reach_arcsec:
            names[int(np.argmin(distance))] = name
    records = []
    for item, name in zip(blind.candidates, names, strict=True):
        separation, pa_deg = detector_to_sky(item.x_arcsec, item.y_arcsec, roll_deg=roll_deg, parity=parity)
        records.append(
            CandidateRecord.of(
                item,
                separation_arcsec=float(separation),
                pa_deg=float(pa_deg) % 360.0,
                snr=item.snr_mf,
                planet=name,
            )
        )
    return SearchRecord.of(
        task,
        false_detections=0,
        resolution_elements=blind.region.n_elements,
        sigma=task.strategy["sigma"],
        candidates=records,
    )


def position_records(scene: Scene, bands: Sequence[BandConfirmation]) -> list[PositionRecord]:
    """Positions of planets, mean of the bands that show them, weighted by their errors along and across.

    Parameters
    ----------
    scene : Scene
    bands : sequence of BandConfirmation
        What was measured in each band.
    """
    records = []
    for planet in scene.planets:
        seen = [band for band in bands if band.planet == planet.name and band.found_separation_arcsec is not None]
        if not seen:
            continue
        truth = place(scene.cstar, planet)
        radial = _mean([(band.found_separation_arcsec, band.found_separation_error_arcsec) for band in seen])
        turned = [((band.found_pa_deg or 0.0) - truth.pa_deg + 180.0) % 360.0 - 180.0 for band in seen]
        angular = _mean([(turn, band.found_pa_error_deg) for turn, band in zip(turned, seen, strict=True)])
        records.append(
            PositionRecord(
                planet=planet.name,
                bands=[band.band for band in seen],
                separation_arcsec=radial[0],
                separation_error_arcsec=radial[1],
                pa_deg=(truth.pa_deg + angular[0]) % 360.0,
                pa_error_deg=angular[1],
                true_separation_arcsec=truth.separation_arcsec,
                true_pa_deg=truth.pa_deg % 360.0,
            )
        )
    return records


def _mean(values: Sequence[tuple[Any, Any]]) -> tuple[float, float]:
    """Mean weighted by inverse variance."""
    value, error = (np.array([pair[i] for pair in values], float) for i in (0, 1))
    weight = error**-2.0
    return float(weight @ value / weight.sum()), float(weight.sum() ** -0.5)


@dataclass(frozen=True, eq=False)
class FittedAlbedo:
    """A fit of metallicity and clouds, with what it was made of.

    Attributes
    ----------
    light : LitPlanet
        The planet in the scene.
    model : AlbedoModel
    fit : AlbedoFit
    """

    light: LitPlanet
    model: AlbedoModel
    fit: AlbedoFit


def albedo_fits(scene: Scene, instrument: Instrument, bands: Sequence[BandConfirmation]) -> list[FittedAlbedo]:
    """Fits of metallicity and clouds to the mean contrasts, with the errors of one observation a band.

    Parameters
    ----------
    scene : Scene
    instrument : Instrument
    bands : sequence of BandConfirmation
        What was measured in each band.
    """
    passbands = Passbands.from_instrument(instrument)
    found = []
    lights = [row.light for row in spectrum_generator(scene) if isinstance(row.light, LitPlanet)]
    for planet, light in zip(scene.planets, lights, strict=True):
        seen = [b for b in bands if b.planet == planet.name and b.recovered_contrast is not None and b.status == "ok"]
        if not seen or not planet.reflects:
            continue
        chosen = [passbands.bands[passbands.index(band.band)] for band in seen]
        try:
            model = planet_albedo_model(light, chosen)
        except InputError:
            continue  # its insolation is not known: no luminosity, or no distance
        measured = {band.band: (band.recovered_contrast or 0.0, band.contrast_error or 0.0) for band in seen}
        found.append(FittedAlbedo(light, model, fit_albedo(measured, model)))
    return found


def albedo_records(fitted: Sequence[FittedAlbedo]) -> list[AlbedoRecord]:
    """Fits of metallicity and clouds for the record."""
    return [
        AlbedoRecord.of(
            item.fit,
            planet=item.light.name,
            log10_mh_interval=list(item.fit.interval("log10_mh")),
            log10_fsed_interval=list(item.fit.interval("log10_fsed")),
        )
        for item in fitted
    ]
