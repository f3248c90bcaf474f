"""Whether a later publication contradicts the orbit of a known planet that an answer rests on."""

import math
import re

import numpy as np

from catalogs import KnownPlanetTable, load_known_planets
from catalogs.known_planet_table import NUMBERS, planet_key
from cpic_core import FloatArray
from cpic_planner.planets import draw_known, known_uniforms, places_at, quantiles
from cpic_planner.ranking.known_completeness import KnownChoice

SIGMAS = 3.0
"""Combined errors by which two orbits differ that contradict each other."""
_LEAST = {
    "period": 0.05,
    "semi-major axis": 0.05,
    "eccentricity": 0.05,
    "separation": 0.02,
    "phase angle": 5.0,
}
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
    """Whether two rows have the same orbits."""
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
