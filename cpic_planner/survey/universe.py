"""Synthetic universes: which planets each star has, seeded per star and draw, and where they stand at any date."""

from __future__ import annotations

from collections.abc import Sequence
from typing import cast

import numpy as np

from catalogs import KnownPlanetTable, OrbitPlaces
from cpic_core import ArrayLike, BoolArray, FloatArray, InputError, IntArray, stream
from cpic_planner.planets import (
    OrbitingPlanets,
    PopulationConfig,
    StarLimits,
    chosen_entry,
    draw_known,
    masses_of_gravity_msun,
)
from cpic_planner.planets.population import QUANTITIES
from cpic_planner.planets.published_orbits import QUANTITIES as KNOWN_QUANTITIES
from cpic_planner.survey.strategy import SurveyStrategy
from cpic_planner.targets import Targets
from simulator.config import AlbedoSpec, MeasuredAlbedo

BLOCK = 250
"""Universes of one random stream; results do not depend on the number of workers, but streams are named by block."""
NEW = -1
"""Row in the table of known planets of a planet that nobody knows."""
_YEAR_DAYS = 365.25
_VALUES = (*QUANTITIES, "mass_mjup", "period_days")
_MOST = 10_000
_TOGETHER = 20_000
"""Places that are worked out at once: arrays that stay in the processor's own memory take two thirds of the time."""


