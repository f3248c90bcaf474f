"""Confirm a prediction: simulate science and reference visits, subtract, search blind, measure, compare."""

import base64
import io
import itertools
import math
from dataclasses import replace
from typing import Any

import numpy as np

from cpic_core import NDArray, Status, announce
from cpic_planner.etc import threshold_array
from cpic_planner.results import AuditRecord, BandConfirmation, CandidateRecord, LimitRow, SearchRecord
from cpic_planner.validation import level1
from cpic_planner.validation.astrometry import Astrometry, fit_position
from cpic_planner.validation.measure import (
    Measurement,
    PlanetTemplate,
    is_covered,
    maps_of,
    measure_planets,
    measured_at,
    obstacle,
    place_at,
    planet_templates,
    speckles_of,
    with_image,
)
from cpic_planner.validation.photometry import radius_pixel
from cpic_planner.validation.realise import FrameStatistics, Realisation, VisitPair, audited, realisations, visit_pair
from cpic_planner.validation.search import MATCH_LAMBDA_D, BlindSearch
from cpic_planner.validation.star_flux import StarFlux, observe_off_mask, star_flux_off_mask
from cpic_planner.validation.task import ConfirmTask, Modelling, modelling_of
from cpic_planner.validation.verdict import audit_of, confirmation_of
from simulator.imaging import ExternalPsf
from simulator.passbands import Passbands, band_flux_density
from simulator.target import LitStar, detector_to_sky

N_LIMITS = 12
"""Separations of a contrast curve."""


def confirm_task(tree: dict[str, Any], *, counted: bool = False) -> dict[str, Any]:
    """Simulate and measure one scene in one band.

    Parameters
    ----------
    tree : dict
        `ConfirmTask.to_dict`.
    counted : bool
        Whether only the number of images that show a planet is wanted: the star's rate is then that of the scene, which
        is not measured off the mask, and no place is fitted.

    Returns
    -------
    dict
        ``confirmations`` (a `BandConfirmation` as plain data for each planet), ``panels`` (images of the first
        realisation, encoded), ``planet_offsets_arcsec``, and ``search`` (a `SearchRecord` of the first realisation;
        None for two rolls). Of files beside them ``visits`` (`ProductVisitRecord`), ``sources`` (`SourceRecord`) and
        ``roll_deg``.
    """
    task = ConfirmTask(**tree)
    announce(f"images of {task.name} in {task.band}")
    if task.files is not None:
        return _measure_files(task)
    modelling = modelling_of(task)
    visits = visit_pair(task, modelling=modelling)
    sums = modelling.draw == "sums" and visits.stackable.status is Status.OK
    if not sums:
        modelling = modelling_of(task, by_frames=True)
    every: list[list[Measurement | None]] = []
    parts: list[FrameStatistics] = []
    false = 0
    record: SearchRecord | None = None
    numbers = range(task.realisations if sums else modelling.runs_by_frames(task.realisations))
    for at, realisation, statistics in realisations(task, modelling, numbers, visits if sums else None):
        if not every:
            first = realisation
            planets = planet_templates(at)
            star = _star(at, measured=not counted)
            maps = maps_of(at)
            positions: list[list[Astrometry | None]] = [[] for _ in planets]
        measured, blind = measure_planets(at, realisation, planets, star, maps=maps)
        every.append(measured)
        announce(f"images of {task.name} in {task.band}, {len(every)} of {task.realisations} realisations")
        if statistics is not None:
            parts.append(statistics)
        if blind is not None:
            false += _false(blind, at)
            record = record or _search_record(blind, at, planets)
        for found, planet, item in zip(positions, planets, measured, strict=True):
            shown = not counted and item is not None and item.found
            found.append(positions_of(at, realisation, blind, planet) if blind is not None and shown else None)
    audits: list[AuditRecord | None] = [None] * len(planets)
    if task.audit and sums and planets and visits.counting is None:
        audits = _audits(task, modelling, visits, planets, star)
    told: dict[str, Any] = {"false_detections": false, "statistics": FrameStatistics.of(parts) if parts else None}
    light = _star_light(visits)
    confirmations = [
        confirmation_of(
            task,
            modelling,
            index,
            [measured[index] for measured in every],
            star,
            planet.core,
            positions=positions[index],
            light=light,
            audit=audits[index],
            **told,
        )
        for index, planet in enumerate(planets)
    ]
    if record is not None:
        curve = [] if counted else _curve(visits, first, star)
        record = record.model_copy(update={"realisations": len(every), "false_detections": false, "curve": curve})
    return _body(confirmations, first, planets, record)


