"""Populations of planets: the laws of their quantities, configuration and presets, and seeded draws.

Each quantity is drawn through the quantile function of its law. Draws have Kepler orbits.
"""

import functools
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, TypeAlias, cast, get_args

import numpy as np
from pydantic import BeforeValidator, Field, ValidationInfo, model_validator

from catalogs import ECCENTRICITY_MAX, ORBIT, OrbitPlaces, orbit_places
from cpic_core import ArrayLike, FloatArray, InputError, IntArray, Record, check_whole, faults_by_line, special, stream
from cpic_planner.planets.allowed import StarLimits
from cpic_planner.planets.masses import least_mass
from cpic_planner.queries import EXCLUSIONS, ReferencePlanet
from cpic_planner.results import PopulationRecord
from simulator import config
from simulator.config import AlbedoSpec, FrozenModel, Real, nearest, validate
from simulator.config.scene import paths_beside

N_PLANETS = 4000
"""Planets that a ranking draws."""
MAX_PLANETS = 1_000_000


class _Between(FrozenModel):
    """A law between two limits, ``low < high``."""

    low: Real
    high: Real

    @model_validator(mode="after")
    def _ordered(self) -> "_Between":
        if not self.low < self.high:
            raise InputError("low", self.low, allowed=f"below high = {self.high:g}")
        return self

    @property
    def support(self) -> tuple[float, float]:
        """Smallest and largest value."""
        return self.low, self.high


class Fixed(FrozenModel):
    """One value for all."""

    law: Literal["fixed"] = "fixed"
    value: Real

    @property
    def support(self) -> tuple[float, float]:
        """Smallest and largest value."""
        return self.value, self.value

    def quantile(self, share: FloatArray) -> FloatArray:
        """Return the values below which these shares of the population lie."""
        return np.full(share.shape, self.value)


class Uniform(_Between):
    """The same density everywhere."""

    law: Literal["uniform"] = "uniform"

    def quantile(self, share: FloatArray) -> FloatArray:
        """Return the values below which these shares of the population lie."""
        return self.low + share * (self.high - self.low)


class _Positive(_Between):
    """A law between two limits above 0."""

    @model_validator(mode="after")
    def _above_zero(self) -> "_Positive":
        if self.low <= 0.0:
            raise InputError("low", self.low, allowed="above 0")
        return self


class LogUniform(_Positive):
    """The same number in every interval of the logarithm."""

    law: Literal["log_uniform"] = "log_uniform"

    def quantile(self, share: FloatArray) -> FloatArray:
        """Return the values below which these shares of the population lie."""
        return _power_quantile(share, self.low, self.high, -1.0)


class PowerLaw(_Positive):
    """Density ``dN/dx ~ x^index``: -1 is log-uniform, 0 uniform."""

    law: Literal["power_law"] = "power_law"
    index: Annotated[Real, Field(ge=-20, le=20)]

    def quantile(self, share: FloatArray) -> FloatArray:
        """Return the values below which these shares of the population lie."""
        return _power_quantile(share, self.low, self.high, self.index)


class BrokenPowerLaw(_Positive):
    """Density ``dN/dx ~ x^index_inner`` up to ``turn``, ``x^index_outer`` beyond, continuous there."""

    law: Literal["broken_power_law"] = "broken_power_law"
    index_inner: Annotated[Real, Field(ge=-20, le=20)]
    index_outer: Annotated[Real, Field(ge=-20, le=20)]
    turn: Real

    @model_validator(mode="after")
    def _turn_between(self) -> "BrokenPowerLaw":
        if not self.low < self.turn < self.high:
            raise InputError("turn", self.turn, allowed=f"between low = {self.low:g} and high = {self.high:g}")
        return self

    @property
    def inner_share(self) -> float:
        """Share of the population below the turn."""
        inner = _power_integral(self.low / self.turn, 1.0, self.index_inner)
        return inner / (inner + _power_integral(1.0, self.high / self.turn, self.index_outer))

    def quantile(self, share: FloatArray) -> FloatArray:
        """Return the values below which these shares of the population lie."""
        inner = self.inner_share
        below = _power_quantile(np.minimum(share / inner, 1.0), self.low, self.turn, self.index_inner)
        past = np.maximum(share - inner, 0.0) / (1.0 - inner)
        above = _power_quantile(past, self.turn, self.high, self.index_outer)
        return np.where(share < inner, below, above)