class PlanetSample(OrbitingPlanets, eq=False, kw_only=True):
    """Planets of one star in some universes, arrays of one length.

    Attributes
    ----------
    universe : ndarray of int
        Position of the universe in the draw.
    number : ndarray of int
        Number of the planet in its universe: known planets first, in the order of their table.
    known : ndarray of int
        Row in the table of known planets, or `NEW`.
    kind : ndarray of int
        Number of the planet's kind in the population; that of a known planet lies behind them all.
    mass_mjup : ndarray
        True mass; nan where a known planet has none.
    period_days : ndarray
    """

    universe: IntArray
    number: IntArray
    known: IntArray
    kind: IntArray
    mass_mjup: FloatArray
    period_days: FloatArray

    def __len__(self) -> int:
        return len(self.universe)

    def select(self, rows: ArrayLike) -> PlanetSample:
        """Return the planets of a mask or of row numbers."""
        return PlanetSample(**{name: getattr(self, name)[rows] for name in PlanetSample.__dataclass_fields__})

    @classmethod
    def joined(cls, parts: Sequence[PlanetSample]) -> PlanetSample:
        """Return the planets of several, one after the other."""
        names = cls.__dataclass_fields__
        return cls(**{name: np.concatenate([getattr(part, name) for part in parts]) for name in names})

    def within(self, inner_au: float, outer_au: float) -> BoolArray:
        """Return the planets whose projected distance can lie between two at all: of the others no date shows any.

        It is at most ``a (1 + e)``, and at least ``a (1 - e) |cos i|``.

        Parameters
        ----------
        inner_au : float
            Smallest projected distance, au.
        outer_au : float
            Largest projected distance, au.
        """
        farthest = self.semi_major_axis_au * (1.0 + self.eccentricity)
        nearest = self.semi_major_axis_au * (1.0 - self.eccentricity) * np.abs(np.cos(np.deg2rad(self.inclination_deg)))
        return np.asarray((farthest >= inner_au) & (nearest <= outer_au))

    def places(self, days: ArrayLike) -> OrbitPlaces:
        """Return the places so many days after the epoch, shape ``(len(days), n_planets)``."""
        when = np.asarray(days, float)
        step = max(_TOGETHER // max(len(self), 1), 1)
        parts = [self.places_after(when[i : i + step, None], self.period_days) for i in range(0, len(when), step)]
        if len(parts) == 1:
            return parts[0]
        names = OrbitPlaces.__dataclass_fields__
        empty = [np.zeros((0, len(self)))]
        return OrbitPlaces(*(np.concatenate(empty + [getattr(part, name) for part in parts]) for name in names))


def star_mass_msun(targets: Targets) -> FloatArray:
    """Return the masses of stars that follow from their gravity (`cpic_planner.planets.masses_of_gravity_msun`)."""
    return masses_of_gravity_msun(targets.log_g, targets.luminosity_lsun, targets.teff_k)


def occurrence(population: PopulationConfig) -> float:
    """Return the planets per star of a population.

    Raises
    ------
    InputError
        If it states none: a yield is then not defined.
    """
    if population.planets_per_star is None:
        hint = f"{population.name} states no occurrence rate, and a yield needs one"
        raise InputError("population.planets_per_star", "missing", allowed="planets per star, above 0", hint=hint)
    return population.planets_per_star


Block = int | range
"""The number of a block of universes, or those of several blocks of `BLOCK` universes that are worked out together."""


def chance(seed: int, *path: str | Block, shape: tuple[int, ...]) -> FloatArray:
    """Return the uniform numbers of a named stage, the last axis over universes.

    The first rows of a larger shape are those of a smaller one, and so are the first universes of a larger block.

    Parameters
    ----------
    seed : int
        Seed of all random streams.
    *path : str, int or range
        Names of the stream; each block of several has one of its own.
    shape : tuple of int
        Shape of the result; the last axis is over universes.
    """
    *rows, n = shape
    blocks = next((part for part in path if isinstance(part, range)), None)
    if blocks is None:
        names = cast("tuple[str | int, ...]", path)
        return stream(seed, "survey", *names).random((*rows, -(-n // BLOCK) * BLOCK))[..., :n]
    paths = ((block if part is blocks else part for part in path) for block in blocks[: -(-n // BLOCK)])
    return np.concatenate([chance(seed, *own, shape=(*rows, BLOCK)) for own in paths], axis=-1)[..., :n]


def at_known_place(planets: PlanetSample, table: KnownPlanetTable | None) -> BoolArray:
    """Tell for which planets a visit knows where to look: known ones whose orbit in space is published, node included.

    Radial velocities alone leave the position angle open, and so do errors of more than a few degrees
    (`catalogs.known_planets.PLACE_DEG`): such planets are searched for as unknown ones are.
    """
    placed = np.zeros(len(planets), bool)
    if table is not None:
        mine = planets.known != NEW
        placed[mine] = table.placed[planets.known[mine]]
    return placed


def allowed_probability(planets: PlanetSample, limits: StarLimits, star: int) -> FloatArray:
    """Return the probability that what is known of a star still allows each planet; 1 for known ones.

    Parameters
    ----------
    planets : PlanetSample
        Planets of that star.
    limits : StarLimits
    star : int
        Position of the star among those of ``limits``.
    """
    new = planets.known == NEW
    allowed = np.ones(len(planets))
    mine = planets.select(new)
    which = np.full(len(mine), star)
    allowed[new] = limits.allowed_probability(which, mine.semi_major_axis_au, mine.mass_mjup, mine.inclination_deg)
    return allowed


def draw_planet_sample(
    star: str,
    mass_msun: float,
    luminosity_lsun: float,
    population: PopulationConfig | None,
    *,
    known: KnownPlanetTable | None = None,
    known_rows: Sequence[int] = (),
    epoch_mjd: float,
    n: int,
    seed: int,
    block: Block = 0,
    stage: str = "universe",
    one_each: bool = False,
) -> PlanetSample:
    """Return the planets of one star in ``n`` universes.

    Every planet has its own uniform numbers, one for each quantity, that its laws turn into values: changing a law or
    the occurrence rate leaves the planets that remain where they are, so that strategies with different assumptions see
    the same chance.

    Parameters
    ----------
    star : str
        Name, which with ``seed`` and ``block`` names the random streams.
    mass_msun, luminosity_lsun : float
    population : PopulationConfig or None
        None: known planets alone.
    known : KnownPlanetTable, optional
    known_rows : sequence of int
        Rows of this star's planets in that table.
    epoch_mjd : float
        When ``mean_anomaly_deg`` holds.
    n : int
        Universes.
    seed : int
    block : int or range
    stage : str
        What the draw is for; another stage has other planets.
    one_each : bool
        Exactly one new planet in every universe, whatever the occurrence rate.
    """
    path = (star, stage, block)
    parts = [_sample({}, np.zeros(0, np.int64), 0, NEW, 0)]
    behind = 0 if population is None else len(population.mixture)
    if known is not None and len(known_rows):
        names = known.text("planet")
        shape = (len(KNOWN_QUANTITIES), n)
        uniforms = [chance(seed, "known", *path, names[row], shape=shape).T for row in known_rows]
        rows = [int(row) for row in known_rows]
        drawn = draw_known(known, rows, np.stack(uniforms), epoch_mjd=epoch_mjd, star_mass_msun=mass_msun)
        for number, row in enumerate(rows):
            values = {name: np.asarray(getattr(drawn, name)[number], float) for name in _VALUES}
            parts.append(_sample(values, np.arange(n), number, row, behind))
    if population is not None:
        numbers = np.ones(n, np.int64)
        if not one_each:
            numbers = poisson_quantile(occurrence(population), chance(seed, "number", *path, shape=(n,)))
        for j in range(int(numbers.max(initial=0))):
            mine = np.flatnonzero(numbers > j)
            shares = chance(seed, "planet", *path, j, shape=(1 + len(QUANTITIES), n))[:, mine]
            kind = chosen_entry(shares[0], tuple(item.weight for item in population.mixture))
            values = population.quantiles(kind, list(shares[1:]))
            if population.semi_major_axis_scale == "insolation":
                values["semi_major_axis_au"] = values["semi_major_axis_au"] * np.sqrt(luminosity_lsun)
            values["period_days"] = _YEAR_DAYS * np.sqrt(values["semi_major_axis_au"] ** 3 / mass_msun)
            parts.append(_sample(values, mine, len(known_rows) + j, NEW, kind))
    return PlanetSample.joined(parts)


def _sample(
    values: dict[str, FloatArray], universe: IntArray, number: int, known: int, kind: IntArray | int
) -> PlanetSample:
    empty = np.zeros(universe.size)
    return PlanetSample(
        universe=universe,
        number=np.full(universe.size, number),
        known=np.full(universe.size, known),
        kind=np.broadcast_to(np.asarray(kind, np.int64), universe.shape),
        **{name: values.get(name, empty) for name in _VALUES},
    )


def uniform_draws(planets: PlanetSample, seed: int, name: str, block: Block, visit: int | str, n: int) -> FloatArray:
    """Return a uniform number of each planet in one visit.

    Parameters
    ----------
    planets : PlanetSample
        Planets of one star.
    seed : int
    name : str
        Of the star; with ``block`` and ``visit`` it names the random stream.
    block : int or range
    visit : int or str
        Number or name of the visit.
    n : int
        Universes.

    Returns
    -------
    ndarray
        In [0, 1), one for each planet.
    """
    if not len(planets):
        return np.zeros(0)
    drawn = chance(seed, "visit", name, block, visit, shape=(int(planets.number.max()) + 1, n))
    return drawn[planets.number, planets.universe]


def poisson_quantile(rate: float, share: FloatArray) -> IntArray:
    """Return Poisson numbers at given shares of their law.

    Parameters
    ----------
    rate : float
        Mean of the law, at least 0.
    share : ndarray
        In [0, 1).

    Raises
    ------
    InputError
        If the rate is too large for a table of the law.
    """
    length = int(rate + 40.0 * np.sqrt(rate) + 60.0)
    if length > _MOST:
        raise InputError("population.planets_per_star", rate, allowed=f"at most {_MOST / 2:g} in a survey")
    from scipy.special import pdtr

    return np.searchsorted(pdtr(np.arange(length), rate), share, side="right").astype(np.int64)


KNOWN_ALBEDO = MeasuredAlbedo(model="jupiter")


def albedos_of(population: PopulationConfig | None) -> tuple[AlbedoSpec, ...]:
    """Return the albedos by kind: those of the population, then that of known planets, Jupiter's."""
    own = () if population is None else tuple(kind.albedo for kind in population.mixture)
    return (*(spec for spec in own if spec is not None), KNOWN_ALBEDO)


def dust_of(
    strategy: SurveyStrategy, planets: PlanetSample, seed: int, star: str, block: Block | str
) -> FloatArray | None:
    """Return the dust around a star in the universe of each planet, zodi; None where it is the same everywhere.

    Parameters
    ----------
    strategy : SurveyStrategy
    planets : PlanetSample
        Of that star.
    seed : int
    star : str
        Name, which with ``block`` names the random stream: all strategies see the same luck.
    block : int, range or str
        Number of the block of universes, or ``planning``.
    """
    law = strategy.assumptions.dust
    if law is None:
        return None
    n = int(planets.universe.max(initial=0)) + 1
    return law.zodis(chance(seed, "dust", star, block, shape=(n,)))[planets.universe]