def _body(
    confirmations: list[BandConfirmation],
    first: Realisation,
    planets: tuple[PlanetTemplate, ...],
    record: SearchRecord | None,
) -> dict[str, Any]:
    """Return what was measured as plain data, with the images."""
    residual = np.where(first.reduced.region, first.reduced.image_e, np.nan)
    panels = {"science": first.science_e, "reference": first.reference_e, "residual": residual}
    return {
        "confirmations": [item.model_dump(mode="json") for item in confirmations],
        "panels": encode_arrays({name: image.astype(np.float32) for name, image in panels.items()}),
        "planet_offsets_arcsec": [list(planet.places_arcsec[0]) for planet in planets],
        "search": None if record is None else record.model_dump(mode="json"),
    }


def _measure_files(task: ConfirmTask) -> dict[str, Any]:
    """Measure the Level-1 files of a task, as `confirm_task` measures the first realisation of simulated images."""
    assert task.files is not None
    programme = level1.programme_of(task.files, task.band)
    task = replace(task, epoch_mjd=programme.middle_mjd or task.epoch_mjd)
    modelling = modelling_of(task, by_frames=True).of_files()
    at, realisation, statistics, visits = level1.realise_files(visit_pair(task, modelling=modelling), programme)
    star = level1.star_of_files(at, programme)
    if star is None and not task.bare:
        star = StarFlux.known(at.science.truth.sources[0].rate_e_s)
    light = star or StarFlux.known(level1.starlight_e_s(at, realisation))
    planets, maps = planet_templates(at), maps_of(at)
    measured, blind = measure_planets(at, realisation, planets, light, maps=maps)
    false = None if task.bare or blind is None else _false(blind, at)
    confirmations = []
    for index, (planet, item) in enumerate(zip(planets, measured, strict=True)):
        found = None if item is None or blind is None else positions_of(at, realisation, blind, planet)
        told: dict[str, Any] = {"false_detections": false or 0, "statistics": statistics, "positions": [found]}
        made = confirmation_of(task, modelling, index, [item], light, planet.core, **told)
        confirmations.append(made.model_copy(update={"drawn_as": "files", "modelled": None}))
    record = None if blind is None else _search_record(blind, at, planets)
    if record is not None:
        curve = [] if star is None else _curve(at, realisation, star)
        record = record.model_copy(update={"realisations": 1, "false_detections": false, "curve": curve})
    sources = [] if blind is None else level1.sources_of(at, realisation, blind, star, programme)
    told = {"visits": visits, "sources": sources}
    plain = {name: [item.model_dump(mode="json") for item in rows] for name, rows in told.items()}
    return _body(confirmations, realisation, planets, record) | plain | {"roll_deg": programme.rolls_deg[0]}


def positions_of(
    visits: VisitPair, realisation: Realisation, blind: BlindSearch, planet: PlanetTemplate
) -> Astrometry | None:
    """Return the fitted position of a planet that the search found; None where it did not."""
    match = blind.strongest_near(*planet.places_arcsec[0], visits.geometry)
    if match is None or not match.detected:
        return None
    pixel, middle = visits.geometry.pixel_scale_arcsec, visits.geometry.stamp_pixels // 2
    others = [((x - middle) * pixel, (y - middle) * pixel) for x, y in planet.others]
    return fit_position(
        realisation.reduced,
        visits.optics,
        match.x_arcsec,
        match.y_arcsec,
        roll_deg=visits.plan.science["roll_deg"],
        exclude=others,
    )


def _search_record(blind: BlindSearch, visits: VisitPair, planets: tuple[PlanetTemplate, ...]) -> SearchRecord:
    """Return a blind search for the record; the candidate nearest to a planet, within reach, bears its name."""
    reach_arcsec = MATCH_LAMBDA_D * visits.geometry.lambda_d_arcsec
    roll_deg, parity = visits.plan.science["roll_deg"], visits.instrument.detector.parity
    names = [""] * len(blind.candidates)
    for planet in planets:
        x, y = planet.places_arcsec[0]
        distance = [math.hypot(item.x_arcsec - x, item.y_arcsec - y) for item in blind.candidates]
        if distance and min(distance) <= reach_arcsec:
            names[int(np.argmin(distance))] = planet.name
    records = []
    for item, name in zip(blind.candidates, names, strict=True):
        separation, pa_deg = detector_to_sky(item.x_arcsec, item.y_arcsec, roll_deg=roll_deg, parity=parity)
        record = CandidateRecord.of(
            item, snr=item.snr_mf, planet=name, separation_arcsec=float(separation), pa_deg=float(pa_deg) % 360.0
        )
        records.append(record)
    return SearchRecord.of(
        visits.task,
        false_detections=0,
        resolution_elements=blind.region.n_elements,
        sigma=visits.task.strategy["sigma"],
        candidates=records,
    )