class Normal(_Between):
    """Normal, cut at both limits."""

    law: Literal["normal"] = "normal"
    mean: Real
    sd: Annotated[Real, Field(gt=0)]

    @model_validator(mode="after")
    def _reached(self) -> "Normal":
        # Beyond 6 sd less than 1e-9 is left of the law: what is meant is another one.
        if self.low > self.mean + 6.0 * self.sd or self.high < self.mean - 6.0 * self.sd:
            raise InputError("mean", self.mean, allowed="within 6 sd of a value between low and high")
        return self

    def quantile(self, share: FloatArray) -> FloatArray:
        """Return the values below which these shares of the population lie."""
        low, high = (self.low - self.mean) / self.sd, (self.high - self.mean) / self.sd
        # In the upper tail the complement keeps its digits.
        sign = -1.0 if low > 0.0 else 1.0
        first, last = float(special().ndtr(sign * low)), float(special().ndtr(sign * high))
        z = sign * special().ndtri(first + share * (last - first))
        return np.asarray(np.clip(self.mean + self.sd * z, self.low, self.high))


class Rayleigh(FrozenModel):
    """Rayleigh law of a scale, cut at ``high``."""

    law: Literal["rayleigh"] = "rayleigh"
    scale: Annotated[Real, Field(gt=0)]
    high: Annotated[Real, Field(gt=0)]

    @property
    def support(self) -> tuple[float, float]:
        """Smallest and largest value."""
        return 0.0, self.high

    def quantile(self, share: FloatArray) -> FloatArray:
        """Return the values below which these shares of the population lie."""
        all_below = -math.expm1(-0.5 * (self.high / self.scale) ** 2)
        return np.minimum(self.scale * np.sqrt(-2.0 * np.log1p(-share * all_below)), self.high)


class Beta(FrozenModel):
    """Beta law on 0 to 1, density ~ ``x^(a-1) (1-x)^(b-1)``, cut at ``high``."""

    law: Literal["beta"] = "beta"
    a: Annotated[Real, Field(gt=0, le=1000)]
    b: Annotated[Real, Field(gt=0, le=1000)]
    high: Annotated[Real, Field(gt=0, le=1)]

    @property
    def support(self) -> tuple[float, float]:
        """Smallest and largest value."""
        return 0.0, self.high

    def quantile(self, share: FloatArray) -> FloatArray:
        """Return the values below which these shares of the population lie."""
        value: FloatArray = special().betaincinv(
            self.a, self.b, share * float(special().betainc(self.a, self.b, self.high))
        )
        return np.minimum(value, self.high)


class Isotropic(FrozenModel):
    """Inclinations of orbits whose poles point anywhere: density ~ ``sin i``, 0 to 180 degrees."""

    law: Literal["isotropic"] = "isotropic"

    @property
    def support(self) -> tuple[float, float]:
        """Smallest and largest value."""
        return 0.0, 180.0

    def quantile(self, share: FloatArray) -> FloatArray:
        """Return the values below which these shares of the population lie."""
        return np.rad2deg(2.0 * np.arcsin(np.sqrt(share)))


class Table(FrozenModel):
    """Some values, each with its weight; equal weights if none are given."""

    law: Literal["table"] = "table"
    values: Annotated[tuple[Real, ...], Field(min_length=1)]
    weights: tuple[Annotated[Real, Field(ge=0)], ...] | None = None

    @model_validator(mode="after")
    def _weighed(self) -> "Table":
        weights = self.weights
        if weights is not None and (len(weights) != len(self.values) or not sum(weights) > 0.0):
            raise InputError("weights", list(weights), allowed=f"{len(self.values)} numbers, at least one above 0")
        return self

    @property
    def support(self) -> tuple[float, float]:
        """Smallest and largest value."""
        return min(self.values), max(self.values)

    def quantile(self, share: FloatArray) -> FloatArray:
        """Return the values below which these shares of the population lie, in the order of the table."""
        return np.asarray(self.values)[chosen_entry(share, self.weights or (1.0,) * len(self.values))]


Law: TypeAlias = Fixed | Uniform | LogUniform | PowerLaw | BrokenPowerLaw | Normal | Rayleigh | Beta | Isotropic | Table

_BY_NAME: dict[str, type[Law]] = {item.model_fields["law"].default: item for item in get_args(Law)}
LAWS = tuple(_BY_NAME)
"""Names of the laws."""


