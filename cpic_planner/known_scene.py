"""A star with its known planets as a scene: one draw of what their published orbits allow, at a date."""

from __future__ import annotations

from typing import Any

import numpy as np

from catalogs.errors import InputError
from catalogs.names import resolve_star
from cpic_planner.known_completeness import KnownChoice
from cpic_planner.known_planets import draw_known, known_uniforms, places_at
from cpic_planner.targets import CatalogSource, as_catalogue
from simulator.config.bodies import MAX_SEPARATION_ARCSEC
from simulator.config.scene_table import scenes_from_table
from simulator.quantities import check_whole

__all__ = ["known_scene"]


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
    stars = as_catalogue(catalog).table
    match = resolve_star(star, stars)
    rows = choice.table.rows_of(match.name)
    if not rows:
        raise InputError("star", star, allowed="a star with known planets", hint=choice.table.provenance)
    uniforms = known_uniforms(choice.table, rows, choice.n_draws, choice.seed)[:, number : number + 1]
    drawn = draw_known(choice.table, rows, uniforms, epoch_mjd=choice.mjd)
    distance_pc = float(np.asarray(stars.column("distance_pc"), float)[match.index])
    scene = scenes_from_table(stars.select([match.index]))[0].model_dump(mode="json", exclude_none=True)
    planets = []
    for k, row in enumerate(rows):
        place = places_at(drawn, k, [choice.mjd])
        east, north = float(place.east_au[0, 0]), float(place.north_au[0, 0])
        separation_arcsec = float(np.hypot(east, north)) / distance_pc
        if separation_arcsec > MAX_SEPARATION_ARCSEC:
            continue
        planet = {
            "name": choice.table.text("planet")[row],
            "radius_rjup": min(float(drawn.radius_rjup[k, 0]), 10.0),
            "distance_au": float(place.distance_au[0, 0]),
            "phase_deg": float(place.phase_deg[0, 0]),
            "separation_arcsec": separation_arcsec,
            "pa_deg": float(np.rad2deg(np.arctan2(east, north)) % 360.0),
            "albedo": choice.albedo.model_dump(mode="json", exclude_none=True),
        }
        planets.append(planet)
    return scene | {"planets": planets}