def _audits(
    task: ConfirmTask, modelling: Modelling, visits: VisitPair, planets: tuple[PlanetTemplate, ...], star: StarFlux
) -> list[AuditRecord | None]:
    """Return the records of a realisation with every effect on, measured as the others are."""
    realisation, statistics = audited(task, modelling, visits)
    measured, blind = measure_planets(visits, realisation, planets, star)
    false = 0 if blind is None else _false(blind, visits)
    return [
        None if item is None else audit_of(task, index, item, statistics, false) for index, item in enumerate(measured)
    ]


def _false(blind: BlindSearch, visits: VisitPair) -> int:
    """Return the detections where the scene has no planet and no star."""
    return sum(one.detected for one in blind.apart_from(visits.beside_arcsec, visits.geometry))


def _star(visits: VisitPair, *, measured: bool) -> StarFlux:
    """Return the star's rate from a series off the mask; the scene's if that saturates, or of a table, has no place."""
    if measured and not isinstance(visits.science.psf, ExternalPsf):
        scene, task, knobs = visits.plan.science_scene, visits.task, visits.modelling.knobs
        series = observe_off_mask(scene, task.band, instrument=visits.instrument, seed=task.seed, fidelity=knobs)
        found = star_flux_off_mask(series.value).value if series.value is not None else None
        if found is not None:
            return found
    return StarFlux.known(visits.science.truth.sources[0].rate_e_s)


def _curve(visits: VisitPair, realisation: Realisation, star: StarFlux) -> list[LimitRow]:
    """Return the contrast limit against separation, each on a diagonal where no other source stands."""
    geometry, strategy, found = visits.geometry, visits.strategy, []
    model, zone = speckles_of(visits, star.rate_e_s), geometry.zone
    margin = math.ceil(radius_pixel(geometry)) + 1
    for separation in np.linspace(zone.inner_corner_arcsec, zone.outer_corner_arcsec, N_LIMITS + 2)[1:-1].tolist():
        for signs in itertools.product((1, -1), repeat=2):
            at = signs[0] * separation / math.sqrt(2.0), signs[1] * separation / math.sqrt(2.0)
            place = place_at(geometry, strategy, "limit", (at,), visits.beside_arcsec)
            whole = is_covered(realisation.reduced.region, place.apertures[0] * geometry.hole)
            if not whole or obstacle(place, geometry, strategy) is not None:
                continue
            empty = with_image(visits, place, margin_pixels=margin)
            told = measured_at(visits, realisation, empty, star.rate_e_s, model)
            if told is not None:
                threshold = float(threshold_array(geometry.resolution_elements(separation), strategy.sigma))
                row = {"separation_arcsec": separation, "threshold": threshold, "throughput": told.throughput}
                found.append(LimitRow(**row, contrast_limit=threshold * told.contrast_sigma))
                break
    return found


def _star_light(visits: VisitPair) -> dict[str, float]:
    """Return the fields of a `BandConfirmation` on the star's light in the band."""
    passbands = Passbands.from_instrument(visits.instrument)
    band = passbands.bands[passbands.index(visits.task.band)]
    flux, wavelength_nm = band_flux_density(band, LitStar(visits.plan.science_scene.cstar, "scene.cstar").spectrum)
    light = {"star_flux_density": flux, "effective_wavelength_nm": wavelength_nm}
    return light | {"band_center_nm": band.center_nm, "band_width_nm": band.width_nm}


def encode_arrays(arrays: dict[str, NDArray[Any]]) -> str:
    """Return the arrays as base64 text of a compressed npz."""
    buffer = io.BytesIO()
    np.savez_compressed(buffer, **arrays)  # type: ignore[arg-type]
    return base64.b64encode(buffer.getvalue()).decode("ascii")


def decode_arrays(text: str) -> dict[str, NDArray[Any]]:
    """Return the inverse of `encode_arrays`."""
    with np.load(io.BytesIO(base64.b64decode(text)), allow_pickle=False) as stored:
        return {name: stored[name] for name in stored.files}