def read_law(value: Any) -> Law:
    """Return the law of what a user writes.

    Parameters
    ----------
    value : Law, mapping, float or str
        A mapping with ``law`` and the law's own keys; a number for ``fixed``; a word for a law without keys.

    Raises
    ------
    InputError
        Naming the key, its value and what is allowed.
    """
    if isinstance(value, tuple(_BY_NAME.values())):
        return cast("Law", value)
    if isinstance(value, int | float) and not isinstance(value, bool):
        return validate(Fixed, {"value": value})
    given = {"law": value} if isinstance(value, str) else value
    if not isinstance(given, Mapping):
        raise InputError("law", value, allowed="a number, or a mapping with law: " + ", ".join(LAWS))
    name = given.get("law", "missing")
    if not isinstance(name, str) or name not in _BY_NAME:
        raise InputError("law", name, allowed=", ".join(LAWS), hint=nearest(name, LAWS))
    return validate(_BY_NAME[name], given)


def chosen_entry(share: FloatArray, weights: tuple[float, ...]) -> IntArray:
    """Return the entry of a list that each share of the population falls on, entries weighed.

    Parameters
    ----------
    share : ndarray
        Uniform numbers in [0, 1), turned into values by the law.
    weights : tuple of float
        Weight of each entry, relative to the others.
    """
    ends = np.cumsum(weights) / math.fsum(weights)
    last = int(np.flatnonzero(weights)[-1])
    return np.minimum(np.searchsorted(ends, share, side="right"), last)


def _power_integral(low: float, high: float, index: float) -> float:
    """Return the integral of ``x^index``."""
    width, power = math.log(high / low), index + 1.0
    return float(low**power * (width if power == 0.0 else math.expm1(power * width) / power))


def _power_quantile(share: FloatArray, low: float, high: float, index: float) -> FloatArray:
    """Return the quantile of the density ``x^index`` between two limits; accurate for every index, -1 included."""
    width, power = math.log(high / low), index + 1.0
    grown = power * width
    # ln of (x / high)^power or (x / low)^power, at most 1: a sum of positive terms or, near 1, its distance from 1.
    least = math.exp(-abs(grown))
    near, far, end = (share, 1.0 - share, width) if grown > 0.0 else (1.0 - share, share, 0.0)
    if grown == 0.0:
        up = share * width
    elif least < 0.5:
        up = end + np.log(near + far * least) / power
    else:
        up = end + np.log1p(far * math.expm1(-abs(grown))) / power
    return np.clip(low * np.exp(up), low, high)


DEFAULT_POPULATION = "giants"
PACKAGE = "cpic_planner"

_RANGES = {
    "radius_rjup": (1e-3, 10.0),
    "semi_major_axis_au": (1e-3, 1e4),
    "eccentricity": (0.0, ECCENTRICITY_MAX),
    "inclination_deg": (0.0, 180.0),
    "argument_of_pericentre_deg": (-360.0, 360.0),
    "node_deg": (-360.0, 360.0),
    "mean_anomaly_deg": (-360.0, 360.0),
}
_IN_UNIT = ("value", "values", "low", "high", "mean", "sd", "scale", "turn")
_ALIASES = {key.rpartition("_")[0]: key for key in (*_RANGES, "mass_mjup") if key != "eccentricity"}  # without units
_PHASE = "the phase follows from the orbit: give mean_anomaly_deg and inclination_deg"
_HINTS = {"phase": _PHASE, "phase_deg": _PHASE, "period": "give semi_major_axis_au"}


def _law(value: Any, info: ValidationInfo) -> Law | None:
    """Return the law of one quantity, checked against what the quantity can be."""
    if value is None:
        return None
    quantity = str(info.field_name)
    unit, (low, high) = config.unit_of(quantity), _RANGES[quantity]
    try:
        law = read_law(value)
    except InputError as error:
        own = unit if error.key in _IN_UNIT and error.value != "missing" else ""
        raise InputError(error.key, error.value, unit=own, allowed=error.allowed, hint=error.hint) from None
    if law.law == "isotropic" and quantity != "inclination_deg":
        raise InputError("law", law.law, allowed="for inclination_deg alone")
    for key, end in zip(("low", "high"), law.support, strict=True):
        if not low <= end <= high:
            named = next((name for name in (key, "value", "values") if hasattr(law, name)), None)
            if named is None:
                raise InputError("law", law.law, allowed=f"a law between {low:g} and {high:g} {unit}")
            raise InputError(named, end, unit=unit, allowed=f"{low:g} to {high:g}")
    return law


_READ_ALBEDO = BeforeValidator(lambda value: None if value is None else config.albedo_spec(value))
LawValue: TypeAlias = Annotated[Law | None, BeforeValidator(_law)]
MassRelation: TypeAlias = Literal["chen_kipping_2017"]
_OF_RADIUS: MassRelation = "chen_kipping_2017"


