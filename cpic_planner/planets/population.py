"""Seeded draws of a population of planets, and the orbits that every draw of planets has."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from catalogs import ORBIT, OrbitPlaces, orbit_places
from cpic_core import ArrayLike, FloatArray, InputError, IntArray, check_whole, stream
from cpic_planner.planets.allowed import StarLimits
from cpic_planner.planets.laws import chosen_entry
from cpic_planner.planets.population_config import QUANTITIES, PopulationConfig, load_population
from cpic_planner.queries import EXCLUSIONS, MAX_PLANETS, N_PLANETS
from cpic_planner.results import PopulationRecord
from simulator.config import AlbedoSpec


@dataclass(frozen=True, eq=False, kw_only=True)
class OrbitingPlanets:
    """Planets on Kepler orbits, arrays of one shape; what every draw of planets has.

    Attributes
    ----------
    radius_rjup : ndarray
        Radius in Jupiter equatorial radii.
    semi_major_axis_au, eccentricity, inclination_deg, argument_of_pericentre_deg, node_deg : ndarray
        As `orbit_places` takes them.
    mean_anomaly_deg : ndarray
        At the epoch of the draw.
    """

    radius_rjup: FloatArray
    semi_major_axis_au: FloatArray
    eccentricity: FloatArray
    inclination_deg: FloatArray
    argument_of_pericentre_deg: FloatArray
    node_deg: FloatArray
    mean_anomaly_deg: FloatArray

    def places_after(self, days: ArrayLike, period_days: FloatArray) -> OrbitPlaces:
        """Return places so many days after the epoch.

        Parameters
        ----------
        days : array_like
            Broadcasts against the planets.
        period_days : ndarray
            Period of each planet, days.

        Returns
        -------
        OrbitPlaces
            Arrays of the shape of ``days`` and the planets, broadcast.
        """
        *elements, anomaly = (getattr(self, name) for name in ORBIT)
        return orbit_places(*[*elements, anomaly + 360.0 * np.asarray(days, float) / period_days])


@dataclass(frozen=True, eq=False, kw_only=True)
class Planets(OrbitingPlanets):
    """Drawn planets, arrays of one length.

    Attributes
    ----------
    population : str
        Name of the population.
    kind : ndarray of int
        Number of the planet's kind, into ``kind_names`` and ``albedos``.
    mass_mjup : ndarray
        True mass, nan where a known planet has none.
    east_au, north_au, distance_au, phase_deg : ndarray
        Offset from the star on the sky, true distance, and phase angle, before `scale`.
    kind_names : tuple of str
    albedos : tuple of AlbedoSpec
    semi_major_axis_scale : str
    planets_per_star : float or None
    """

    population: str
    kind: IntArray
    mass_mjup: FloatArray
    east_au: FloatArray
    north_au: FloatArray
    distance_au: FloatArray
    phase_deg: FloatArray
    kind_names: tuple[str, ...]
    albedos: tuple[AlbedoSpec, ...]
    semi_major_axis_scale: Literal["none", "insolation"]
    planets_per_star: float | None

    def __len__(self) -> int:
        return len(self.radius_rjup)

    def scale(self, luminosity_lsun: FloatArray) -> FloatArray:
        """Return the factor of all orbits' lengths around stars of these luminosities, 1 unless they follow insolation.

        Raises
        ------
        InputError
            If orbits follow insolation and a luminosity is unknown.
        """
        luminosity = np.asarray(luminosity_lsun, float)
        if self.semi_major_axis_scale == "none":
            return np.ones(luminosity.shape)
        good = np.isfinite(luminosity) & (luminosity > 0.0)
        if not good.all():
            first, allowed = float(luminosity[~good].flat[0]), "above 0: the population's orbits follow insolation"
            raise InputError("luminosity_lsun", first, unit="L_sun", allowed=allowed)
        return np.asarray(np.sqrt(luminosity))


def draw_population(config: PopulationConfig, n_planets: int, seed: int) -> Planets:
    """Draw planets.

    Every quantity has a random stream of its own, one number a planet, that its law turns into a value: changing one
    law leaves the other quantities alone, and the first planets of a larger draw are those of a smaller one.

    Parameters
    ----------
    config : PopulationConfig
    n_planets : int
        1 to 1e6.
    seed : int

    Returns
    -------
    Planets

    Raises
    ------
    InputError
        If a number is out of range.
    """
    n = check_whole("n_planets", n_planets, 1, MAX_PLANETS)
    mixture = config.mixture

    shares = {name: stream(seed, "population", name).random(n) for name in ("kind", *QUANTITIES)}
    kind = chosen_entry(shares["kind"], tuple(item.weight for item in mixture))
    drawn = config.quantiles(kind, [shares[quantity] for quantity in QUANTITIES])
    places = orbit_places(*(drawn[name] for name in ORBIT))
    return Planets(
        population=config.name,
        kind=kind,
        **drawn,
        **vars(places),
        kind_names=tuple(item.name for item in mixture),
        albedos=tuple(item.albedo for item in mixture if item.albedo is not None),
        semi_major_axis_scale=config.semi_major_axis_scale,
        planets_per_star=config.planets_per_star,
    )


@dataclass(frozen=True)
class PopulationChoice:
    """A population, how many planets are drawn of it, the seed, and which knowledge of the stars excludes planets."""

    config: PopulationConfig
    n_planets: int = N_PLANETS
    seed: int = 1
    exclusions: tuple[str, ...] = EXCLUSIONS

    @classmethod
    def default(cls) -> "PopulationChoice":
        """Return the shipped population of giant planets."""
        return cls(load_population())

    def draw(self) -> Planets:
        """Return the planets, the same at every star."""
        return draw_population(self.config, self.n_planets, self.seed)

    def limits(self, names: Sequence[str]) -> StarLimits:
        """Return what is known of stars of these names, as far as it counts."""
        return StarLimits.of(names, self.exclusions)

    def record(self) -> PopulationRecord:
        """Return what is written into results."""
        standing = self.config.provenance.get("planets_per_star")
        return PopulationRecord.of(
            self, self.config, planets_per_star_range=None if standing is None else standing.range
        )

    def content(self) -> dict[str, object]:
        """Return what decides a draw, for content hashes."""
        asked = {"n_planets": self.n_planets, "seed": self.seed, "exclusions": list(self.exclusions)}
        return {"config": self.config.content(), **asked}
