"""A star with its known planets as a scene: one draw of what their published orbits allow, at a date.

Where the known planets of some stars are at a date, how bright, and when the dark hole covers them; and whether a later
publication contradicts the orbit that says so.
"""

import math
import re
from collections.abc import Sequence
from datetime import datetime, timedelta
from typing import Any

import numpy as np

from catalogs import KnownPlanetTable, load_known_planets, resolve_star, snapshot_vintage, stars_at
from catalogs.known_planets import NUMBERS, planet_key
from cpic_core import FloatArray, InputError, check_whole, fingerprint
from cpic_planner import results
from cpic_planner.etc import EtcModel, check_range, reflected_contrast
from cpic_planner.planets import (
    Ephemeris,
    Planets,
    draw_known,
    ephemeris,
    known_uniforms,
    places_at,
    planets_of,
    quantiles,
    star_masses_msun,
)
from cpic_planner.ranking.completeness import KnownChoice
from cpic_planner.targets import CatalogSource, Targets, as_catalogue
from cpic_planner.version import __version__
from simulator.config import MAX_SEPARATION_ARCSEC, AlbedoSpec, content_hash, julian_year, scenes_from_table


def known_scene(
    star: str, choice: KnownChoice, *, draw: int = 0, catalog: CatalogSource = "snapshot"
) -> dict[str, Any]:
    """Return a scene for `simulator.load_scene`, `cpic simulate` and `cpic confirm`.

    Parameters
    ----------
    star : str
        Any name of a star with known planets.
    choice : KnownChoice
        Table, date, seed and albedo.
    draw : int
        Which draw, below ``choice.n_draws``: the planets are those that a ranking of the same choice counts.
    catalog : Catalogue, str or Path
        Star table.

    Returns
    -------
    dict
        Keys of a scene file: ``cstar``, ``planets``, and a companion where one is known. Planets farther than 120
        arcsec are left out.

    Raises
    ------
    InputError
        If the star is unknown or has no known planets.
    """
    number = check_whole("draw", draw, 0, choice.n_draws - 1)
    chosen = as_catalogue(catalog)
    match = resolve_star(star, chosen.table)
    rows = choice.table.rows_of(match.name)
    if not rows:
        raise InputError("star", star, allowed="a star with known planets", hint=choice.table.provenance)
    uniforms = known_uniforms(choice.table, rows, choice.n_draws, choice.seed)[:, number : number + 1]
    drawn = draw_known(choice.table, rows, uniforms, epoch_mjd=choice.mjd)
    place = stars_at(chosen.table.select([match.index]), julian_year(choice.date_utc), orbits=chosen.orbits)
    distance_pc = float(np.asarray(place.column("distance_pc"), float)[0])
    scene = scenes_from_table(place)[0].model_dump(mode="json", exclude_none=True)
    planets = []
    for k, row in enumerate(rows):
        at = {name: float(values[0, 0]) for name, values in vars(places_at(drawn, k, [choice.mjd])).items()}
        east, north = at["east_au"], at["north_au"]
        separation_arcsec = float(np.hypot(east, north)) / distance_pc
        if separation_arcsec > MAX_SEPARATION_ARCSEC:
            continue
        planet = {
            "name": choice.table.text("planet")[row],
            "radius_rjup": min(float(drawn.radius_rjup[k, 0]), 10.0),
            "distance_au": at["distance_au"],
            "phase_deg": at["phase_deg"],
            "separation_arcsec": separation_arcsec,
            "pa_deg": float(np.rad2deg(np.arctan2(east, north)) % 360.0),
            "albedo": choice.albedo.model_dump(mode="json", exclude_none=True),
        }
        planets.append(planet)
    return scene | {"planets": planets}


DAYS_PER_YEAR = 365.25
_STEPS = 400
_PER_PERIOD = 24
_MOST_STEPS = 2000
_LIKELY = 0.5
_TEXTS = ("planet", "discovery_method", "status", "reference", "status_reference", "updated", "note")
_OF_ORBIT = ("period_days", "semi_major_axis_au", "eccentricity", "radius_rjup")
_MJD_ZERO = datetime(1858, 11, 17)


