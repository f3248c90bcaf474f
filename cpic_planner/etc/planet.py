"""Light that planets reflect towards the observer, and the stated planet that a ranked star's numbers refer to."""

from collections.abc import Sequence

import numpy as np

from cpic_core import ArrayLike, FloatArray, IntArray
from cpic_planner.etc.model import EtcModel
from cpic_planner.queries import ReferencePlanet
from cpic_planner.targets import Targets
from simulator.config import AlbedoSpec
from simulator.target import albedo_notes, albedo_source, contrast_at, needs_insolation, phase_value, sin_phase


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
    model: EtcModel, target: Targets, band: str, separation_arcsec: float, planet: ReferencePlanet
) -> tuple[str, ...]:
    """What was clamped or extrapolated in the reference planet of one star, as flags.

    Parameters
    ----------
    model : EtcModel
    target : Targets
    band : str
        Name of a band of the instrument, such as ``F520``.
    separation_arcsec : float
        Projected separation from the star, arcsec, above 0.
    planet : ReferencePlanet
    """
    distance = float(reference_distance_au(target, np.array([separation_arcsec]), planet)[0, 0])
    notes = albedo_notes(planet.albedo, distance / float(np.sqrt(target.luminosity_lsun[0])))
    beyond = model.passbands.albedo_flags(albedo_source(planet.albedo))[model.passbands.index(band)]
    return (*notes, "extrapolated") if beyond else notes


def reference_contrast(
    model: EtcModel, targets: Targets, band: str, separation_arcsec: FloatArray, planet: ReferencePlanet
) -> FloatArray:
    """Contrast of the reference planet in one band, ``(n_star, n_separation)``; as `reference_distance_au`.

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
    """Geometric albedo in a band times the phase function.

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
    """Different albedos with the numbers of the kinds that have them."""
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
    """Contrast of planets of several kinds.

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
