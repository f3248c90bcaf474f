"""Limits from radial velocities: for each star that was searched, which planets were likely to be found.

``velocity_limits.csv`` has one row a star. Its numbers are fits to planets that a survey put into its own velocities
and searched for (`tools.velocity_limits`); where a row has none it names a rule, the medians of a kind of stars, in
``velocity_rules.csv``. A star without a row has no limit. Rows name their publications.
"""

import functools
import itertools
import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from catalogs.known_planets import star_key
from catalogs.shipped import shipped_rows
from catalogs.stars import load_stars
from cpic_core import ArrayLike, FloatArray, Record, real_array

_DATA = Path(__file__).resolve().parent / "data"
LIMITS_FILE = _DATA / "velocity_limits.csv"
RULES_FILE = _DATA / "velocity_rules.csv"

ANNULI_AU = (0.3, 0.6, 1.2, 2.4, 4.0, 6.5, 10.0, 16.0)
"""Edges of the annuli of semi-major axis in which sensitivities are fitted."""
VELOCITY_AXES_AU = tuple(math.sqrt(low * high) for low, high in itertools.pairwise(ANNULI_AU))
"""Axis for which the numbers of each annulus hold: its geometric middle."""
NUMBERS = ("m50_mjup", "m90_mjup", "ceiling")
"""What is known in each annulus; columns of the table end in the number of the annulus, from 1."""
_RULE_NUMBERS = ("k50_m_s", "m90_over_m50", "ceiling")
_AMPLITUDE_M_S = 28.4329


def amplitude_m_s(msini_mjup: ArrayLike, semi_major_axis_au: ArrayLike, star_mass_msun: ArrayLike) -> FloatArray:
    """Return the semi-amplitude (m/s) of a star's velocity that a light planet on a circular orbit gives; broadcasts.

    Notes
    -----
    ``K = 28.4329 m/s (m sin i / M_Jup) / sqrt((M / M_Sun) (a / au))``: Lovis & Fischer 2010, in Exoplanets, equation
    14, with the period by Kepler's third law and the planet's mass neglected beside the star's.
    """
    msini, axis = (
        real_array("msini_mjup", msini_mjup, "M_Jup"),
        real_array("semi_major_axis_au", semi_major_axis_au, "au"),
    )
    mass = real_array("star_mass_msun", star_mass_msun, "M_Sun")
    return np.asarray(_AMPLITUDE_M_S * msini / np.sqrt(mass * axis))


class VelocityLimit(Record):
    """The probabilities with which one star's velocities would have shown a planet; over `VELOCITY_AXES_AU`.

    ``P(found) = ceiling / (1 + (m50 / m)^s)`` with ``s = ln 9 / ln(m90 / m50)`` and ``m = m sin i``.

    Attributes
    ----------
    star : str
        Name in the embedded catalogue.
    rule : str
        Which stars' medians stand where the star has no injections of its own; empty for none.
    n_velocities : int or None
    baseline_years : float
        From the first velocity to the last.
    m50_mjup, m90_mjup : tuple of float
        m sin i that is found half as often, and 0.9 times as often, as the heaviest planets.
    ceiling : tuple of float
        Share of the heaviest planets that is found; 0 where nothing is known.
    reach_au : float
        Axis beyond which nothing is excluded.
    reference, note : str
    """

    star: str
    rule: str
    n_velocities: int | None
    baseline_years: float
    m50_mjup: tuple[float, ...]
    m90_mjup: tuple[float, ...]
    ceiling: tuple[float, ...]
    reach_au: float
    reference: str
    note: str


def velocity_limit(star: str) -> VelocityLimit | None:
    """Return what radial velocities exclude around a star, by any of its names; None where no search is known.

    Examples
    --------
    >>> from catalogs.velocity_limits import velocity_limit
    >>> velocity_limit("HD 10700").star
    'tau Cet'
    >>> velocity_limit("Vega") is None
    True
    """
    return _limit_of(star_key(star))


@functools.cache
def _rows() -> tuple[dict[str, dict[str, str]], dict[str, dict[str, str]], dict[str, float]]:
    """Return the rows of the table by star, the rules by name, and the masses of stars."""
    stars = load_stars()
    masses = dict(zip(stars.column("name").tolist(), stars.column("mass_msun").tolist(), strict=True))
    rules = {row["rule"]: row for row in shipped_rows(RULES_FILE.name)}
    return {star_key(row["star"]): row for row in shipped_rows(LIMITS_FILE.name)}, rules, masses


@functools.cache
def _limit_of(key: str) -> VelocityLimit | None:
    rows, rules, masses = _rows()
    row = rows.get(key)
    return None if row is None else _limit(row, rules.get(row["rule"], {}), masses[row["star"]])


def _numbers(row: Mapping[str, str], names: tuple[str, ...]) -> FloatArray:
    """Return numbers by annulus, one row each; nan where there is none."""
    annuli = range(1, len(VELOCITY_AXES_AU) + 1)
    return np.array([[float(row.get(f"{name}_{number}") or math.nan) for number in annuli] for name in names])


def _limit(row: Mapping[str, str], rule: Mapping[str, str], star_mass_msun: float) -> VelocityLimit:
    """Return a row with what its rule says in the annuli without numbers of their own; a ceiling of 0 for nothing."""
    own, (k50, ratio, share) = _numbers(row, NUMBERS), _numbers(rule, _RULE_NUMBERS)
    m50 = k50 / amplitude_m_s(1.0, VELOCITY_AXES_AU, star_mass_msun)
    by_rule = np.where(np.isfinite(share), [m50, ratio * m50, share], [[1.0], [2.0], [0.0]])
    limits = np.where(np.isfinite(own[2]), own, by_rule)
    baseline = float(row["baseline_years"])
    # Beyond the orbit whose period is the baseline only the star's own injections say what is found.
    reach = math.inf if np.isfinite(own[2, -1]) else (star_mass_msun * baseline**2) ** (1.0 / 3.0)
    known = [axis for axis, ceiling in zip(VELOCITY_AXES_AU, limits[2], strict=True) if ceiling > 0.0]
    return VelocityLimit(
        star=row["star"],
        rule=row["rule"],
        n_velocities=int(row["n_velocities"]) if row["n_velocities"] else None,
        baseline_years=baseline,
        **dict(zip(NUMBERS, map(tuple, limits.tolist()), strict=True)),
        reach_au=min(reach, max(known, default=0.0)),
        reference=row["reference"],
        note=row["note"],
    )
