"""Light that planets reflect towards the observer, and the stated planet that a ranked star's numbers refer to.

A planet with a separation and no position angle stands on the diagonal of a dark quadrant, the upper right one if it is
dark. Around a star whose companion lights the hole it stands in the quadrant that holds least of that light. The noise
of a measurement is that of the whole annulus (`simulator.signal.light`), nearly the same for all quadrants; but
the scatter of the planet's own aperture is least there.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from cpic_core import ArrayLike, FloatArray, InputError, IntArray
from cpic_planner.etc.model import EtcModel, check_range
from cpic_planner.etc.rates import companions_of
from cpic_planner.queries import ReferencePlanet
from cpic_planner.targets import Targets
from simulator.config import AlbedoSpec
from simulator.imaging import quadrant_of
from simulator.target import albedo_notes, albedo_source, contrast_at, needs_insolation, phase_value, sin_phase

NEAREST_ARCSEC, FARTHEST_ARCSEC = 1e-6, 120.0
"""Where a planet can be asked for, and the nearest place at which the light of a modelled one is worked out: inside
it is none, as at the star itself, and no double holds the contrast of a planet at 1e-308 arcsec."""


def reference_distance_au(targets: Targets, separation_arcsec: FloatArray, planet: ReferencePlanet) -> FloatArray:
    """Return the true star-planet distance in au, shape ``(n_star, n_separation)``; 1 arcsec at 1 pc is 1 au.

    Separations are the same for all stars, ``(n_separation,)``, or one row for each.

    Parameters
    ----------
    targets : Targets
    separation_arcsec : ndarray
        Projected.
    planet : ReferencePlanet
    """
    projected = targets.distance_pc[:, None] * np.atleast_2d(separation_arcsec)
    return np.asarray(projected / sin_phase(planet.phase_deg))


def reference_notes(
    model: EtcModel, targets: Targets, band: str, separation_arcsec: float, planet: ReferencePlanet, star: int = 0
) -> tuple[str, ...]:
    """Return what was clamped or extrapolated in the reference planet of one star, as flags.

    Parameters
    ----------
    model : EtcModel
    targets : Targets
    band : str
        Name of a band of the instrument, such as ``F520``.
    separation_arcsec : float
        Projected separation from the star, arcsec, above 0.
    planet : ReferencePlanet
    star : int, optional
        Number of the star.
    """
    distance = float(targets.distance_pc[star] * separation_arcsec / sin_phase(planet.phase_deg))
    notes = albedo_notes(planet.albedo, distance / float(np.sqrt(targets.luminosity_lsun[star])))
    beyond = model.passbands.albedo_flags(albedo_source(planet.albedo))[model.passbands.index(band)]
    return (*notes, "extrapolated") if beyond else notes


def reference_contrast(
    model: EtcModel, targets: Targets, band: str, separation_arcsec: FloatArray, planet: ReferencePlanet
) -> FloatArray:
    """Return the contrast of the reference planet in one band, ``(n_star, n_separation)``; as `reference_distance_au`.

    Parameters
    ----------
    model : EtcModel
    targets : Targets
    band : str
        Name of a band of the instrument, such as ``F520``.
    separation_arcsec : ndarray
        Projected separation from the star, arcsec, above 0.
    planet : ReferencePlanet
    """
    distance = reference_distance_au(targets, separation_arcsec, planet)
    return reflected_contrast(model, targets, band, planet.albedo, planet.radius_rjup, distance, planet.phase_deg)


def insolation_distance_au(targets: Targets, distance_au: FloatArray) -> FloatArray:
    """Return the distances from the Sun of the same insolation, ``r / sqrt(L)``, shape ``(n, k)``.

    Parameters
    ----------
    targets : Targets
        ``n`` stars.
    distance_au : ndarray, shape (n, k)
        From each star.
    """
    return np.asarray(distance_au / np.sqrt(targets.luminosity_lsun)[:, None])


def reflected_share(
    model: EtcModel, targets: Targets, band: str, albedo: AlbedoSpec, distance_au: FloatArray, phase_deg: ArrayLike
) -> FloatArray:
    """Return the geometric albedo in a band times the phase function.

    Parameters
    ----------
    model : EtcModel
    targets : Targets
        ``n`` stars, whose spectra weigh the albedo.
    band : str
        One band at a time: a user's albedo need not reach the bands that are not asked about.
    albedo : AlbedoSpec
        One that follows the insolation takes it as ``r / sqrt(L)``.
    distance_au : ndarray, shape (n, k)
        True distance of planets from their star.
    phase_deg : array_like
        Their phase angles, of the same shape or one that is broadcast to it.

    Returns
    -------
    ndarray, shape (n, k)
    """
    own = insolation_distance_au(targets, distance_au) if needs_insolation(albedo) else None
    stars = (targets.teff_k[:, None], targets.log_g[:, None], targets.metallicity[:, None])
    reflected = model.passbands.band_albedo(albedo_source(albedo), *stars, insolation_au=own, only=band)
    share = reflected * phase_value(albedo, phase_deg, insolation_au=own)
    return np.broadcast_to(share, np.shape(distance_au))


def reflected_contrast(
    model: EtcModel,
    targets: Targets,
    band: str,
    albedo: AlbedoSpec,
    radius_rjup: ArrayLike,
    distance_au: FloatArray,
    phase_deg: ArrayLike,
) -> FloatArray:
    """Return the contrast of planets of one albedo, shape ``(n, k)``.

    Parameters
    ----------
    model, targets, band, albedo, distance_au, phase_deg
        As of `reflected_share`.
    radius_rjup : array_like
        Of the planets.
    """
    share = reflected_share(model, targets, band, albedo, distance_au, phase_deg)
    return np.asarray(contrast_at(radius_rjup, distance_au, phase_deg, 1.0, phase_value=share))


def kinds_by_albedo(albedos: Sequence[AlbedoSpec]) -> list[tuple[AlbedoSpec, list[int]]]:
    """Return the different albedos with the numbers of the kinds that have them."""
    found: list[tuple[AlbedoSpec, list[int]]] = []
    for number, spec in enumerate(albedos):
        same = next((kinds for other, kinds in found if other == spec), None)
        if same is None:
            found.append((spec, [number]))
        else:
            same.append(number)
    return found


def mixture_contrast(
    model: EtcModel,
    targets: Targets,
    band: str,
    albedos: Sequence[AlbedoSpec],
    kind: IntArray,
    radius_rjup: FloatArray,
    distance_au: FloatArray,
    phase_deg: FloatArray,
) -> FloatArray:
    """Return the contrast of planets of several kinds.

    Parameters
    ----------
    model, targets, band
        As of `reflected_share`.
    albedos : sequence of AlbedoSpec
        By kind.
    kind, radius_rjup, distance_au, phase_deg : ndarray, shape (n, k)
        Of the planets of each star.

    Returns
    -------
    ndarray, shape (n, k)
    """
    share = np.zeros(distance_au.shape)
    for spec, numbers in kinds_by_albedo(albedos):
        mine = np.isin(kind, numbers)
        some = mine.any(axis=0)
        if some.any():
            own = reflected_share(model, targets, band, spec, distance_au[:, some], phase_deg[:, some])
            share[:, some] = np.where(mine[:, some], own, share[:, some])
    return np.asarray(contrast_at(radius_rjup, distance_au, phase_deg, 1.0, phase_value=share))


QUADRANTS = ("upper right", "upper left", "lower right", "lower left")
"""Quadrants on the detector by their number, +x to the right and +y up."""


def dark_quadrants(model: EtcModel, targets: Targets, band: str) -> IntArray:
    """Return the number of the quadrant of each star in which its planet is put, shape ``(n,)``.

    Parameters
    ----------
    model : EtcModel
    targets : Targets
        ``n`` stars; a companion without position angle lights all quadrants alike.
    band : str
        Name of a band of the instrument, such as ``F520``.
    """
    found = np.full(len(targets), quadrant_of(*model.metrics[band].zone.diagonal))
    for near, placed, tables in companions_of(model, targets, band):
        if placed:
            light = np.zeros((len(targets), 4))
            np.add.at(light, near.row, near.rate_e_s[:, None] * tables.quadrants)
            found[near.row] = np.argmin(light[near.row], axis=1)
    return found


def planet_offsets(model: EtcModel, targets: Targets, band: str, separation_arcsec: Any) -> tuple[Any, Any]:
    """Return the detector offsets of planets: on the diagonal, or half the roll beside it for a library of two rolls.

    Parameters
    ----------
    model : EtcModel
    targets : Targets
        ``n`` stars.
    band : str
        Name of a band of the instrument, such as ``F520``.
    separation_arcsec : array_like
        Projected separations from the stars, arcsec, above 0, ``(n or 1, ...)``.

    Returns
    -------
    x_arcsec, y_arcsec : ndarray
        Shape of the separations, or ``(n, ...)`` where the stars' quadrants differ.
    """
    offset, number = np.asarray(separation_arcsec, float) / math.sqrt(2.0), dark_quadrants(model, targets, band)
    same = bool(np.all(number == number[0]))
    number = number[0] if same else number.reshape((-1,) + (1,) * (offset.ndim - 1))
    x, y = np.where(number % 2, -offset, offset), np.where(number // 2, -offset, offset)
    rolls = model.strategy.rolls_deg
    if len(rolls) == 1:
        return x, y
    half = math.radians(rolls[1])
    return x * math.cos(half) - y * math.sin(half), x * math.sin(half) + y * math.cos(half)


def diagonal_pa_deg(model: EtcModel, target: Targets, band: str) -> float:
    """Return the position angle of the diagonal on which the planet of one star is put, at roll 0.

    Parameters
    ----------
    model : EtcModel
    target : Targets
        One star.
    band : str
        Name of a band of the instrument, such as ``F520``.
    """
    from simulator.target import detector_to_sky

    (number,) = dark_quadrants(model, target, band)
    _, pa = detector_to_sky(1 - 2 * (number % 2), 1 - 2 * (number // 2), parity=model.instrument.detector.parity)
    return float(pa)


@dataclass(frozen=True)
class Planets:
    """Planets of a question: projected separations, with a model each or a given contrast each."""

    separation_arcsec: FloatArray
    models: tuple[ReferencePlanet, ...]
    contrast: FloatArray | None

    def __len__(self) -> int:
        return len(self.separation_arcsec)


def planets_of(
    separation_arcsec: float | Sequence[float],
    planet: ReferencePlanet | Sequence[ReferencePlanet] | None = None,
    contrast: float | Sequence[float] | None = None,
) -> Planets:
    """Return planets from one value or a sequence of each; sequences have one length.

    Parameters
    ----------
    separation_arcsec : float or sequence of float
        Projected, 0 to 120 arcsec.
    planet : ReferencePlanet or sequence of it, optional
    contrast : float or sequence of float, optional
        Instead of a model, 0 to 1.

    Raises
    ------
    InputError
        For values out of range or lengths that differ.
    """
    places = np.atleast_1d(np.asarray(separation_arcsec, dtype=object))
    bodies = list(planet) if isinstance(planet, Sequence) else [planet or ReferencePlanet()]
    ratios = None if contrast is None else np.atleast_1d(np.asarray(contrast, dtype=object))
    sizes = {len(places), len(bodies), 1 if ratios is None else len(ratios)} - {1}
    if len(sizes) > 1 or 0 in sizes or places.ndim != 1:
        raise InputError("separation_arcsec", len(places), allowed="as many as there are planets and contrasts, or one")
    n = max(sizes, default=1)
    where = np.array([check_range("separation_arcsec", value, 0.0, FARTHEST_ARCSEC, "arcsec") for value in places])
    given = None
    if ratios is not None:
        given = np.broadcast_to(np.array([check_range("contrast", value, 0.0, 1.0, "") for value in ratios]), n)
    models = tuple(bodies * (n if len(bodies) == 1 else 1))
    return Planets(np.broadcast_to(where, n), models, given)