class _Quantities(config.FrozenModel):
    """A law for each quantity, and what the planets reflect."""

    radius_rjup: LawValue = None
    semi_major_axis_au: LawValue = None
    eccentricity: LawValue = None
    inclination_deg: LawValue = None
    argument_of_pericentre_deg: LawValue = None
    node_deg: LawValue = None
    mean_anomaly_deg: LawValue = None
    mass_mjup: Annotated[config.Real, Field(gt=0, le=100)] | MassRelation | None = None
    albedo: Annotated[config.AlbedoSpec | None, _READ_ALBEDO] = None

    @model_validator(mode="before")
    @classmethod
    def _spelled(cls, tree: Any) -> Any:
        return (
            config.canonical_keys(tree, cls.model_fields, _ALIASES, hints=_HINTS) if isinstance(tree, Mapping) else tree
        )


QUANTITIES = tuple(_RANGES)
"""What is drawn for each planet, each from a stream of random numbers of its own."""
_LAWS = tuple(_Quantities.model_fields)


class PlanetKind(_Quantities):
    """One kind of a mixed population; what it does not state is that of the population.

    Attributes
    ----------
    name : str
    weight : float
        Share of the population, relative to the other kinds' weights.
    """

    name: str = ""
    weight: Annotated[config.Real, Field(gt=0, le=1e6)] = 1.0


class PopulationConfig(_Quantities, config.Sourced):
    """A population: all that is assumed of planets.

    Attributes
    ----------
    name, description : str
    radius_rjup, semi_major_axis_au, eccentricity, inclination_deg, argument_of_pericentre_deg, node_deg, \
mean_anomaly_deg : Law
        Laws (`read_law`); a number stands for one value. The elements of the orbit are defined in
        `catalogs.orbits.orbit_places`.
    mass_mjup : float or {"chen_kipping_2017"}, optional
        Mass of the planets, which velocities of the star show: one number, or the least that their radius has by that
        relation (`cpic_planner.planets.masses.least_mass`), as where none is stated beside a radius.
    albedo : AlbedoSpec
        What `simulator.config.scene.albedo_spec` reads; all planets of a kind share it, except that an albedo without
        ``insolation_au`` follows each planet's own light.
    semi_major_axis_scale : {"none", "insolation"}
        ``insolation``: orbits are those around a star of one solar luminosity, and grow with ``sqrt(L)``.
    planets_per_star : float, optional
        Occurrence rate of this population, for expected numbers of detections.
    kinds : tuple of PlanetKind
        A mixture, for quantities that go together; none: all planets follow the laws above.
    """

    name: str = ""
    description: str = ""
    semi_major_axis_scale: Literal["none", "insolation"] = "none"
    planets_per_star: Annotated[config.Real, Field(gt=0, le=1000)] | None = None
    kinds: tuple[PlanetKind, ...] = ()

    @model_validator(mode="after")
    def _complete(self) -> "PopulationConfig":
        for key in _LAWS:
            own = [getattr(kind, key) is not None for kind in self.kinds]
            if getattr(self, key) is None and not (own and all(own)) and key != "mass_mjup":
                where = f"kinds.{own.index(False)}.{key}" if any(own) else key
                raise InputError(where, "missing", allowed="a value is required")
            if getattr(self, key) is not None and own and all(own):
                raise InputError(key, "given", allowed="nothing here: every kind has its own")
        return self

    @property
    def mixture(self) -> tuple[PlanetKind, ...]:
        """The kinds, each complete; one for a population without kinds."""
        return _mixture(self)

    def quantiles(self, kind: IntArray, shares: Sequence[FloatArray]) -> dict[str, FloatArray]:
        """Return what each planet is, from its kind and uniform numbers.

        Parameters
        ----------
        kind : ndarray of int
            Number of each planet's kind in `mixture`, shape ``(n,)``.
        shares : sequence of ndarray
            Uniform numbers in [0, 1), one array of shape ``(n,)`` for each of `QUANTITIES`.

        Returns
        -------
        dict of ndarray
            By quantity, and ``mass_mjup``; shape ``(n,)``.
        """
        drawn = {"mass_mjup": np.empty(len(kind))}
        for quantity, share in zip(QUANTITIES, shares, strict=True):
            values = drawn[quantity] = np.empty(len(kind))
            for number, item in enumerate(self.mixture):
                mine = kind == number
                values[mine] = getattr(item, quantity).quantile(share[mine])
        for number, item in enumerate(self.mixture):
            mine = kind == number
            of_radius = least_mass(drawn["radius_rjup"][mine])
            drawn["mass_mjup"][mine] = item.mass_mjup if isinstance(item.mass_mjup, int | float) else of_radius
        return drawn

    def content(self) -> dict[str, Any]:
        """Return everything that decides a draw, for content hashes: a file counts by what is in it."""
        albedos = [ReferencePlanet(albedo=kind.albedo).content()["albedo"] for kind in self.mixture]
        laws = [kind.model_dump(mode="json", exclude={"name"}) for kind in self.mixture]
        kinds = [law | {"albedo": albedo} for law, albedo in zip(laws, albedos, strict=True)]
        return {
            "semi_major_axis_scale": self.semi_major_axis_scale,
            "planets_per_star": self.planets_per_star,
            "kinds": kinds,
        }


