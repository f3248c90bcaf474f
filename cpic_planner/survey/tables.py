"""Tables of a survey's results and their keys: one kind of row each, its fields are the columns."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cpic_planner.models.base import Row
from cpic_planner.models.columns import column, columns_of
from cpic_planner.survey.events import Played
from cpic_planner.survey.store import Table


class UniverseRow(Row):
    """One universe of a strategy."""

    strategy: str = column("name of the strategy")
    universe: int = column("number of the universe, the same sky for every strategy")
    new_planets: int = column("planets found that nobody knew")
    known_planets: int = column("known planets seen")
    stars_with_planet: int = column("stars with a planet found")
    characterised_planets: int = column("planets found and seen in every band of the follow-up")
    noise_alarms: int = column("noise taken for a planet")
    background_alarms: int = column("background stars taken for a planet")
    visits: int = column("visits made")
    search_h: float = column("telescope time of the search")
    follow_up_h: float = column("telescope time of the follow-up")


class DetectionRow(Row):
    """One planet that a strategy finds in one universe."""

    strategy: str = column("name of the strategy")
    universe: int = column("number of the universe")
    star: str = column("name in the catalogue")
    planet: int = column("number of the planet around its star, known ones first")
    known_row: int = column("row in the table of known planets, -1 for a new planet")
    kind: int = column("number of the planet's kind in the population; the last one is that of known planets")
    ordinal: int = column("number of the visit among those of its star")
    option: int = column("way to visit the star: number of its frames")
    band: str = column("band of the visit")
    day: float = column("since the start of the survey", unit="d")
    used_h: float = column("telescope time used by then")
    radius_rjup: float = column("radius")
    semi_major_axis_au: float = column("of the orbit")
    eccentricity: float = column("of the orbit")
    inclination_deg: float = column("of the orbit")
    margin: float = column("predicted significance over threshold")
    chance: float = column("probability that this visit detects it")
    snr: float = column("predicted photometric SNR")
    contrast: float = column("true planet-to-star ratio of detected rates")
    separation_arcsec: float = column("projected")
    pa_deg: float = column("position angle, east of north")
    roll_deg: float = column("position angle of the detector's +y axis")
    distance_au: float = column("true distance from the star")
    phase_deg: float = column("star-planet-observer")


class StarRow(Row):
    """What a strategy does at one star in one block of universes."""

    strategy: str = column("name of the strategy")
    star: str = column("name in the catalogue")
    block: int = column("block of universes that the sums run over")
    universes: int = column("universes of the block")
    visits: int = column("visits of the search, sum")
    search_h: float = column("telescope time of the search, sum")
    follow_up_h: float = column("telescope time of the follow-up, sum")
    new_planets: int = column("planets found that nobody knew, sum")
    known_planets: int = column("known planets seen, sum")


TABLES = (
    Table("universes", columns_of(UniverseRow), key=("strategy", "universe")),
    Table("detections", columns_of(DetectionRow), key=("strategy", "universe", "star", "planet")),
    Table("stars", columns_of(StarRow), key=("strategy", "star", "block")),
)


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