def known_answer(
    model: EtcModel,
    targets: Targets,
    choice: KnownChoice,
    *,
    years: float | None = None,
    catalogue: str | None = None,
    bands: Sequence[str] | None = None,
    planet: str | None = None,
    notes: Sequence[str] = (),
) -> results.KnownResult:
    """Return the known planets of some stars, in order of stars and table; those that are not counted as well.

    Parameters
    ----------
    model : EtcModel
    targets : Targets
    choice : KnownChoice
        Table, date, draws and albedo.
    years : float, optional
        Also the separations over so long, and the days on which the dark hole covers them; 0.01 to 100. Planets that
        are not counted have neither.
    catalogue : str, optional
        Which table the stars are from; the snapshot by default.
    bands : sequence of str, optional
        All of the model by default.
    planet : str, optional
        Name of the one planet that is asked for; all by default.
    notes : sequence of str
        Remarks on the reading of the table of stars; those on the planets are added.

    Returns
    -------
    KnownResult

    Raises
    ------
    InputError
        If a number is out of range, or no star has a known planet.
    """
    names = model.named(bands)
    span = None if years is None else check_range("years", years, 0.01, 100.0, "yr")
    listed = [choice.table.listed_rows_of(str(name)) for name in targets.name]
    stars = targets.select([i for i, mine in enumerate(listed) if mine])
    if not len(stars):
        raise InputError("known_planets", choice.table.provenance, allowed="planets of stars of the sample")
    called = choice.table.text("planet")
    asked = [(i, row) for i, mine in enumerate(listed) for row in mine if planet in (None, called[row])]
    zones = {band: model.metrics[band].zone for band in names}
    decides = {
        "kind": "known",
        "version": __version__,
        "model": model.content(),
        "bands": list(names),
        "choice": choice.content(),
        "years": span,
        "targets": stars.content(),
    }
    return results.KnownResult.of(
        choice,
        fingerprint=str(fingerprint()),
        config_hash=content_hash(decides),
        catalogue=snapshot_vintage() if catalogue is None else catalogue,
        planets_table=choice.table.provenance,
        columns_not_used=list(choice.table.unused),
        notes=[*notes, *choice.table.notes],
        years=span,
        albedo=choice.albedo.label,
        holes=[
            results.KnownHole(band=band, inner_arcsec=zone.inner_corner_arcsec, outer_arcsec=zone.outer_corner_arcsec)
            for band, zone in zones.items()
        ],
        planets=[_row(model, targets.select([i]), choice, row, names, span) for i, row in asked],
    )


def planets_contrast(model: EtcModel, target: Targets, band: str, planets: Planets, albedo: AlbedoSpec) -> FloatArray:
    """Return the contrast of planets of one star in a band, where they are; one value for each.

    Parameters
    ----------
    model : EtcModel
    target : Targets
    band : str
        Name of a band of the instrument, such as ``F520``.
    planets : Planets
    albedo : AlbedoSpec
    """
    result: FloatArray = reflected_contrast(
        model, target.select([0]), band, albedo, planets.radius_rjup, planets.distance_au[None], planets.phase_deg
    )[0]
    return result