@functools.lru_cache(maxsize=256)
def _mixture(population: PopulationConfig) -> tuple[PlanetKind, ...]:
    """Return the kinds of a population, each complete; kept, as every draw asks and reading laws takes a while."""
    shared = {key: getattr(population, key) for key in _LAWS}
    if not population.kinds:
        return (PlanetKind(name=population.name, **shared),)
    lacking = [{key: shared[key] for key in _LAWS if getattr(kind, key) is None} for kind in population.kinds]
    for kind, update in zip(population.kinds, lacking, strict=True):
        if kind.radius_rjup is not None and kind.mass_mjup is None:
            update["mass_mjup"] = _OF_RADIUS  # the mass of all was that of their radius
    return tuple(kind.model_copy(update=update) for kind, update in zip(population.kinds, lacking, strict=True))


PopulationSource = PopulationConfig | Mapping[str, Any] | str | Path | None


def load_population(source: PopulationSource = None) -> PopulationConfig:
    """Load a population.

    Parameters
    ----------
    source : PopulationConfig, mapping, str, Path or None
        Preset name, YAML path or mapping; ``None`` is the preset ``giants``. A file or mapping needs to hold only what
        differs from its ``base`` (a preset name, ``giants`` if absent). A law that names its ``law`` replaces that of
        the base, other keys are laid over it; an occurrence rate is never inherited: it belongs to its population.

    Returns
    -------
    PopulationConfig

    Raises
    ------
    InputError
        Naming key, value, unit and allowed range of the first fault.

    Examples
    --------
    >>> from cpic_planner.planets.population import load_population
    >>> load_population({"semi_major_axis_au": {"law": "log_uniform", "low": 1, "high": 20}}).semi_major_axis_au.high
    20.0
    """
    if isinstance(source, PopulationConfig):
        return source
    with faults_by_line(source):
        return PopulationConfig.read(_tree(source), "population")


def _tree(source: Any) -> dict[str, Any]:
    keys = (*PopulationConfig.model_fields, *_ALIASES, *_HINTS)
    own, folder, base = config.tree_over_preset(
        "population", source, default=DEFAULT_POPULATION, keys=keys, package=PACKAGE
    )
    if folder is not None:
        own = paths_beside(own, folder)
    if base is None:
        return own
    try:
        own = config.canonical_keys(own, PopulationConfig.model_fields, _ALIASES, hints=_HINTS)
    except InputError as error:
        raise config.at("population", error) from None
    return _laid_over(_tree(base), own)


def _laid_over(base: dict[str, Any], own: dict[str, Any]) -> dict[str, Any]:
    """Return what differs, laid over a preset."""
    merged = {key: item for key, item in base.items() if key not in ("planets_per_star", "description")}
    merged["name"] = f"{base['name']}+changes"
    kinds = own.get("kinds")
    if isinstance(kinds, list | tuple) and kinds and all(isinstance(kind, Mapping) for kind in kinds):
        # The preset's law of something that every kind states is nobody's.
        for key in _LAWS:
            if all(key in kind for kind in kinds):
                merged.pop(key, None)
    if "mass_mjup" in merged and "radius_rjup" in own:
        merged["mass_mjup"] = _OF_RADIUS  # the base's mass was that of its radius
    for key, value in own.items():
        law = merged.get(key)
        over = key in QUANTITIES and isinstance(value, Mapping) and "law" not in value
        merged[key] = {**law, **value} if over and isinstance(law, Mapping) and "law" in law else value
    return merged


class OrbitingPlanets(Record, eq=False, kw_only=True):
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


class Planets(OrbitingPlanets, eq=False, kw_only=True):
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


class PopulationChoice(Record):
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
