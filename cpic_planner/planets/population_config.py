"""A population of planets as configuration, with its presets and its loader."""

import functools
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal, TypeAlias

import numpy as np
from pydantic import BeforeValidator, Field, ValidationInfo, model_validator

from catalogs import ECCENTRICITY_MAX
from cpic_core import FloatArray, InputError, IntArray, faults_by_line
from cpic_planner.planets.laws import Law, read_law
from cpic_planner.planets.mass_radius import least_mass
from cpic_planner.queries import ReferencePlanet
from simulator import config
from simulator.config.scene import paths_beside

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
        Laws of `cpic_planner.planets.laws`; a number stands for one value. The elements of the orbit are defined in
        `catalogs.orbits.orbit_places`.
    mass_mjup : float or {"chen_kipping_2017"}, optional
        Mass of the planets, which velocities of the star show: one number, or the least that their radius has by that
        relation (`cpic_planner.planets.mass_radius.least_mass`), as where none is stated beside a radius.
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