def _row(
    model: EtcModel, star: Targets, choice: KnownChoice, row: int, bands: Sequence[str], years: float | None
) -> results.KnownPlanetRow:
    table = choice.table
    years = years if table.counted[row] else None
    star_msun = star_masses_msun(star.name.tolist(), star.log_g, star.luminosity_lsun, star.teff_k)[0]
    uniforms = known_uniforms(table, [row], choice.n_draws, choice.seed)
    drawn = draw_known(table, [row], uniforms, epoch_mjd=choice.mjd, star_mass_msun=star_msun)
    planets = planets_of(drawn, 0, choice.albedo)
    period = float(np.median(drawn.period_days[0]))
    days = [0.0] if years is None else _days(years * DAYS_PER_YEAR, period)
    where = ephemeris(
        table,
        row,
        choice.mjd + np.asarray(days),
        n_draws=choice.n_draws,
        seed=choice.seed,
        distance_pc=float(star.distance_pc[0]),
    )
    looks: list[results.KnownBand] = []
    windows: list[results.KnownWindow] = []
    for band in bands:
        zone = model.metrics[band].zone
        share = where.share_between(zone.inner_corner_arcsec, zone.outer_corner_arcsec)
        contrast = planets_contrast(model, star, band, planets, choice.albedo)
        looks.append(results.KnownBand(band=band, contrast=_quantiles(contrast), hole_share=float(share[0])))
        if years is not None:
            windows += _windows(band, where.mjd, share)
    mass = drawn.mass_mjup[0]
    texts = {name: table.text(name)[row] for name in _TEXTS}
    orbit = {name: _quantiles(getattr(drawn, name)[0]) for name in _OF_ORBIT}
    later = superseded_by(choice, row, float(star.distance_pc[0]))
    place = {name: _three(getattr(where, name)[:, 0]) for name in ("separation_arcsec", "distance_au", "phase_deg")}
    return results.KnownPlanetRow.of(
        star,
        at=0,
        star=str(star.name[0]),
        hip=int(star.hip[0]) or None,
        flags=[*table.flags(row), *(["orbit_superseded"] if later else [])],
        counted=bool(table.counted[row]),
        orbits=_orbits(table, row),
        superseded_by=later,
        **(texts | orbit | place),
        mass_mjup=_quantiles(mass) if np.isfinite(mass).all() else None,
        pa_deg=None if where.pa_deg is None else _three(where.pa_deg[:, 0]),
        bands=looks,
        windows=windows,
        track=None if years is None else _track(where),
    )


def _orbits(table: KnownPlanetTable, row: int) -> list[results.KnownOrbit]:
    orbits = table.orbits_of(row)
    weights = np.nan_to_num(orbits.number("solution_weight"), nan=1.0) if len(orbits) > 1 else np.ones(1)
    numbers = [orbits.number(name) for name in ("period_days", "semi_major_axis_au", "eccentricity")]
    found = []
    for k, reference in enumerate(orbits.text("reference")):
        period, axis, eccentricity = (float(values[k]) if np.isfinite(values[k]) else None for values in numbers)
        share = float(weights[k] / weights.sum())
        found.append(
            results.KnownOrbit(
                reference=reference, share=share, period_days=period, semi_major_axis_au=axis, eccentricity=eccentricity
            )
        )
    return found


def _days(length: float, period: float) -> list[float]:
    """Return the days from the date on: many in a period, but not without end."""
    step = max(min(length / _STEPS, period / _PER_PERIOD), length / _MOST_STEPS)
    return [float(day) for day in np.linspace(0.0, length, math.ceil(length / step) + 1)]


def _windows(band: str, mjd: FloatArray, share: FloatArray) -> list[results.KnownWindow]:
    """Return the runs of dates on which the share is at least a half."""
    likely = np.concatenate([[False], share >= _LIKELY, [False]])
    starts = np.flatnonzero(likely[1:] & ~likely[:-1])
    ends = np.flatnonzero(~likely[1:] & likely[:-1]) - 1
    found = []
    for start, end in zip(starts, ends, strict=True):
        best = int(start + np.argmax(share[start : end + 1]))
        first, last, peak = ((_MJD_ZERO + timedelta(days=float(mjd[i]))).date().isoformat() for i in (start, end, best))
        found.append(
            results.KnownWindow(band=band, start_utc=first, end_utc=last, best_utc=peak, best_share=float(share[best]))
        )
    return found


def _track(where: Ephemeris) -> results.KnownTrack:
    low, median, high = where.separation_arcsec.tolist()
    return results.KnownTrack(
        mjd=where.mjd.tolist(), separation_low_arcsec=low, separation_median_arcsec=median, separation_high_arcsec=high
    )


def _quantiles(draws: FloatArray) -> results.Quantiles:
    return _three(quantiles(draws))


