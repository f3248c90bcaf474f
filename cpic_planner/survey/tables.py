"""Tables of a survey's results and their keys."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cpic_planner.survey.events import Played
from cpic_planner.survey.store import Column, Table

__all__ = ["TABLES", "rows_of"]

UNIVERSES = Table(
    "universes",
    (
        Column("strategy", "string", "name of the strategy"),
        Column("universe", "int64", "number of the universe, the same sky for every strategy"),
        Column("new_planets", "int64", "planets found that nobody knew"),
        Column("known_planets", "int64", "known planets seen"),
        Column("stars_with_planet", "int64", "stars with a planet found"),
        Column("characterised_planets", "int64", "planets found and seen in every band of the follow-up"),
        Column("noise_alarms", "int64", "noise taken for a planet"),
        Column("background_alarms", "int64", "background stars taken for a planet"),
        Column("visits", "int64", "visits made"),
        Column("search_h", "float64", "telescope time of the search", "h"),
        Column("follow_up_h", "float64", "telescope time of the follow-up", "h"),
    ),
    key=("strategy", "universe"),
)
DETECTIONS = Table(
    "detections",
    (
        Column("strategy", "string", "name of the strategy"),
        Column("universe", "int64", "number of the universe"),
        Column("star", "string", "name in the catalogue"),
        Column("planet", "int64", "number of the planet around its star, known ones first"),
        Column("known_row", "int64", "row in the table of known planets, -1 for a new planet"),
        Column("kind", "int64", "number of the planet's kind in the population; the last one is that of known planets"),
        Column("ordinal", "int64", "number of the visit among those of its star"),
        Column("option", "int64", "way to visit the star: number of its frames"),
        Column("band", "string", "band of the visit"),
        Column("day", "float64", "since the start of the survey", "d"),
        Column("used_h", "float64", "telescope time used by then", "h"),
        Column("radius_rjup", "float64", "radius", "R_Jup"),
        Column("semi_major_axis_au", "float64", "of the orbit", "au"),
        Column("eccentricity", "float64", "of the orbit"),
        Column("inclination_deg", "float64", "of the orbit", "deg"),
        Column("margin", "float64", "predicted significance over threshold"),
        Column("chance", "float64", "probability that this visit detects it"),
        Column("snr", "float64", "predicted photometric SNR"),
        Column("contrast", "float64", "true planet-to-star ratio of detected rates"),
        Column("separation_arcsec", "float64", "projected", "arcsec"),
        Column("pa_deg", "float64", "position angle, east of north", "deg"),
        Column("roll_deg", "float64", "position angle of the detector's +y axis", "deg"),
        Column("distance_au", "float64", "true distance from the star", "au"),
        Column("phase_deg", "float64", "star-planet-observer", "deg"),
    ),
    key=("strategy", "universe", "star", "planet"),
)
STARS = Table(
    "stars",
    (
        Column("strategy", "string", "name of the strategy"),
        Column("star", "string", "name in the catalogue"),
        Column("block", "int64", "block of universes that the sums run over"),
        Column("universes", "int64", "universes of the block"),
        Column("visits", "int64", "visits of the search, sum"),
        Column("search_h", "float64", "telescope time of the search, sum", "h"),
        Column("follow_up_h", "float64", "telescope time of the follow-up, sum", "h"),
        Column("new_planets", "int64", "planets found that nobody knew, sum"),
        Column("known_planets", "int64", "known planets seen, sum"),
    ),
    key=("strategy", "star", "block"),
)
TABLES = (UNIVERSES, DETECTIONS, STARS)


def rows_of(played: Played, strategy: str, first_universe: int) -> dict[str, Mapping[str, NDArray[Any]]]:
    """Columns of all tables of one block, universes by their number in the survey."""
    n = len(played.universes["visits"])
    found: dict[str, Mapping[str, NDArray[Any]]] = {
        "universes": dict(played.universes) | {"universe": first_universe + np.arange(n)},
        "detections": dict(played.detections) | {"universe": first_universe + played.detections["universe"]},
        "stars": dict(played.stars),
    }
    lengths = {"universes": n, "detections": len(played.detections["universe"]), "stars": len(played.stars["star"])}
    return {
        name: dict(columns) | {"strategy": np.full(lengths[name], strategy, object)} for name, columns in found.items()
    }