def _three(values: FloatArray) -> results.Quantiles:
    low, median, high = values.tolist()
    return results.Quantiles(low=low, median=median, high=high)


SIGMAS = 3.0
"""Combined errors by which two orbits differ that contradict each other."""
_LEAST = {"period": 0.05, "semi-major axis": 0.05, "eccentricity": 0.05, "separation": 0.02, "phase angle": 5.0}
"""Differences that are never a contradiction, where errors are small or not given: of the natural logarithm of period
and axis, of the eccentricity, of the separation in arcsec and the phase angle in degrees."""
_YEAR = re.compile(r"(?<!\d)(?:19|20)\d\d(?!\d)")


def superseded_by(choice: KnownChoice, row: int, distance_pc: float) -> str:
    """Return the publication of a later orbit that contradicts the one in use, and in what; ``""`` if there is none.

    Parameters
    ----------
    choice : KnownChoice
        Table in use, date, draws.
    row : int
        Row of the planet in that table.
    distance_pc : float
        Of the star.

    Notes
    -----
    The other orbit is that of the shipped table with its updates. It is later if the latest year that its reference
    names is after that of the orbit in use; an orbit without any year in its reference is as old as the date of its
    row, and one without a date is taken as earlier. The two contradict each other if the medians of their draws differ
    in period, semi-major axis, eccentricity, or at the date of the choice in projected separation or phase angle, by
    more than three times both half widths that hold 68 % of the draws, added in quadrature, and by more than 5 % (0.05
    in eccentricity, 0.02 arcsec, 5 deg).
    """
    table, current = choice.table, load_known_planets()
    star, planet = table.text("star")[row], table.text("planet")[row]
    key, names = planet_key(star, planet), current.text("planet")
    other = next((k for k in current.listed_rows_of(star) if planet_key(star, names[k]) == key), None)
    if other is None or _same(table, row, current, other) or _year(table, row) >= _year(current, other):
        return ""
    mine, theirs = (_drawn(choice, item, at, distance_pc) for item, at in ((table, row), (current, other)))
    apart = [name for name, least in _LEAST.items() if _differ(mine[name], theirs[name], least)]
    return f"{current.text('reference')[other]}, in {', '.join(apart)}" if apart else ""


def _same(one: KnownPlanetTable, row: int, other: KnownPlanetTable, at: int) -> bool:
    """Return whether two rows have the same orbits."""
    first, second = one.orbits_of(row), other.orbits_of(at)
    return len(first) == len(second) and all(
        np.array_equal(first.number(name), second.number(name), equal_nan=True) for name in NUMBERS
    )


def _year(table: KnownPlanetTable, row: int) -> int:
    """Return the year of an orbit; 0 where nothing tells it."""
    orbits = table.orbits_of(row)
    for told in ("reference", "updated"):
        years = [int(year) for text in orbits.text(told) for year in _YEAR.findall(text)]
        if years:
            return max(years)
    return 0


def _drawn(choice: KnownChoice, table: KnownPlanetTable, row: int, distance_pc: float) -> dict[str, FloatArray]:
    """Return 16, 50 and 84 % of what is compared, by the names of `_LEAST`."""
    uniforms = known_uniforms(table, [row], choice.n_draws, choice.seed)
    drawn = draw_known(table, [row], uniforms, epoch_mjd=choice.mjd)
    place = places_at(drawn, 0, [choice.mjd])
    draws = {
        "period": np.log(drawn.period_days[0]),
        "semi-major axis": np.log(drawn.semi_major_axis_au[0]),
        "eccentricity": drawn.eccentricity[0],
        "separation": np.hypot(place.east_au, place.north_au)[:, 0] / distance_pc,
        "phase angle": place.phase_deg[:, 0],
    }
    return {name: quantiles(values) for name, values in draws.items()}


def _differ(one: FloatArray, other: FloatArray, least: float) -> bool:
    widths = [0.5 * float(item[2] - item[0]) for item in (one, other)]
    return bool(abs(one[1] - other[1]) > max(SIGMAS * math.hypot(*widths), least))
